"""Winches of a robot that was locked: they are where its cables are as long as was seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flywheel.data.recordings.evidence import PULLED, ROWS, lengths_between, stretch
from flywheel.data.recordings.mapping import RecordingMap
from flywheel.data.recordings.report import Finding, listed
from flywheel.data.recordings.tables.columns import Log
from flywheel.records import Floats
from flywheel.robots import Robot


def with_locked(
    log: Log, points: Floats, robot: Robot, how: RecordingMap
) -> tuple[Log, list[Finding]]:
    """The log with positions of its winches if all of them were held and none was measured, and a note on it.

    They are those of the keyframe, and nothing is written, unless a cable is longer or shorter there than it
    is on average by more than it may be pulled. All cables are then taken to be stretched as in the keyframe.

    Args:
      log: with NaN for winches that were not measured [m].
      points: (N, P, 3) under their names [m]; NaN where missing.
      robot: of the log.
      how: which says what was held.
    """
    held = {name for name, channel in how.commands.items() if channel.hold}
    unknown = held >= {winch.name for winch in robot.winches} and not np.isfinite(log.winch).any()
    if not unknown or not robot.winches or not robot.free or robot.tension_driven:
        return log, []
    seen = points[np.isfinite(points[..., 0]).all(axis=1)]
    if not len(seen):
        return log, []
    cables = [winch.cables[0] for winch in robot.winches]
    at_home = lengths_between(robot.points_of(robot.keyframe)[None], robot)[0]
    usual = lengths_between(seen[:: max(1, len(seen) // ROWS)], robot).mean(axis=0)
    longer = (usual - at_home)[cables]
    if (np.abs(longer) <= PULLED * stretch(robot)[cables]).all():
        return log, []
    at = np.clip(robot.winch_of(robot.keyframe) + longer, robot.rest_low, robot.rest_high)
    places = listed([f"{w.name} at {a:.6g} m" for w, a in zip(robot.winches, at, strict=True)])
    words = f"locked where their cables are as long as was seen: {places}"
    note = Finding("channel", "noted", "the winches", 0, words=words)
    rows = len(log.time)
    winch, controls = (np.tile(each, (rows, 1)) for each in (at, robot.holding(at)))
    return replace(log, winch=winch, controls=controls), [note]
