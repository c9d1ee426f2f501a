"""Quantities derived from stored episodes: effects, winch positions, excerpts, a predicted window."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from flywheel.data import TrajectoryStore
from flywheel.dynamics.plant import Reckoning
from flywheel.dynamics.protocol import Dynamics
from flywheel.effects import NAMED, Effect, WrittenTerm
from flywheel.errors import DataError
from flywheel.evaluation import past_at
from flywheel.records import Episode, Floats, KnownWinch, Trajectory
from flywheel.results import Overlay
from flywheel.robots import Robot
from flywheel.runtime.workers.episode_plan import Effects

KEPT = 32  # episodes whose winch positions are kept, because scoring asks for them repeatedly


@dataclass(frozen=True)
class EpisodeWinches:
    """Winch positions of episodes, by dead-reckoning (`Reckoning`).

    A simulated episode names the effects and the numbers of its plant. Recordings are assumed to have the
    adopted effects.

    Attributes:
      robot: of the episodes.
      effects: adopted so far.
      library: of the effects.
    """

    robot: Robot
    effects: Effects = ()
    library: Mapping[str, Effect] = field(default_factory=lambda: NAMED)
    _known: dict[str, Floats] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __call__(self, episode: Episode) -> Floats:
        """The winch positions of an episode, (T + 1, W) [m]."""
        if episode.id not in self._known:
            if len(self._known) >= KEPT:
                del self._known[next(iter(self._known))]
            self._known[episode.id] = self._reckoned(episode)
        return self._known[episode.id]

    def _reckoned(self, episode: Episode) -> Floats:
        simulated = episode.provenance.source == "sim"
        effects = effects_of(episode) if simulated else self.effects
        terms = tuple(effect.term(self.robot, self.library) for effect in effects)
        speed = episode.provenance.plant.get("winch_speed", 1.0)
        return Reckoning(self.robot, episode.trajectory.dt, terms, speed).known(episode.trajectory)

    @property
    def effects_digest(self) -> str:
        """A short digest of the adopted effects; "" for none."""
        if not self.effects:
            return ""
        text = ";".join(effect.model_dump_json() for effect in self.effects)
        return hashlib.sha256(text.encode()).hexdigest()[:12]


def committed(store: TrajectoryStore, name: str) -> Episode | None:
    """The episode if the store has it; a damaged one that is in no snapshot is set aside.

    Raises:
      DataError: it is damaged, and in a snapshot.
    """
    if name not in (*store.committed(), *store.unreadable()):
        return None
    try:
        return store.read(name)
    except DataError:
        if any(name in store.snapshot(s).segments for s in store.snapshots()):
            raise
        store.quarantine(name)
        return None


SECONDS_APART = 0.1


def overlay(
    dynamics: Dynamics,
    episode: Episode,
    seconds: float,
    datasets: Mapping[str, int],
    winches: KnownWinch | None = None,
) -> Overlay | None:
    """Predict the window in the middle of an episode; None if the episode is too short.

    Args:
      dynamics: the model.
      episode: with at least `seconds` of measurements.
      seconds: length of the window [s].
      datasets: index of each data set in the network's one-hot.
      winches: gives the winch positions of the episode; None for `Robot.winches_of`.
    """
    trajectory, robot = episode.trajectory, dynamics.robot
    steps = round(seconds / trajectory.dt)
    start = (trajectory.steps - steps) // 2
    if start < 0:
        return None
    measured = trajectory.observations.points[start : start + steps + 1]
    controls = trajectory.controls
    winch = (winches or robot.winches_of)(episode)
    dataset = datasets.get(episode.provenance.dataset, 0)
    past = past_at(episode, robot, start, dynamics.history, winch, dataset)
    predicted = dynamics.rollout(past, controls[None, start : start + steps]).points[0]
    stride = max(1, round(SECONDS_APART / trajectory.dt))
    return Overlay(
        seconds=tuple((np.arange(0, steps + 1, stride) * trajectory.dt).round(6).tolist()),
        measured=_places(measured[::stride]),
        predicted=_places(predicted[::stride]),
        rods=tuple(
            (body.points[0], body.points[-1]) for body in robot.bodies if len(body.points) > 1
        ),
        episode=episode.id,
    )


def _places(points: np.ndarray) -> tuple[tuple[tuple[float, float, float], ...], ...]:
    return tuple(tuple((x, y, z) for x, y, z in frame) for frame in points.round(4).tolist())


def excerpt(episodes: Iterable[Episode], seconds: float, each: float | None) -> list[Trajectory]:
    """The first episodes, up to `seconds` [s] in all; the last of them is cut.

    Args:
      episodes: recordings.
      seconds: largest total duration [s].
      each: longest part of each of them [s]; None for all of it.
    """
    taken, left = [], seconds
    for episode in episodes:
        trajectory = episode.trajectory
        most = left if each is None else min(left, each)
        steps = min(trajectory.steps, round(most / trajectory.dt))
        if steps < 1:
            break
        taken.append(trajectory.first(steps))
        left -= steps * trajectory.dt
    return taken


def effects_of(episode: Episode) -> Effects:
    """The effects of an episode's plant, beyond the MJCF."""
    there = episode.provenance.effects
    return tuple(WrittenTerm.labelled(label, values) for label, values in there.items())
