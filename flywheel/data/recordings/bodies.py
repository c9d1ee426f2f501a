"""Poses of rigid bodies, from which the positions of their tracked points follow."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from flywheel.data.recordings.lookup import Found, Sheets, Source, length_of
from flywheel.data.recordings.mapping import RecordingMap
from flywheel.data.recordings.sources import PoseSource
from flywheel.errors import DataError
from flywheel.records import Floats
from flywheel.rotations import rotate

UNIT_LENGTH = 0.05  # a quaternion may be so far from length 1; others are no rotation


def pose_points(sheets: Sheets, body: str, offset: Floats, how: RecordingMap) -> Found:
    """(N, 3) positions of a point of a body, in the axes and the unit of the file.

    A body that the file does not turn is not turned in the MJCF: its axes are
    renamed as those of the log are.

    Args:
      sheets: all columns.
      body: its name.
      offset: (3,) of the point in the body's frame [m].
      how: the map, which has the body under poses.

    Raises:
      DataError: there are no such columns, or they are no poses.
    """
    pose = how.poses[body]
    position = sheets.needed(pose.source or pose.position or "")
    turned = sheets.rotations(pose.source or pose.rotation or "")
    if turned.source is not position.source:
        raise DataError(f"the position and the rotation of {body} must be in one table.")
    local = np.array(pose.at) + rotate(np.array(pose.turned), offset)
    theirs = how.axes.turned(np.eye(3)) @ local  # [m]
    quaternion = _quaternions(turned.values, pose, turned.source, body)
    apart = rotate(quaternion, theirs) / length_of(position.source, how)
    return Found(position.source, position.values + apart)


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
            turned = Rotation.from_euler(order, values[good], degrees=degrees)
            found[good] = turned.as_quat(scalar_first=True)
    if not good.any():
        raise DataError(f"the rotation of {body} is none in any row: quaternions have length 1.")
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(good[:, None], found / size[:, None], np.nan)
