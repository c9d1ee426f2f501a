"""Cables are witnesses: of the frame of a log, and of what its markers are called."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.imports import hanging
from flywheel.data.recordings import Imported, RecordingMap, read_recording, write_recording
from flywheel.data.recordings.mapping import Axes
from flywheel.dynamics.plant import Plant
from flywheel.errors import DataError
from flywheel.records import Episode, Observation, Provenance, Trajectory
from flywheel.robots import Robot, load_robot

NOISE = 0.0005  # [m]


def swung(robot: Robot, seed: int = 0) -> Trajectory:
    """Three seconds of a robot whose winches take new rates each 0.3 s, as measured."""
    rng = np.random.default_rng(seed)
    controls = np.repeat(rng.uniform(-0.15, 0.15, (1, 10, len(robot.winches))), 30, axis=1)
    plant = Plant(robot)
    points = plant.simulate(plant.settle(0.5), controls).observations[0].points
    points = points + NOISE * rng.standard_normal(points.shape)
    return Trajectory(
        Observation(points, np.full((len(points), len(robot.winches)), np.nan)), controls[0], 0.01
    )


@pytest.fixture(scope="module")
def beam() -> Robot:
    return hanging(1)


@pytest.fixture(scope="module")
def beams() -> Robot:
    return hanging(2)


@pytest.fixture(scope="module")
def moved(beam: Robot, beams: Robot) -> dict[str, Trajectory]:
    return {robot.name: swung(robot) for robot in (beam, beams)}


def read(
    folder: Path,
    robot: Robot,
    track: Trajectory,
    points: np.ndarray,
    how: RecordingMap | None = None,
) -> Imported:
    """The log of a trajectory with other points, as it is imported."""
    changed = Trajectory(Observation(points, track.observations.winch), track.controls, 0.01)
    log = folder / "log.csv"
    write_recording(Episode("e", changed, Provenance(robot.digest), "train"), log, robot)
    return read_recording(log, robot, how=how)


TURNED = {
    "y up": lambda p: p[..., [0, 2, 1]] * [1, 1, -1],
    "y up, mirrored": lambda p: p[..., [0, 2, 1]],
    "x up": lambda p: p[..., [2, 0, 1]],
    "upside down": lambda p: p * [1, -1, -1],
    "a quarter about the vertical": lambda p: p[..., [1, 0, 2]] * [1, -1, 1],
    "half about the vertical": lambda p: p * [-1, -1, 1],
    "origin 1.2 m below": lambda p: p + [0, 0, 1.2],
    "origin 1.2 m above": lambda p: p - [0, 0, 1.2],
    "origin 0.5 m beside": lambda p: p + [0.3, 0.4, 0],
}


@pytest.mark.parametrize("frame", TURNED)
def test_a_hanging_robot_in_another_frame_is_refused(frame, beam, moved, tmp_path):
    track = moved[beam.name]
    with pytest.raises(DataError, match="do not fit the cables from fixed points.*its origin"):
        read(tmp_path, beam, track, TURNED[frame](track.observations.points))


def test_the_lengths_that_cables_would_have_are_told(beam, moved, tmp_path):
    track = moved[beam.name]
    points = TURNED["upside down"](track.observations.points)
    with pytest.raises(
        DataError, match=r"left_cableA would usually be 3.\d+ m long, at most 2.\d+ m"
    ):
        read(tmp_path, beam, track, points)


def test_axes_that_make_the_cables_fit_are_named_and_do(beam, moved, tmp_path):
    track = moved[beam.name]
    points = TURNED["half about the vertical"](track.observations.points)
    with pytest.raises(DataError, match="axes: {x: -x, y: -y, z: z} they would fit|were exchanged"):
        read(tmp_path, beam, track, points)
    (tmp_path / "log.csv").unlink()
    how = RecordingMap(axes=Axes(x="-x", y="-y", z="z"))
    assert read(tmp_path, beam, track, points, how).report.findings == ()


@pytest.mark.parametrize("name", ["beam", "beams"])
def test_a_hanging_robot_in_its_own_frame_is_taken(name, request, moved, tmp_path):
    robot = request.getfixturevalue(name)
    track = moved[robot.name]
    assert read(tmp_path, robot, track, track.observations.points).report.findings == ()


def test_a_robot_on_the_ground_may_be_anywhere_on_it(tmp_path: Path) -> None:
    robot = load_robot("prism3")
    track = swung(robot)
    points = track.observations.points[..., [1, 0, 2]] * [1, -1, 1] + [3.0, -2.0, 0.0]
    assert read(tmp_path, robot, track, points).report.findings == ()


@pytest.mark.parametrize(("begin", "end"), [(0, 100), (0, 200), (90, 200), (200, 301), (80, 301)])
def test_two_bodies_that_are_exchanged_for_a_while_are_put_right(
    begin: int, end: int, beams: Robot, moved: dict[str, Trajectory], tmp_path: Path
) -> None:
    """At the beginning, too, for a third of the log or two: the cables tell which rows are right."""
    track = moved[beams.name]
    points = track.observations.points.copy()
    points[begin:end] = points[begin:end][:, [2, 3, 0, 1]]
    found = read(tmp_path, beams, track, points)
    np.testing.assert_allclose(
        found.episodes[0].trajectory.observations.points, track.observations.points, atol=1e-12
    )
    told = {(f.kind, f.action, f.subject, f.count) for f in found.report.findings}
    pairs = ("leftA and leftB", "rightA and rightB")
    assert told == {("swap", "repaired", pair, end - begin) for pair in pairs}


@pytest.mark.parametrize("share", [0.1, 0.35, 0.5, 0.65, 0.9])
def test_markers_exchanged_in_any_share_of_the_rows_are_put_right_by_the_cables(
    share: float, beam: Robot, moved: dict[str, Trajectory], tmp_path: Path
) -> None:
    track = moved[beam.name]
    points = track.observations.points.copy()
    rows = np.random.default_rng(3).random(len(points)) < share
    points[rows] = points[rows][:, ::-1]
    found = read(tmp_path, beam, track, points)
    np.testing.assert_allclose(
        found.episodes[0].trajectory.observations.points, track.observations.points, atol=1e-12
    )
    assert [f.count for f in found.report.findings] == [rows.sum()]


@pytest.mark.parametrize(("share", "right"), [(0.2, True), (0.35, True), (0.5, False)])
def test_without_a_witness_the_commonest_order_is_right_or_none(
    share: float, right: bool, beam: Robot, moved: dict[str, Trajectory], tmp_path: Path
) -> None:
    still = moved[beam.name]
    track = Trajectory(still.observations, 0 * still.controls, still.dt)
    rng = np.random.default_rng(4)
    points = still.observations.points[:1] + NOISE * rng.standard_normal((301, 2, 3))
    rows = rng.random(len(points)) < share
    rows[0] = True
    spoilt = np.where(rows[:, None, None], points[:, ::-1], points)
    if right:
        found = read(tmp_path, beam, track, spoilt)
        got = found.episodes[0].trajectory.observations.points
        np.testing.assert_allclose(got, points, atol=1e-12)
    else:
        with pytest.raises(
            DataError, match="leftA and rightA are exchanged from row to row, .* times"
        ):
            read(tmp_path, beam, track, spoilt)


def test_columns_that_are_exchanged_from_the_beginning_are_known_by_the_cables(
    beams: Robot, moved: dict[str, Trajectory], tmp_path: Path
) -> None:
    track = moved[beams.name]
    points = track.observations.points[:, [1, 0, 2, 3]]
    with pytest.raises(DataError, match="if the columns of leftA with rightA were exchanged"):
        read(tmp_path, beams, track, points)


def test_a_body_that_is_elsewhere_is_noted_by_its_cables_on_a_robot_without_fixed_ones(tmp_path):
    robot = load_robot("prism3")
    track = swung(robot)
    points = track.observations.points.copy()
    points[:, list(robot.bodies[0].points), 0] += 2.0
    notes = read(tmp_path, robot, track, points).report.findings
    own = {c.name for c in robot.cables if 0 in {end.body for end in c.ends}}
    told = {f.subject for f in notes if f.kind == "cable" and "marker or its axes wrong" in f.words}
    assert told and told <= own


def test_three_markers_exchanged_in_most_rows_of_a_noisy_log_are_put_right(tmp_path: Path) -> None:
    """Not by what their own distances vary by, which are those of other pairs in most rows."""
    robot = load_robot("prism3")
    track = swung(robot)
    rng = np.random.default_rng(7)
    right = track.observations.points + 0.003 * robot.length * rng.standard_normal((301, 6, 3))
    points, some = right.copy(), np.array([0, 2, 5])
    exchanged = rng.random(301) < 0.6
    exchanged[0] = True
    for row in np.flatnonzero(exchanged):
        points[row, some] = right[row, np.roll(some, int(rng.integers(1, 3)))]
    found = read(tmp_path, robot, track, points)
    got = found.episodes[0].trajectory.observations.points
    seen = np.isfinite(got)
    assert seen.mean() > 0.95
    np.testing.assert_allclose(got[seen], right[seen], atol=1e-12)
