"""Checks of a log against the MJCF: the robot, the units, the vertical axis and the commands' range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flywheel.data.recordings.mapping import Axes
from flywheel.data.recordings.pieces import distance
from flywheel.data.recordings.report import Finding, counted, listed
from flywheel.data.recordings.sources import LENGTHS
from flywheel.data.recordings.tables.columns import Log, control_names, winch_names
from flywheel.errors import DataError
from flywheel.records import Floats
from flywheel.robots import Robot

SAME = 0.05  # relative: distances on a body agree with the MJCF's
ROWS = 10_000  # of a log, whose distances tell its units
MOST = 0.5  # share of the distances; the others may be of exchanged markers
BELOW = 0.05  # depth below the ground that is too far, in L
OFTEN = 0.1  # share of the samples
SLACK = 1e-6  # share of a range: rounding in the log
DEGREES = np.pi / 180
FEW = 0.01  # share of the values: too few to suggest another unit
FILLED = 0.1  # share of a range that values in the right unit use at least
HIGH = 0.03  # height above the ground, or depth below it, of a robot that stands on it, in L
HIGH_TETHERED = 0.1  # the same where cables may hold it


@dataclass(frozen=True)
class Pair:
    """Two tracked points on one body.

    Attributes:
      a, b: indices into `Robot.points`, a < b.
      distance: between them, by the MJCF [m].
    """

    a: int
    b: int
    distance: float


def pairs(robot: Robot) -> list[Pair]:
    """All pairs of tracked points with a constant distance on a body."""
    found = []
    for body in robot.bodies:
        for i, a in enumerate(body.points):
            for b in body.points[i + 1 :]:
                apart = robot.points[a].offset - robot.points[b].offset
                found.append(Pair(a, b, float(np.linalg.norm(apart))))
    return [pair for pair in found if pair.distance > 0]


def distances(points: Floats, rods: list[Pair]) -> Floats:
    """(..., rods) measured distances of points (..., P, 3) [m]; NaN where one is missing."""
    a, b = [rod.a for rod in rods], [rod.b for rod in rods]
    return distance(points[..., a, :], points[..., b, :])


def median(values: Floats) -> float:
    """The median of the values (N,) without NaN; NaN if all are."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else np.nan


def usual_distances(points: Floats, rods: list[Pair]) -> Floats:
    """(rods,) medians over time of the distances of points (N, P, 3) [m]; NaN where never seen."""
    # One at a time: together they would be larger than the log.
    return np.array([median(distances(points, [rod])[:, 0]) for rod in rods])


