"""The page stands alone, shows every model beside what it is judged by, and hides nothing."""

import base64
import re
from html.parser import HTMLParser

import matplotlib.pyplot as plt
import pytest

from flywheel.errors import DataError
from flywheel.reports import page
from flywheel.reports.figures import FIGURES
from flywheel.reports.page import result_rows, write_page
from flywheel.reports.pictures import as_file
from flywheel.results import ErrorNumbers, Errors, RunResult
from tests.unit.reports.fake_run import fake_errors, fake_run

pytestmark = pytest.mark.slow

NAN = float("nan")
VIDEO = b"\x00\x00\x00\x18ftypmp42 not much of a video"
VOID = {"meta", "img", "br", "link", "input"}


class Reader(HTMLParser):
    """Collects what a page refers to, and whether its elements are closed in order."""

    def __init__(self):
        super().__init__()
        self.open, self.links, self.text = [], [], []

    def handle_starttag(self, tag, attrs):
        if tag not in VOID:
            self.open.append(tag)
        self.links += [value for name, value in attrs if name in {"src", "href", "action"}]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def read(path):
    reader = Reader()
    reader.feed(path.read_text())
    assert reader.open == []
    return reader, " ".join("".join(reader.text).split())


@pytest.fixture
def one_figure(monkeypatch):
    """Pages with one figure, for the tests that are about something else."""
    monkeypatch.setattr(page, "FIGURES", {"planning": page.FIGURES["planning"]})


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    (folder / "videos").mkdir()
    (folder / "videos" / "episode.mp4").write_bytes(VIDEO)
    run = fake_run(2, video="videos/episode.mp4")
    run.save(folder)
    return run, folder, *read(write_page(folder))


def test_the_page_needs_neither_network_nor_neighbours(shown):
    _, folder, reader, text = shown
    assert reader.links
    assert "On the robot" not in text  # which this run does not have
    for link in reader.links:
        kind, content = re.fullmatch(r"data:(image/svg\+xml|video/mp4);base64,(.+)", link).groups()
        data = base64.b64decode(content, validate=True)
        if kind == "image/svg+xml":
            assert not re.search(rb"(href|src)=\"(?!#)", data)
    css = (folder / "report.html").read_text().split("</style>")[0]
    assert "url(" not in css and "@import" not in css


def test_the_page_embeds_the_video_and_names_every_digest(shown):
    run, _, reader, text = shown
    videos = [link for link in reader.links if link.startswith("data:video")]
    assert [base64.b64decode(v.split(",")[1]) for v in videos] == [VIDEO, VIDEO]
    for turn in run.iterations:
        assert turn.snapshot in text and turn.model in text
    for digest in (run.config_digest, run.robot_digest, run.key, run.code):
        assert digest in text
    assert "learning_rate: 0.001" in text
    assert "Simulation only." in text


def test_the_table_shows_both_arms_beside_floor_and_oracle(shown):
    run = shown[0]
    rows = {row.name: row for row in result_rows(run)}
    assert list(rows) == [
        "iteration 0",
        "iteration 1",
        "iteration 1, control arm",
        "floor: plant restarted from the same observations",
        "informed floor: its roll computed from the cables",
        "nothing moves",
        "oracle: MPPI on the plant",
        "maze, never seen",
        "maze: MPPI on the plant",
    ]
    errors = run.pooled[1].errors.short
    assert rows["iteration 1"].short_rotation == f"{errors.e_rot:.2f}"
    success = run.oracle.success
    assert rows["oracle: MPPI on the plant"].success.startswith(
        f"{success.reached}/{success.total}"
    )
    assert rows["oracle: MPPI on the plant"].short_rotation == ""


def test_errors_on_recordings_have_lines_of_their_own():
    run = fake_run(1)
    turn = run.iterations[0].model_copy(update={"recordings": fake_errors(2.0, full=False)})
    changes = {"iterations": (turn,), "persistence_on_recordings": fake_errors(5.0)}
    rows = {row.name: row for row in result_rows(run.model_copy(update=changes))}
    own = rows["iteration 0, on recordings"]
    assert own.short_rotation == f"{turn.recordings.short.e_rot:.2f}"
    assert own.full_rotation == ""
    assert rows["nothing moves, on recordings"].full_position


