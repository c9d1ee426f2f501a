"""Driving through a link: in lockstep and in real time, to the goal or to whatever ends it."""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flywheel.control import Command, EpisodeOrder, RandomControls
from flywheel.control.drive import Drive, drive, replayed
from flywheel.dynamics.plant import Reckoning
from flywheel.errors import LinkError, ModelError
from flywheel.records import Floats, Past, Provenance
from flywheel.robot_link import (
    ReplayedLink,
    RobotInfo,
    RobotLink,
    Sample,
    StandIn,
    StandInConfig,
    TranscribedLink,
)
from flywheel.robots import Robot, load_robot
from flywheel.tasks import Task

PERIOD = 0.01


class Planner:
    """Plans as many steps as it is told, each with another command, and notes what it was shown."""

    name, model, history = "planner", "", 0

    def __init__(self, steps: int = 5, tail: bool = True) -> None:
        self.steps, self.tail = steps, tail
        self.pasts: list[Past] = []
        self.tasks: list[Task | None] = []

    def reset(self, task: Task | None, seed: int) -> None:
        self.tasks.append(task)

    def act(self, past: Past) -> Command:
        self.pasts.append(past)
        number = 0.001 * len(self.pasts)
        ahead = np.full((2 * self.steps, 6), number)
        return Command(ahead[: self.steps], tail=-ahead[: self.steps] if self.tail else None)


class Clockwork(StandIn):
    """A stand-in whose clock skips periods, or whose link breaks, where a test wants it."""

    def __init__(
        self, robot: Robot, skips: dict[int, int] | None = None, breaks: int | None = None
    ) -> None:
        super().__init__(robot, StandInConfig(noise=0.0, winch_measured=True), PERIOD)
        self.skips, self.breaks, self.looks, self.stopped = skips or {}, breaks, 0, False

    def observe(self) -> Sample:
        self.looks += 1
        if self.looks == self.breaks:
            raise LinkError("The link is lost: it broke.")
        for _ in range(self.skips.get(self.looks, 0)):
            self.advance()
        return super().observe()

    def stop(self) -> None:
        self.stopped = True
        super().stop()


def driven(
    link: RobotLink, robot: Robot, controller: object, seconds: float = 0.2, **more: object
) -> Drive:
    about = Provenance(robot=robot.digest, source="recording", dataset="recording")
    return drive(
        link,
        robot,
        controller,  # type: ignore[arg-type]
        more.pop("task_of", lambda points: None),  # type: ignore[arg-type]
        EpisodeOrder("drive-0", about, seconds, seed=2),
        reckoning=Reckoning(robot, PERIOD),
        **more,  # type: ignore[arg-type]
    )


def test_what_was_measured_and_commanded_is_in_the_episode_to_the_bit(robot: Robot) -> None:
    link = Clockwork(robot)
    done = driven(link, robot, RandomControls(robot, PERIOD))
    again = Clockwork(robot)
    again.reset(2)
    track = done.episode.trajectory
    rows = [again.observe()]
    for control in track.controls:
        again.send(control, rows[-1].time + 1)
        rows.append(again.observe())
    np.testing.assert_array_equal(track.observations.points, [row.points for row in rows])
    np.testing.assert_array_equal(track.observations.winch, [row.winch for row in rows])
    assert (done.ended, track.states, link.stopped) == ("time", None, True)
    assert track.steps == 20 and done.skipped == done.late_plans == 0


def test_the_same_seed_drives_the_same_way(robot: Robot) -> None:
    config = StandInConfig(hidden=("payload",), dropout=0.1)
    one, same = (
        driven(StandIn(robot, config), robot, RandomControls(robot, PERIOD)).episode.trajectory
        for _ in range(2)
    )
    np.testing.assert_array_equal(one.observations.points, same.observations.points)
    np.testing.assert_array_equal(one.controls, same.controls)


def test_a_goal_is_reached_by_what_is_measured(robot: Robot) -> None:
    def here(points: Floats) -> Task:
        then = Task("reach", robot, np.zeros(2), 100.0, 9.0, lambda places: places[..., 0])
        return Task("reach", robot, np.zeros(2), 100.0, 9.0, lambda p: p[..., 0], then=then)

    planner = Planner()
    done = driven(StandIn(robot, StandInConfig()), robot, planner, task_of=here)
    assert done.ended == "goal" and done.episode.outcome is not None
    assert done.episode.outcome.success and done.episode.outcome.seconds == pytest.approx(0.02)
    assert len(planner.tasks) == 2  # the second one followed the first


