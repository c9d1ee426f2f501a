"""`flywheel demo`: the whole story, short, and what is refused."""

import dataclasses
import functools
import re
import shlex

import numpy as np
import pytest
from typer.testing import CliRunner

from flywheel.cli.main import app
from flywheel.demo import demonstration
from flywheel.demo.assessment import Naming
from flywheel.demo.demonstration import (
    DemoConfig,
    Demonstration,
    adopted_effects,
    demonstrate,
    drawn_effect,
    hidden_truth,
)
from flywheel.demo.page import steps, truth, worst_window, write_demo
from flywheel.diagnosis import Verdict, diagnose
from flywheel.effects import EFFECTS
from flywheel.reports import diagnosis_video
from flywheel.reports.diagnosis_video import FARTHEST, MAGNIFIED, SHOT
from flywheel.robots import load_robot
from flywheel.truth_simulator import HIDDEN
from tests.unit.diagnosis.conftest import QUICK

FEW = {name: EFFECTS[name] for name in ("winch_gain", "cable_friction")}
SHORT = DemoConfig(seconds=0.8, held_out=1, horizon=0.3, draws=40, threads=1)
COMMAND = "demo --robot platform4 --effect winch_gain:2 --seed 3 --no-show --page new/story.html"


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> tuple[Demonstration, str, str]:
    """A short story, told by the command: the record, what is printed, and the page."""
    stories: list[Demonstration] = []

    @functools.wraps(demonstrate)
    def short(robot, effect, seed, config, progress):
        stories.append(demonstrate(robot, effect, seed, SHORT, progress, FEW))
        return stories[-1]

    folder = tmp_path_factory.mktemp("demo")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(demonstration, "demonstrate", short)
        patch.setattr(demonstration, "diagnose", functools.partial(diagnose, settings=QUICK))
        done = CliRunner().invoke(app, shlex.split(COMMAND))
    assert done.exit_code == 0, done.output
    return stories[0], done.stdout, (folder / "new" / "story.html").read_text()


@pytest.mark.slow
def test_the_record_has_every_step(told: tuple[Demonstration, str, str]) -> None:
    story, _, _ = told
    assert [each.split for each in story.recordings] == ["train", "train", "test"]
    assert all(each.trajectory.states is None for each in story.recordings)
    assert story.hidden == hidden_truth("winch_gain:2", load_robot("platform4"))
    assert story.diagnosis.verdict is Verdict.EFFECT
    assert [each.effect for each in story.adopted] == ["winch_gain"]
    assert story.assessment.outcome is Naming.NAMED
    assert story.after is not None
    before, after = story.beside.models
    assert after.rms < before.rms
    np.testing.assert_array_equal(story.before.windows.measured, story.after.windows.measured)
    (row,) = truth(story)
    assert row.found is not None and row.found.value == pytest.approx(row.value, rel=0.1)


@pytest.mark.slow
def test_the_command_tells_it_and_reveals_at_the_end(told: tuple[Demonstration, str, str]) -> None:
    story, printed, _ = told
    before, after = printed.split("Page: ")[0].rsplit(story.diagnosis.verdict, 1)
    assert "winch_gain" not in before.split("To repeat this: ")[1].split("\n", 1)[1]
    assert story.why in printed and story.assessment.sentence in after
    assert "flywheel demo --seed 3 --robot platform4 --effect winch_gain:2" in printed
    assert "new/story.html" in printed


@pytest.mark.slow
def test_the_page_tells_the_same_and_needs_no_other_file(told):
    story, _, page = told
    assert re.findall(r'(?:src|href)="(?!data:)([^"]*)"', page) == []
    assert page.count('src="data:image/svg+xml') == 5
    assert page.count('src="data:video/mp4') == 1 or "No video: " in page
    for step in steps(story):
        assert step.words in page
    assert "6. What was hidden" in page and "4. Adopted" in page


@pytest.mark.slow
def test_a_story_without_an_end_or_a_video_is_told_as_well(told, tmp_path):
    story = told[0]
    unclear = dataclasses.replace(story.diagnosis, verdict=Verdict.AMBIGUOUS)
    adopted, why = adopted_effects(unclear)
    assert adopted == () and "AMBIGUOUS" in why
    other = dataclasses.replace(
        story, diagnosis=unclear, adopted=(), why=why, after=None, hidden=None
    )
    page = write_demo(other, tmp_path / "p.html", "flywheel demo", "no <graphics>").read_text()
    assert "No video: no &lt;graphics&gt;" in page
    assert "4. Not adopted" in page and "no other model to compare" in page
    assert "true value" not in page