def test_a_model_that_diverged_is_said_to_have():
    run = fake_run(2)
    nothing = Errors(short=ErrorNumbers(e_pos_mse=NAN, e_pos_rmse=NAN, e_rot=NAN))
    first, *others = run.iterations
    first = first.model_copy(update={"test": nothing})
    run = run.model_copy(update={"iterations": (first, *others), "pooled": ()})
    row = result_rows(run)[0]
    assert row.short_position == row.short_rotation == "diverged"
    drawn = FIGURES["errors"].draw(run)
    said = [text.get_text() for axes in drawn.axes for text in axes.texts]
    assert (
        said == ["\N{MULTIPLICATION SIGN} diverged"] * 2
    )  # in the two panels of the short horizon


def test_an_unfinished_run_has_a_page_that_says_so_and_what_is_missing(tmp_path, one_figure):
    fake_run(1, finished=False).save(tmp_path)
    _, text = read(write_page(tmp_path))
    assert "not finished" in text
    for missing in ("No floor", "No oracle", "No control arm", "has not ended"):
        assert missing in text
    RunResult(name="just begun", key="k").save(tmp_path)
    _, text = read(write_page(tmp_path))
    assert "No iteration has ended yet" in text


def test_names_from_a_configuration_cannot_break_the_page(tmp_path, one_figure):
    run = fake_run(1).model_copy(
        update={"name": "<script>alert(1)</script>", "notes": ("a & <b>",)}
    )
    run.save(tmp_path)
    path = write_page(tmp_path)
    assert "<script" not in path.read_text()
    assert "a & <b>" in read(path)[1]


def test_a_video_that_is_gone_or_too_large_is_not_embedded(tmp_path, one_figure, monkeypatch):
    fake_run(1, video="gone.mp4").save(tmp_path)
    assert "video/mp4" not in write_page(tmp_path).read_text()
    (tmp_path / "gone.mp4").write_bytes(VIDEO)
    monkeypatch.setattr(page, "LARGEST_VIDEO", 10)
    text = write_page(tmp_path).read_text()
    assert "video/mp4" not in text and "Too large" in text


def test_a_video_that_lies_outside_the_run_is_not_embedded(tmp_path, one_figure):
    secret, folder = tmp_path / "secret", tmp_path / "run"
    secret.write_text("of another")
    folder.mkdir()
    fake_run(1, video="film.mp4").save(folder)
    (folder / "film.mp4").symlink_to(secret)
    text = write_page(folder).read_text()
    assert "video/mp4" not in text and "lies outside the run" in text
    saved = (folder / "result.json").read_text()
    (folder / "result.json").write_text(saved.replace("film.mp4", "../secret"))
    with pytest.raises(DataError, match="altered"):
        write_page(folder)


def test_a_folder_without_a_run_is_refused(tmp_path):
    with pytest.raises(DataError, match=r"result\.json"):
        write_page(tmp_path)


@pytest.mark.parametrize(
    "name", ["<script>alert(1)</script>", "a & b", '"><img src=x>', "$\\frac$"]
)
def test_a_name_is_text_on_the_page_whatever_it_holds(tmp_path, one_figure, name):
    run = fake_run(1).model_copy(update={"name": name, "robot": name, "notes": (name,)})
    path = write_page(tmp_path, run)
    reader, text = read(path)
    assert text.count(name) >= 3
    assert not [link for link in reader.links if not link.startswith("data:")]


def test_a_name_in_a_figure_is_text_whatever_it_holds():
    def draw(name):
        figure, axes = plt.subplots()
        axes.set_title(name)
        axes.plot([0, 1], [0, 1], label=name)
        axes.legend()
        plt.close(figure)
        return figure

    names = ("cost $", "$x$", "$\\frac$", "a_b^c")
    drawn = {name: as_file(lambda name=name: draw(name), "svg") for name in names}
    assert len(set(drawn.values())) == len(names)
    assert len(drawn["$x$"]) > len(as_file(lambda: draw("x"), "svg"))  # both "$" are drawn
