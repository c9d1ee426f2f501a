"""Guessed attachments: on the caps' circles, one place for each partner, and nothing of the MJCF's."""

from dataclasses import replace

import numpy as np
import pytest

from flywheel.dynamics.baselines.engine import EngineConfig, RigidBodyEngine
from flywheel.dynamics.rigid_bodies.guessed_attachments import with_attachments
from flywheel.robots import Attachment, Robot, load_robot
from flywheel.rotations import rotate


def scrambled(robot: Robot) -> Robot:
    """The robot with its cables' ends elsewhere on their bodies, near the same tracked points."""

    def moved(end: Attachment) -> Attachment:
        return replace(end, offset=end.offset + [0.03, -0.02, 0.01]) if end.body >= 0 else end

    cables = [replace(c, ends=(moved(c.ends[0]), moved(c.ends[1]))) for c in robot.cables]
    return replace(robot, cables=tuple(cables))


@pytest.mark.parametrize("name", ["prism3", "icosa6", "platform4"])
@pytest.mark.parametrize("guess", ["heuristic", "uninformed"])
def test_a_guess_knows_nothing_of_the_mjcfs_attachments(name, guess) -> None:
    robot = load_robot(name)
    one, other = (with_attachments(r, guess).cables for r in (robot, scrambled(robot)))
    for a, b in zip(one, other, strict=True):
        for here, there in zip(a.ends, b.ends, strict=True):
            np.testing.assert_array_equal(here.offset, there.offset)


def test_uninformed_cables_end_at_the_tracked_points_and_in_the_world() -> None:
    robot = load_robot("platform4")
    for cable, own in zip(with_attachments(robot, "uninformed").cables, robot.cables, strict=True):
        for end, before in zip(cable.ends, own.ends, strict=True):
            there = before.offset if end.body < 0 else robot.points[end.point].offset
            np.testing.assert_array_equal(end.offset, there)


@pytest.mark.parametrize(("name", "places"), [("prism3", 3), ("icosa6", 4)])
def test_heuristic_places_divide_the_circle_from_its_highest_point_on(name, places) -> None:
    robot = load_robot(name)
    found: dict[int, set[tuple[float, ...]]] = {i: set() for i in range(len(robot.points))}
    for cable in with_attachments(robot, "heuristic").cables:
        for end in cable.ends:
            found[end.point].add(tuple(np.round(end.offset, 9)))
    for index, offsets in found.items():
        point, arms = robot.points[index], np.array(list(offsets))
        arms = arms - point.offset
        assert len(arms) == places
        np.testing.assert_allclose(np.linalg.norm(arms, axis=1), point.radius, atol=1e-8)
        np.testing.assert_allclose(arms[:, 2], 0.0, atol=1e-8)  # across the rod
        cosines = np.sort((arms @ arms.T)[0]) / point.radius**2
        np.testing.assert_allclose(
            cosines, np.sort(np.cos(2 * np.pi * np.arange(places) / places)), atol=1e-6
        )
        turn = robot.keyframe.qpos.reshape(-1, 7)[point.body, 3:]
        up = np.array([0.0, 0.0, 1.0])
        axis = rotate(turn, up)
        highest = point.radius * np.sqrt(1.0 - axis[2] ** 2)
        assert rotate(turn, arms)[:, 2].max() == pytest.approx(highest, abs=1e-6)


def test_heuristic_places_face_their_partners_better_than_the_axis_does() -> None:
    robot = load_robot("prism3")
    poses = robot.keyframe.qpos.reshape(1, -1, 7)
    guessed, centres, own = (
        with_attachments(robot, guess).cable_lengths(poses)[0]
        for guess in ("heuristic", "uninformed", "mjcf")
    )
    assert guessed.sum() < centres.sum()
    assert np.abs(guessed - own).mean() < np.abs(centres - own).mean()


@pytest.mark.parametrize("guess", ["heuristic", "uninformed"])
def test_calibrated_cables_are_as_taut_in_the_keyframe_as_the_mjcfs(guess) -> None:
    robot = load_robot("prism3")
    poses, winch = robot.keyframe.qpos.reshape(1, -1, 7), robot.winch_of(robot.keyframe)
    rest = np.array([cable.rest_length for cable in robot.cables])
    strain = robot.cable_lengths(poses)[0] - rest
    length = with_attachments(robot, guess).cable_lengths(poses)[0]
    for calibrated in (True, False):
        engine = RigidBodyEngine(
            robot, 0.01, EngineConfig(attachments=guess, calibrated=calibrated)
        )
        got = length - engine.rest(np.repeat(winch[None, None], 2, axis=1))[0, :, 0].numpy()
        np.testing.assert_allclose(got, strain if calibrated else length - rest, atol=1e-12)