def test_a_late_measurement_stands_where_it_was_made_and_plans_know_what_was_sent_since(robot):
    config = StandInConfig(noise=0.0, latency=0.03, winch_measured=True)
    prompt, late = Planner(), Planner()
    exact = driven(Clockwork(robot), robot, prompt).episode.trajectory
    seen = driven(StandIn(robot, config, PERIOD), robot, late).episode.trajectory
    np.testing.assert_array_equal(seen.controls, exact.controls)
    np.testing.assert_array_equal(seen.observations.points[1:18], exact.observations.points[1:18])
    assert np.isnan(seen.observations.points[18:]).all()
    past = late.pasts[2]
    assert past.history == 7 and past.pending is not None and past.pending.shape == (1, 3, 6)
    np.testing.assert_array_equal(past.pending[0], exact.controls[7:10])
    assert prompt.pasts[2].history == 10


def test_skipped_periods_are_counted_and_logged_as_the_robot_lived_them(robot: Robot) -> None:
    """It goes on with the last command until that is not valid any more, then holds still."""
    done = driven(Clockwork(robot, skips={6: 12}), robot, Planner(steps=30), seconds=0.3)
    track = done.episode.trajectory
    assert done.skipped == 12 and track.steps == 30
    assert np.isnan(track.observations.points[5:17]).all()
    moved = np.diff(track.observations.winch[[4, 17], 0])
    assert moved == pytest.approx(track.controls[4:17, 0].sum() * PERIOD)
    assert (track.controls[4:14] == 0.001).all() and (track.controls[14:17] == 0).all()


def test_a_lost_link_ends_the_drive_and_what_was_measured_is_whole(robot: Robot) -> None:
    link = Clockwork(robot, breaks=9)
    done = driven(link, robot, Planner())
    assert (done.ended, done.why) == ("lost", "The link is lost: it broke.")
    assert done.episode.trajectory.steps == 7 and link.stopped
    assert np.isfinite(done.episode.trajectory.observations.points).all()
    with pytest.raises(LinkError, match="it broke"):
        driven(Clockwork(robot, breaks=2), robot, Planner())


def test_what_a_driver_that_was_killed_had_measured_is_in_its_transcript_to_the_bit(
    robot: Robot, tmp_path: Path
) -> None:
    path = tmp_path / "drive.jsonl"
    link = TranscribedLink(Clockwork(robot, skips={6: 12}), path)
    whole = driven(link, robot, Planner(steps=30), seconds=0.4).episode.trajectory
    link.end()
    lines = path.read_bytes().splitlines(keepends=True)
    kept = len(lines) * 2 // 3
    path.write_bytes(b"".join(lines[:kept]) + lines[kept][:20])
    about = Provenance(robot=robot.digest, source="recording", dataset="recording")
    again = replayed(ReplayedLink(path), robot, "again", about, Reckoning(robot, PERIOD))
    track = again.episode.trajectory
    assert 17 < track.steps < whole.steps and again.skipped == 12
    for name in ("points", "winch"):
        then = getattr(whole.observations, name)[: track.steps + 1]
        np.testing.assert_array_equal(getattr(track.observations, name), then)
    np.testing.assert_array_equal(track.controls, whole.controls[: track.steps])
    path.write_bytes(b"".join(lines[:4]))
    with pytest.raises(LinkError):
        replayed(ReplayedLink(path), robot, "again", about, Reckoning(robot, PERIOD))


class Diverging(Planner):
    """Its third plan is not finite."""

    def act(self, past: Past) -> Command:
        if len(self.pasts) == 2:
            raise ModelError("Not one rollout is finite.")
        return super().act(past)


def test_a_planner_that_fails_loses_nothing_that_was_measured(robot: Robot) -> None:
    link = Clockwork(robot)
    done = driven(link, robot, Diverging())
    assert (done.ended, done.why, link.stopped) == ("failed", "Not one rollout is finite.", True)
    assert done.episode.trajectory.steps == 10


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (Sample(0.0, 0.0, np.zeros((5, 3)), np.zeros(6)), "6 points and 6 winches; it measured"),
        (Sample(np.nan, 0.0, np.zeros((6, 3)), np.zeros(6)), "gave the time nan"),
        (Sample(0.0, np.nan, np.zeros((6, 3)), np.zeros(6)), "the stamp nan s"),
        (Sample(1.0, 1.8e9, np.zeros((6, 3)), np.zeros(6)), "time 1 s and the stamp 1.8e.09 s"),
    ],
)
def test_measurements_that_cannot_be_are_refused(robot, wrong, message, monkeypatch):
    link = Clockwork(robot)
    monkeypatch.setattr(link, "observe", lambda: wrong)
    with pytest.raises(LinkError, match=message):
        driven(link, robot, Planner())


@pytest.mark.parametrize("scale", [1000.0, 100.0, 0.001])
def test_points_in_other_units_are_refused_before_a_command(robot, scale, monkeypatch):
    link = Clockwork(robot)
    seen, planner = link.observe, Planner()
    monkeypatch.setattr(link, "observe", lambda: replace(s := seen(), points=scale * s.points))
    with pytest.raises(LinkError, match=f"usually {scale:g} times as far apart"):
        driven(link, robot, planner)
    assert not planner.pasts


