"""Checks, before anything starts, that a robot can do what a configuration requests.

All misfits are found at once, each with the override that disables it, so that nobody finds them
one by one after hours.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from flywheel.control import MppiConfig, refuse_fixed
from flywheel.control.gaits import Gait, refuse_other_robots
from flywheel.dynamics.gnn import check_device
from flywheel.dynamics.plant import Plant, Reckoning
from flywheel.dynamics.plant.law_checks import check_laws
from flywheel.errors import ConfigError, ModelError, RobotError
from flywheel.robot_link import StandIn
from flywheel.robot_link.opening import SIMULATED, is_tcp, open_link
from flywheel.robots import Robot, draw_terrain, load_robot
from flywheel.runtime.config.robot_config import RobotConfig
from flywheel.runtime.config.run_config import RunConfig
from flywheel.runtime.run.initial_weights import initial_weights
from flywheel.runtime.workers.episode_plan import (
    GAITS,
    EpisodePlan,
    collection,
    evaluation,
    first_recordings,
    unseen,
)
from flywheel.runtime.workers.episode_recorder import EpisodeRecorder

ENOUGH = 10  # episodes with random controls give training, validation and test data


@dataclass(frozen=True)
class Misfit:
    """A request of a run that its robot cannot fulfil.

    Attributes:
      asked: the setting that requests it.
      why: a sentence with the reason.
      override: `key=value` that disables it.
    """

    asked: str
    why: str
    override: str


def check_suits(config: RunConfig, robot: Robot) -> None:
    """Reject a run that its robot cannot do.

    Raises:
      ConfigError: it requests something that the robot cannot do, and the message has the overrides
        that disable it; iteration 0 would record too little; or a law file cannot be used.
      UnknownNameError: an effect has a place that the robot does not have, or is in no library.
      DataError: an effect cannot be uncertain.
      ModelError: the robot does not come to rest.
      RobotError: the robot has no winch, or winches that take tensions.
    """
    robot.require_winches("run")
    robot.require_rest_lengths("run")
    if config.effects_from:
        config.diagnose.check_names(config.library())
        own = config.library({})
        check_laws(own.values(), Plant(robot, robot.control_steps(config.network.dt)[0]))
    found = misfits(config, robot) or list(_tasks(config, robot))
    if found:
        lines = "\n".join(f"  {misfit.asked}: {misfit.why}" for misfit in found)
        raise ConfigError(
            f"{robot.name} cannot do this run:\n{lines}\nTo leave these out: "
            f"{overrides_without(found)}"
        )
    collection(config, 0, "mppi")
    if config.robot is not None:
        _check_robot(config, config.robot, robot)


def check_new(config: RunConfig, address: str | None) -> None:
    """Reject a run that cannot begin: see `check_devices` and `check_suits`."""
    check_devices(config, address)
    check_suits(config, load_robot(config.model))


def check_devices(config: RunConfig, address: str | None) -> None:
    """Reject a run on a GPU where there is none; in a cluster at `address` its workers ask for it.

    Raises:
      ConfigError: this machine has no such device.
    """
    if address is None:
        check_device(config.training.device, "training.device")
        check_device(config.mppi.device, "mppi.device")


def check_reached(config: RunConfig, robot: Robot, address: str | None) -> None:
    """Reject a run whose robot does not answer at its port, or that wants another device.

    Raises:
      LinkError: it does not, or is another robot.
      ConfigError: see `check_devices`.
    """
    check_devices(config, address)
    link = config.robot
    if link is not None and is_tcp(link.link):
        open_link(link.link, robot, config.network.dt).close()


def _check_robot(config: RunConfig, link: RobotConfig, robot: Robot) -> None:
    """Reject a robot that records too little, or an impossible stand-in.

    Raises:
      ConfigError, UnknownNameError: the message says what is wrong.
    """
    first_recordings(config)
    if link.link != SIMULATED:
        return
    StandIn(robot, link.stand_in, config.network.dt)
    if config.task.name != "reach":
        raise ConfigError(
            "A stand-in has no obstacles around it: task.name must be reach, got "
            f"{config.task.name}."
        )


def misfits(config: RunConfig, robot: Robot, dt: float | None = None) -> list[Misfit]:
    """All requests of a configuration that a robot of this kind cannot fulfil; nothing is simulated.

    Args:
      config: of a run.
      robot: of the run.
      dt: control step to use instead of the configuration's [s].
    """
    step = robot.control_steps(config.network.dt if dt is None else dt)[0]
    found = [*_times(config, robot, step), *_kinds(config, robot)]
    return [*found, *_too_little(config, found)]


def overrides_without(found: list[Misfit]) -> str:
    """The overrides that disable what a robot cannot do, in shell syntax."""
    return shlex.join(dict.fromkeys(misfit.override for misfit in found))


def _kinds(config: RunConfig, robot: Robot) -> Iterator[Misfit]:
    """Misfits with the kind of the robot: fixed, with joints, without gaits."""
    collect, evaluate, terrain = config.collect, config.evaluate, config.terrain

    def fixed() -> None:
        refuse_fixed(robot)

    def jointed(to_be: str) -> Callable[[], None]:
        return lambda: robot.require_free(to_be)

    wanted: list[tuple[object, str, str, Callable[[], object]]] = [
        (
            collect.gaits,
            f"collect.gaits={collect.gaits}",
            "0",
            lambda: _refuse_gaits(config, robot),
        ),
        (
            config.mppi.turning,
            f"mppi.turning={config.mppi.turning}",
            "0",
            lambda: refuse_other_robots(robot),
        ),
        (collect.drops, f"collect.drops={collect.drops}", "0", fixed),
        (config.task.name == "obstacle_course", "task.name=obstacle_course", "reach", fixed),
        (collect.courses, f"collect.courses={_listed(collect.courses)}", "[]", fixed),
        (evaluate.unseen, f"evaluate.unseen={_listed(evaluate.unseen)}", "[]", fixed),
        (
            terrain.kinds,
            f"terrain.kinds={_listed(terrain.kinds)}",
            "[]",
            lambda: _refuse_terrain(config, robot),
        ),
        (evaluate.floor, "evaluate.floor=true", "false", jointed("restarted from its points")),
        (config.diagnose.on, "diagnose.on=true", "false", jointed("diagnosed")),
        (
            config.training.start_from,
            f"training.from={config.training.start_from}",
            "",
            lambda: initial_weights(config, robot),
        ),
        (
            _feels_load(config, robot),
            "effects=...",
            "[]",
            jointed("reckoned with winches that feel their load"),
        ),
    ]
    for asked, setting, instead, check in wanted:
        if asked and (why := _reason(check)):
            yield Misfit(setting, why, f"{setting.partition('=')[0]}={instead}")


def _times(config: RunConfig, robot: Robot, dt: float) -> Iterator[Misfit]:
    """Misfits of times that must be multiples of a time step, with control steps of `dt` [s]."""
    if dt != config.network.dt:
        why = f"It must be a multiple of the time step of {robot.name}, {robot.timestep:g} s."
        yield Misfit(f"network.dt={config.network.dt:g}", why, f"network.dt={dt:.12g}")
    for name in MppiConfig.TIMES:
        seconds = getattr(config.mppi, name)
        count = max(1, round(seconds / dt))
        if not np.isclose(count * dt, seconds, rtol=1e-6):
            why = f"It is not a multiple of the control step of {dt:.12g} s."
            yield Misfit(f"mppi.{name}={seconds:g}", why, f"mppi.{name}={count * dt:.12g}")


def _too_little(config: RunConfig, found: list[Misfit]) -> Iterator[Misfit]:
    """The misfit of iteration 0 with too few episodes, once impossible gaits and drops are left out."""
    overrides = {misfit.override for misfit in found}
    none = {kind: 0 for kind in ("gaits", "drops") if f"collect.{kind}=0" in overrides}
    rest = config.model_copy(update={"collect": config.collect.model_copy(update=none)})
    if none and (why := _reason(lambda: collection(rest, 0, "mppi"))):
        yield Misfit(f"collect.random={config.collect.random}", why, f"collect.random={ENOUGH}")


def _tasks(config: RunConfig, robot: Robot) -> Iterator[Misfit]:
    """Misfits of tasks that cannot be drawn, such as a course that is too narrow for the robot."""
    recorder = EpisodeRecorder(config, robot)

    def why_not(plans: list[EpisodePlan]) -> str:
        return _reason(lambda: recorder.task(plans[0])) if plans else ""

    if why := why_not(evaluation(config, 0, "mppi")):
        yield Misfit(f"task.name={config.task.name}", why, "task.name=reach")
    lists = {"collect.courses": config.collect.courses, "evaluate.unseen": config.evaluate.unseen}
    for setting, courses in lists.items():
        narrow = {name: why for name in courses if (why := why_not(unseen(config, name)))}
        fitting = _listed(tuple(name for name in courses if name not in narrow))
        for course, why in narrow.items():
            yield Misfit(f"{setting}={course}", why, f"{setting}={fitting}")


def _refuse_gaits(config: RunConfig, robot: Robot) -> None:
    """Reject a robot without gaits, or that cannot be dropped: gaits begin with a drop."""
    for gait in GAITS:
        Gait(robot, gait, config.network.dt)
    refuse_fixed(robot)


def _refuse_terrain(config: RunConfig, robot: Robot) -> None:
    """Reject a robot that cannot stand on the ground of a run."""
    robot.require_free("put on ground that is not level")
    rough = tuple(kind for kind in config.terrain.kinds if kind != "flat")
    terrain = config.terrain.model_copy(update={"kinds": rough})
    drawn = draw_terrain(terrain, robot.length, np.random.default_rng(config.seed))
    Plant(robot, robot.timestep, terrain=drawn)


def _feels_load(config: RunConfig, robot: Robot) -> bool:
    """True if the position of an unmeasured winch depends on its load."""
    terms = tuple(effect.term(robot, config.library()) for effect in config.effects)
    reckoning = Reckoning(robot, config.network.dt, terms)
    return reckoning.loaded and not all(winch.measured for winch in robot.winches)


def _reason(check: Callable[[], object]) -> str:
    """Reason why a check fails; "" if it passes."""
    try:
        check()
    except (RobotError, ConfigError, ModelError) as error:
        return str(error)
    return ""


def _listed(names: tuple[str, ...]) -> str:
    return f"[{','.join(names)}]"
