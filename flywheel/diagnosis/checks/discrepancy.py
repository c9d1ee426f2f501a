"""A learned law that stands in for physics that the library does not have.

Where none of the library's effects explains the recordings, a small network is put into the law of the
cables: their strain, speed and direction give an extra tension, the same network for all cables. Its
hidden layer is drawn at random and stays so; its outputs are trained like any effect is fitted, through
the plant and with the windows' starts, by Levenberg-Marquardt with a normal prior (random features:
Rahimi and Recht 2007). Many random features find more than few trained ones, whose training gets stuck.
What the law changes is then held against what the effects of the library would change, to say what the
unknown looks like.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.parameters import Free, free_values
from flywheel.diagnosis.fitting.stopping import worth_a_round
from flywheel.diagnosis.results.diagnosis import Likeness
from flywheel.diagnosis.selection.probes import is_probe
from flywheel.diagnosis.selection.score_test import ScoreTest
from flywheel.diagnosis.selection.step import Step
from flywheel.effects import Cables, Parameter, Scales, TensionEffect, Term, Terms
from flywheel.effects.effect import Memory, Values
from flywheel.records import Floats

UNITS = 32  # hidden units
STRAIN, FAST = 0.05, 10.0  # of a cable whose inputs are one; speed in those that count as still
BEGINNINGS = 2  # hidden layers whose outputs are trained for a round, to go on with the best
ROUNDS = 5  # of the best of them, at most
PATIENCE = 2  # rounds that explain little before it is given up: the next one may explain much
STEP = 0.05  # of a finite difference of an output
SHOWN = 3  # effects that it is said to be like


class LearnedTension(TensionEffect):
    """A network of one hidden layer: strain, speed and direction of a cable to extra tension.

    Laws of different hidden layers are not simulated in one batch, where effects go by their names.

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
    shown_by = "what no other effect explains"

    def __init__(self, hidden: Floats) -> None:
        self._hidden = hidden

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        strain = cables.elastic / cables.stiffness / cables.rest / STRAIN
        speed = cables.speed / (FAST * cables.slow)
        inputs = np.stack([strain, speed, cables.direction, np.ones_like(strain)], axis=-1)
        outputs = np.stack([values[size.name] for size in self.sizes], axis=-1)
        return (np.tanh(inputs @ self._hidden) * outputs).sum(axis=-1), memory


@dataclass(frozen=True)
class Learned:
    """A trained law.

    Attributes:
      fit: with it.
      likeness: effects that do most nearly what it does, the nearest first.
    """

    fit: Fit
    likeness: tuple[Likeness, ...]


def stand_in(fitter: Fitter, step: Step, seed: int = 0) -> Learned:
    """Train a law on top of a fit.

    Args:
      fitter: of the windows.
      step: the model so far, with the test of the library on top of it.
      seed: of the hidden layer.
    """
    begun = _begun(fitter, step, np.random.default_rng(seed))
    free = _free(fitter, begun[0].terms)
    worth = worth_a_round(fitter, step.fit)
    # From each a step down may be found or not, whatever the sensitivities promise: it must be tried.
    tried = [fitter.fit(fit, free, rounds=1) for fit in begun]
    trained = min(tried, key=lambda fit: fit.cost)
    fruitless = 0
    for _ in range(ROUNDS):
        before, trained = trained, fitter.fit(trained, free, rounds=1)
        fruitless = fruitless + 1 if before.cost - trained.cost <= worth else 0
        if trained.converged or fruitless == PATIENCE:
            break
    return Learned(trained, _likeness(fitter, trained, step.test))


def _begun(fitter: Fitter, step: Step, rng: np.random.Generator) -> list[Fit]:
    """The step's fit with laws of random features that add nothing yet."""
    scales = Scales.of(fitter.windows.robot)
    known = tuple(size.typical(scales) for size in LearnedTension.sizes)
    found = []
    for _ in range(BEGINNINGS):
        law = LearnedTension(rng.normal(size=(4, UNITS)))
        term = Term(law, None, (0.0,) * UNITS, known)
        found.append(fitter.under(step.fit, (*step.fit.terms, term)))
    return found


def _free(fitter: Fitter, terms: Terms) -> list[Free]:
    """The values of terms, of which the last one is a law."""
    law = len(terms) - 1
    return [
        replace(value, step=STEP) if value.term == law else value
        for value in free_values(terms, Scales.of(fitter.windows.robot))
    ]


def _likeness(fitter: Fitter, trained: Fit, test: ScoreTest) -> tuple[Likeness, ...]:
    """The library's effects, which alone may be asked for by name, against what the last term changes."""
    without = fitter.columns(trained, [trained.terms[:-1]])  # (K, D, 1)
    change = test.projection(without)[:, 0]
    power = float(change @ change)
    found = []
    for candidate, shapes in zip(test.candidates, test.slices, strict=True):
        if is_probe(candidate.effect):
            continue
        best = 0.0
        for columns in shapes:
            part = test.columns[:, columns]
            sizes = np.linalg.lstsq(part, change, rcond=None)[0]
            best = max(best, float(change @ (part @ sizes)))
        found.append(Likeness(candidate.effect.name, candidate.location, best / max(power, 1e-300)))
    found.sort(key=lambda each: -each.share)
    return tuple(found[:SHOWN])
