"""What `flywheel drive` does: episodes on a robot behind a link, one at a time."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flywheel.cli.driving.driver import config_of, known_effects, network_of
from flywheel.cli.driving.drives import Drive as DriveLine
from flywheel.cli.driving.drives import Setting
from flywheel.control.drive import Drive, without_gaps
from flywheel.dynamics.gnn.shipped import SHIPPED
from flywheel.dynamics.plant import RestartedPlant
from flywheel.dynamics.protocol import Dynamics
from flywheel.errors import ConfigError
from flywheel.robot_link import RobotLink, Sample, StandInConfig, TranscribedLink
from flywheel.robot_link.opening import SIMULATED, open_link
from flywheel.runtime.config.run_config import config_digest
from flywheel.runtime.pool.progress import Stage
from flywheel.runtime.run.folder import RunFolder
from flywheel.runtime.workers.episode_plan import EpisodePlan
from flywheel.runtime.workers.episode_recorder import EpisodeRecorder
from flywheel.runtime.workers.model_weights import TrainedModel, dynamics_of
from flywheel.runtime.workers.robot_recorder import RobotRecorder

PLANT, RESIDUAL = "plant", "residual"


class RobotDriver:
    """Drives a robot with MPPI.

    Args:
      source: folder of a run, or file of a configuration.
      overrides: "key=value" on top of it.
      model: "champion", an iteration of the run, "plant" (the MJCF with the effects that are known),
        "residual" (that plant with the network that corrects it), "shipped", or a file of weights.
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
        self._stand_in = stand_in if where == SIMULATED else None
        if where == SIMULATED and self.config.task.name != "reach":
            raise ConfigError(
                "A stand-in has no obstacles around it: task.name must be reach, got "
                f"{self.config.task.name}."
            )
        self.robot = RunFolder(source).robot(self.config)
        # A shipped network knows no recordings; the plant of the MJCF is its first data set.
        dataset = 0 if model == SHIPPED else None
        self._recorder = RobotRecorder(self.config, self.robot, dataset)
        self._effects = known_effects(source, self.config, overrides)
        self._dynamics, self._digest = self._model(source)
        self.link: RobotLink = open_link(
            where, self.robot, self.config.network.dt, stand_in, arguments
        )

    def _model(self, source: Path) -> tuple[Dynamics, str]:
        if self.model == PLANT:
            plant = EpisodeRecorder(self.config, self.robot).plant(0, self._effects)
            return RestartedPlant.from_measurements(plant), ""
        if (path := self._file(source)) is not None:
            weights = TrainedModel.read(self.model, path, self.robot).weights
            threads, library = self.config.sim_threads, self.config.library()
            return dynamics_of(weights, self.robot, threads, library), weights.digest
        network, digest = network_of(source, self.config, self.robot, self.model, PLANT)
        if network is None:
            raise ConfigError(
                f"Nobody knows a robot's state, which --model {self.model} needs; take {PLANT}."
            )
        return network, digest

    def _file(self, source: Path) -> Path | None:
        """The file of weights that the model is, or the last residual model of the run."""
        if self.model != RESIDUAL:
            return path if (path := Path(self.model)).is_file() else None
        folder = RunFolder(source)
        paths = [folder.residual(i) for i in range(self.config.iterations, -1, -1)]
        found = next((path for path in paths if path.exists()), None)
        if found is None:
            raise ConfigError(
                f"{source} has no residual model: no run was made there with residual.on."
            )
        return found

    def drive(self, seed: int, stage: Stage, transcript: Path) -> Drive:
        """Drive one episode; however it ends, what was measured is in the result.

        Args:
          seed: of task, planner and, where simulated, of the sensors.
          stage: shows how far it is.
          transcript: file for what goes over the link, which stays if this process is killed.
        """
        plan = self._plan(seed)
        steps = max(1, round(plan.seconds / self.config.network.dt))

        def on_step(done: int, sample: Sample) -> None:
            stage.update(min(1.0, done / steps))

        link = TranscribedLink(self.link, transcript)
        try:
            return self._recorder.record(link, plan, self._dynamics, self._digest, on_step)
        finally:
            link.end()

    def _plan(self, seed: int) -> EpisodePlan:
        return EpisodePlan(
            id=f"drive-{Path(self.model).stem}-{seed}",
            controller="mppi",
            iteration=-1,
            split="train",
            dataset=0,
            seconds=self.config.task.seconds,
            seed=seed,
            task_seed=seed,
            effects=self._effects,
        )

    def line(self, seed: int, driven: Drive, begun: float) -> DriveLine:
        """A drive as a line of the results.

        Args:
          seed: of the drive.
          driven: what came of it.
          begun: `time.process_time()` before it [s].
        """
        plan, episode = self._plan(seed), driven.episode
        task = self._recorder.task(plan, without_gaps(episode.trajectory.observations.points[0]))
        walk = self._recorder.walk(plan, episode)
        assert task is not None and walk is not None, "an episode to a goal has both"
        plans = episode.telemetry.get("plan_seconds", np.zeros(1))
        middle, late = np.quantile(plans, [0.5, 0.95])
        return DriveLine(
            setting=self.setting,
            seed=seed,
            walk=walk,
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
            hidden=() if self._stand_in is None else self._stand_in.hidden,
            samples=config.mppi.samples,
            horizon_seconds=config.mppi.horizon_seconds,
            threads=config.sim_threads,
            config=config_digest(config),
            link=self.where if self._stand_in is None else _sensors(self._stand_in),
        )


def _sensors(stand_in: StandInConfig) -> str:
    """A stand-in and its sensors: "simulated, noise 0.003"."""
    values = stand_in.model_dump(exclude={"hidden"})
    usual = StandInConfig().model_dump()
    changed = [f"{name} {value}" for name, value in values.items() if value != usual[name]]
    return ", ".join([SIMULATED, *changed])
