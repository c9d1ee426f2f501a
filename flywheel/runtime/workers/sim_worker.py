"""What happens inside worker processes: plain classes that a test can call without a cluster.

Only ids and numbers go back to the driver; episodes go to the store, weights to files.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial, reduce
from operator import add
from typing import Literal

import numpy as np

from flywheel.data import TrajectoryStore
from flywheel.dynamics import Persistence
from flywheel.dynamics.gnn import LearnedDynamics
from flywheel.dynamics.plant import MeasurementModel, RestartedPlant
from flywheel.dynamics.protocol import Dynamics
from flywheel.errors import DataError, ModelError
from flywheel.evaluation import (
    HISTORY_SECONDS,
    ErrorTable,
    places,
    score,
    score_by,
    score_full,
)
from flywheel.records import Episode, Floats, Past
from flywheel.reports.diagnosis_page import diagnosis_page
from flywheel.robots import Robot
from flywheel.runtime.config.run_config import RunConfig
from flywheel.runtime.measures import DiagnosisNote, Overlay, Walk
from flywheel.runtime.pool.heartbeat import Watch
from flywheel.runtime.pool.jobs import Beat
from flywheel.runtime.workers.diagnosis_job import missing
from flywheel.runtime.workers.episode_plan import Effects, EpisodePlan
from flywheel.runtime.workers.episode_recorder import Recorder, effects_of
from flywheel.runtime.workers.model_weights import Weights
from flywheel.runtime.workers.overlays import overlay
from flywheel.runtime.workers.sharded import Helpers, ShardedDynamics
from flywheel.runtime.workers.winches import EpisodeWinches

MODELS_KEPT = 4
PERSISTENCE, FLOOR, INFORMED_FLOOR = "persistence", "floor", "informed floor"
ROLLS: dict[str, Literal["random", "relaxed"]] = {FLOOR: "random", INFORMED_FLOOR: "relaxed"}


@dataclass(frozen=True)
class EpisodeNote:
    """What the driver is told about a recorded episode.

    Attributes:
      id: of the episode.
      steps: control steps; 0 where invalid.
      walk: seen from above, for tasks.
      plan_seconds: wall time of its plans [s].
      invalid: why it was thrown away, or "".
    """

    id: str
    steps: int = 0
    walk: Walk | None = None
    plan_seconds: tuple[float, ...] = ()
    invalid: str = ""


@dataclass(frozen=True)
class Scores:
    """Errors over a share of the episodes; the shares add.

    Attributes:
      by_episode: episode id -> errors from random starts in it.
      full: over whole episodes.
      problem: why there are none, or "".
    """

    by_episode: Mapping[str, ErrorTable] = field(default_factory=dict)
    full: ErrorTable | None = None
    problem: str = ""

    @property
    def short(self) -> ErrorTable | None:
        """Errors from random starts, in all episodes together."""
        return reduce(add, self.by_episode.values()) if self.by_episode else None


class SimWorker:
    """Records episodes and scores models.

    Args:
      config: of the run.
      store: URL of the trajectory store.
      robot: of the run.
    """

    def __init__(self, config: RunConfig, store: str, robot: Robot) -> None:
        self._recorder = Recorder(config, robot)
        self._config = config
        self._store = TrajectoryStore(store)
        self._watch = Watch()
        self._models: dict[str, LearnedDynamics] = {}

    @property
    def beat(self) -> Beat:
        """Latest sign of progress."""
        return self._watch.beat

    def record(
        self, plan: EpisodePlan, weights: Weights | None = None, helpers: Helpers | None = None
    ) -> EpisodeNote:
        """Record and commit an episode, unless the store has it already.

        An episode in which the plant or the model diverges is not stored; its note says why.

        Args:
          plan: what to record.
          weights: of the model that MPPI plans with.
          helpers: that roll it out, instead of this process.
        """
        self._watch.start(plan.id)
        if (there := self._committed(plan.id)) is not None:
            self._recorder.check_own(there)
            return self._note(plan, there)
        dynamics: Dynamics | None = None if weights is None else self._model(weights)
        if weights is not None and helpers is not None:
            dynamics = ShardedDynamics(self._model(weights), helpers.ask)
        digest = "" if weights is None else weights.digest
        try:
            episode = self._recorder.record(plan, dynamics, digest, self._watch)
        except ModelError as error:
            return EpisodeNote(plan.id, invalid=str(error))
        self._store.commit(plan.id, [episode])
        return self._note(plan, episode)

    def score(
        self,
        subject: Weights | str,
        episodes: Sequence[str],
        seed: int,
        full: bool,
        effects: Effects = (),
    ) -> Scores:
        """Score a model, a floor or persistence on episodes of the store.

        Args:
          subject: weights, or "persistence", "floor" or "informed floor".
          episodes: ids.
          seed: of the starts.
          full: also predict whole episodes.
          effects: adopted so far.
        """
        name = subject if isinstance(subject, str) else subject.digest[:8]
        self._watch.start(f"scoring {name}")
        scores: Scores | None = None
        for dynamics, group in self._by_dynamics(subject, episodes):
            try:
                part = self._scored(dynamics, group, seed, full, effects)
            except ModelError as error:
                return Scores(problem=str(error))
            scores = part if scores is None else added(scores, part)
            self._watch.progress(0.5)
        return scores or Scores(problem="no episode")

    def diagnose(
        self, effects: Effects, fit: Sequence[str], held_out: Sequence[str]
    ) -> tuple[DiagnosisNote, str]:
        """What the plant with these effects lacks to explain recordings; and the page about it.

        Args:
          effects: of the plant.
          fit, held_out: ids of recordings.
        """
        self._watch.start("diagnosing")
        note, found = missing(
            self._config.diagnose,
            self._recorder.plant(0, effects),
            effects,
            (self._store.read(name) for name in fit),
            (self._store.read(name) for name in held_out),
            self._watch,
        )
        about = {"recordings": ", ".join(fit), "held out": ", ".join(held_out) or "none"}
        return note, diagnosis_page(found, about)

    def rollout(self, weights: Weights, past: Past, controls: Floats) -> tuple[Floats, Floats]:
        """Points and winch positions that a model predicts, for another worker's planner."""
        rollout = self._model(weights).rollout(past, controls)
        return rollout.points, rollout.winch

    def overlay(self, weights: Weights, episode: str, effects: Effects = ()) -> Overlay | None:
        """A window of an episode, measured and predicted; None if the model cannot."""
        self._watch.start("overlay")
        try:
            return overlay(
                self._model(weights),
                self._store.read(episode),
                self._config.evaluate.horizon_seconds,
                self._config.dataset_numbers(),
                EpisodeWinches(self._recorder.robot, effects),
            )
        except ModelError:
            return None

    def _committed(self, name: str) -> Episode | None:
        """The episode, if the store has it whole; a damaged one not in use yet is set aside."""
        if name not in (*self._store.committed(), *self._store.unreadable()):
            return None
        try:
            return self._store.read(name)
        except DataError:
            if any(name in self._store.snapshot(s).segments for s in self._store.snapshots()):
                raise
            self._store.quarantine(name)
            return None

    def _note(self, plan: EpisodePlan, episode: Episode) -> EpisodeNote:
        seconds = np.round(episode.telemetry.get("plan_seconds", np.zeros(0)), 5)
        return EpisodeNote(
            plan.id,
            steps=episode.trajectory.steps,
            walk=self._recorder.walk(plan, episode),
            plan_seconds=tuple(float(s) for s in seconds),
        )

    def _by_dynamics(
        self, subject: Weights | str, names: Sequence[str]
    ) -> list[tuple[Dynamics, list[Episode]]]:
        episodes = [self._store.read(name) for name in names]
        robot, dt = self._recorder.robot, episodes[0].trajectory.dt if episodes else 0.01
        if isinstance(subject, Weights):
            return [(self._model(subject), episodes)]
        if subject == PERSISTENCE:
            return [(Persistence(robot, dt), episodes)]
        by_plant: dict[tuple[int, Effects], list[Episode]] = {}
        for episode in (e for e in episodes if e.provenance.source == "sim"):
            number = self._config.dataset_numbers()[episode.provenance.dataset]
            by_plant.setdefault((number, effects_of(episode)), []).append(episode)
        window = self._config.evaluate.floor_window
        return [
            (RestartedPlant(self._recorder.plant(*plant), window, roll=ROLLS[subject]), part)
            for plant, part in by_plant.items()
        ]

    def _scored(
        self,
        dynamics: Dynamics,
        episodes: Sequence[Episode],
        seed: int,
        full: bool,
        effects: Effects,
    ) -> Scores:
        evaluate, datasets = self._config.evaluate, self._config.dataset_numbers()
        steps = round(evaluate.horizon_seconds / dynamics.dt)
        earliest = round(HISTORY_SECONDS / dynamics.dt)
        long = [e for e in episodes if len(places(e, steps, earliest))]
        truth = None if self._config.measurement == MeasurementModel() else self._truth
        winches = EpisodeWinches(self._recorder.robot, effects)
        short = partial(
            score,
            dynamics,
            horizon_seconds=evaluate.horizon_seconds,
            starts_per_episode=evaluate.starts,
            seed=seed,
            truth=truth,
            datasets=datasets,
            winches=winches,
        )
        whole = None
        if full and long:
            whole = score_full(dynamics, long, truth=truth, datasets=datasets, winches=winches)
        return Scores(score_by(lambda episode: episode.id, long, short), whole)

    def _truth(self, episode: Episode) -> Floats:
        """Where the points really were, if that is known: noise is no error of the model."""
        states = episode.trajectory.states
        if states is None:
            return episode.trajectory.observations.points
        return self._recorder.plant(0, effects_of(episode)).observe(states).points

    def _model(self, weights: Weights) -> LearnedDynamics:
        if weights.digest not in self._models:
            while len(self._models) >= MODELS_KEPT:
                del self._models[next(iter(self._models))]
            self._models[weights.digest] = weights.dynamics(
                self._recorder.robot, self._config.sim_threads
            )
        return self._models[weights.digest]


def added(one: Scores, other: Scores) -> Scores:
    """Errors over both shares of the episodes."""
    if problem := one.problem or other.problem:
        return Scores(problem=problem)
    short = {**one.by_episode, **other.by_episode}
    if one.full is None or other.full is None:
        return Scores(short, one.full or other.full)
    return Scores(short, one.full + other.full)
