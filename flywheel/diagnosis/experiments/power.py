"""Power of a planned experiment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flywheel.diagnosis.experiments.information import Information, information_of, simulate_scripts
from flywheel.diagnosis.fitting.windows import ChannelNoise
from flywheel.diagnosis.selection.candidates import Candidate, candidates
from flywheel.diagnosis.settings import Settings, unusual
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS, Effect
from flywheel.options import PowerOptions
from flywheel.records import Floats


@dataclass(frozen=True)
class Prospect:
    """Power of an experiment for one candidate.

    Attributes:
      candidate: the candidate.
      smallest: size visible in 95 of 100 recordings, in typical sizes; infinite if nothing changes.
      strength: its change at the requested size, beyond known influences [sigma].
      rival: candidate that would explain most of it; None if there is no other.
      likeness: |cosine| between the changes of the two.
      separation: part that the rival cannot explain at any size [sigma].
      shown: True if the requested size would be visible, more often than not.
      taken_for: candidates too similar to be distinguished from it, if it is visible.
    """

    candidate: Candidate
    smallest: float
    strength: float
    rival: Candidate | None
    likeness: float
    separation: float
    shown: bool
    taken_for: tuple[Candidate, ...]

    @property
    def visible(self) -> bool:
        """True if an allowed size of the effect would be visible."""
        return self.smallest <= self.candidate.effect.sizes[0].high

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        parameters = zip(self.candidate.effect.sizes, self.candidate.typical, strict=True)
        finite = np.isfinite(self.smallest)
        return {
            "effect": self.candidate.effect.name,
            "location": self.candidate.location,
            "visible": self.visible,
            "smallest": self.smallest if finite else None,
            "sizes": {
                p.name: {"value": self.smallest * typical if finite else None, "unit": p.unit}
                for p, typical in parameters
            },
            "strength": self.strength,
            "rival": None if self.rival is None else self.rival.label,
            "likeness": self.likeness,
            "separation": None if self.rival is None else self.separation,
            "taken_for": [candidate.label for candidate in self.taken_for],
        }


@dataclass(frozen=True)
class Power:
    """Power of an experiment for a library.

    Attributes:
      prospects: of every candidate, the most visible first.
      likeness: (n, n) |cosine| between their changes, in that order.
      size: requested, in typical sizes.
      sigma: noise of each coordinate [m].
      dt: control step [s].
      controls: (T, W) of the experiment.
      settings: of the following diagnosis.
      channels: measured beside the points.
      by_points: the same by points alone; None without channels.
    """

    prospects: tuple[Prospect, ...]
    likeness: Floats
    size: float
    sigma: float
    dt: float
    controls: Floats
    settings: Settings
    channels: tuple[ChannelNoise, ...] = ()
    by_points: Power | None = None

    @property
    def enough(self) -> float:
        """Strength from which an effect is visible, and separation from which two are distinguished
        [sigma].
        """
        return float(np.sqrt(self.settings.limits.threshold))

    @property
    def bare_sizes(self) -> dict[str, float]:
        """By label, the smallest visible sizes by points alone, NaN if invisible; none without channels."""
        prospects = () if self.by_points is None else self.by_points.prospects
        return {p.candidate.label: p.smallest if p.visible else np.nan for p in prospects}

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        return {
            "noise": {"value": self.sigma, "unit": "m"},
            "seconds": len(self.controls) * self.dt,
            "size": self.size,
            "enough": self.enough,
            "effects": [prospect.summary() for prospect in self.prospects],
            "likeness": self.likeness.tolist(),
            **({} if self.by_points is None else self._beside(self.by_points)),
            **({"settings": changes} if (changes := unusual(self.settings)) else {}),
        }

    def _beside(self, by_points: Power) -> dict[str, Any]:
        channels = [channel.summary() for channel in self.channels]
        return {"channels": channels, "by_points_alone": by_points.summary()["effects"]}


def power(
    plant: Plant,
    controls: Floats,
    sigma: float,
    library: Mapping[str, Effect] = EFFECTS,
    options: PowerOptions = PowerOptions(),
    settings: Settings = Settings(),
    channels: Sequence[ChannelNoise] = (),
) -> Power:
    """Predict the power of commands.

    Args:
      plant: with its known effects.
      controls: (T, W) commands.
      sigma: noise of each coordinate [m].
      library: candidate effects.
      options: size of the effects, and length of the windows.
      settings: of the following diagnosis.
      channels: measured beside the points.

    Raises:
      DataError: too few commands for a window, no effect, or no noise.
      ModelError: the plant diverges under the commands.
    """
    scripts, known = controls[None], candidates(plant.robot, library)
    motion, size = simulate_scripts(plant, scripts, channels=channels), options.size
    information = information_of(
        plant, scripts, motion, known, sigma, options.window, settings, channels
    )
    apart, likeness = _pairs(information)
    prospects = [_prospect(information, i, size, apart[i], likeness[i]) for i in range(len(known))]
    order = np.argsort([prospect.smallest for prospect in prospects], kind="stable")
    return Power(
        prospects=tuple(prospects[i] for i in order),
        likeness=likeness[np.ix_(order, order)],
        size=size,
        sigma=sigma,
        dt=plant.dt,
        controls=controls,
        settings=settings,
        channels=tuple(channels),
        by_points=power(plant, controls, sigma, library, options, settings) if channels else None,
    )


def _pairs(information: Information) -> tuple[Floats, Floats]:
    """(n, n) separation of each from each at typical size, and largest |cosine|, of one experiment."""
    count = len(information.candidates)
    apart, likeness = np.full((count, count), np.inf), np.ones((count, count))
    for i in range(count):
        for j in range(count):
            if i != j:
                apart[i, j] = information.separation(i, j)[0]
                likeness[i, j] = information.cosines(i, j)[0, 0]
    return apart, likeness


def _prospect(
    information: Information, index: int, size: float, apart: Floats, likeness: Floats
) -> Prospect:
    rival, alone = int(apart.argmin()), len(apart) == 1
    strength = size * float(information.strength(index)[0])
    enough = np.sqrt(information.threshold)
    shown = bool(strength >= enough)
    close = np.flatnonzero(size * apart < enough) if shown else ()
    return Prospect(
        candidate=information.candidates[index],
        smallest=float(information.smallest(index)[0]),
        strength=strength,
        rival=None if alone else information.candidates[rival],
        likeness=0.0 if alone else float(likeness[rival]),
        separation=size * float(apart[rival]),
        shown=shown,
        taken_for=tuple(information.candidates[i] for i in close),
    )
