"""Tensions and lengths of cables, and winch positions, as sensors beside the points measure them."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from flywheel.records import ChannelKind, Floats
from flywheel.robots import Robot, add_plain, free_name

ChannelKey = tuple[ChannelKind, str]  # kind, and name of the cable or winch
NEEDED = {
    "winch": (),
    "length": (mujoco.mjtSensor.mjSENS_TENDONPOS,),
    "tension": (
        mujoco.mjtSensor.mjSENS_TENDONPOS,
        mujoco.mjtSensor.mjSENS_TENDONVEL,
        mujoco.mjtSensor.mjSENS_TENDONACTFRC,
    ),
}


class Channels:
    """Sensors of channels, added to a robot's MJCF.

    Args:
      spec: to which they are added.
      robot: of the spec.
      keys: kinds and names.

    Attributes:
      forces: columns of the sensor data that MuJoCo only computes during a step.
    """

    def __init__(self, spec: mujoco.MjSpec, robot: Robot, keys: Sequence[ChannelKey]) -> None:
        self.keys, self._sensors = keys, list[list[str]]()
        parts = {"winch": robot.winches}
        names = [[p.name for p in parts.get(kind, robot.cables)] for kind, _ in keys]
        self._places = [each.index(name) for each, (_, name) in zip(names, keys, strict=True)]
        for kind, cable in keys:
            self._sensors.append([])
            for sensor in NEEDED[kind]:
                name = free_name(cable, spec.sensors)
                target = {"objtype": mujoco.mjtObj.mjOBJ_TENDON, "objname": cable}
                add_plain(spec, "sensor", name=name, type=sensor, **target)
                self._sensors[-1].append(name)

    def compiled(self, model: mujoco.MjModel) -> None:
        """Find the sensors in the compiled spec."""
        self._columns = [[int(model.sensor(n).adr[0]) for n in each] for each in self._sensors]
        self.forces = [each[2] for each in self._columns if len(each) > 2]

    def read(self, sensors: Floats, winch: Floats, models: Sequence[mujoco.MjModel]) -> Floats:
        """(n, T, channels) values [m or N].

        Args:
          sensors: (n, T, S) data.
          winch: (n, T, W) winch positions [m or N].
          models: of each of the n simulations.
        """
        found = np.empty((*sensors.shape[:-1], len(self.keys)))
        for i, ((kind, _), place, columns) in enumerate(
            zip(self.keys, self._places, self._columns, strict=True)
        ):
            if kind == "winch":
                found[..., i] = winch[..., place]
                continue
            seen = sensors[..., columns]
            found[..., i] = seen[..., 0] if kind == "length" else _tension(seen, models, place)
        return found


def _tension(seen: Floats, models: Sequence[mujoco.MjModel], cable: int) -> Floats:
    """(n, T) tension of a cable's own spring and of its actuators [N].

    Args:
      seen: (n, T, 3) its length, speed, and force of actuators, which pull below 0 [m, m/s, N].
      models: of each of the n simulations.
      cable: index of its tendon.
    """
    length, speed, force = np.moveaxis(seen, -1, 0)
    stiffness, slack, damping = (
        np.array([numbers[cable] for numbers in each])[:, None]
        for each in (
            [model.tendon_stiffness for model in models],
            [model.tendon_lengthspring[:, 1] for model in models],
            [model.tendon_damping for model in models],
        )
    )
    return np.asarray(stiffness * np.maximum(length - slack, 0.0) + damping * speed - force)
