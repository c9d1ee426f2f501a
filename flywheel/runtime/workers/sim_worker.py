"""The worker that simulates: a plain class that a test can call without a cluster.

Episodes go to the store; the driver gets ids, numbers and the answer of a diagnosis.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial, reduce
from operator import add
from typing import Literal

import numpy as np

from flywheel.data import TrajectoryStore
from flywheel.diagnosis import Diagnosis, diagnose
from flywheel.dynamics import Persistence
from flywheel.dynamics.arithmetic import Arithmetic
from flywheel.dynamics.plant import MeasurementModel, RestartedPlant
from flywheel.dynamics.protocol import Dynamics
from flywheel.effects import EFFECTS
from flywheel.errors import ModelError
from flywheel.evaluation import HISTORY_SECONDS, ErrorTable, places, score, score_by, score_full
from flywheel.noise import noise_floor
from flywheel.options import DiagnosisOptions
from flywheel.records import Episode, Floats
from flywheel.results import Overlay
from flywheel.robots import Robot
from flywheel.runtime.config.run_config import RunConfig
from flywheel.runtime.pool.heartbeat import Worker
from flywheel.runtime.workers.episode_note import EpisodeNote
from flywheel.runtime.workers.episode_plan import Effects, EpisodePlan
from flywheel.runtime.workers.episode_recorder import EpisodeRecorder
from flywheel.runtime.workers.model_weights import AnyWeights
from flywheel.runtime.workers.stored_episodes import (
    EpisodeWinches,
    committed,
    effects_of,
    excerpt,
    overlay,
)

MODELS_KEPT = 4


class Baseline(StrEnum):
    """Predictions without training; trained models are compared with them.

    The floors are MuJoCo restarted from the same partial observations. They differ in the roll of
    each rod, which is not observed: drawn at random, or computed from the cables. "noise" is the
    error of a perfect prediction of recordings: their own measurements, with noise of equal size.
    """

    PERSISTENCE = "persistence"
    NOISE = "noise"
    FLOOR = "floor"
    INFORMED_FLOOR = "informed floor"


@dataclass(frozen=True)
class KnownPlant:
    """The MJCF with known effects, restarted from measurements."""

    effects: Effects


Subject = AnyWeights | Baseline | KnownPlant
ROLLS: dict[Baseline, Literal["random", "relaxed"]] = {
    Baseline.FLOOR: "random",
    Baseline.INFORMED_FLOOR: "relaxed",
}


@dataclass(frozen=True)
class Scores:
    """The errors over a part of the episodes; the parts add up exactly (`added`).

    Attributes:
      by_episode: episode id -> errors from random starts in it.
      full: over whole episodes.
      problem: reason for missing errors, or "".
    """

    by_episode: Mapping[str, ErrorTable] = field(default_factory=dict)
    full: ErrorTable | None = None
    problem: str = ""

    @property
    def short(self) -> ErrorTable | None:
        """The errors from random starts, in all episodes together."""
        return reduce(add, self.by_episode.values()) if self.by_episode else None


class SimWorker(Worker):
    """Records episodes, scores models and diagnoses the plant.

    Args:
      config: of the run.
      store: URL of the trajectory store.
      robot: of the run.
    """

    def __init__(self, config: RunConfig, store: str, robot: Robot) -> None:
        super().__init__()
        self._recorder = EpisodeRecorder(config, robot)
        self._config = config
        self._store = TrajectoryStore(store)
        self._models: dict[tuple[str, Arithmetic], Dynamics] = {}
        self._library = config.library()

    def record(self, plan: EpisodePlan, weights: AnyWeights | None = None) -> EpisodeNote:
        """Record and commit an episode, unless the store has it already.

        A diverged episode is not stored; its note says why.

        Args:
          plan: of the episode.
          weights: of the model for MPPI.
        """
        self._heartbeat.start(plan.id)
        if (there := committed(self._store, plan.id)) is not None:
            self._recorder.check_own(there)
            return EpisodeNote.of(there, self._recorder.walk(plan, there))
        arithmetic = self._config.mppi.arithmetic
        dynamics = None if weights is None else self._model(weights, arithmetic)
        digest = "" if weights is None else weights.digest
        try:
            episode = self._recorder.record(plan, dynamics, digest, self._heartbeat.progress)
        except ModelError as error:
            return EpisodeNote(plan.id, invalid=str(error))
        self._store.commit(plan.id, [episode])
        return EpisodeNote.of(episode, self._recorder.walk(plan, episode))

    def score(
        self,
        subject: Subject,
        episodes: Sequence[str],
        seed: int,
        full: bool,
        effects: Effects = (),
    ) -> Scores:
        """Score a model, a baseline or the plant on episodes of the store.

        Args:
          subject: of the score.
          episodes: ids.
          seed: of the starts of the predictions.
          full: also predict whole episodes.
          effects: adopted so far.
        """
        self._heartbeat.start("scoring")
        found = [self._store.read(name) for name in episodes]
        if subject is Baseline.NOISE:
            return noise_scores(self._recorder.robot, found, seed)
        if isinstance(subject, Baseline):
            return self._scores(self._baselines(subject, found), seed, full, effects)
        if isinstance(subject, KnownPlant):
            plant = self._recorder.plant(0, subject.effects)
            return self._scores(
                [(RestartedPlant.from_measurements(plant), found)], seed, full, effects
            )
        return self._scores([(self._model(subject), found)], seed, full, effects)

    def diagnose(self, effects: Effects, fit: Sequence[str], held_out: Sequence[str]) -> Diagnosis:
        """Identify effects missing from the plant with these effects, with recordings.

        Nothing else of a run computes meanwhile, so it uses all cores of its machine.

        Args:
          effects: of the plant.
          fit, held_out: ids of recordings.

        Raises:
          DataError: the recordings cannot be used.
        """
        self._heartbeat.start("diagnosing")
        config, has = self._config.diagnose, {effect.effect for effect in effects}
        logs, kept_aside = (
            excerpt(map(self._store.read, names), config.seconds, config.episode_seconds)
            for names in (fit, held_out)
        )
        return diagnose(
            self._recorder.plant(0, effects, threads=len(os.sched_getaffinity(0))),
            logs,
            kept_aside,
            {name: self._library[name] for name in config.effects or self._config.library(EFFECTS)},
            options=DiagnosisOptions(config.window_seconds),
            progress=self._heartbeat.progress,
            unsure={name: share for name, share in config.unsure.items() if name not in has},
        )

    def overlay(self, weights: AnyWeights, episode: str, effects: Effects = ()) -> Overlay | None:
        """One window of an episode, measured and predicted; None if the model cannot predict it.

        Args:
          weights: of the model.
          episode: its id.
          effects: adopted so far.
        """
        self._heartbeat.start("overlay")
        try:
            return overlay(
                self._model(weights),
                self._store.read(episode),
                self._config.evaluate.horizon_seconds,
                self._config.dataset_numbers(),
                EpisodeWinches(self._recorder.robot, effects, self._library),
            )
        except ModelError:
            return None

    def _baselines(
        self, baseline: Baseline, episodes: list[Episode]
    ) -> list[tuple[Dynamics, list[Episode]]]:
        """The dynamics of a baseline, each with its episodes.

        A floor restarts the plant of the episode; recordings have no floor.
        """
        if baseline is Baseline.PERSISTENCE:
            dt = episodes[0].trajectory.dt if episodes else 0.01
            return [(Persistence(self._recorder.robot, dt), episodes)]
        by_plant: dict[tuple[int, Effects], list[Episode]] = {}
        for episode in (e for e in episodes if e.provenance.source == "sim"):
            number = self._config.dataset_numbers()[episode.provenance.dataset]
            by_plant.setdefault((number, effects_of(episode)), []).append(episode)
        window, roll = self._config.evaluate.floor_window, ROLLS[baseline]
        return [
            (RestartedPlant(self._recorder.plant(*plant), window, roll=roll), part)
            for plant, part in by_plant.items()
        ]

    def _scores(
        self, groups: list[tuple[Dynamics, list[Episode]]], seed: int, full: bool, effects: Effects
    ) -> Scores:
        """The sum of the scores of each dynamics on its episodes."""
        scores: Scores | None = None
        for dynamics, episodes in groups:
            try:
                part = self._scored(dynamics, episodes, seed, full, effects)
            except ModelError as error:
                return Scores(problem=str(error))
            scores = part if scores is None else added(scores, part)
            self._heartbeat.progress(0.5)
        return scores or Scores(problem="no episode")

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
        winches = EpisodeWinches(self._recorder.robot, effects, self._library)
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
        """The true points of a simulated episode, else the measured ones: noise is not an error of
        the model.
        """
        states = episode.trajectory.states
        if states is None:
            return episode.trajectory.observations.points
        return self._recorder.plant(0, effects_of(episode)).observe(states).points

    def _model(self, weights: AnyWeights, arithmetic: Arithmetic = Arithmetic()) -> Dynamics:
        key = weights.digest, arithmetic
        if key not in self._models:
            while len(self._models) >= MODELS_KEPT:
                del self._models[next(iter(self._models))]
            self._models[key] = weights.dynamics(
                self._recorder.robot, self._config.sim_threads, self._library, arithmetic
            )
        return self._models[key]


def noise_scores(robot: Robot, recordings: Sequence[Episode], seed: int) -> Scores:
    """The errors of a perfect prediction of recordings, due to their noise.

    Args:
      robot: of the recordings.
      recordings: any.
      seed: of the drawn noise.

    Raises:
      DataError: the recordings are too short to separate noise from motion.
    """
    points = [episode.trajectory.observations.points for episode in recordings]
    sigma, by_episode = noise_floor(points), {}
    for episode, measured in zip(recordings, points, strict=True):
        rng = np.random.default_rng([seed, *episode.id.encode()])
        again = np.nan_to_num(measured) + rng.normal(0.0, sigma, measured.shape)
        windows = (measured[:, None], again[:, None])  # of one step each
        by_episode[episode.id] = ErrorTable.between(robot, episode.trajectory.dt, *windows)
    return Scores(by_episode)


def added(one: Scores, other: Scores) -> Scores:
    """The errors over both shares of the episodes."""
    if problem := one.problem or other.problem:
        return Scores(problem=problem)
    short = {**one.by_episode, **other.by_episode}
    if one.full is None or other.full is None:
        return Scores(short, one.full or other.full)
    return Scores(short, one.full + other.full)
