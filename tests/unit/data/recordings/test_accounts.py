"""Commands, winch positions and cables are three accounts of one motion; that they disagree is noted."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.imports import hanging
from flywheel.cli.console import console
from flywheel.cli.logs.reading import read_logs
from flywheel.data.recordings import Imported, read_recording, write_recording
from flywheel.dynamics.plant import Plant
from flywheel.records import Episode, Floats, Observation, Provenance, Trajectory
from flywheel.robots import Robot, load_robot, read_robot

NOISE = 0.0005  # [m]
Change = Callable[[Floats], Floats]


def measuring(robot: Robot) -> Robot:
    """The robot with a sensor on each winch."""
    sensors = "".join(
        f'<user name="at_{w.name}" objtype="actuator" objname="{w.name}" dim="1"/>'
        for w in robot.winches
    )
    return read_robot(robot.xml.replace("</sensor>", f"{sensors}</sensor>"))


ROBOTS = {
    "beams": lambda: hanging(2),
    "measured": lambda: measuring(hanging(2)),
    "prism3": lambda: load_robot("prism3"),
}


@pytest.fixture(scope="module")
def moved() -> dict[str, tuple[Robot, Trajectory]]:
    """Four seconds of each robot, whose winches take new rates each 0.4 s."""
    return {name: (robot := make(), swung(robot)) for name, make in ROBOTS.items()}


def swung(robot: Robot, alike: Floats | None = None) -> Trajectory:
    rng = np.random.default_rng(5)
    rates = rng.uniform(-0.75, 0.75, (1, 10, len(robot.winches))) * robot.control_high
    rates = rates if alike is None else rates[..., :1] * alike
    controls, plant = np.repeat(rates, 40, axis=1), Plant(robot)
    flown = plant.simulate(plant.settle(0.5), controls)
    points = flown.observations[0].points
    points = points + NOISE * rng.standard_normal(points.shape)
    winch = robot.dead_reckon(robot.winch_of(robot.keyframe), controls[0], 0.01)
    seen = np.array([w.measured for w in robot.winches])
    winch = np.where(seen, winch + NOISE * rng.standard_normal(winch.shape), np.nan)
    return Trajectory(Observation(points, winch), controls[0], 0.01)


def read(
    folder: Path,
    robot: Robot,
    track: Trajectory,
    controls: Change | None = None,
    winch: Change | None = None,
) -> Imported:
    """The log of a trajectory with other commands, or winch positions, as it is imported."""
    seen = track.observations
    changed = replace(
        track,
        controls=track.controls if controls is None else controls(track.controls),
        observations=seen if winch is None else replace(seen, winch=winch(seen.winch)),
    )
    log = folder / "log.csv"
    write_recording(Episode("e", changed, Provenance(robot.digest), "train"), log, robot)
    return read_recording(log, robot)


def told(found: Imported) -> dict[str, str]:
    """Subject -> words of each note."""
    assert all(f.action == "noted" for f in found.report.findings)
    return {f.subject: f.words for f in found.report.findings}


def turned(*winches: int) -> Change:
    def change(values: Floats) -> Floats:
        values = values.copy()
        values[:, winches] = 2 * values[:1, winches] - values[:, winches]
        return values

    return change


def exchanged(a: int, b: int) -> Change:
    def change(values: Floats) -> Floats:
        values = values.copy()
        values[:, [a, b]] = values[:, [b, a]]
        return values

    return change


def late(rows: int) -> Change:
    """Values that come some rows later, or earlier; the first, or last, ones are held."""

    def change(values: Floats) -> Floats:
        index = np.clip(np.arange(len(values)) - rows, 0, len(values) - 1)
        return values[index]

    return change


def lagging(winch: Floats) -> Floats:
    """Measurements that come 0.8 s late."""
    return late(80)(winch) + 0.1 * NOISE * np.random.default_rng(6).standard_normal(winch.shape)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_right_log_has_no_note(name, moved, tmp_path):
    assert told(read(tmp_path, *moved[name])) == {}


@pytest.mark.parametrize("name", ROBOTS)
def test_a_winch_told_with_the_wrong_sign_is_noted(name, moved, tmp_path):
    robot, track = moved[name]
    notes = told(
        read(tmp_path, robot, track, lambda c: c * np.where(np.arange(c.shape[1]) == 1, -1, 1))
    )
    assert list(notes) == [f"ctrl.{robot.winches[1].name}"]
    assert "changes the other way: has it the wrong sign" in notes[f"ctrl.{robot.winches[1].name}"]


def test_all_signs_wrong_are_noted_for_each_winch_and_are_no_other_clock(moved, tmp_path):
    robot, track = moved["beams"]
    notes = told(read(tmp_path, robot, track, lambda c: -c))
    assert list(notes) == [f"ctrl.{w.name}" for w in robot.winches]
    assert all("changes the other way" in words for words in notes.values())


@pytest.mark.parametrize("name", ["beam", "prism3"])
def test_a_wrong_sign_among_commands_that_are_alike_but_for_their_signs_is_noted(name, tmp_path):
    """Where a cable must pull, or moves as far as its winch was told."""
    robot = hanging(1) if name == "beam" else load_robot(name)
    signs = np.where(np.arange(len(robot.winches)) % 2, -1.0, 1.0)
    track = swung(robot, signs)
    assert told(read(tmp_path, robot, track)) == {}
    (tmp_path / "log.csv").unlink()
    wrong = np.where(np.arange(len(signs)) == 1, -1, 1)
    notes = told(read(tmp_path, robot, track, lambda c: c * wrong))
    assert list(notes) == [f"ctrl.{robot.winches[1].name}"]
    assert "changes the other way" in notes[f"ctrl.{robot.winches[1].name}"]


@pytest.mark.parametrize("name", ROBOTS)
def test_commands_of_two_winches_that_are_exchanged_are_noted_with_who_follows_whom(
    name, moved, tmp_path
):
    robot, track = moved[name]
    notes = told(read(tmp_path, robot, track, exchanged(0, 2)))
    first, third = (f"ctrl.{robot.winches[i].name}" for i in (0, 2))
    assert set(notes) == {first, third}
    assert f"follows it, and not {third}: are the columns exchanged?" in notes[first]
    assert f"follows it, and not {first}: are the columns exchanged?" in notes[third]


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("rows", [-60, -15, 30, 60])
def test_another_clock_of_the_commands_is_noted_with_how_much_it_is_off(
    name, rows, moved, tmp_path
):
    robot, track = moved[name]
    notes = told(read(tmp_path, robot, track, late(rows)))
    assert list(notes) == [""]  # of all winches
    # The commands are later in the log, so that all else is earlier.
    when = re.search(r"moved ([0-9.]+) s (before|later than)", notes[""])
    assert when is not None and when[2] == ("before" if rows > 0 else "later than")
    assert float(when[1]) == pytest.approx(abs(rows) / 100, abs=0.08)


@pytest.mark.parametrize("factor", [0.1, 0.2])
def test_commands_in_a_smaller_unit_that_are_in_range_are_noted(factor, moved, tmp_path):
    robot, track = moved["beams"]
    notes = told(read(tmp_path, robot, track, lambda c: factor * c))
    assert list(notes) == [f"ctrl.{w.name}" for w in robot.winches]
    times = [re.search(r"changes ([0-9.]+) times as much", words) for words in notes.values()]
    assert [float(each[1]) for each in times if each] == pytest.approx([1 / factor] * 4, rel=0.1)


def test_commands_that_were_not_logged_are_noted_where_cables_move(moved, tmp_path):
    robot, track = moved["beams"]
    notes = told(read(tmp_path, robot, track, lambda c: 0 * c))
    assert set(notes) <= {f"ctrl.{w.name}" for w in robot.winches} and len(notes) >= 2
    assert all(words.startswith("never changes, but ") for words in notes.values())


@pytest.mark.parametrize("name", ["beams", "measured"])
def test_commands_that_stuck_at_one_value_are_noted_where_a_cable_or_sensor_moves_otherwise(
    name, moved, tmp_path
):
    robot, track = moved[name]
    notes = told(read(tmp_path, robot, track, lambda c: np.where(np.arange(4) == 2, c[:1], c)))
    assert list(notes) == [f"ctrl.{robot.winches[2].name}"]
    assert (
        "does not follow it: is it what the winch was told"
        in notes[f"ctrl.{robot.winches[2].name}"]
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (turned(1), "changes the other way"),
        (exchanged(0, 1), "are the columns exchanged?"),
        (lagging, "have all columns one clock?"),
    ],
)
def test_what_is_wrong_with_winch_positions_is_told_by_commands_and_cables(
    change, words, moved, tmp_path
):
    robot, track = moved["measured"]
    found = read(tmp_path, robot, track, winch=change).report.findings
    assert all(f.action == "noted" and words in f.words for f in found)
    causes = {f.subject.split("_")[0] for f in found}
    assert causes in (
        {"ctrl.left", "at"},
        {"ctrl.right", "at"},
        {"ctrl.left", "ctrl.right", "at"},
        {""},
    )


def test_one_late_winch_sensor_is_noted_by_its_name(moved, tmp_path):
    robot, track = moved["measured"]

    def change(winch: Floats) -> Floats:
        return np.where(np.arange(winch.shape[1]) == 2, lagging(winch), winch)

    found = read(tmp_path, robot, track, winch=change).report.findings
    assert {f.subject for f in found} == {
        f"ctrl.{robot.winches[2].name}",
        f"at_{robot.winches[2].name}",
    }
    assert all("have all columns one clock?" in f.words for f in found)


def test_commands_tell_a_note_in_one_sentence_without_counts(moved, tmp_path, capsys):
    robot, track = moved["beams"]
    read(tmp_path, robot, track, lambda c: -c)
    read_logs([tmp_path / "log.csv"], robot, 0.01, console())
    first = robot.winches[0].name
    assert (
        f"log.csv: channel ctrl.{first}: left_cableA changes the other way"
        in capsys.readouterr().out
    )
