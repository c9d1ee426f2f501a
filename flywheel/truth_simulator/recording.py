"""A recording with a known answer, and its files."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import mujoco
import numpy as np

from flywheel.records import Floats, Observation, Trajectory
from flywheel.robots import Robot
from flywheel.truth_simulator.contact import Contact
from flywheel.truth_simulator.effect import EffectTruth, HiddenEffect
from flywheel.truth_simulator.measurement import Measurement
from flywheel.truth_simulator.scripts import script
from flywheel.truth_simulator.simulator import TruthSimulator


@dataclass(frozen=True)
class HiddenRecording:
    """The measured motion of a robot with hidden effects, with the truth.

    Attributes:
      robot: its name.
      dt: control step [s].
      time: (T + 1,) [s].
      controls: (T, W) commands sent.
      points: (T + 1, P, 3) measured [m]; NaN where missing.
      winch: (T + 1, W) measured motor positions [m]; NaN without a channel.
      true_points: (T + 1, P, 3) true tracked points [m].
      winch_true: (T + 1, W) true motor positions, as length paid out [m].
      rest_true: (T + 1, C) rest lengths of the cables [m].
      effects: the answers, without the robot's deviations as built.
      script: name of the command script.
      seed: of commands and noise.
      contact: kind of ground contact.
      measurement: its settings.
    """

    robot: str
    dt: float
    time: Floats
    controls: Floats
    points: Floats
    winch: Floats
    true_points: Floats
    winch_true: Floats
    rest_true: Floats
    effects: tuple[EffectTruth, ...]
    script: str
    seed: int
    contact: Contact
    measurement: Measurement

    @property
    def trajectory(self) -> Trajectory:
        """The part of the recording available to a diagnosis, without the truth."""
        return Trajectory(Observation(self.points, self.winch), self.controls, self.dt)

    def write(self, folder: Path, name: str, robot: Robot) -> tuple[Path, Path]:
        """Write `<name>.csv`, in the format of a robot's log, and `<name>.truth.json`.

        Row t of the log has the points at time t and the commands that act until the next row, so
        the last row has none. Unmeasured cells are empty. Motor positions get a column if the MJCF
        names a sensor for them; otherwise they are not in the log.
        """
        folder.mkdir(parents=True, exist_ok=True)
        log, truth = folder / f"{name}.csv", folder / f"{name}.truth.json"
        axes = [f"{point.name}.{axis}" for point in robot.points for axis in "xyz"]
        sensors = _winch_sensors(robot)
        blank = np.full((1, self.controls.shape[1]), np.nan)
        columns = [
            np.round(self.time, 9)[:, None],
            np.concatenate([self.controls, blank]),
            self.points.reshape(len(self.points), -1),
            self.winch[:, list(sensors.values())],
        ]
        commands = [f"ctrl.{winch.name}" for winch in robot.winches]
        with log.open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["time", *commands, *axes, *sensors])
            for row in np.concatenate(columns, axis=1):
                writer.writerow(repr(float(x)) if np.isfinite(x) else "" for x in row)
        truth.write_text(json.dumps(self._truth(), indent=1) + "\n")
        return log, truth

    def _truth(self) -> dict[str, object]:
        words = ("robot", "dt", "script", "seed", "contact")
        arrays = ("true_points", "winch_true", "rest_true")
        return {
            **{name: getattr(self, name) for name in words},
            "effects": [asdict(effect) for effect in self.effects],
            "measurement": asdict(self.measurement),
            **{name: getattr(self, name).tolist() for name in arrays},
        }


def record(
    robot: Robot,
    effects: Sequence[HiddenEffect] = (),
    *,
    script_name: str = "random_steps",
    seconds: float = 3.0,
    seed: int = 0,
    measurement: Measurement | None = None,
    contact: Contact = "elliptic",
) -> HiddenRecording:
    """Let a robot with hidden effects settle, play a script to it, and measure.

    Commands and noise have separate random streams, so that the same seed gives the same commands
    and the same noise for all effects.

    Raises:
      UnknownNameError: no such script.
      ModelError: the simulation diverged, or does not fit the robot.
    """
    measurement = measurement or Measurement()
    for_commands, for_noise = np.random.default_rng(seed).spawn(2)
    controls = script(script_name, robot, seconds, measurement.dt, for_commands)
    motion = TruthSimulator(robot, effects, contact).run(controls, measurement.dt)
    return HiddenRecording(
        robot=robot.name,
        dt=measurement.dt,
        time=measurement.dt * np.arange(len(controls) + 1),
        controls=controls,
        points=measurement.points(motion.seen, robot.length, for_noise),
        winch=measurement.winch(motion.motor, for_noise),
        true_points=motion.points,
        winch_true=motion.motor,
        rest_true=motion.rest,
        effects=tuple(effect.truth(robot) for effect in effects if effect.units),
        script=script_name,
        seed=seed,
        contact=contact,
        measurement=measurement,
    )


def _winch_sensors(robot: Robot) -> dict[str, int]:
    """Sensor -> winch, for those of the MJCF's `user` sensors that measure a winch."""
    model = mujoco.MjSpec.from_string(robot.xml).compile()
    found = {}
    for sensor in range(model.nsensor):
        user = model.sensor_type[sensor] == mujoco.mjtSensor.mjSENS_USER
        if user and model.sensor_objtype[sensor] == mujoco.mjtObj.mjOBJ_ACTUATOR:
            actuator = int(model.sensor_objid[sensor])
            for index, winch in enumerate(robot.winches):
                if actuator in winch.actuators:
                    found[model.sensor(sensor).name] = index
    return found