@pytest.mark.parametrize("how", ["hidden", "stamps of another clock", "one stamp"])
def test_a_robot_that_is_no_longer_seen_is_lost_with_what_was_measured(robot, how, monkeypatch):
    link = Clockwork(robot)
    seen = link.observe

    def observe() -> Sample:
        sample = seen()
        if link.looks <= 10:
            return sample
        if how == "hidden":
            return replace(sample, points=np.full_like(sample.points, np.nan))
        return replace(sample, stamp=0.09 if how == "one stamp" else sample.stamp - 1e6)

    monkeypatch.setattr(link, "observe", observe)
    done = driven(link, robot, Planner(), seconds=8.0)
    assert (done.ended, link.stopped) == ("lost", True)
    assert "No point of the robot was measured for 5 s" in done.why
    points = done.episode.trajectory.observations.points
    assert len(points) == 10 + 501
    assert np.isfinite(points[:10]).all() and np.isnan(points[10:]).all()


def test_points_that_are_hidden_for_seconds_and_come_back_are_no_loss(robot, monkeypatch):
    link = Clockwork(robot)
    seen = link.observe

    def observe() -> Sample:
        sample, away = seen(), 10 < link.looks <= 500
        return replace(sample, points=np.where(away, np.nan, sample.points))

    monkeypatch.setattr(link, "observe", observe)
    assert driven(link, robot, Planner(), seconds=5.5).ended == "time"


def test_ctrl_c_ends_the_drive_and_stops_the_robot(robot: Robot) -> None:
    def interrupt(done: int, sample: Sample) -> None:
        if done == 4:
            raise KeyboardInterrupt

    link = Clockwork(robot)
    done = driven(link, robot, Planner(), on_step=interrupt)
    assert (done.ended, done.episode.trajectory.steps, link.stopped) == ("stopped", 4, True)


class Waiting(Clockwork):
    """A stand-in whose clock waits for plans, as if they took less time than they have."""

    def __init__(self, robot: Robot, planner: Planner, every: int) -> None:
        super().__init__(robot)
        self.planner, self.every = planner, every

    def observe(self) -> Sample:
        while len(self.planner.pasts) < self.looks // self.every:
            time.sleep(0.001)
        return super().observe()


def test_ahead_of_time_a_plan_begins_when_it_was_asked_for(robot: Robot) -> None:
    planner = Planner(steps=10)
    done = driven(Waiting(robot, planner, 10), robot, planner, seconds=0.4, lead=10)
    controls = done.episode.trajectory.controls[:, 0]
    np.testing.assert_allclose(controls, np.repeat([0.0, 0.001, 0.002, 0.003], 10))
    assert done.late_plans == 0
    past = planner.pasts[1]
    assert past.pending is not None
    np.testing.assert_allclose(past.pending[0, :, 0], 0.001)
    assert past.history + past.pending.shape[1] == 20  # the next plan begins then


class Slow(Planner):
    """Its plans are there 12 control periods after they were asked for."""

    def __init__(self, link: Clockwork, tail: bool) -> None:
        super().__init__(5, tail=tail)
        self.link = link

    def act(self, past: Past) -> Command:
        until = self.link.looks + 12
        while self.link.looks < until and not self.link.stopped:
            time.sleep(0.001)
        return super().act(past)


class Steady(Clockwork):
    """Its clock is slow enough for a thread to be seen to wait for it."""

    def observe(self) -> Sample:
        time.sleep(0.002)
        return super().observe()


@pytest.mark.parametrize("tail", [True, False])
def test_a_late_plan_is_counted_while_the_one_before_goes_on(robot: Robot, tail: bool) -> None:
    link = Steady(robot)
    done = driven(link, robot, Slow(link, tail), seconds=0.5, lead=5)
    controls = done.episode.trajectory.controls[:, 0]
    assert done.late_plans >= 2
    assert (
        controls.any() == tail
    )  # of a plan that is late by more than its length only the tail is left
    assert (controls <= 0).all() and (controls == 0).any()


class Frozen(Clockwork):
    """A robot whose clock stands still."""

    def advance(self) -> None: ...


def test_a_clock_that_stands_still_and_another_robot_are_refused(robot: Robot) -> None:
    with pytest.raises(LinkError, match="clock is stopped"):
        driven(Frozen(robot), robot, Planner())
    with pytest.raises(LinkError, match="the MJCF of icosa6 has"):
        driven(Clockwork(robot), load_robot("icosa6"), Planner())
    assert RobotInfo.of(robot, PERIOD).dead_man == 0.5
