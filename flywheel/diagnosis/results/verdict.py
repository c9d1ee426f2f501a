"""The verdict of a diagnosis, the effects with their values, and the rules for the verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np

from flywheel.diagnosis.checks.adequacy import Adequacy, OwnErrors
from flywheel.diagnosis.checks.held_out import Errors
from flywheel.diagnosis.checks.held_out_gain import Gain
from flywheel.diagnosis.selection.misspecification import NONE, Misspecification
from flywheel.diagnosis.settings import FittingSettings, Limits
from flywheel.diagnosis.statistics import INTERVAL
from flywheel.effects import Parameter, PerPart, Scales, Term, place_name
from flywheel.records import Floats
from flywheel.robots import Robot

NEAR = 0.999  # of a bound: a step that ends there may miss it by a rounding


class Verdict(StrEnum):
    """The verdict in a word.

    `NOT_CONVERGED` means that the cost of the last model is not finite: no start was found from which the
    simulation of the recordings stays finite; that most windows fit far worse than from their first
    estimates; or that the search was stopped before it knew what is missing. A search or a fit that ends at a
    limit on its rounds is judged by its residual, so that the answer is likely to be `OUTSIDE_LIBRARY`. The
    same holds for an effect whose true value is beyond the bounds of its fit; see `Found.at_bound`.
    """

    NOISE_ONLY = "NOISE_ONLY"
    EFFECT = "EFFECT"
    AMBIGUOUS = "AMBIGUOUS"
    PARTIAL = "PARTIAL"
    OUTSIDE_LIBRARY = "OUTSIDE_LIBRARY"
    DATA_INSUFFICIENT = "DATA_INSUFFICIENT"
    NOT_CONVERGED = "NOT_CONVERGED"


EXIT_CODES = {
    Verdict.NOISE_ONLY: 0,
    Verdict.EFFECT: 10,
    Verdict.AMBIGUOUS: 11,
    Verdict.PARTIAL: 12,
    Verdict.OUTSIDE_LIBRARY: 13,
    Verdict.DATA_INSUFFICIENT: 20,
    Verdict.NOT_CONVERGED: 21,
}
INTERRUPTED = 130  # exit code of an answer that was the best so far, whatever it says


@dataclass(frozen=True)
class Value:
    """A fitted number.

    Attributes:
      name, unit: of the parameter.
      value: of the robot.
      low, high: its 95 % interval.
      in_plant: the value that brings the plant at its time step closest to the robot.
    """

    name: str
    value: float
    low: float
    high: float
    unit: str
    in_plant: float

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        return {
            "value": self.value,
            "low": self.low,
            "high": self.high,
            "unit": self.unit,
            "in_plant": self.in_plant,
        }


@dataclass(frozen=True)
class Found:
    """An effect with fitted values.

    Attributes:
      effect: its name.
      location: name of the cable or point; "" for the whole robot.
      values: of its parameters.
      term: the same, to be added to a plant.
      held_back: a value ended at the limit of its prior.
      at_bound: its values that ended at a bound of their parameter other than zero.
      gain: on windows that were not fitted; None if not computed.
    """

    effect: str
    location: str
    values: tuple[Value, ...]
    term: Term
    held_back: bool = False
    at_bound: tuple[Value, ...] = ()
    gain: Gain | None = None

    @property
    def label(self) -> str:
        """Readable name: "weak_cable at long_03"."""
        return f"{self.effect} at {self.location}" if self.location else self.effect

    @property
    def family(self) -> str:
        """The effect with the same physical cause, by whatever law."""
        return self.term.effect.family

    @property
    def form(self) -> str:
        """Difference from the effect of its family; "" for that itself."""
        return self.term.effect.form

    @property
    def described(self) -> str:
        """The same with its form: "cable_friction (different from cable to cable)"."""
        return f"{self.label} ({self.form})" if self.form else self.label

    @property
    def by_part(self) -> tuple[Value, ...]:
        """Its size at each part, if that differs; the intervals assume the common one as known."""
        if not isinstance(self.term.effect, PerPart):
            return ()
        common = self.values[0]
        return tuple(
            replace(
                common,
                name=f"{common.name} at {part}",
                value=common.value * math.exp(log.value),
                low=common.value * math.exp(log.low),
                high=common.value * math.exp(log.high),
                in_plant=common.in_plant * math.exp(log.in_plant),
            )
            for part, log in zip(self.term.effect.parts, self._factors, strict=True)
        )

    @property
    def readable(self) -> tuple[Value, ...]:
        """Its values for people: sizes of parts instead of logarithms of factors."""
        return self.values[: len(self.values) - len(self._factors)] + self.by_part

    @property
    def _factors(self) -> tuple[Value, ...]:
        effect = self.term.effect
        return self.values[-len(effect.parts) :] if isinstance(effect, PerPart) else ()

    @property
    def shown(self) -> bool:
        """True if the interval of one of its sizes excludes zero."""
        sizes = self.values[: len(self.term.effect.sizes)]
        return any(value.low > 0 or value.high < 0 for value in sizes)

    @property
    def certainty(self) -> float:
        """Largest of its sizes over its interval's width."""
        sizes = self.values[: len(self.term.effect.sizes)]
        return max(abs(v.value) / max(v.high - v.low, 1e-300) for v in sizes)

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        return {
            "effect": self.effect,
            "family": self.family,
            "form": self.form,
            "location": self.location,
            "parameters": {v.name: v.summary() for v in self.values},
            **({"by_part": {v.name: v.summary() for v in self.by_part}} if self.by_part else {}),
            **({} if self.gain is None else {"held_out_gain": self.gain.summary()}),
        }


