"""Recordings are tiled by windows that can be predicted."""

import dataclasses

import numpy as np
import pytest

from flywheel.diagnosis.comparison import ForecastWindows
from flywheel.diagnosis.fitting.subject import Subject
from flywheel.dynamics import Persistence
from flywheel.dynamics.plant import Reckoning
from flywheel.effects import EFFECTS, Term
from flywheel.errors import DataError
from flywheel.records import Floats, Observation, Trajectory
from flywheel.robots import Robot


def with_points(t: Trajectory, points: np.ndarray) -> Trajectory:
    return dataclasses.replace(t, observations=Observation(points, t.observations.winch))


def test_windows_follow_one_another_after_a_past(robot, nothing_hidden):
    windows = ForecastWindows.cut(robot, nothing_hidden, 0.5, 20)
    assert (windows.lead, windows.warmup, windows.steps) == (50, 30, 50)
    assert windows.first.tolist() == [50, 100, 50, 100]
    assert windows.recording.tolist() == [0, 0, 1, 1]
    seen = nothing_hidden[1].observations.points
    assert np.array_equal(windows.measured[2:].reshape(100, -1, 3), seen[51:151])
    assert np.array_equal(windows.controls(30)[3], nothing_hidden[1].controls[70:150])
    past = windows.past(Subject("still", Persistence(robot, windows.dt, 20)))
    assert np.array_equal(
        past.observations.points[1], nothing_hidden[0].observations.points[80:101]
    )


def test_a_model_is_told_the_winches_of_the_plant_that_it_knows(robot, nothing_hidden):
    windows = ForecastWindows.cut(robot, nothing_hidden, 0.5, 20)
    still = Subject("still", Persistence(robot, windows.dt, 20))
    faster = dataclasses.replace(still, terms=(Term(EFFECTS["winch_gain"], None, (0.5,)),))
    for ask in (windows.past, windows.origin):
        plain, told = (ask(subject).winch for subject in (still, faster))
        assert np.abs(plain - told).max() > 0.01
    known = Reckoning(robot, windows.dt, faster.terms).known(nothing_hidden[1])
    assert np.array_equal(windows.past(faster).winch[3], known[80:101])


def test_winches_are_reckoned_once_for_all_parts(robot, nothing_hidden, monkeypatch):
    asked: list[Trajectory] = []
    known = Reckoning.known

    def counted(self: Reckoning, trajectory: Trajectory) -> Floats:
        asked.append(trajectory)
        return known(self, trajectory)

    monkeypatch.setattr(Reckoning, "known", counted)
    windows = ForecastWindows.cut(robot, nothing_hidden, 0.5, 20)
    still = Subject("still", Persistence(robot, windows.dt, 20))
    for part in (windows[:2], windows[2:]):
        part.past(still)
        part.origin(still)
    assert len(asked) == len(nothing_hidden)


def test_no_window_begins_where_a_point_is_out_of_sight(robot, nothing_hidden):
    points = nothing_hidden[0].observations.points.copy()
    points[35:60, 2] = np.nan
    windows = ForecastWindows.cut(robot, [with_points(nothing_hidden[0], points)], 0.5, 20)
    assert windows.first.tolist() == [60, 110]


def test_a_horizon_that_nothing_holds_is_shortened_and_a_short_recording_left_out(
    robot: Robot, nothing_hidden: list[Trajectory]
) -> None:
    t = nothing_hidden[0]
    short = Trajectory(t.observations[:81], t.controls[:80], t.dt)
    windows = ForecastWindows.cut(robot, [t, short], 30.0, 20, ["long", "short"])
    assert windows.steps == t.steps - 50
    assert windows.unused == ("short",)
    assert windows.labels == ("long, 0.50 to 1.60 s",)


def test_what_cannot_be_used_is_refused(robot: Robot, nothing_hidden: list[Trajectory]) -> None:
    t = nothing_hidden[0]
    with pytest.raises(DataError, match="no recording"):
        ForecastWindows.cut(robot, [], 0.5, 20)
    tiny = Trajectory(t.observations[:53], t.controls[:52], t.dt)
    with pytest.raises(DataError, match="the longest recording has 52 steps in all"):
        ForecastWindows.cut(robot, [tiny], 0.5, 20)
    with pytest.raises(DataError, match=r"one control step, got \[0.01, 0.02\]"):
        ForecastWindows.cut(robot, [t, dataclasses.replace(t, dt=0.02)], 0.5, 20)
    with pytest.raises(DataError, match=r"\(points, winches\) = \(5, 6\)"):
        ForecastWindows.cut(robot, [with_points(t, t.observations.points[:, :5])], 0.5, 20)
    blind = t.observations.points.copy()
    blind[40:, 0] = np.nan
    with pytest.raises(DataError, match="all points are in sight"):
        ForecastWindows.cut(robot, [with_points(t, blind)], 0.5, 20)
