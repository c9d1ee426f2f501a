"""A robot that lacks nothing but an edit of its MJCF, stepped and logged in plain MuJoCo.

Whoever tries a diagnosis first does this: change the file, or the commands, run `mj_step`, write a CSV.
Nothing here comes from the plant, its effects, or the simulator that hides them.
"""

import csv
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

STEP, CONTROL_STEP, SETTLING = 0.001, 0.01, 1.0  # [s]
HOLD = (10, 40)  # control steps between two commands
SHARE = 0.7  # of the largest command, that commands reach: MuJoCo clips what is beyond
NOISE = 0.003  # of the robot's length

Floats = NDArray[np.float64]
Spec = mujoco.MjSpec


@dataclass(frozen=True)
class Edit:
    """What was done to a robot.

    Attributes:
      effect: what that is called in the library.
      location: where.
      value: how much, in the library's unit.
      of_spec: done to the MJCF.
      of_commands: (T, W) commands at every step -> those that winches get.
    """

    effect: str
    location: str
    value: float
    of_spec: Callable[[Spec], None] = lambda spec: None
    of_commands: Callable[[Floats], Floats] = field(default=lambda commands: commands)


def weak_cable(spec: Spec, rng: np.random.Generator) -> Edit:
    """A passive cable with less stiffness."""
    name, share = (
        rng.choice([t.name for t in spec.tendons if "long" in t.name]),
        rng.uniform(0.3, 0.5),
    )

    def edit(spec: Spec) -> None:
        tendon = spec.tendon(name)
        tendon.stiffness = np.multiply(tendon.stiffness, 1.0 - share)

    return Edit("weak_cable", str(name), share, edit)


def payload(spec: Spec, rng: np.random.Generator) -> Edit:
    """A heavier cap."""
    number, mass = rng.integers(len(spec.sensors)), rng.uniform(60.0, 100.0)

    def edit(spec: Spec) -> None:
        (cap,) = (g for g in spec.geoms if g.name == f"cap{number}")
        cap.mass += mass

    return Edit("payload", f"s{number}", mass, edit)


def ground_friction(spec: Spec, rng: np.random.Generator) -> Edit:
    """Smoother caps on smoother ground."""
    share = rng.uniform(0.4, 0.6)

    def edit(spec: Spec) -> None:
        for geom in spec.geoms:
            geom.friction = [geom.friction[0] * (1.0 - share), *geom.friction[1:]]

    return Edit("ground_friction", "", -share, edit)


def command_delay(spec: Spec, rng: np.random.Generator) -> Edit:
    """Commands that come later."""
    steps = int(rng.integers(30, 60))
    return Edit(
        "command_delay",
        "",
        steps * STEP,
        of_commands=lambda told: np.concatenate([np.zeros_like(told[:steps]), told[:-steps]]),
    )


def actuator_lag(spec: Spec, rng: np.random.Generator) -> Edit:
    """Winches that follow their commands like a filter of first order."""
    time = rng.uniform(0.03, 0.06)

    def edit(told: Floats) -> Floats:
        rates, rate = np.empty_like(told), np.zeros(told.shape[1])
        for step, command in enumerate(told):
            rate = rate + STEP / time * (command - rate)
            rates[step] = rate
        return rates

    return Edit("actuator_lag", "", time, of_commands=edit)


def winch_gain(spec: Spec, rng: np.random.Generator) -> Edit:
    """Thicker or thinner drums."""
    share = float(rng.uniform(0.15, 0.3) * rng.choice([-1.0, 1.0]))
    return Edit("winch_gain", "", share, of_commands=lambda told: told * (1.0 + share))


EDITS = (weak_cable, payload, ground_friction, command_delay, actuator_lag, winch_gain)


def record(mjcf: str, edit: Edit, seconds: float, rng: np.random.Generator, path: Path) -> None:
    """Log an edited robot under random commands."""
    spec = Spec.from_string(mjcf)
    spec.option.timestep = STEP
    edit.of_spec(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, round(SETTLING / STEP))
    told = _commands(round(seconds / CONTROL_STEP), model.actuator_ctrlrange, rng)
    every = round(CONTROL_STEP / STEP)
    points = []
    for step, command in enumerate(edit.of_commands(np.repeat(told, every, axis=0))):
        if step % every == 0:
            points.append(_seen(model, data))
        data.ctrl[:] = command
        mujoco.mj_step(model, data)
    points.append(_seen(model, data))
    _write(path, model, told, _noisy(np.array(points), rng))


def _commands(count: int, limits: Floats, rng: np.random.Generator) -> Floats:
    """(count, W), each winch's held for a while."""
    told = np.empty((count, len(limits)))
    for winch, (low, high) in enumerate(limits):
        begun = 0
        while begun < count:
            end = begun + int(rng.integers(*HOLD))
            told[begun:end, winch] = SHARE * rng.uniform(low, high)
            begun = end
    return told


def _seen(model: mujoco.MjModel, data: mujoco.MjData) -> Floats:
    """(P, 3) where tracked points are now: `sensordata` is older by a step."""
    mujoco.mj_kinematics(model, data)
    return data.site_xpos[model.sensor_objid].copy()


def _noisy(points: Floats, rng: np.random.Generator) -> Floats:
    """(T, P, 3) as measured."""
    first = points[0]
    length = np.linalg.norm(first[1] - first[0])
    return points + rng.normal(0.0, NOISE * length, points.shape)


def _write(path: Path, model: mujoco.MjModel, told: Floats, points: Floats) -> None:
    winches = [f"ctrl.{model.actuator(k).name}" for k in range(model.nu)]
    sensors = [f"{model.sensor(k).name}.{axis}" for k in range(model.nsensor) for axis in "xyz"]
    nothing = [""] * model.nu  # the commands of the last row act on nothing
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["time", *winches, *sensors])
        for step, seen in enumerate(points):
            commands = told[step] if step < len(told) else nothing
            rows.writerow([f"{step * CONTROL_STEP:.2f}", *commands, *seen.ravel()])
