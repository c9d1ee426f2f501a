"""The worker that drives the robot: the only one that has a link to it."""

from __future__ import annotations

from pathlib import Path

from flywheel.data import TrajectoryStore
from flywheel.data.recordings import write_recording
from flywheel.dynamics.plant import RestartedPlant
from flywheel.dynamics.protocol import Dynamics
from flywheel.errors import ModelError, RunError
from flywheel.records import Episode
from flywheel.robot_link import RobotLink, StandInConfig
from flywheel.robot_link.opening import is_tcp, open_link
from flywheel.robot_link.transcript import ReplayedLink, TranscribedLink
from flywheel.robots import Robot
from flywheel.runtime.config.robot_config import TRANSCRIPTS, read_stand_in
from flywheel.runtime.config.run_config import RunConfig
from flywheel.runtime.pool.heartbeat import Worker
from flywheel.runtime.workers.episode_note import EpisodeNote
from flywheel.runtime.workers.episode_plan import EpisodePlan
from flywheel.runtime.workers.episode_recorder import EpisodeRecorder, RobotRecorder
from flywheel.runtime.workers.model_weights import AnyWeights
from flywheel.runtime.workers.stored_episodes import committed


class RobotWorker(Worker):
    """Drives the robot, one episode at a time, and commits the measurements.

    The messages on the link are kept as a transcript, from which the run can be repeated without
    the robot.

    Args:
      config: of the run.
      store: URL of the trajectory store.
      robot: of its MJCF.
      folder: for transcripts, with the stand-in's description.
    """

    def __init__(self, config: RunConfig, store: str, robot: Robot, folder: Path) -> None:
        assert config.robot is not None, "only a run with a robot drives one"
        super().__init__()
        self._config, self._where, self._robot, self._folder = config, config.robot, robot, folder
        self._store = TrajectoryStore(store)
        self._recorder = RobotRecorder(config, robot)
        self._link: RobotLink | None = None

    def record(self, plan: EpisodePlan, weights: AnyWeights | None = None) -> EpisodeNote:
        """Record and commit an episode on the robot, unless the store has it already.

        Args:
          plan: of the episode.
          weights: for MPPI; None for the plant with the plan's effects.

        Raises:
          RunError: the link was lost. The measurements until then are in a log next to the
            transcripts.
          LinkError: the robot cannot be reached.
        """
        self._heartbeat.start(plan.id)
        if (there := committed(self._store, plan.id)) is not None:
            self._recorder.check_own(there)
            return self._note(plan, there)
        dynamics = self._dynamics(plan, weights)
        link = self._transcribed(plan)
        try:
            digest, progress = weights.digest if weights else "", self._heartbeat.progress
            driven = self._recorder.record(link, plan, dynamics, digest, progress)
        except ModelError as error:  # before the first step
            return EpisodeNote(plan.id, invalid=str(error))
        finally:
            self._end(link)
        if driven.ended in ("lost", "stopped"):
            raise RunError(self._kept_apart(driven.episode, driven.why))
        self._store.commit(plan.id, [driven.episode])
        return self._note(plan, driven.episode)

    def _dynamics(self, plan: EpisodePlan, weights: AnyWeights | None) -> Dynamics | None:
        if plan.controller != "mppi":
            return None
        if weights is not None:
            threads, library = self._config.sim_threads, self._config.library()
            return weights.dynamics(self._robot, threads, library, self._config.mppi.arithmetic)
        simulated = EpisodeRecorder(self._config, self._robot).plant(0, plan.effects)
        return RestartedPlant.from_measurements(simulated)

    def _transcribed(self, plan: EpisodePlan) -> RobotLink:
        """The link of an episode with its transcript; or the replayed one of an earlier run."""
        name = f"{plan.id}.jsonl"
        if self._where.link.startswith(TRANSCRIPTS):
            return ReplayedLink(Path(self._where.link.removeprefix(TRANSCRIPTS)) / name)
        if self._link is None:
            stand_in = read_stand_in(self._folder) or StandInConfig()
            dt, arguments = self._config.network.dt, self._where.arguments
            self._link = open_link(self._where.link, self._robot, dt, stand_in, arguments)
        return TranscribedLink(self._link, self._folder / name)

    def _end(self, link: RobotLink) -> None:
        if isinstance(link, TranscribedLink):
            link.end()
        if is_tcp(self._where.link):  # others may drive it until the next episode
            self.close()

    def close(self) -> None:
        """Disconnect from the robot; the next episode connects again."""
        if self._link is not None:
            self._link.close()
            self._link = None

    def _kept_apart(self, episode: Episode, why: str) -> str:
        path = self._folder / f"{episode.id}-lost.csv"
        write_recording(episode, path, self._robot)
        self.close()
        return (
            f"The robot was lost during {episode.id}: {why} The measurements until then are in "
            f"{path}. --resume drives this episode again, and continues."
        )

    def _note(self, plan: EpisodePlan, episode: Episode) -> EpisodeNote:
        return EpisodeNote.of(episode, self._recorder.walk(plan, episode))
