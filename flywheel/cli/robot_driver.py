"""What `flywheel drive` does: episodes on a robot behind a link, one at a time."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flywheel import __version__
from flywheel.cli.driver import config_of, known_effects, network_of
from flywheel.cli.drives import Drive as DriveLine
from flywheel.cli.drives import Setting
from flywheel.control import Mppi
from flywheel.control.drive import Drive, drive
from flywheel.dynamics.plant import Reckoning, RestartedPlant
from flywheel.dynamics.protocol import Dynamics
from flywheel.effects import Terms
from flywheel.errors import ConfigError
from flywheel.records import Episode, Floats, Provenance
from flywheel.robot_link import RobotLink, Sample, StandInConfig
from flywheel.robot_link.opening import SIMULATED, open_link
from flywheel.runtime.config.run_config import config_digest
from flywheel.runtime.pool.progress import Stage
from flywheel.runtime.results import Walk
from flywheel.runtime.run.folder import RunFolder
from flywheel.runtime.workers.episode_recorder import EpisodeRecorder
from flywheel.tasks import Task, sample_task

PLANT = "plant"
WALK_SECONDS = 0.5  # between two points of a path that is shown [s]


class RobotDriver:
    """Drives a robot with MPPI.

    Args:
      source: folder of a run, or file of a configuration.
      overrides: "key=value" on top of it.
      model: "champion", an iteration of the run, or "plant": the MJCF with the effects that are known.
      where: the robot is, see `open_link`.
      stand_in: what it is, if it is simulated.
      arguments: of a link of one's own.

    Raises:
      ConfigError: nothing can be driven like that.
      LinkError: the robot is not there, or is another one.
    """

    def __init__(
        self,
        source: Path,
        overrides: tuple[str, ...],
        model: str,
        where: str,
        stand_in: StandInConfig,
        arguments: Mapping[str, Any],
    ) -> None:
        threads = f"sim_threads={len(os.sched_getaffinity(0))}"  # nothing else runs beside it
        self.config, self.model, self.where = config_of(source, [threads, *overrides]), model, where
        if where == SIMULATED and self.config.task.name != "reach":
            raise ConfigError(
                "A stand-in has no obstacles around it: task.name must be reach, got "
                f"{self.config.task.name}."
            )
        self.recorder = EpisodeRecorder(self.config, RunFolder(source).robot(self.config))
        self.robot = self.recorder.robot
        self._effects = known_effects(source, self.config, overrides)
        self._dynamics, self._digest = self._model(source)
        self.link: RobotLink = open_link(
            where, self.robot, self.config.network.dt, stand_in, arguments
        )

    def _model(self, source: Path) -> tuple[Dynamics, str]:
        if self.model == PLANT:
            return RestartedPlant(self.recorder.plant(0, self._effects), roll="relaxed"), ""
        network, digest = network_of(source, self.config, self.recorder, self.model, PLANT)
        if network is None:
            raise ConfigError(
                f"Nobody knows a robot's state, which --model {self.model} needs; take {PLANT}."
            )
        return network, digest

    @property
    def _terms(self) -> Terms:
        return tuple(effect.term(self.robot, self.recorder.library) for effect in self._effects)

    def drive(self, seed: int, stage: Stage) -> Drive:
        """Drive one episode; however it ends, what was measured is in the result.

        Args:
          seed: of task, planner and, where simulated, of the sensors.
          stage: shows how far it is.
        """
        config, dt = self.config, self.config.network.dt
        mppi = Mppi(self._dynamics, config.mppi, "mppi", self._digest)
        lead = config.mppi.steps(dt)["replan_seconds"] if self.link.info.real_time else 0
        steps = max(1, round(config.task.seconds / dt))
        self._task: Task | None = None

        def task_of(points: Floats) -> Task:
            rng = np.random.default_rng(seed)
            self._task = sample_task(config.task.name, self.robot, points, rng, config.task)
            return self._task

        def on_step(done: int, sample: Sample) -> None:
            stage.update(min(1.0, done / steps))

        return drive(
            self.link,
            self.robot,
            mppi,
            task_of,
            seconds=config.task.seconds,
            seed=seed,
            episode_id=f"drive-{self.model}-{seed}",
            provenance=self._provenance(seed),
            split="train",
            lead=lead,
            reckoning=Reckoning(self.robot, dt, self._terms),
            on_step=on_step,
        )

    def line(self, seed: int, driven: Drive, begun: float) -> DriveLine:
        """A drive as a line of the results.

        Args:
          seed: of the drive.
          driven: what came of it.
          begun: `time.process_time()` before it [s].
        """
        task, episode = self._task, driven.episode
        assert task is not None, "a drive begins with its task"
        plans = episode.telemetry.get("plan_seconds", np.zeros(1))
        middle, late = np.quantile(plans, [0.5, 0.95])
        return DriveLine(
            setting=self.setting,
            seed=seed,
            walk=self._walk(task, episode, seed),
            seconds_allowed=task.seconds,
            tolerance=task.tolerance,
            plan_seconds=(round(float(middle), 4), round(float(late), 4)),
            cpu_seconds=round(time.process_time() - begun, 2),
        )

    @property
    def setting(self) -> Setting:
        """What drives, and where."""
        config = self.config
        return Setting(
            robot=self.robot.name,
            task=config.task.name,
            model=self.model,
            digest=self._digest,
            effects=tuple(effect.label for effect in self._effects),
            samples=config.mppi.samples,
            horizon_seconds=config.mppi.horizon_seconds,
            threads=config.sim_threads,
            config=config_digest(config),
            link=self.where,
        )

    def _walk(self, task: Task, episode: Episode, seed: int) -> Walk:
        outcome, trajectory = episode.outcome, episode.trajectory
        assert outcome is not None, "a drive to a goal has an outcome"
        points = trajectory.observations.points
        seen = points[np.isfinite(points).all(axis=(1, 2))]
        centre = task.place(seen[:: max(1, round(WALK_SECONDS / trajectory.dt))])
        return Walk(
            path=tuple((float(x), float(y)) for x, y in np.round(centre, 4)),
            goal=(float(task.last_goal[0]), float(task.last_goal[1])),
            reached=outcome.success,
            seconds=outcome.seconds,
            distance=outcome.distance,
            seed=seed,
            obstacles=task.obstacles,
        )

    def _provenance(self, seed: int) -> Provenance:
        return Provenance(
            robot=self.robot.digest,
            source="recording",
            dataset="recording",
            controller="mppi",
            model=self._digest,
            task=self.config.task.name,
            seed=seed,
            config=config_digest(self.config),
            code=__version__,
        )
