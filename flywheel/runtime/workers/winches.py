"""Where the winches of stored episodes were, by what is known of the plant that each was recorded on."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field

from flywheel.dynamics.plant import Reckoning
from flywheel.effects import NAMED
from flywheel.records import Episode, Floats
from flywheel.robots import Robot
from flywheel.runtime.workers.episode_plan import Effects
from flywheel.runtime.workers.episode_recorder import effects_of

KEPT = 32  # episodes: what is scored is asked for again and again


@dataclass(frozen=True)
class EpisodeWinches:
    """Winch positions of episodes, see `Reckoning`.

    A simulated episode says which effects its plant had; that of a recording has those adopted so far.

    Attributes:
      robot: that the episodes are of.
      effects: adopted so far.
    """

    robot: Robot
    effects: Effects = ()
    _known: dict[str, Floats] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __call__(self, episode: Episode) -> Floats:
        """(T + 1, W) positions [m]."""
        if episode.id not in self._known:
            if len(self._known) >= KEPT:
                del self._known[next(iter(self._known))]
            self._known[episode.id] = self._reckoned(episode)
        return self._known[episode.id]

    def _reckoned(self, episode: Episode) -> Floats:
        simulated = episode.provenance.source == "sim"
        effects = effects_of(episode) if simulated else self.effects
        terms = tuple(effect.term(self.robot, NAMED) for effect in effects)
        return Reckoning(self.robot, episode.trajectory.dt, terms).known(episode.trajectory)

    @property
    def belief(self) -> str:
        """Name of what has been adopted; "" for nothing."""
        if not self.effects:
            return ""
        text = ";".join(effect.model_dump_json() for effect in self.effects)
        return hashlib.sha256(text.encode()).hexdigest()[:12]
