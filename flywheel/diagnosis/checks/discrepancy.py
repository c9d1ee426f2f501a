"""A discrepancy model: a learned law for physics outside the library.

If no effect of the library explains the recordings, a small network is added to the law of the
cables: their strain, speed and direction give an additional tension, the same network for all
cables. Its hidden layer is random and constant; its outputs are fitted like any effect, through the
plant and with the windows' starts, by Levenberg-Marquardt with a normal prior (random features:
Rahimi and Recht 2007). Many random features find more than few trained ones, whose training gets
stuck. The change caused by the law is then compared with those of the library's effects, to
characterise the unknown.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flywheel.diagnosis.checks.held_out import Errors
from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.parameters import FreeParameter
from flywheel.diagnosis.selection.misspecification import is_probe
from flywheel.diagnosis.selection.scores import ScoredModel, ScoreTest
from flywheel.effects import Cables, Parameter, TensionEffect, Term, Terms
from flywheel.effects.effect import Memory, Values
from flywheel.records import Floats

UNITS = 32  # hidden units
BEGINNINGS = 2  # hidden layers whose outputs are fitted for a round; the best continues
ROUNDS = 5  # of the best of them, at most
PATIENCE = 2  # rounds with little gain before it is abandoned: the next one may gain much
STEP = 0.05  # of a finite difference of an output, in typical sizes
SHOWN = 3  # similar effects that are reported
STRAIN, FAST = 0.05, 10.0  # of a cable whose inputs are one; speed in those that count as still


class LearnedTension(TensionEffect):
    """A network of one hidden layer: from strain, speed and direction of a cable to additional tension.

    Laws of different hidden layers are not simulated in one batch, where effects are identified by
    their names.

    Args:
      hidden: (4, UNITS) weights of strain, speed and direction, and biases, of the hidden layer.
    """

    name = "learned_tension"
    sizes = tuple(
        Parameter(f"out{unit}", "N", lambda s: 0.05 * s.weight, low=-10.0, high=10.0)
        for unit in range(UNITS)
    )
    equation = "dT = sum_j v_j tanh(a_j e / l0 + b_j V + c_j tanh(V / v0) + d_j)"
    source = "fitted to the recordings"
    shown_by = "the unexplained error"

    def __init__(self, hidden: Floats) -> None:
        self._hidden = hidden

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        strain = cables.extension / cables.rest / STRAIN
        speed = cables.speed / (FAST * cables.slow)
        inputs = np.stack([strain, speed, cables.direction, np.ones_like(strain)], axis=-1)
        outputs = np.stack([values[size.name] for size in self.sizes], axis=-1)
        return (np.tanh(inputs @ self._hidden) * outputs).sum(axis=-1), memory


@dataclass(frozen=True)
class Resemblance:
    """Similarity of an effect of the library to a learned law.

    Attributes:
      effect, location: the effect.
      share: of the law's squared change, reproduced by the effect's best size; 1 for all of it.
    """

    effect: str
    location: str
    share: float

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        return {"effect": self.effect, "location": self.location, "share": self.share}


@dataclass(frozen=True)
class DiscrepancyModel:
    """A law of the cables, fitted to the recordings for an effect outside the library.

    Attributes:
      errors: on the fitted recordings; the baseline has all identified effects.
      held_out: on the others, with the initial plant as baseline; None without any.
      resembles: most similar effects, nearest first.
    """

    errors: Errors
    held_out: Errors | None
    resembles: tuple[Resemblance, ...]

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        return {
            "error": self.errors.summary(),
            "held_out": None if self.held_out is None else self.held_out.summary(),
            "like": [each.summary() for each in self.resembles],
        }


def learned_law(fitter: Fitter, model: ScoredModel, seed: int = 0) -> Fit:
    """Fit a law on top of a model; it is the last term of the returned fit.

    Args:
      fitter: of the windows.
      model: so far, with the test of the library on top of it.
      seed: of the hidden layer.
    """
    begun = _begun(fitter, model.fit, np.random.default_rng(seed))
    free = _free(fitter, begun[0].terms)
    worthwhile = fitter.worthwhile(model.fit)
    # From each a step down may be found or not, whatever the Jacobian promises: it must be tried.
    tried = [fitter.fit(fit, free, rounds=1) for fit in begun]
    trained = min(tried, key=lambda fit: fit.cost)
    fruitless = 0
    for _ in range(ROUNDS):
        before, trained = trained, fitter.fit(trained, free, rounds=1)
        fruitless = fruitless + 1 if before.cost - trained.cost <= worthwhile else 0
        if trained.converged or fruitless == PATIENCE:
            break
    return trained


def resemblances(fitter: Fitter, trained: Fit, test: ScoreTest) -> tuple[Resemblance, ...]:
    """The effects of the library most similar to the last term of a fit.

    Args:
      fitter, trained: the model with the law.
      test: of the library on top of the model without it.
    """
    without = fitter.columns(trained, [trained.terms[:-1]])  # (K, D, 1)
    change = test.projection(without)[:, 0]
    squares = float(change @ change)
    found = []
    for candidate, shapes in zip(test.candidates, test.slices, strict=True):
        if is_probe(candidate.effect) or candidate.effect.form:
            continue
        best = 0.0
        for columns in shapes:
            part = test.columns[:, columns]
            sizes = np.linalg.lstsq(part, change, rcond=None)[0]
            best = max(best, float(change @ (part @ sizes)))
        share = best / max(squares, 1e-300)
        found.append(Resemblance(candidate.effect.name, candidate.location, share))
    found.sort(key=lambda each: -each.share)
    return tuple(found[:SHOWN])


def _begun(fitter: Fitter, fit: Fit, rng: np.random.Generator) -> list[Fit]:
    """A fit with laws of random features and zero outputs."""
    known = tuple(size.typical(fitter.scales) for size in LearnedTension.sizes)
    found = []
    for _ in range(BEGINNINGS):
        law = LearnedTension(rng.normal(size=(4, UNITS)))
        term = Term(law, None, (0.0,) * UNITS, known)
        found.append(fitter.with_terms(fit, (*fit.terms, term)))
    return found


def _free(fitter: Fitter, terms: Terms) -> list[FreeParameter]:
    """The values of terms, the last of which is a law with its own step."""
    law = len(terms) - 1
    return [
        replace(value, step=STEP) if value.term == law else value for value in fitter.free(terms)
    ]
