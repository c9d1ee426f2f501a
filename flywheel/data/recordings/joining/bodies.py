"""Poses of rigid bodies, from which the positions of their tracked points follow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flywheel.data.recordings.joining.lookup import Found, Sheets, Source, length_of
from flywheel.data.recordings.joining.series import Clock
from flywheel.data.recordings.mapping import RecordingMap
from flywheel.data.recordings.repair.flips import Limits, UnseenTurns, unflipped
from flywheel.data.recordings.report import Action, Finding
from flywheel.data.recordings.sources import PoseSource
from flywheel.errors import DataError
from flywheel.records import Floats
from flywheel.robots import Body, Robot
from flywheel.rotations import rotate

UNIT_LENGTH = 0.05  # a quaternion may be so far from length 1; others are no rotation


@dataclass(frozen=True)
class Poses:
    """Poses of a body in a file.

    Attributes:
      position: (N, 3) in the axes and the unit of the file.
      turned: (N, 4) rotations of the file's body, w, x, y, z; NaN where unknown.
      metres: (3,) per unit of the position.
      frame: the MJCF's body frame in the file's.
    """

    position: Found
    turned: Floats
    metres: Floats
    frame: Callable[[Floats], Floats]

    def point(self, offset: Floats) -> Found:
        """(N, 3) positions of a point at an offset (3,) in the MJCF's body [m], as `position`."""
        apart = rotate(self.turned, self.frame(offset)) / self.metres
        return Found(self.position.source, self.position.values + apart)


def poses_of(
    sheets: Sheets, clocks: Sequence[Clock], robot: Robot, body: Body, how: RecordingMap
) -> tuple[Poses, list[Finding]]:
    """Poses of a body, without flips.

    A body that the file does not turn is not turned in the MJCF: its axes are
    renamed as those of the log are.

    Args:
      sheets: all columns.
      clocks: of the files.
      robot: of the body.
      body: with tracked points.
      how: the map, which has the body under poses.

    Raises:
      DataError: there are no such columns, or they are no poses.
    """
    pose = how.poses[body.name]
    position = sheets.needed(pose.source or pose.position or "")
    turned = sheets.rotations(pose.source or pose.rotation or "")
    if turned.source is not position.source:
        raise DataError(f"the position and the rotation of {body.name} must be in one table.")
    axes = how.axes.turned(np.eye(3))

    def frame(offsets: Floats) -> Floats:
        return (np.array(pose.at) + rotate(np.array(pose.turned), offsets)) @ axes.T

    quaternion = _quaternions(turned.values, pose, turned.source, body.name)
    points, about = frame(robot.offsets_of(body)), frame(body.principal.T) - frame(np.zeros(3))
    unseen = UnseenTurns.of(points, np.concatenate([about, np.eye(3)]))
    time = clocks[turned.source.file].of(turned.source.time)
    metres = length_of(position.source, how)
    limits = Limits.of(robot, points, time)
    place = position.values * metres
    quaternion, other, lost = unflipped(quaternion, place, time, unseen, limits)
    repair = "swaps" in how.repair
    if not repair:
        quaternion = np.where(other[:, None], np.nan, quaternion)
    done: Action = "repaired" if repair else "masked"
    put = "corrected; to mask it instead, write repair: [] in the map"
    told = put if repair else "turned by a symmetry, and not corrected, as the map asks"
    far = "turned further from one row to the next than it can have"
    masks: list[tuple[Action, NDArray[np.bool_], str]] = [
        (done, other, told),
        ("masked", lost, far),
    ]
    found = [
        Finding.over("flip", action, body.name, where, time, words)
        for action, where, words in masks
        if where.any()
    ]
    return Poses(position, quaternion, metres, frame), found


def _quaternions(values: Floats, pose: PoseSource, source: Source, body: str) -> Floats:
    """(N, 4) quaternions w, x, y, z; NaN where there is no rotation."""
    order = pose.order or ("xyzw" if pose.source and values.shape[1] == 4 else "")
    if len(order) != values.shape[1]:
        angles = "three letters, such as XYZ (own axes) or xyz (fixed axes)"
        allowed = "xyzw or wxyz" if values.shape[1] == 4 else angles
        raise DataError(
            f"the rotation of {body} has {values.shape[1]} numbers: give order, {allowed}; got "
            f"{order or 'none'}."
        )
    if len(order) == 4:
        found = values if order == "wxyz" else values[:, [3, 0, 1, 2]]
        size = np.linalg.norm(found, axis=1)
        good = np.abs(size - 1) < UNIT_LENGTH
    else:
        good = np.isfinite(values).all(axis=1)
        degrees = (pose.unit or source.stream.angle) == "deg"
        found, size = np.full((len(values), 4), np.nan), np.ones(len(values))
        if good.any():
            # Start-up time: as in flywheel.smoothing.
            from scipy.spatial.transform import Rotation

            turned = Rotation.from_euler(order, values[good], degrees=degrees)
            found[good] = turned.as_quat(scalar_first=True)
    if not good.any():
        raise DataError(f"the rotation of {body} is none in any row: quaternions have length 1.")
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(good[:, None], found / size[:, None], np.nan)
