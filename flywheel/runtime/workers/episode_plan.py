"""The plan of a run's episodes: names, seeds and splits, from the configuration alone.

The plan depends on the configuration alone, so that a resumed run knows the missing episodes.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from flywheel.effects import WrittenTerm
from flywheel.errors import ConfigError
from flywheel.records import Split
from flywheel.results import Arm
from flywheel.runtime.config.robot_config import RobotConfig
from flywheel.runtime.config.run_config import RunConfig

GAITS = ("roll", "cw", "ccw")
ORACLE = "oracle"
ASTAR = "astar"
FIRST = "first"  # recordings on a robot
# Divides the time step of icosa6, 5 ms, to about 1 ms, below which contacts hardly change any more.
STAND_IN_FINENESS = 4
Effects = tuple[WrittenTerm, ...]


@dataclass(frozen=True)
class EpisodePlan:
    """One episode to be recorded. Its segment in the store has the same name.

    Attributes:
      id: of the episode ("i0001-mppi-collect-0003").
      controller: "gait:roll", "random", "drop", "throw", "mppi", "oracle" or "astar".
      iteration: of the episode; -1 for the oracle's.
      split: fixed here, before anything is known about the episode.
      seconds: longest duration [s].
      seed: of start, controls, noise and planner.
      dataset: index of its plant in the configuration's data sets.
      task_seed: of the task; None without a task. Evaluation uses the same seeds in every
        iteration.
      effects: of the plant, beyond its MJCF.
      samples: plans that MPPI samples at a time; None for the configured number.
      course: of its task, or by one of whose boxes it begins; "" for the configured task, or none.
      hidden: true effects of the plant, if it stands in for a real robot. Learning, planning and
        reckoning receive `effects` instead. None without hidden effects.
      perturbed: it begins near the keyframe, tilted, in place of a gait's random drop.
    """

    id: str
    controller: str
    iteration: int
    split: Split
    seconds: float
    seed: int
    dataset: int = 0
    task_seed: int | None = None
    effects: Effects = ()
    samples: int | None = None
    course: str = ""
    hidden: Effects | None = None
    perturbed: bool = False

    @property
    def plant_effects(self) -> Effects:
        """The true effects of the plant."""
        return self.effects if self.hidden is None else self.hidden

    @property
    def fineness(self) -> int:
        """Ratio of the MJCF's time step to the plant's.

        A stand-in for a real robot must not share the time steps of the model, because their
        influence on contacts is absent from real recordings.
        """
        return 1 if self.hidden is None else STAND_IN_FINENESS


def collection(
    config: RunConfig, iteration: int, arm: Arm, effects: Effects = (), anew: bool = False
) -> list[EpisodePlan]:
    """The new episodes of an iteration of an arm.

    Args:
      config: of the run.
      iteration, arm: of the episodes.
      effects: of the plant.
      anew: True after a change of the plant: the gaits, random controls and drops of iteration 0
        are recorded again, once for all arms.
    """
    if iteration == 0:
        return _first_collection(config, effects)
    again = list(_first_episodes(config, effects, iteration)) if anew else []
    return again + _further(config, iteration, arm, effects)


def _further(config: RunConfig, iteration: int, arm: Arm, effects: Effects) -> list[EpisodePlan]:
    collect = config.collect
    splits = assigned_splits(config, collect.mppi, collect.validation, 0.0, iteration)
    mppi = arm == "mppi"
    return [
        EpisodePlan(
            id=f"i{iteration:04d}-{arm}-collect-{index:04d}",
            controller="mppi" if mppi else "random",
            iteration=iteration,
            split=split,
            seconds=collect.mppi_seconds,
            # Both arms begin from the same starts.
            seed=derive_seed(config.seed, "collect", iteration, index),
            task_seed=derive_seed(config.seed, "collect-task", iteration, index) if mppi else None,
            effects=effects,
            samples=collect.mppi_samples if mppi else None,
            course=_in_turn(collect.courses, index),
        )
        for index, split in enumerate(splits)
    ]


def evaluation(
    config: RunConfig, iteration: int, arm: Arm, effects: Effects = ()
) -> list[EpisodePlan]:
    """The closed-loop episodes for the evaluation of a model, which are test data; every iteration
    has the same tasks.
    """
    return _navigation(config, f"i{iteration:04d}-{arm}-evaluate", "mppi", iteration, effects)


def ceiling(config: RunConfig, effects: Effects = ()) -> list[EpisodePlan]:
    """The evaluation tasks, for the planner that knows the plant itself."""
    if not config.evaluate.oracle or config.robot is not None:  # nobody knows the robot
        return []
    return _navigation(config, ORACLE, ORACLE, -1, effects)


def unseen(config: RunConfig, course: str, effects: Effects = ()) -> list[EpisodePlan]:
    """Closed-loop episodes of the last champion on another course than the run's."""
    return _navigation(config, unseen_name(course), "mppi", -1, effects, course)


def unseen_ceiling(config: RunConfig, course: str, effects: Effects = ()) -> list[EpisodePlan]:
    """The same course, for the planner that knows the plant itself."""
    if not config.evaluate.oracle:
        return []
    name = f"{unseen_name(course)}-{ORACLE}"
    return _navigation(config, name, ORACLE, -1, effects, course)


def unseen_name(course: str) -> str:
    """The name of a course in episode ids; a path becomes a hash, because ids are short."""
    return f"unseen-{zlib.crc32(course.encode()):08x}" if "." in course else f"unseen-{course}"


