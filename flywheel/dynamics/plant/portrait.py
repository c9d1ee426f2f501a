"""A picture of a robot at its keyframe, and where its parts are in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from flywheel.dynamics.plant.render import Shot
from flywheel.dynamics.plant.world import scene
from flywheel.records import Floats
from flywheel.robots import Attachment, Robot

MARGIN = 1.15  # times the space of the robot that is in the picture
SHOT = Shot(size=(1280, 960), azimuth=110.0, elevation=-15.0)


@dataclass(frozen=True)
class Label:
    """A name in a picture.

    Attributes:
      kind: of the part; a cable of a winch has both names.
      text: the name.
      at: (2,) where the part is, from the left and from the top [pixels].
    """

    kind: Literal["body", "cable", "point"]
    text: str
    at: Floats


def portrait(robot: Robot) -> tuple[NDArray[np.uint8], tuple[Label, ...]]:
    """Pixels (height, width, 3) of a robot at its keyframe with the ends of its cables, and names in it."""
    model = scene(robot).compile()
    width, height = SHOT.size
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    data = mujoco.MjData(model)
    data.qpos[:], data.act[:] = robot.keyframe.qpos, robot.keyframe.act
    mujoco.mj_forward(model, data)

    def place(end: Attachment) -> Floats:
        if end.body < 0:
            return end.offset
        body = data.body(robot.bodies[end.body].name)
        return np.asarray(body.xpos + body.xmat.reshape(3, 3) @ end.offset)

    ends = np.array([[place(end) for end in cable.ends] for cable in robot.cables])
    points = np.array([data.site(_site(model, point.name)).xpos for point in robot.points])
    bodies = np.array([data.body(body.name).xipos for body in robot.bodies])
    view = _View(np.concatenate([ends.reshape(-1, 3), points, bodies]), model)
    with mujoco.Renderer(model, height=height, width=width) as renderer:
        renderer.update_scene(data, view.camera)
        pixels = renderer.render()
    names = [
        f"{cable.name} ({robot.winches[cable.winch].name})" if cable.winch >= 0 else cable.name
        for cable in robot.cables
    ]
    labels = [Label("cable", n, view.at(e.mean(axis=0))) for n, e in zip(names, ends, strict=True)]
    labels += [
        Label("point", p.name, view.at(at)) for p, at in zip(robot.points, points, strict=True)
    ]
    labels += [
        Label("body", b.name, view.at(at)) for b, at in zip(robot.bodies, bodies, strict=True)
    ]
    return pixels, tuple(labels)


def _site(model: mujoco.MjModel, sensor: str) -> int:
    """The site of a framepos sensor."""
    return int(model.sensor(sensor).objid[0])


class _View:
    """A camera from which places (N, 3) are all seen [m]."""

    def __init__(self, places: Floats, model: mujoco.MjModel) -> None:
        middle = (places.min(axis=0) + places.max(axis=0)) / 2
        far = MARGIN * max(float(np.linalg.norm(places - middle, axis=1).max()), 1e-3)
        half = np.deg2rad(model.vis.global_.fovy) / 2
        self.camera = mujoco.MjvCamera()
        self.camera.lookat[:] = middle
        self.camera.distance = distance = far / np.sin(half)
        self.camera.azimuth, self.camera.elevation = SHOT.azimuth, SHOT.elevation
        a, e = np.deg2rad([SHOT.azimuth, SHOT.elevation])
        self._ahead = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        self._right = np.array([np.sin(a), -np.cos(a), 0.0])
        self._up = np.cross(self._right, self._ahead)
        self._eye = middle - distance * self._ahead
        self._size, self._focus = np.array(SHOT.size), SHOT.size[1] / 2 / np.tan(half)

    def at(self, place: Floats) -> Floats:
        """Where a place (3,) is in the picture (2,) [pixels]."""
        apart = place - self._eye
        seen = np.array([apart @ self._right, -(apart @ self._up)]) / (apart @ self._ahead)
        return np.asarray(self._size / 2 + self._focus * seen)
