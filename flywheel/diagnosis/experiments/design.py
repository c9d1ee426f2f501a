"""The experiment that best distinguishes given effects: many scripts are tried on the plant, the
best varied.

T-optimal design: Hunter and Reiner 1965, Atkinson and Fedorov 1975.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from flywheel.diagnosis.experiments.command_scripts import FAMILIES, PLAIN, WinchRange, varied
from flywheel.diagnosis.experiments.information import (
    SETTLING,
    Information,
    information_of,
    simulate_scripts,
)
from flywheel.diagnosis.fitting.windows import ChannelNoise
from flywheel.diagnosis.selection.candidates import AT, Candidate, candidates
from flywheel.diagnosis.settings import Settings, unusual
from flywheel.dynamics.plant import Motion, Plant
from flywheel.dynamics.plant.tautness import taut_share
from flywheel.effects import NAMED, Effect
from flywheel.errors import DataError
from flywheel.options import DesignOptions
from flywheel.records import Floats
from flywheel.registry import lookup
from flywheel.robots import Robot

ELITE = 6  # scripts that are varied
WIDTHS = (0.3, 0.2, 0.12, 0.08)  # of the variations, round by round, as shares of the reach
SLACKEST = 0.5  # share of cables and time that must be taut, of what is taut while lying still
SHORTEST = 5  # control steps of a script

Told = Callable[[int, float], None]


@dataclass(frozen=True)
class Pair:
    """Two effects in an experiment.

    Attributes:
      first, second: the candidates that are hardest to distinguish.
      likeness: |cosine| between their changes.
      separation: part of the first that the second cannot explain [sigma].
      plain_likeness, plain: the median of the same under plain random scripts.
    """

    first: Candidate
    second: Candidate
    likeness: float
    separation: float
    plain_likeness: float
    plain: float


@dataclass(frozen=True)
class Design:
    """A command script that distinguishes effects.

    Attributes:
      controls: (T, W) commands.
      path: (T, W) resulting winch positions, step by step [m].
      dt: control step [s].
      family: of the original script.
      separation: smallest one of all pairs [sigma].
      plain: its median over plain random scripts.
      pairs: of effects.
      history: best separation after the first scripts, and after each round.
      tried: number of scripts.
      unsafe: number of excluded ones: diverging, or too slack.
      sigma: noise [m].
      size: of the effects, in typical sizes.
      settings: of the following diagnosis.
      by_points: separation by points alone; None without channels [sigma].
    """

    controls: Floats
    path: Floats
    dt: float
    family: str
    separation: float
    plain: float
    pairs: tuple[Pair, ...]
    history: tuple[float, ...]
    tried: int
    unsafe: int
    sigma: float
    size: float
    settings: Settings
    by_points: float | None = None

    @property
    def needed(self) -> float:
        """Separation from which two effects are distinguished [sigma]."""
        return float(np.sqrt(self.settings.limits.threshold))

    @property
    def enough(self) -> bool:
        """True if all effects are distinguished."""
        return self.separation >= self.needed

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        return {
            "separation": self.separation,
            "plain": self.plain,
            "by_points_alone": self.by_points,
            "enough": self.needed,
            "family": self.family,
            "pairs": [
                {
                    "rivals": [pair.first.label, pair.second.label],
                    "likeness": pair.likeness,
                    "separation": pair.separation,
                    "plain_likeness": pair.plain_likeness,
                    "plain_separation": pair.plain,
                }
                for pair in self.pairs
            ],
            "history": list(self.history),
            "tried": self.tried,
            "unsafe": self.unsafe,
            "noise": {"value": self.sigma, "unit": "m"},
            "size": self.size,
            **({"settings": changes} if (changes := unusual(self.settings)) else {}),
        }


@dataclass(frozen=True)
class Tried:
    """Evaluated scripts, all of them safe.

    Attributes:
      path: (S, T, W) of the winches [m].
      family: (S,) of each.
      information: of each.
      separation: (S,) smallest one of all pairs [sigma].
      unsafe: number of further, unsafe ones.
    """

    path: Floats
    family: tuple[str, ...]
    information: Information
    separation: Floats
    unsafe: int

    def __add__(self, other: Tried) -> Tried:
        return Tried(
            np.concatenate([self.path, other.path]),
            self.family + other.family,
            self.information + other.information,
            np.concatenate([self.separation, other.separation]),
            self.unsafe + other.unsafe,
        )

    @property
    def count(self) -> int:
        """Number of scripts."""
        return len(self.path) + self.unsafe

    @property
    def best(self) -> float:
        """Largest separation."""
        return float(self.separation.max())


@dataclass(frozen=True)
class Rival:
    """A possible effect, at one place or at any.

    Attributes:
      name: as given.
      candidates: the effect at each possible place.
    """

    name: str
    candidates: tuple[Candidate, ...]

    @classmethod
    def named(cls, name: str, robot: Robot, library: Mapping[str, Effect] = NAMED) -> Rival:
        """From "effect", at any place, or "effect@place", at one.

        Raises:
          UnknownNameError: no such effect or place.
          DataError: a place for an effect that has none.
          RobotError: an effect that this robot cannot have.
        """
        effect, at, place = name.partition(AT)
        named = lookup(library, effect, "effect")
        named.require_place(robot)
        found = candidates(robot, {effect: named})
        if not at:
            return cls(name, found)
        at_places = {candidate.location: candidate for candidate in found if candidate.location}
        if not at_places:
            raise DataError(f"{effect} is of the whole robot: name it without {AT}{place}.")
        return cls(name, (lookup(at_places, place, f"place of {effect}"),))


class Designer:
    """Searches for scripts that distinguish effects.

    Args:
      plant: with its known effects.
      rivals: two or more.
      sigma: noise of each coordinate [m].
      options: size of the rivals, length and number of scripts, and seed.
      settings: of the following diagnosis.
      channels: measured beside the points.

    Raises:
      DataError: fewer than two rivals, or one of them twice.
    """

    def __init__(
        self,
        plant: Plant,
        rivals: Sequence[Rival],
        sigma: float,
        options: DesignOptions = DesignOptions(),
        settings: Settings = Settings(),
        channels: Sequence[ChannelNoise] = (),
    ) -> None:
        labels = [c.label for rival in rivals for c in rival.candidates]
        if len(rivals) < 2 or len(set(labels)) < len(labels):
            names = ", ".join(rival.name for rival in rivals)
            raise DataError(f"A design needs two or more different rivals, got {names or 'none'}.")
        self.plant, self.sigma, self.options, self.settings = plant, sigma, options, settings
        self.channels = channels
        self.start = plant.settle(SETTLING)
        self.reach = WinchRange.around(plant.robot, plant.winch(self.start)[0], plant.dt)
        self.library = tuple(c for rival in rivals for c in rival.candidates)
        owner = [number for number, rival in enumerate(rivals) for _ in rival.candidates]
        self.pairs: dict[tuple[int, int], list[tuple[int, int]]] = {}
        for (i, a), (j, b) in combinations(enumerate(owner), 2):
            if a != b:
                self.pairs.setdefault((a, b), []).append((i, j))
        self._least_taut = SLACKEST * float(taut_share(plant, self.start[:, None])[0])

    def design(
        self,
        told: Told = lambda tried, best: None,
        stop: Callable[[], bool] = lambda: False,
    ) -> Design:
        """The best of many scripts, and of variations of the best of them.

        Args:
          told: called after the first scripts and after each round, with the number tried and the
            best separation so far [sigma].
          stop: asked before each round of variations; True ends the search with the best script so far.

        Raises:
          DataError: nothing to try, or no plain script is safe.
        """
        rng, count = np.random.default_rng(self.options.seed), self.options.candidates
        steps = round(self.options.seconds / self.plant.dt)
        if count < 1 or steps < SHORTEST:
            raise DataError(
                f"A design needs 1 script or more of {SHORTEST} steps or more, got {count} of {steps}."
            )
        names = [list(FAMILIES)[i % len(FAMILIES)] for i in range(count)]
        drawn = self._tried([FAMILIES[name](self.reach, steps, rng) for name in names], names)
        if PLAIN not in drawn.family:
            raise DataError(
                f"None of the plain ones among {count} scripts is safe for {self.plant.robot.name}; "
                "more scripts may help."
            )
        tried, history = drawn, [drawn.best]
        told(tried.count, tried.best)
        for width in WIDTHS:
            if stop():
                break
            tried += self._varied(tried, width, max(1, count // len(WIDTHS)), rng)
            history.append(tried.best)
            told(tried.count, tried.best)
        return self._design(drawn, tried, tuple(history))

    def separation(self, information: Information, pairs: Sequence[tuple[int, int]]) -> Floats:
        """(S,) least separation over pairs of candidates, either way round [sigma]."""
        ways = [information.separation(*way) for i, j in pairs for way in ((i, j), (j, i))]
        return self.options.size * np.asarray(np.min(ways, axis=0))

    def _tried(self, wishes: Sequence[Floats], families: Sequence[str]) -> Tried:
        path = self.reach.path(np.stack(wishes))
        scripts = self.reach.commands(path)
        motion = simulate_scripts(self.plant, scripts, self.start, self.channels)
        safe = motion.finite & (taut_share(self.plant, motion.states) >= self._least_taut)
        kept = np.flatnonzero(safe)
        information = self._information(scripts[kept], motion[kept], self.channels)
        return Tried(
            path[kept],
            tuple(families[i] for i in kept.tolist()),
            information,
            self.separation(information, self._everyone),
            len(path) - len(kept),
        )

    def _information(
        self, scripts: Floats, motion: Motion, channels: Sequence[ChannelNoise]
    ) -> Information:
        return information_of(
            self.plant,
            scripts,
            motion,
            self.library,
            self.sigma,
            settings=self.settings,
            channels=channels,
        )

    @property
    def _everyone(self) -> list[tuple[int, int]]:
        return [pair for pairs in self.pairs.values() for pair in pairs]

    def _by_points(self, script: Floats) -> float | None:
        """Separation of the rivals under a script (T, W) by points alone; None without channels."""
        if not self.channels:
            return None
        scripts = script[None]
        bare = self._information(scripts, simulate_scripts(self.plant, scripts, self.start), ())
        return float(self.separation(bare, self._everyone)[0])

    def _varied(self, tried: Tried, width: float, count: int, rng: np.random.Generator) -> Tried:
        elite = np.argsort(-tried.separation)[:ELITE]
        parents = rng.choice(elite, (count, 2))
        wishes = [varied(self.reach, tried.path[a], tried.path[b], width, rng) for a, b in parents]
        return self._tried(wishes, [tried.family[a] for a, _ in parents])

    def _design(self, drawn: Tried, tried: Tried, history: tuple[float, ...]) -> Design:
        best = int(tried.separation.argmax())
        plain = np.flatnonzero(np.array(drawn.family) == PLAIN)
        controls = self.reach.commands(tried.path[best])
        return Design(
            controls=controls,
            path=tried.path[best],
            dt=self.plant.dt,
            family=tried.family[best],
            separation=float(tried.separation[best]),
            plain=float(np.median(drawn.separation[plain])),
            pairs=tuple(
                self._pair(members, tried.information[[best]], drawn.information[plain])
                for members in self.pairs.values()
            ),
            history=history,
            tried=tried.count,
            unsafe=tried.unsafe,
            sigma=self.sigma,
            size=self.options.size,
            settings=self.settings,
            by_points=self._by_points(controls),
        )

    def _pair(
        self, members: Sequence[tuple[int, int]], best: Information, plain: Information
    ) -> Pair:
        i, j = min(members, key=lambda pair: self.separation(best, [pair])[0])
        return Pair(
            first=self.library[i],
            second=self.library[j],
            likeness=float(best.cosines(i, j)[0, 0]),
            separation=float(self.separation(best, [(i, j)])[0]),
            plain_likeness=float(np.median(plain.cosines(i, j)[:, 0])),
            plain=float(np.median(self.separation(plain, members))),
        )
