"""`flywheel recordings`: reports for people and scripts, and exit codes."""

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from typer.testing import CliRunner

from flywheel.cli.main import app
from flywheel.cli.recordings import import_logs
from flywheel.data import TrajectoryStore
from flywheel.data.recordings import store_recording
from flywheel.robots import load_robot
from flywheel.runtime.config.run_config import RunConfig
from flywheel.runtime.run.folder import RunFolder
from flywheel.truth_simulator.measurement import Measurement
from flywheel.truth_simulator.recording import record
from tests import draws

SEED = draws.seed()  # fresh; shown when a test fails


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two logs of prism3; in the second, markers are exchanged."""
    folder, robot = tmp_path_factory.mktemp("logs"), load_robot("prism3")
    settings = [Measurement(), Measurement(swap=True)]
    return [
        record(robot, seconds=1.0, seed=SEED + i, measurement=one).write(folder, f"log{i}", robot)[
            0
        ]
        for i, one in enumerate(settings)
    ]


def ask(*arguments: object, code: int = 0) -> str:
    done = CliRunner().invoke(app, ["recordings", *map(str, arguments)])
    assert done.exit_code == code, f"{done.output}\n{done.exception!r}\n(seed {SEED})"
    return done.output


@pytest.mark.slow
def test_logs_come_into_a_new_store_with_a_report(logs: list[Path], tmp_path: Path) -> None:
    place = tmp_path / "store"
    known = ("--robot", "prism3", "--store", place)
    looked = ask("import", *logs, *known, "--dry-run")
    assert "dry run" in looked and not place.exists()
    printed = ask("import", *logs, *known, "--split", "test")
    assert "Nothing was masked" in printed and "repair: []" in printed and "repaired" in printed
    store = TrajectoryStore(place)
    first, second = sorted(store.committed())
    assert f"collect.recordings=[{first},{second}]" in printed
    assert all(s.split == "test" for s in (*store.episodes(first), *store.episodes(second)))
    assert "stored already" in ask("import", logs[0], *known)
    assert "keeps its split" in ask("import", logs[0], *known, "--split", "train", code=2)
    shown = ask("show", place)
    assert first in shown and f"collect.recordings=[{first},{second}]" in shown
    as_json = json.loads(ask("show", place, "--json"))
    assert [row["episode"] for row in as_json] == [first, second]
    out = tmp_path / "out.csv"
    assert "101 rows" in ask("export", place, first, out, "--robot", "prism3")
    assert out.read_bytes() == logs[0].read_bytes()
    several = ask("export", place, "recording-*", tmp_path / "a.csv", "--robot", "prism3", code=2)
    assert f"takes one episode; 'recording-*' is {first}, {second}" in " ".join(several.split())
    nearly = ask("export", place, first[:-1], tmp_path / "a.csv", "--robot", "prism3", code=2)
    assert f"Did you mean '{first}'" in nearly
    ask("export", place, f"{first[:-1]}?", tmp_path / "a.csv", "--robot", "prism3")
    assert "not overwritten" in ask("export", place, first, out, "--robot", "prism3", code=2)
    wrong = ask("export", place, first, tmp_path / "out.txt", "--robot", "prism3", code=2)
    assert "must be .csv or .mcap, or none for a LeRobot data set; got '.txt'" in wrong
    assert not (tmp_path / "out.txt").exists()


def test_a_report_for_scripts_is_json(logs: list[Path], tmp_path: Path) -> None:
    known = ("--robot", "prism3", "--store", tmp_path / "store", "--json")
    clean, swapped = json.loads(ask("import", *logs, *known))
    assert (clean["state"], clean["findings"], clean["rows"]) == ("stored", [], 101)
    assert swapped["findings"][0]["kind"] == "swap"
    again = json.loads(ask("import", logs[0], *known))
    assert again[0]["segment"] == clean["segment"]


def test_if_one_log_is_broken_none_is_stored(logs: list[Path], tmp_path: Path) -> None:
    (tmp_path / "empty.csv").write_text("")
    place = tmp_path / "store"
    said = ask(
        "import", logs[0], tmp_path / "empty.csv", "--robot", "prism3", "--store", place, code=2
    )
    assert "empty.csv is empty" in said and "Nothing was stored of the 2 logs" in said
    assert not place.exists()


def test_one_log_named_twice_is_refused(logs: list[Path], tmp_path: Path) -> None:
    copy = tmp_path / "copy.csv"
    copy.write_bytes(logs[0].read_bytes())
    said = ask("import", logs[0], copy, "--robot", "prism3", "--store", tmp_path / "s", code=2)
    assert "are the same log" in said


def test_a_map_for_all_logs_and_the_run_s_own_robot(logs: list[Path], tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    RunFolder(run).begin(RunConfig(model="prism3"), resume=False)
    (tmp_path / "map.yaml").write_text("repair: []\nconditions: new cables\n")
    printed = ask("import", logs[1], "--store", run, "--map", tmp_path / "map.yaml")
    assert "as requested by the map" in " ".join(printed.split())
    assert "new cables" in ask("show", run)
    assert len(TrajectoryStore(run / "store").committed()) == 1


def test_a_store_does_not_say_whose_episodes_it_holds(logs: list[Path], tmp_path: Path) -> None:
    said = ask("import", logs[0], "--store", tmp_path / "store", code=2)
    assert "with --robot" in said


def test_a_store_without_a_recording_says_so(tmp_path: Path) -> None:
    assert "no recording" in ask("show", tmp_path)


@pytest.mark.parametrize("name", ["[red]x.csv", "[bold]y [blue.csv", "\\[red]z.csv"])
def test_a_name_is_printed_as_it_is(name: str, logs: list[Path], tmp_path: Path) -> None:
    log, place = tmp_path / name, tmp_path / "[red]store"
    log.write_bytes(logs[1].read_bytes())
    known = ("--robot", "prism3", "--store", place)
    said = ask("import", log, *known)
    assert said.startswith(f"{name}: 101 rows") and f"Changes to {name}" in said
    assert f"Recordings in {place}" in ask("show", place)
    (segment,) = TrajectoryStore(place).committed()
    out = tmp_path / "[red]out.csv"
    assert f"{out}: 101 rows" in ask("export", place, segment, out, "--robot", "prism3")
    empty = tmp_path / "[red]empty"
    empty.mkdir()
    assert f"There is no recording in {empty}." in ask("show", empty)


def test_a_name_that_cannot_be_printed_is_escaped(logs: list[Path], tmp_path: Path) -> None:
    log = tmp_path / "a\x1b[31m\udcff.csv"
    log.write_bytes(logs[0].read_bytes())
    said = ask("import", log, "--robot", "prism3", "--store", tmp_path / "store", "--dry-run")
    assert said.startswith(r"a\x1b[31m\udcff.csv: 101 rows")


def test_logs_that_do_not_fit_in_memory_together_are_read_again_to_be_stored(
    logs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = ("--robot", "prism3", "--json", "--store")
    together = json.loads(ask("import", *logs, *known, tmp_path / "one"))
    monkeypatch.setattr(import_logs, "ROOM", 0)
    again = json.loads(ask("import", *logs, *known, tmp_path / "two"))
    assert again == together
    stores = [TrajectoryStore(tmp_path / name).committed() for name in ("one", "two")]
    assert stores[0] == stores[1] and len(stores[0]) == 2


def test_a_log_that_changed_before_it_was_stored_is_refused(logs, tmp_path, monkeypatch):
    log = tmp_path / "log.csv"
    log.write_bytes(logs[0].read_bytes())

    def store_and_change(*arguments: object) -> tuple[str, bool]:
        with log.open("a") as file:
            file.write("\n")
        return store_recording(*arguments)

    monkeypatch.setattr(import_logs, "ROOM", 0)
    monkeypatch.setattr("flywheel.data.recordings.store_recording", store_and_change)
    known = ("--robot", "prism3", "--store", tmp_path / "store")
    assert "log.csv changed since it was read" in ask("import", logs[1], log, *known, code=2)
    assert len(TrajectoryStore(tmp_path / "store").committed()) == 1


class Shown:
    """Remembers what a bar would show."""

    def __init__(self) -> None:
        self.seen: list[tuple[float, str]] = []

    def update(self, done: float, note: str = "") -> None:
        self.seen.append((done, note))

    @contextmanager
    def stage(self, title: str, total: float) -> "Iterator[Shown]":
        self.seen.append((total, title))
        yield self


def test_a_bar_shows_how_much_of_a_log_is_read(logs, tmp_path, monkeypatch):
    shown = Shown()
    monkeypatch.setattr(import_logs, "_progress", lambda: shown)
    ask("import", logs[0], "--robot", "prism3", "--store", tmp_path / "store")
    assert shown.seen[0] == (1.0, "log0.csv")
    assert shown.seen[-1] == (1.0, "now checked")


def test_nothing_but_the_result_is_written_where_there_is_no_terminal(logs, tmp_path):
    asked = ("import", str(logs[0]), "--robot", "prism3", "--store", str(tmp_path / "s"), "--json")
    done = CliRunner().invoke(app, ["recordings", *asked])
    assert done.stderr == "" and json.loads(done.stdout)


@pytest.mark.parametrize("dt", ["1e-9", "nan", "inf", "0"])
@pytest.mark.parametrize(
    "command",
    [
        "recordings import log.csv --store s --robot prism3",
        "compare log.csv --robot prism3",
        "diagnose log.csv --robot prism3",
        "power log.csv --robot prism3",
        "design payload capstan --robot prism3",
    ],
)
def test_every_command_refuses_what_is_no_control_step(command: str, dt: str) -> None:
    done = CliRunner().invoke(app, [*command.split(), "--dt", dt])
    assert done.exit_code == 2
    assert "must be a number from 0.0001 to 10 s; got" in " ".join(done.output.split())


def test_draws_that_could_not_tell_noise_from_more_are_refused_before_a_log_is_read() -> None:
    done = CliRunner().invoke(app, ["compare", "log.csv", "--robot", "prism3", "--draws", "39"])
    assert done.exit_code == 2
    assert "must be a number from 40 to 10,000; got 39" in " ".join(done.output.split())


@pytest.mark.slow
def test_a_recording_is_stored_without_the_engine_of_the_network(logs, tmp_path):
    code = (
        "import sys\n"
        "from flywheel.cli.main import app\n"
        "app(sys.argv[1:], standalone_mode=False)\n"
        "print({'torch', 'ray', 'mlflow', 'scipy.signal', 'scipy.stats'} & sys.modules.keys())"
    )
    asked = ["recordings", "import", logs[0], "--robot", "prism3", "--store", tmp_path / "store"]
    done = subprocess.run(
        [sys.executable, "-c", code, *asked], capture_output=True, text=True, check=True
    )
    assert done.stdout.endswith("set()\n")
