"""Parts of recordings, and the windows in them, from which models of recordings alone are fitted."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from flywheel.errors import DataError
from flywheel.evaluation import past_at, places
from flywheel.evaluation.pasts import stacked
from flywheel.records import RECORDING, Episode, Floats, Past, Provenance, Trajectory
from flywheel.robots import Robot


@dataclass(frozen=True)
class Span:
    """A range of steps of a recording for windows; steps before it are used as past only.

    Attributes:
      track: the whole recording.
      begin, end: first and last step.
    """

    track: Trajectory
    begin: int
    end: int


Present = tuple[Episode, int, Floats]
"""A recording, a step of it, and its winch positions (T + 1, W) [m]."""


def check_recordings(robot: Robot, dt: float, recordings: Sequence[Trajectory]) -> None:
    """Check that recordings fit a model.

    Args:
      robot: the model's.
      dt: the model's control step [s].
      recordings: unbatched.

    Raises:
      DataError: they do not.
    """
    if not recordings:
        raise DataError("There is no recording to learn from.")
    for number, track in enumerate(recordings):
        got = (track.observations.points.shape[-2], track.controls.shape[-1])
        if got != (wanted := (len(robot.points), len(robot.winches))):
            raise DataError(
                f"Recording {number} has (points, winches) = {got}; robot {robot.name} has {wanted}."
            )
        if abs(track.dt - dt) > 1e-9:
            raise DataError(
                f"Recording {number} is in control steps of {track.dt:g} s, the model in steps of "
                f"{dt:g} s."
            )


def split(recordings: Sequence[Trajectory], share: float) -> tuple[list[Span], list[Span]]:
    """Training and held-out parts: whole recordings if there are enough, else the end of each."""
    count, period = len(recordings), max(2, round(1 / share))
    if count >= period:
        held = range(period - 1, count, period)
        whole = [Span(track, 0, track.steps) for track in recordings]
        return [p for i, p in enumerate(whole) if i not in held], [whole[i] for i in held]
    pairs = [(track, round((1 - share) * track.steps)) for track in recordings]
    return (
        [Span(track, 0, cut) for track, cut in pairs],
        [Span(track, cut, track.steps) for track, cut in pairs],
    )


def presents(
    robot: Robot,
    parts: Sequence[Span],
    known: Callable[[Trajectory], Floats],
    history: int,
    steps: int,
    stride: int,
    most: int,
) -> list[Present]:
    """Starts of windows in parts of recordings, where all points are in sight.

    Args:
      robot: of the recordings.
      parts: of the recordings.
      known: best estimate of the winch positions of a recording [m].
      history: past steps of a window.
      steps: control steps of a window from the present on.
      stride: steps between two starts.
      most: largest number.
    """
    about = Provenance(robot.digest, source=RECORDING, dataset=RECORDING)
    found: list[Present] = []
    for number, part in enumerate(parts):
        episode = Episode(f"recording-{number}", part.track, about, "train")
        at = places(episode, steps, max(part.begin, history))
        at = at[(at >= part.begin) & (at + steps <= part.end)][::stride]
        if len(at):
            winch = known(part.track)
            found += [(episode, int(start), winch) for start in at]
    return found[:: max(1, math.ceil(len(found) / most))]


def questions(
    robot: Robot, windows: Sequence[Present], history: int, steps: int
) -> tuple[Past, Floats, Floats]:
    """Measured pasts (B,), controls (B, steps, W) and measured points (B, steps + 1, P, 3) [m]."""
    past = stacked([past_at(e, robot, s, history, w) for e, s, w in windows])
    tracks = [(episode.trajectory, s) for episode, s, _ in windows]
    controls = np.stack([t.controls[s : s + steps] for t, s in tracks])
    measured = np.stack([t.observations.points[s : s + steps + 1] for t, s in tracks])
    return past, controls, measured
