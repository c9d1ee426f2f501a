"""The diagnosis: from recordings to a verdict."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flywheel.diagnosis.adequacy import Adequacy, adequacy
from flywheel.diagnosis.baseline import fitted, fitter_of
from flywheel.diagnosis.candidates import candidates
from flywheel.diagnosis.evidence import Evidence, rms
from flywheel.diagnosis.fit import Fit
from flywheel.diagnosis.free import free_values
from flywheel.diagnosis.selection import Selection, Step
from flywheel.diagnosis.uncertainty import deviations
from flywheel.diagnosis.verdict import Alternative, Diagnosis, Errors, Verdict, found
from flywheel.diagnosis.windows import Windows
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS, Effect, Terms
from flywheel.records import Trajectory

THRESHOLD = 25.0  # score from which an effect counts as seen
EQUALLY_GOOD = 10.0  # difference of two criteria (BIC) below which data do not tell
LOUD = 1.10  # variance of what is left from which it is more than noise
CORRELATED = 0.08  # correlation from sample to sample, likewise
INCONSTANT = 7.0  # differences of a size between windows, likewise


@dataclass(frozen=True)
class Limits:
    """What counts as seen, and as noise. See the module's constants."""

    threshold: float = THRESHOLD
    equally_good: float = EQUALLY_GOOD
    loud: float = LOUD
    correlated: float = CORRELATED
    inconstant: float = INCONSTANT

    def enough(self, left: Adequacy) -> bool:
        """Nothing but noise is left."""
        return left.noise < self.loud and left.correlation < self.correlated

    def constant(self, left: Adequacy) -> bool:
        """Fitted sizes are the same everywhere."""
        return left.inconstancy < self.inconstant


def diagnose(
    plant: Plant,
    recordings: Sequence[Trajectory],
    held_out: Sequence[Trajectory] = (),
    library: Mapping[str, Effect] = EFFECTS,
    limits: Limits = Limits(),
    window_seconds: float | None = None,
    seed: int = 0,
    progress: Callable[[str], None] = lambda note: None,
) -> Diagnosis:
    """Find out which effects a plant lacks to explain recordings.

    Args:
      plant: the model under test. Effects that it has already are fitted anew beside those found.
      recordings: unbatched, of its control step.
      held_out: further ones, on which the answer is only judged.
      library: effects that may be missing.
      limits: what counts as seen.
      window_seconds: length of the windows [s]; None for what suits the robot.
      seed: of the search for starts.
      progress: told what has been done, every few seconds.

    Raises:
      DataError: recordings that cannot be used.
    """
    begun = time.perf_counter()
    windows = Windows.cut(plant.robot, recordings, window_seconds)
    fitter = fitter_of(windows, plant)
    library_here = candidates(plant.robot, library)
    selection = Selection(fitter, library_here, limits.threshold, progress)
    steps = selection.run(fitted(fitter, plant.terms, seed=seed))
    last = steps[-1]
    alternatives = selection.alternatives(steps, limits.equally_good)
    before, after = (_adequacy(selection, step) for step in (steps[0], last))
    return Diagnosis(
        verdict=_verdict(limits, steps, len(alternatives), before, after),
        answers=tuple(_answer(selection, fit) for fit in alternatives) if len(steps) > 1 else ((),),
        ranking=steps[0].scores,
        threshold=limits.threshold,
        errors=_errors(windows, steps[0].fit, last.fit),
        held_out=_held_out(plant, held_out, last.fit.terms, windows, seed) if held_out else None,
        before=before,
        after=after,
        evidence=Evidence.of(windows, steps),
        seconds=time.perf_counter() - begun,
    )


def _verdict(
    limits: Limits, steps: Sequence[Step], alternatives: int, before: Adequacy, after: Adequacy
) -> Verdict:
    last = steps[-1]
    if not np.isfinite(last.fit.cost):
        return Verdict.NOT_CONVERGED
    if len(steps) == 1:
        if limits.enough(before):
            smallest = [score.smallest for score in last.scores]
            blind = all(
                size > s.candidate.effect.sizes[0].high
                for size, s in zip(smallest, last.scores, strict=True)
            )
            return Verdict.DATA_INSUFFICIENT if blind else Verdict.NOISE_ONLY
        return Verdict.OUTSIDE_LIBRARY
    if not limits.constant(after):
        return Verdict.OUTSIDE_LIBRARY
    if not limits.enough(after):
        explained = (before.noise - after.noise) / max(before.noise - 1.0, 1e-9)
        return Verdict.PARTIAL if explained > 0.5 else Verdict.OUTSIDE_LIBRARY
    return Verdict.AMBIGUOUS if alternatives > 1 else Verdict.EFFECT


def _adequacy(selection: Selection, step: Step) -> Adequacy:
    return adequacy(selection.fitter, step.fit, step.test, selection.known(step.fit))


def _answer(selection: Selection, fit: Fit) -> Alternative:
    """The effects of a fit with intervals."""
    spread = deviations(selection.fitter, fit, free_values(fit.terms, selection.scales))
    robot, answer, start = selection.fitter.predictor.windows.robot, [], 0
    for term in fit.terms:
        stop = start + len(term.values)
        answer.append(found(term, spread[start:stop].tolist(), robot))
        start = stop
    return tuple(answer)


def _errors(windows: Windows, before: Fit, after: Fit) -> Errors:
    return Errors(windows.sigma, rms(windows, before), rms(windows, after))


def _held_out(
    plant: Plant, recordings: Sequence[Trajectory], terms: Terms, fitted_on: Windows, seed: int
) -> Errors:
    """Errors where only the starts were fitted."""
    seconds = fitted_on.steps * fitted_on.dt
    windows = Windows.cut(plant.robot, recordings, seconds, fitted_on.sigma)
    fitter = fitter_of(windows, plant)
    before = fitted(fitter, plant.terms, seed=seed)
    after = before if terms == plant.terms else fitted(fitter, terms, seed=seed)
    return _errors(windows, before, after)
