"""The plan of a run's episodes on its robot: like those in `episode_plan`, from the configuration alone."""

from __future__ import annotations

from flywheel.errors import ConfigError
from flywheel.runtime.config.robot_config import RobotConfig
from flywheel.runtime.config.run_config import RunConfig
from flywheel.runtime.workers.episode_plan import (
    GAITS,
    Effects,
    EpisodePlan,
    assigned_splits,
    derive_seed,
)

FIRST = "first"


def robot_prefix(iteration: int) -> str:
    """How the ids of an iteration's episodes on the robot begin."""
    return f"i{iteration:04d}-robot-"


def first_recordings(config: RunConfig, effects: Effects = ()) -> list[EpisodePlan]:
    """The episodes that iteration 0 records on the robot: gaits where it has some, and random controls."""
    robot = _robot(config)
    kinds = ("gait", "random") if config.collect.gaits else ("random",)
    shares = assigned_splits(config, robot.first, robot.validation, robot.test, "robot", FIRST)
    if missing := {"train", "test"} - set(shares):
        raise ConfigError(
            f"The robot would have no {' and no '.join(sorted(missing))} recording in iteration 0. Raise "
            f"robot.first (now {robot.first}), or change robot.validation and robot.test (now "
            f"{robot.validation} and {robot.test})."
        )
    return [
        EpisodePlan(
            id=f"{robot_prefix(0)}{FIRST}-{index:04d}",
            controller=_controller(kinds[index % len(kinds)], index // len(kinds)),
            iteration=0,
            split=split,
            dataset=0,
            seconds=robot.first_seconds,
            seed=derive_seed(config.seed, "robot", FIRST, index),
            effects=effects,
        )
        for index, split in enumerate(shares)
    ]


def drives(
    config: RunConfig, iteration: int, planner: str, effects: Effects = ()
) -> list[EpisodePlan]:
    """The episodes to goals that a planner drives in an iteration; every planner has the same goals.

    Args:
      config: of the run.
      iteration: of which the planner's model is.
      planner: its name.
      effects: that the plant is known to have.
    """
    robot = _robot(config)
    shares = assigned_splits(config, robot.drives, robot.validation, robot.test, "robot", iteration)
    return [
        EpisodePlan(
            id=f"{robot_prefix(iteration)}{planner}-{index:04d}",
            controller="mppi",
            iteration=iteration,
            split=split,
            dataset=0,
            seconds=config.task.seconds,
            seed=derive_seed(config.seed, "robot", iteration, index),
            task_seed=derive_seed(config.seed, "evaluate-task", index),
            effects=config.effects if planner == "given" else effects,
        )
        for index, split in enumerate(shares)
    ]


def _controller(kind: str, number: int) -> str:
    return f"gait:{GAITS[number % len(GAITS)]}" if kind == "gait" else kind


def _robot(config: RunConfig) -> RobotConfig:
    assert config.robot is not None, "only a run with a robot records on it"
    return config.robot