Alternative = tuple[Found, ...]


def found(
    term: Term,
    deviations: Floats,
    by_step: Floats,
    robot: Robot,
    believed: float = FittingSettings().believed,
) -> Found:
    """A term with the uncertainty of its values.

    Args:
      term: an effect with fitted values.
      deviations, by_step: of these values, as in `Uncertainty`.
      robot: of the effect.
      believed: allowed number of prior standard deviations.
    """
    values = tuple(
        _value(parameter, value, deviation, of_step)
        for parameter, value, deviation, of_step in zip(
            term.effect.parameters, term.values, deviations, by_step, strict=True
        )
    )
    known = zip(term.values, term.known, strict=False)
    held_back = any(abs(value) > NEAR * believed * deviation for value, deviation in known)
    location = place_name(term.effect, term.place, robot)
    at_bound = tuple(
        value
        for value, parameter in zip(values, term.effect.parameters, strict=True)
        if _at_bound(value.in_plant / parameter.typical(Scales.of(robot)), parameter)
    )
    return Found(term.effect.name, location, values, term, held_back, at_bound)


def _at_bound(size: float, parameter: Parameter) -> bool:
    """True if a size, in typical ones, is at a bound; zero does not count as one."""
    return size >= NEAR * parameter.high or (
        not parameter.one_sided and size <= NEAR * parameter.low
    )


def _value(parameter: Parameter, fitted: float, deviation: float, by_step: float) -> Value:
    least = 0.0 if parameter.one_sided else -np.inf
    value = max(fitted - by_step, least)
    low, high = (value + side * INTERVAL * deviation for side in (-1.0, 1.0))
    return Value(
        parameter.name, float(value), float(max(low, least)), float(high), parameter.unit, fitted
    )


def beyond(limits: Limits, own: OwnErrors) -> Limits:
    """Limits that include a model's own errors."""
    return replace(
        limits,
        threshold=max(limits.threshold, limits.margin * own.score),
        max_residual_variance=limits.max_residual_variance * max(1.0, own.noise),
        correlated=limits.correlated + max(0.0, own.correlation),
        outstanding=max(limits.outstanding, own.loudest),
    )


def tolerated(limits: Limits, left: Adequacy) -> bool:
    """True if the residual beyond noise is within the tolerance."""
    return limits.tolerance > 0.0 and left.beyond_noise <= limits.tolerance


def only_noise(limits: Limits, left: Adequacy) -> bool:
    """True if only noise, or a tolerated residual, is left."""
    return tolerated(limits, left) or (
        left.noise < limits.max_residual_variance + limits.sure * left.doubt
        and left.correlation * min(left.noise, 1.0) < limits.correlated
        and left.loudest < limits.outstanding
    )


