"""The trajectories of a table: planned, recorded in a store, split and sealed, tests apart from training."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from itertools import product
from pathlib import Path

import numpy as np

from benchmarks.paper.definition import Cell, Method, TableConfig
from flywheel.control import EpisodeOrder, Playback, record_episode
from flywheel.data import Snapshot, TrajectoryStore
from flywheel.dynamics.plant import Reckoning, RestartedPlant
from flywheel.dynamics.weight_files import digest_of
from flywheel.errors import DataError, RunError
from flywheel.evaluation import HISTORY_SECONDS, past_at
from flywheel.records import Episode, Floats, Split
from flywheel.robot_link import StandIn
from flywheel.robots import load_robot
from flywheel.runtime.workers.episode_plan import ORACLE, EpisodePlan, derive_seed
from flywheel.runtime.workers.episode_recorder import EpisodeRecorder, RobotRecorder
from flywheel.runtime.workers.stored_episodes import EpisodeWinches, committed

RATES = "-rates"
FAST = 1e-6  # of a rate beyond the range of commands, by rounding [m/s]


class DataSets:
    """All trajectories of one robot of a table.

    Args:
      table: the definition.
      robot: its name.
      folder: of the table's results.
    """

    def __init__(self, table: TableConfig, robot: str, folder: Path) -> None:
        self.table, self.config = table, table.config(robot)
        self.robot = load_robot(self.config.model)
        place = self.config.store
        self.store = TrajectoryStore(f"{place}/{robot}" if place else str(folder / robot / "store"))
        self.recorder = EpisodeRecorder(self.config, self.robot)
        self.winches = EpisodeWinches(self.robot)
        self._contents: dict[str, str] = {}

    @cached_property
    def plans(self) -> list[EpisodePlan]:
        """The recorded trajectories, by data set."""
        names = self.table.datasets(self.config.model)
        return [plan for index, name in enumerate(names) for plan in self._plans(name, index)]

    def _plans(self, dataset: str, index: int) -> list[EpisodePlan]:
        table, seed = self.table, self.config.seed
        kinds = [*product(range(table.repetitions), table.robots[self.config.model])]
        learned = len(kinds) - table.tested * len(table.robots[self.config.model])
        decides = learned - table.validation
        splits: list[Split] = [
            "train" if number < decides else "validation" if number < learned else "test"
            for number in range(len(kinds))
        ]
        plans = []
        for (repetition, controller), split in zip(kinds, splits, strict=True):
            name = f"{dataset}-{controller.rpartition(':')[2]}-{repetition}"
            own = derive_seed(seed, "table", name)
            perturbed = table.starts == "perturbed" and controller.startswith("gait:")
            seconds = np.random.default_rng(own).uniform(*table.seconds)
            plans.append(
                EpisodePlan(
                    id=name + "-perturbed" * perturbed,
                    controller=controller,
                    iteration=0,
                    split=split,
                    seconds=round(float(seconds), 2),
                    seed=own,
                    dataset=index,
                    task_seed=own if controller == ORACLE else None,
                    perturbed=perturbed,
                )
            )
        return plans

    @property
    def simulations(self) -> list[tuple[EpisodePlan, int]]:
        """Training recordings, each with the data sets that are simulated with its commands."""
        most = max(method.simulations for method in self.table.methods.values())
        learned = [plan for plan in self.plans if plan.split != "test"]
        return [*product(learned, range(most))]

    def record(self, plan: EpisodePlan) -> None:
        """Record a trajectory, unless the store has it.

        Raises:
          RunError: the stand-in ended it early.
          ModelError: the plant diverged.
        """
        there = committed(self.store, plan.id)
        if there is not None:
            self.recorder.check_own(there)
        episode = there or self._recorded(plan)
        self.store.commit(plan.id, [episode])
        if any(method.true_winches for method in self.table.methods.values()):
            self.store.commit(plan.id + RATES, [self._with_rates(episode)])

    def _recorded(self, plan: EpisodePlan) -> Episode:
        if self.table.real is None:
            return self.recorder.record(plan, None, "")
        link = StandIn(self.robot, self.table.real, self.config.network.dt)
        driven = RobotRecorder(self.config, self.robot, 0).record(link, plan, None, "")
        if driven.ended != "time":
            raise RunError(f"{plan.id} ended early ({driven.ended}): {driven.why}")
        return driven.episode

    def _with_rates(self, episode: Episode) -> Episode:
        """An episode whose commands are the rates of its winches, as they were."""
        track, origin = episode.trajectory, episode.provenance
        if track.states is None:
            raise DataError(f"The true rates of the winches of {episode.id} are unknown.")
        rates = np.diff(self.recorder.plant(0).winch(track.states), axis=0) / track.dt
        if (
            np.abs(np.clip(rates, self.robot.control_low, self.robot.control_high) - rates).max()
            > FAST
        ):
            raise DataError(
                f"The winches of {episode.id} are faster than the MJCF's ctrlrange allows, so their true "
                "rates are no commands. Give plants with a winch_speed of at most 1."
            )
        plant = {name: value for name, value in origin.plant.items() if name != "winch_speed"}
        return replace(
            episode,
            id=episode.id + RATES,
            trajectory=replace(track, controls=rates),
            provenance=replace(origin, plant=plant),
        )

    def simulate(self, plan: EpisodePlan, dataset: int) -> None:
        """Simulate a plant with the start and the commands of a recording, unless the store has it.

        Raises:
          ModelError: the plant diverged.
        """
        data, recording = self.config.datasets[dataset], self.store.read(plan.id)
        name, track = f"{data.name}-{plan.id}", recording.trajectory
        if committed(self.store, name) is not None:
            return
        plant = self.recorder.plant(dataset)
        start = RestartedPlant.from_measurements(plant)
        begin = round(HISTORY_SECONDS / track.dt)
        past = past_at(
            recording, self.robot, begin, start.history, self.robot.winches_of(recording)
        )
        episode = record_episode(
            plant,
            self.config.measurement,
            Playback(self.robot, track.controls[begin:], plan.id),
            None,
            EpisodeOrder(
                name,
                self.recorder.provenance(plan, "", dataset=data.name, plant=data.plant.changed()),
                (track.steps - begin) * track.dt,
                derive_seed(plan.seed, data.name),
                plan.split,
            ),
            start=start.estimate(past),
            reckoning=Reckoning(self.robot, plant.dt, speed=data.plant.winch_speed),
        )
        self.store.commit(name, [episode])

    def snapshots(self, cell: Cell) -> tuple[Snapshot, Snapshot]:
        """Training and test data of a cell, sealed.

        Raises:
          DataError: they share a trajectory, or their manifests have changed.
        """
        method, store = self.table.methods[cell.method], self.store
        names, end = self._segments(cell.dataset, method), method.variant
        places = [cell.dataset] * method.recordings + self._simulated(method)
        train = store.seal(f"train-{cell.dataset}{end}", names["train"], datasets=places)
        test = store.seal(f"test-{cell.dataset}{RATES * method.true_winches}", names["test"])
        self.check_apart(train, test)
        return train, test

    def _segments(self, dataset: str, method: Method) -> dict[str, list[str]]:
        index = self.table.datasets(self.config.model).index(dataset)
        plans = [plan for plan in self.plans if plan.dataset == index]
        end = RATES * method.true_winches
        learned = [plan.id + end for plan in plans if plan.split != "test"]
        made = [f"{data}-{name}" for data, name in product(self._simulated(method), learned)]
        return {
            "train": learned * method.recordings + made,
            "test": [plan.id + end for plan in plans if plan.split == "test"],
        }

    def _simulated(self, method: Method) -> list[str]:
        return [data.name for data in self.config.datasets[: method.simulations]]

    def check_apart(self, train: Snapshot, test: Snapshot) -> None:
        """Check that no tested trajectory is in the training data, under any name.

        Raises:
          DataError: one is; the message names both.
        """
        learned = {self._content(each.id): each.id for each in train.episodes}
        for tested in test.episodes:
            if (same := learned.get(self._content(tested.id))) is not None:
                raise DataError(
                    f"The tested trajectory {tested.id} is also in the training data, as {same}."
                )

    def _content(self, episode: str) -> str:
        """Digest of the measurements and commands of an episode, without its name."""
        if episode not in self._contents:
            track = self.store.read(episode).trajectory
            arrays = [("controls", track.controls), ("points", track.observations.points)]
            self._contents[episode] = digest_of({}, arrays)
        return self._contents[episode]

    def truth(self, episode: Episode) -> Floats:
        """(T + 1, P, 3) points without noise where they are known, else the measured ones [m]."""
        track = episode.trajectory
        if track.states is None:
            return track.observations.points
        return self.recorder.plant(0).observe(track.states).points
