"""The plant compared with bare `mujoco.rollout` on the same model, for `python -m benchmarks.speed`."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from flywheel.dynamics.plant.plant import FULL, Plant
from flywheel.dynamics.plant.world import scene
from flywheel.robots import Robot

SIMULATIONS = 32
STEPS = 100


def contenders(
    robot: Robot, threads: int, simulations: int = SIMULATIONS, steps: int = STEPS
) -> dict[str, Callable[[], object]]:
    """Two calls that simulate the same: `plant` through this package, `bare` directly in MuJoCo.

    Each call makes `simulations * steps` control steps. Controls are random; start is the keyframe.
    """
    plant = Plant(robot, threads=threads)
    rng = np.random.default_rng(0)
    size = (simulations, steps, len(robot.winches))
    controls = rng.uniform(robot.control_low, robot.control_high, size)
    start = plant.rest(simulations)

    model = scene(robot).compile()
    data = [mujoco.MjData(model) for _ in range(threads)]
    for each in data:
        mujoco.mj_resetDataKeyframe(model, each, 0)
    packed = np.empty(mujoco.mj_stateSize(model, FULL))
    mujoco.mj_getState(model, data[0], packed, FULL)
    packed = np.repeat(packed[None], simulations, axis=0)
    commands = np.zeros((simulations, steps, model.nu))
    commands[..., [w.actuators[0] for w in robot.winches]] = controls
    commands = np.repeat(commands, plant.substeps, axis=1)
    engine = Rollout(nthread=threads if threads > 1 else 0)
    return {
        "plant": lambda: plant.simulate(start, controls),
        "bare": lambda: engine.rollout([model], data, packed, commands),
    }