@pytest.mark.slow
def test_an_answer_that_does_not_carry_over_is_not_adopted(told):
    found = told[0].diagnosis
    assert found.held_out is not None
    worse = dataclasses.replace(found.held_out, augmented=2 * found.held_out.baseline)
    adopted, why = adopted_effects(dataclasses.replace(found, held_out=worse))
    assert adopted == () and "held-out" in why


@pytest.mark.slow
@pytest.mark.renders
def test_the_film_shows_both_models_beside_each_other(told, tmp_path, monkeypatch):
    shapes: list[tuple[int, ...]] = []

    def noted(frames, path, size, fps):
        shapes.extend(frame.shape for frame in frames)
        return path

    monkeypatch.setattr(diagnosis_video, "write_video", noted)
    worst_window(told[0]).film(tmp_path / "film.mp4")
    width, height = SHOT.size
    assert len(shapes) > 5 and set(shapes) == {(height, 2 * width, 3)}


@pytest.mark.slow
def test_the_window_that_is_filmed_is_the_worst_and_differences_have_room(told):
    shown, evidence = worst_window(told[0]), told[0].diagnosis.evidence
    before, after = shown.predicted
    off = [np.linalg.norm(shown.measured - points, axis=-1).max() for points in shown.predicted]
    assert off[1] < off[0]
    assert any(np.array_equal(before, window) for window in evidence.before)
    assert before.shape == after.shape == shown.measured.shape
    squares = ((shown.measured - before) ** 2).mean()
    assert squares > 0.5 * ((evidence.measured - evidence.before) ** 2).mean(axis=(1, 2, 3)).max()
    room = FARTHEST * shown.robot.length
    assert shown.times in MAGNIFIED
    assert shown.times * off[0] <= room or shown.times == 1
    assert shown.times == MAGNIFIED[-1] or 2.5 * shown.times * off[0] > room


@pytest.mark.parametrize(
    ("effect", "words"),
    [
        ("torque_sped", "Did you mean 'torque_speed'?"),
        ("payload@s22", "Did you mean 's2'?"),
        ("slope@s2", "has no place"),
        ("payload:much", "a multiple of the typical size"),
    ],
)
def test_what_cannot_be_hidden_is_refused_at_once(effect, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["demo", "--effect", effect])
    assert done.exit_code == 2, done.output
    assert words in done.stderr and done.stderr.count("\n") == 1
    assert done.stdout == "" and list(tmp_path.iterdir()) == []


def test_an_effect_that_makes_no_difference_to_the_robot_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["demo", "--robot", "platform4", "--effect", "ground_friction"])
    assert done.exit_code == 2 and "has no influence on platform4" in done.stderr


@pytest.mark.parametrize("name", ["prism3", "platform4"])
def test_every_seed_draws_an_effect_that_the_robot_can_have(name: str) -> None:
    robot = load_robot(name)
    texts = [drawn_effect(robot, seed) for seed in range(200)]
    truths = [hidden_truth(text, robot) for text in texts]
    assert {each.name for each in truths if each} == {
        kind.name for kind in HIDDEN.values() if kind.applies(robot)
    }
    assert texts == [drawn_effect(robot, seed) for seed in range(200)]
    placed = {each.place for each in truths if each and each.name == "payload"}
    assert len(placed) > 1


def test_the_page_is_opened_where_that_is_asked_for(monkeypatch, tmp_path):
    from flywheel.cli import demo

    opened: list[str] = []

    def browser(address: str) -> bool:
        opened.append(address)
        return len(opened) == 1

    monkeypatch.setattr(demo.webbrowser, "open", browser)
    out = demo.console()
    demo.open_page(out, tmp_path / "a page.html")
    assert opened == [(tmp_path / "a page.html").as_uri()]
    with out.capture() as said:
        demo.open_page(out, tmp_path / "a page.html")
    assert "No browser" in said.get()