def carries_over(limits: Limits, held_out: Errors | None) -> bool:
    """True if the explanation of fitted recordings also holds for held-out ones; True without any."""
    if held_out is None:
        return True
    most = limits.max_held_out_variance * held_out.noise**2
    return held_out.augmented**2 < most


def worth_having(limits: Limits, gain: Gain) -> bool:
    """True if effects remove enough of the initial model's error to be named as a part of it."""
    return gain.clear and gain.share >= limits.least_share


def imitated(limits: Limits, law: Misspecification) -> bool:
    """True if an effect of the answer only imitates a law outside the library.

    That law explains so much more that it would have been visible in addition to the effect.
    """
    return law.gain > limits.threshold


def other_form(limits: Limits, law: Misspecification) -> bool:
    """True if the answer has another form than the effects of the library.

    An existing effect leaves a residual to another law if the plant has it in a slightly different
    form; but in its place that law would not explain more.
    """
    beside = law.score > limits.threshold and law.share > limits.least_share
    return imitated(limits, law) or beside


@dataclass(frozen=True)
class Facts:
    """Facts about an answer, on which its verdict depends.

    Attributes:
      limits: in force.
      answer: its effects; empty if nothing was found.
      before, after: residuals of the first and the last model.
      law: laws outside the library that explain more than the answer.
      converged: the last model's cost is finite, and most windows fit no worse than before the fit.
      blind: no candidate would be visible at any allowed size.
      discrepancy: the error that any model leaves counts as noise, and is left all the same.
      unfinished: the search was stopped while further candidates were visible.
      as_built: numbers of the robot as built belong to the model.
      gain: of all effects of the answer on windows that were not fitted; None if not computed.
      held_out: errors on held-out recordings; None without any.
      ambiguous: other effects explain the recordings as well.
    """

    limits: Limits
    answer: Alternative
    before: Adequacy
    after: Adequacy
    law: Misspecification = NONE
    converged: bool = True
    blind: bool = False
    discrepancy: bool = False
    unfinished: bool = False
    as_built: bool = False
    gain: Gain | None = None
    held_out: Errors | None = None
    ambiguous: bool = False


def verdict_of(facts: Facts) -> Verdict:
    """The verdict in a word, from the facts known so far."""
    if not facts.converged:
        return Verdict.NOT_CONVERGED
    verdict = _with_effects(facts) if facts.answer else _without_effects(facts)
    if facts.unfinished and verdict in (Verdict.NOISE_ONLY, Verdict.OUTSIDE_LIBRARY):
        return Verdict.NOT_CONVERGED
    return verdict


def _without_effects(facts: Facts) -> Verdict:
    limits, after = facts.limits, facts.after
    beside = facts.discrepancy or other_form(limits, facts.law)
    if not only_noise(limits, after) or (beside and not tolerated(limits, after)):
        return Verdict.OUTSIDE_LIBRARY
    if facts.blind:
        return Verdict.DATA_INSUFFICIENT
    valid = not facts.as_built or carries_over(limits, facts.held_out)
    return Verdict.NOISE_ONLY if valid else Verdict.OUTSIDE_LIBRARY


def _with_effects(facts: Facts) -> Verdict:
    limits, before, after, law = facts.limits, facts.before, facts.after, facts.law
    matters = not tolerated(limits, after)
    # An effect of which nobody can say that it is there, although it explains much, is not the effect.
    certain = all(each.shown for each in facts.answer)
    certain = certain and (after.constant or not matters)
    enough = only_noise(limits, after) and not (matters and other_form(limits, law))
    if certain and enough and not (matters and facts.discrepancy):
        return Verdict.AMBIGUOUS if facts.ambiguous else Verdict.EFFECT
    explained = (before.noise - after.noise) / max(before.noise - 1.0, 1e-9)
    most = enough or (explained > limits.most and not imitated(limits, law))
    gained = facts.gain is not None and worth_having(limits, facts.gain)
    return Verdict.PARTIAL if gained or (certain and most) else Verdict.OUTSIDE_LIBRARY
