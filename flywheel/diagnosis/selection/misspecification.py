"""Misspecification tests: the form of an answer is tested against laws outside the library.

A cable whose damping grows with the square of its speed is well imitated by linear damping: the
residual is small, and the fit looks right. Scoring the square directly reveals it. A probe is such
a law: it is scored like a candidate, and never an answer. If one explains much in addition to the
answer, or more in its place, the answer has the wrong form.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.selection.score_test import Score
from flywheel.effects import CommandEffect, Effect, Parameter, TensionEffect, Terms
from flywheel.effects.effect import Cables, Memory, Values
from flywheel.records import Floats
from flywheel.robots import Robot


class QuadraticDamping(TensionEffect):
    """Damping in proportion to the square of the speed, as in a fluid."""

    name = "damping_by_speed_squared"
    sizes = (
        Parameter(
            "damping", "N s^2/m^2", lambda s: 2.0 * s.weight * (s.time / s.length) ** 2, low=-20.0
        ),
    )
    equation = "dT = c |V| V"
    source = "drag"
    shown_by = "fast strokes of all winches"

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        return values["damping"] * np.abs(cables.speed) * cables.speed, memory


class TensionDamping(TensionEffect):
    """Damping in proportion to the tension."""

    name = "damping_by_tension"
    sizes = (Parameter("time", "s", lambda s: 0.02 * s.time, low=-20.0),)
    equation = "dT = a T V / l0"
    source = "first order in tension and speed"
    shown_by = "fast strokes at high and low pretension"

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        return values["time"] * cables.elastic * cables.speed / cables.rest, memory


class StiffnessDrift(TensionEffect):
    """Cables that lose stiffness, or gain some, during a recording. The memory is the time."""

    name = "stiffness_in_time"
    sizes = (Parameter("rate", "1/s", lambda s: 0.02 / s.time, low=-20.0),)
    equation = "dT = -a t T"
    source = "first order in time"
    shown_by = "the same motion early and late in a recording"
    remembers = True

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        return -values["rate"] * memory * cables.elastic, memory + cables.dt


class RateDependentGain(CommandEffect):
    """Winches with a nonlinear rate."""

    name = "gain_by_rate"
    stage = 2
    sizes = (Parameter("share", "-", lambda s: 0.1, low=-5.0, high=5.0),)
    equation = "r -> (1 + g |r| / r_max) r"
    source = "second order in the command"
    shown_by = "strokes at different rates"

    def command(self, controls: Floats, values: Values, robot: Robot, dt: float) -> Floats:
        full = np.maximum(np.abs(robot.control_low), np.abs(robot.control_high))
        more = values["share"][:, None] * np.abs(controls) / full
        return controls * (1.0 + more * robot.rate_driven)


PROBES: dict[str, Effect] = {
    probe.name: probe
    for probe in (QuadraticDamping(), TensionDamping(), StiffnessDrift(), RateDependentGain())
}


def is_probe(effect: Effect) -> bool:
    """True for a probe, with any sizes of parts, False for one of the library's effects."""
    return effect.name in PROBES


def probed(terms: Terms) -> Terms:
    """Those of them that are probes."""
    return tuple(term for term in terms if is_probe(term.effect))


@dataclass(frozen=True)
class Misspecification:
    """Explanation by probes that an answer lacks.

    Attributes:
      name: of the law that explains the most in addition to it; "" for none.
      score: of that, like a candidate's.
      share: of it in the explanation by both.
      instead: the law that, fitted in place of an effect of the answer, explains the most; "" if
        none comes near.
      gain: improvement of the model by that (difference of the criteria, BIC).
    """

    name: str = ""
    score: float = 0.0
    share: float = 0.0
    instead: str = ""
    gain: float = -np.inf

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        known = {"law": self.name, "score": self.score, "share": self.share}
        return {**known, "instead": self.instead, "gain": self.gain if self.instead else None}


NONE = Misspecification()


def misspecification(
    first: Fit,
    last: Fit,
    probes: Sequence[Score],
    instead: Sequence[Fit],
    criterion: Callable[[Fit], float],
) -> Misspecification:
    """Laws that explain more than the last model of a search.

    Args:
      first, last: models of the search.
      probes: scores on top of the last one.
      instead: models with a law in place of an effect of the last one.
      criterion: of a model, the less the better.
    """
    if not probes:
        return NONE
    best = max(probes, key=lambda score: score.statistic)
    explained = max(0.0, first.cost - last.cost)
    share = best.statistic / max(explained + best.statistic, 1e-9)
    law = Misspecification(best.candidate.effect.name, best.score, share)
    if not instead:
        return law
    better = min(instead, key=criterion)
    gain = criterion(last) - criterion(better)
    return replace(law, instead=probed(better.terms)[0].effect.name, gain=gain)