def check_units(points: Floats, robot: Robot, axes: Axes) -> None:
    """Raise DataError if distances would be right in another unit, of all axes of the log or of some."""
    rods = pairs(robot)
    some = points[:: max(1, len(points) // ROWS)]
    usual = usual_distances(some, rods)
    # One marker taken for all has distances of 0.
    if not (usual > 0).any() or _right(usual, rods) > MOST:
        return
    rod = max((r for r, got in zip(rods, usual, strict=True) if got > 0), key=lambda r: r.distance)
    names = f"{robot.points[rod.a].name} and {robot.points[rod.b].name}"
    got = (
        f"{names} are {usual[rods.index(rod)]:.4g} m apart, the MJCF says {rod.distance:.4g} m, and "
        "distances between markers of one body would be right"
    )
    ours = np.array([str(axis)[-1] for axis in (axes.x, axes.y, axes.z)])
    for letters in ("xyz", "x", "y", "z", "xy", "xz", "yz"):
        scaled = np.isin(ours, list(letters))
        what = "the points" if letters == "xyz" else f"their {' and '.join(letters)}"
        for unit, metres in LENGTHS.items():
            if unit == "m":
                continue
            if _right(usual_distances(some * np.where(scaled, metres, 1), rods), rods) > MOST:
                each = unit if letters == "xyz" else [unit if a in letters else "m" for a in "xyz"]
                words = str(each).replace("'", "")
                raise DataError(
                    f"{got} if {what} were in {unit}: write units: {{points: {words}}} in the map."
                )
            if letters == "xyz" and _right(usual / metres, rods) > MOST:
                raise DataError(
                    f"{got} in m: the map's units.points seems to be {unit} for a log in m: write m."
                )


def _right(usual: Floats, rods: list[Pair]) -> float:
    """Share of the measured distances (rods,) that agree with the MJCF's."""
    known = np.isfinite(usual)
    ratio = usual[known] / np.array([rod.distance for rod in rods])[known]
    return float((np.abs(ratio - 1) <= SAME).mean())


def check_robot(points: Floats, robot: Robot) -> None:
    """Raise DataError if distances on bodies usually differ from the MJCF's."""
    rods = pairs(robot)
    usual = usual_distances(points, rods)
    wrong = [
        f"{robot.points[rod.a].name} to {robot.points[rod.b].name} is {got:.4g} m instead of "
        f"{rod.distance:.4g} m"
        for rod, got in zip(rods, usual, strict=True)
        if abs(got / rod.distance - 1) > SAME
    ]
    if wrong:
        raise DataError(
            f"distances on {len(wrong)} of {len(rods)} pairs of markers differ from those of the "
            f"robot {robot.name} (by more than {SAME:.0%}): {listed(wrong, 4)}. Is it a recording "
            f"of another robot, or are markers swapped?{_exchange(points, robot, rods)}"
        )


def _exchange(points: Floats, robot: Robot, rods: list[Pair]) -> str:
    """Pairs of columns whose swap from the beginning would make all distances right."""
    count = range(len(robot.points))
    every = [Pair(a, b, 0.0) for a in count for b in count[a + 1 :]]
    usual = np.full((len(count), len(count)), np.nan)
    for pair, apart in zip(every, usual_distances(points, every), strict=True):
        usual[[pair.a, pair.b], [pair.b, pair.a]] = apart
    fits = []
    for pair in every:
        order = list(count)
        order[pair.a], order[pair.b] = pair.b, pair.a
        off = [abs(usual[order[rod.a], order[rod.b]] / rod.distance - 1) for rod in rods]
        known = [each for each in off if np.isfinite(each)]
        if known and max(known) <= SAME:
            fits.append(f"{robot.points[pair.a].name} with {robot.points[pair.b].name}")
    if not fits:
        return ""
    return (
        f" Swapping {' or '.join(fits)} would make them right: if so, swap their columns in the "
        "map."
    )


def check_up(points: Floats, robot: Robot) -> None:
    """Raise DataError if markers are often below the ground."""
    if not robot.grounded:
        return
    radius = np.array([point.radius for point in robot.points])
    height = points[..., 2] - radius
    seen = np.isfinite(height)
    below = seen & (height < -BELOW * robot.length - 2 * radius)
    if not seen.any() or below.sum() <= OFTEN * seen.sum():
        return
    raise DataError(
        f"{below.sum() / seen.sum():.0%} of the markers' samples are below the ground (z down to "
        f"{np.nanmin(points[..., 2]):.3g} m; z is up, the ground is at 0). Which of the log's axes points "
        "up? Say so in the map; where it is y, write axes: {x: x, y: -z, z: y}. If the log's origin is "
        "above the ground, write how far: origin: [0, 0, 1.2]."
    )


def floating(points: Floats, robot: Robot) -> list[Finding]:
    """A note where a robot that can touch the ground is never near it, or below it: is it at 0?"""
    radius = np.array([point.radius for point in robot.points])
    height = points[..., radius > 0, 2] - radius[radius > 0]
    height = height[np.isfinite(height)]
    if not robot.grounded or len(height) == 0:
        return []
    lowest = float(np.percentile(height, 1))
    if abs(lowest) < (HIGH_TETHERED if robot.tethered else HIGH) * robot.length:
        return []
    words = (
        f"never nearer to the ground than {lowest:.3g} m: is z up, and the ground at 0?"
        if lowest > 0
        else f"down to {-lowest:.3g} m below the ground: is it at 0?"
    )
    return [Finding("height", "noted", "", 0, words=words)]


def check_commands(log: Log, robot: Robot) -> None:
    """Raise DataError if an effective command is beyond its range."""
    used = log.controls[:-1]
    slack = SLACK * (robot.control_high - robot.control_low)
    beyond = (used < robot.control_low - slack) | (used > robot.control_high + slack)
    if not beyond.any():
        return
    columns = np.flatnonzero(beyond.any(axis=0))
    names = [control_names(robot)[int(each)] for each in columns]
    column = int(columns[0])
    winch = robot.winches[column]
    rows = np.flatnonzero(beyond[:, column])
    unit = winch.unit
    low, high = winch.control_range
    ends = (robot.control_low - slack, robot.control_high + slack)
    raise DataError(
        f"line {log.lines[rows[0]]}: the command {names[0]!r} is "
        f"{used[rows[0], column]:g} {unit}, allowed are {low:g} to {high:g} {unit}; "
        f"{counted(int(beyond.sum()), 'command')} out of range, of {listed(names)}."
        f"{_unit_hint(robot, used, *ends, 'control')}"
    )


def check_winches(log: Log, robot: Robot) -> None:
    """Raise DataError if winch positions are often outside the winch's range."""
    for name, index in winch_names(robot).items():
        winch = robot.winches[index]
        low, high = winch.rest_range
        margin = OFTEN * (high - low)
        got = log.winch[:, index]
        got = got[np.isfinite(got)]
        beyond = (got < low - margin) | (got > high + margin)
        if beyond.sum() > OFTEN * len(got):
            ends = np.array([low]), np.array([high])
            hint = _unit_hint(robot, got[:, None], *ends, "winch")
            raise DataError(
                f"the winch position {name!r} is usually {np.median(got):.4g} {winch.position_unit}; the "
                f"winch {winch.name!r} goes from {low:g} to {high:g} {winch.position_unit}.{hint}"
            )


def _unit_hint(robot: Robot, values: Floats, low: Floats, high: Floats, key: str) -> str:
    """Units of lengths that would bring all values into their range; none for tensions."""

    def fits(factor: float) -> bool:
        inside = ((values * factor >= low) & (values * factor <= high)).all()
        return bool(inside and np.abs(values * factor).max() >= FILLED * high.max())

    if robot.tension_driven or ((values < low) | (values > high)).mean() < FEW:
        return ""  # single commands, not a unit
    per = "/s" if key == "control" and (low < 0).all() else ""
    found = [f"{u}{per}" for u in ("cm", "mm") if fits(LENGTHS[u])]
    hints = []
    if found:
        hints.append(f"They would fit in {' or '.join(found)} (units: {{{key}: {found[0]}}})")
    if fits(DEGREES):
        hints.append(
            f"{'or' if found else 'They would fit'} as degrees for radians of a drum (units: {{{key}: "
            f"deg{per}, drum: ...}})"
        )
    if key == "control" and fits(-1.0):
        hints.append(
            "They would fit with the other sign: positive pays out (units: {control: -m/s})"
        )
    return f" {' '.join(hints)}." if hints else ""


def wrong_rods(points: Floats, rods: list[Pair], tolerance: Floats) -> NDArray[np.bool_]:
    """(..., rods) bool: True for distances off by more than `tolerance` (rods,) [m]; False if missing."""
    with np.errstate(invalid="ignore"):
        off = np.abs(distances(points, rods) - [rod.distance for rod in rods])
        return np.asarray(off > tolerance)