def _navigation(
    config: RunConfig,
    name: str,
    controller: str,
    iteration: int,
    effects: Effects,
    course: str = "",
) -> list[EpisodePlan]:
    return [
        EpisodePlan(
            id=f"{name}-{index:04d}",
            controller=controller,
            iteration=iteration,
            split="test",
            seconds=config.task.seconds,
            seed=derive_seed(config.seed, "evaluate", index),
            task_seed=derive_seed(config.seed, "evaluate-task", index),
            effects=effects,
            course=course,
        )
        for index in range(config.evaluate.tasks)
    ]


def robot_prefix(iteration: int) -> str:
    """Common prefix of the ids of an iteration's episodes on the robot."""
    return f"i{iteration:04d}-robot-"


def first_recordings(config: RunConfig) -> list[EpisodePlan]:
    """The episodes of iteration 0 on the robot: gaits if it has any, and random controls."""
    robot = _robot(config)
    kinds = ("gait", "random") if config.collect.gaits else ("random",)
    shares = assigned_splits(config, robot.first, robot.validation, robot.test, "robot", FIRST)
    if missing := {"train", "test"} - set(shares):
        raise ConfigError(
            f"Iteration 0 would have no {' and no '.join(sorted(missing))} recording of the "
            f"robot. Raise robot.first (now {robot.first}), or change robot.validation and "
            f"robot.test (now {robot.validation} and {robot.test})."
        )
    return [
        EpisodePlan(
            id=f"{robot_prefix(0)}{FIRST}-{index:04d}",
            controller=_controller(kinds[index % len(kinds)], index // len(kinds)),
            iteration=0,
            split=split,
            seconds=robot.first_seconds,
            seed=derive_seed(config.seed, "robot", FIRST, index),
        )
        for index, split in enumerate(shares)
    ]


def robot_drives(
    config: RunConfig, iteration: int, planner: str, effects: Effects = ()
) -> list[EpisodePlan]:
    """A planner's episodes to goals in an iteration; every planner has the same goals.

    Args:
      config: of the run.
      iteration: of the planner's model.
      planner: its name.
      effects: known effects of the plant.
    """
    robot = _robot(config)
    shares = assigned_splits(config, robot.drives, robot.validation, robot.test, "robot", iteration)
    return [
        EpisodePlan(
            id=f"{robot_prefix(iteration)}{planner}-{index:04d}",
            controller="mppi",
            iteration=iteration,
            split=split,
            seconds=config.task.seconds,
            seed=derive_seed(config.seed, "robot", iteration, index),
            task_seed=derive_seed(config.seed, "evaluate-task", index),
            effects=config.effects if planner == "given" else effects,
        )
        for index, split in enumerate(shares)
    ]


def _first_collection(config: RunConfig, effects: Effects) -> list[EpisodePlan]:
    plans = list(_first_episodes(config, effects, 0))
    present = {plan.split for plan in plans}
    if missing := {"train", "validation", "test"} - present:
        raise ConfigError(
            f"Iteration 0 would record no {' and no '.join(sorted(missing))} episode. Raise "
            "collect.gaits, collect.random or collect.drops, or the shares collect.validation "
            f"(now {config.collect.validation}) and collect.test (now {config.collect.test})."
        )
    return plans


def _first_episodes(config: RunConfig, effects: Effects, iteration: int) -> Iterator[EpisodePlan]:
    collect = config.collect
    kinds = (
        ("gait", collect.gaits, collect.gait_seconds),
        ("random", collect.random, collect.random_seconds),
        ("drop", collect.drops, collect.drop_seconds),
    )
    for kind, count, seconds in kinds:
        splits = assigned_splits(config, count, collect.validation, collect.test, 0, kind)
        for index, split in enumerate(splits):
            yield EpisodePlan(
                id=f"i{iteration:04d}-{kind}-{index:04d}",
                controller=_controller(kind, index),
                iteration=iteration,
                split=split,
                dataset=index % len(config.datasets),
                seconds=seconds,
                seed=derive_seed(config.seed, "collect", 0, kind, index),
                effects=effects,
                course=_in_turn(collect.courses, index // len(config.datasets)),
            )


def _in_turn(courses: Sequence[str], number: int) -> str:
    return courses[number % len(courses)] if courses else ""


def _controller(kind: str, number: int) -> str:
    return f"gait:{GAITS[number % len(GAITS)]}" if kind == "gait" else kind


def _robot(config: RunConfig) -> RobotConfig:
    assert config.robot is not None, "only a run with a robot records on it"
    return config.robot


def assigned_splits(
    config: RunConfig, count: int, validation: float, test: float, *what: str | int
) -> list[Split]:
    """The split of each of `count` episodes. Fractions are applied to the count, so that few
    episodes give every split.
    """
    splits: list[Split] = ["train"] * count
    order = np.random.default_rng(derive_seed(config.seed, "split", *what)).permutation(count)
    wanted_validation = round(count * validation)
    for rank, index in enumerate(order[: wanted_validation + round(count * test)]):
        splits[index] = "validation" if rank < wanted_validation else "test"
    return splits


def derive_seed(run_seed: int, *what: str | int) -> int:
    """The seed of one job. It depends only on the run's seed and the job's name, never on order or time.

    Args:
      run_seed: of the whole run.
      what: name of the job, e.g. ("collect", 1, "mppi", 3).

    Returns:
      An integer in [0, 2^32), for numpy and for torch.
    """
    words = hashlib.sha256("/".join(str(part) for part in what).encode()).digest()
    entropy = [run_seed, *np.frombuffer(words, dtype=np.uint32).tolist()]
    return int(np.random.SeedSequence(entropy).generate_state(1)[0])
