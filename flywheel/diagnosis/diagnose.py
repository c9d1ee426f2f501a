"""The diagnosis: from recordings to a verdict."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flywheel.diagnosis.adequacy import Adequacy, adequacy
from flywheel.diagnosis.baseline import fitted, fitter_of
from flywheel.diagnosis.candidates import candidates
from flywheel.diagnosis.evidence import Evidence
from flywheel.diagnosis.fit import Fit, Fitter
from flywheel.diagnosis.free import free_values
from flywheel.diagnosis.network_fit import NetworkFitter, OwnErrors
from flywheel.diagnosis.selection import Selection, Step
from flywheel.diagnosis.subject import Subject
from flywheel.diagnosis.uncertainty import uncertainty
from flywheel.diagnosis.verdict import Alternative, Diagnosis, Errors, Verdict, found
from flywheel.diagnosis.windows import WINDOW, Windows
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS, Effect, Scales, Terms
from flywheel.errors import ModelError
from flywheel.records import Trajectory

THRESHOLD = 25.0  # score from which an effect counts as seen
EQUALLY_GOOD = 10.0  # difference of two criteria (BIC) below which data do not tell
LOUD = 1.10  # variance of what is left from which it is more than noise
CORRELATED = 0.08  # correlation from sample to sample, likewise
PASSES = 2  # for a model: where the plant starts depends on what it lacks
INCONSTANT = 7.0  # differences of a size between windows, likewise


@dataclass(frozen=True)
class Limits:
    """What counts as seen, and as noise. See the module's constants."""

    threshold: float = THRESHOLD
    equally_good: float = EQUALLY_GOOD
    loud: float = LOUD
    correlated: float = CORRELATED
    inconstant: float = INCONSTANT

    def beyond(self, own: OwnErrors) -> Limits:
        """Where a model's own errors are not taken for more."""
        return replace(
            self,
            threshold=max(self.threshold, own.score),
            loud=self.loud * max(1.0, own.noise),
            correlated=self.correlated + max(0.0, own.correlation),
        )

    def enough(self, left: Adequacy) -> bool:
        """Nothing but noise is left."""
        return left.noise < self.loud and left.correlation < self.correlated

    def constant(self, left: Adequacy) -> bool:
        """Fitted sizes are the same everywhere."""
        return left.inconstancy < self.inconstant


@dataclass(frozen=True)
class UnderTest:
    """What is tested.

    Attributes:
      plant: itself, or what says what effects would change.
      model: that is tested in its stead.
      seed: of what is random.
    """

    plant: Plant
    model: Subject | None
    seed: int

    def fitted(
        self,
        recordings: Sequence[Trajectory],
        seconds: float | None = None,
        sigma: float | None = None,
        around: Terms | None = None,
    ) -> tuple[Fitter, Fit]:
        """A fitter of windows of recordings, and its fit without further effects.

        Where a model is tested, the plant starts from where it fits best with terms like `around`.
        """
        plant, model = self.plant, self.model
        if model is None:
            windows = Windows.cut(plant.robot, recordings, seconds, sigma)
            fitter = fitter_of(windows, plant)
            return fitter, fitted(fitter, plant.terms, seed=self.seed)
        _check(plant, model)
        seen = model.dynamics.history * plant.dt
        seconds = seconds or seen + WINDOW * Scales.of(plant.robot).time
        windows = Windows.cut(plant.robot, recordings, seconds, sigma)
        world = fitter_of(windows, plant)
        start = fitted(world, plant.terms if around is None else around, seed=self.seed)
        if around is not None:
            start = world.fit(start, free_values(around, Scales.of(plant.robot)))
        rng = np.random.default_rng(self.seed)
        network = NetworkFitter(world, start, plant.terms, model, rng)
        return network, network.beginning(plant.terms)


def diagnose(
    plant: Plant,
    recordings: Sequence[Trajectory],
    held_out: Sequence[Trajectory] = (),
    library: Mapping[str, Effect] = EFFECTS,
    limits: Limits = Limits(),
    window_seconds: float | None = None,
    seed: int = 0,
    progress: Callable[[str], None] = lambda note: None,
    model: Subject | None = None,
) -> Diagnosis:
    """Find out which effects a plant, or a trained model, lacks to explain recordings.

    Args:
      plant: the model under test. Effects that it has already are fitted anew beside those found.
      recordings: unbatched, of its control step.
      held_out: further ones, on which the answer is only judged.
      library: effects that may be missing.
      limits: what counts as seen.
      window_seconds: length of the windows [s]; None for what suits the robot.
      seed: of the search for starts.
      progress: told what has been done, every few seconds.
      model: a trained model to be tested in the plant's stead, which then only says what effects would
        change, see `network_fit`.

    Raises:
      DataError: recordings that cannot be used.
      ModelError: a model for another robot or control step, or that looks back further than windows go.
    """
    begun = time.perf_counter()
    under_test = UnderTest(plant, model, seed)
    library_here = candidates(plant.robot, library)
    around: Terms | None = None
    for _ in range(1 if model is None else PASSES):
        fitter, first = under_test.fitted(recordings, window_seconds, around=around)
        selection = Selection(fitter, library_here, limits.threshold, progress)
        look, here = selection.look(first), limits
        if isinstance(fitter, NetworkFitter):
            here = limits.beyond(fitter.own_errors(look.test))
            selection.threshold = here.threshold
        steps = selection.run(look)
        last, windows = steps[-1], fitter.windows
        if len(steps) == 1:
            break
        around = last.fit.terms
    alternatives = selection.alternatives(steps, here.equally_good)
    before, after = (_adequacy(selection, step) for step in (steps[0], last))
    return Diagnosis(
        verdict=_verdict(here, steps, len(alternatives), before, after),
        answers=tuple(_answer(selection, fit) for fit in alternatives) if len(steps) > 1 else ((),),
        ranking=steps[0].scores,
        threshold=here.threshold,
        errors=_errors(fitter, steps[0].fit, last.fit),
        held_out=_held_out(under_test, held_out, last.fit.terms, windows) if held_out else None,
        before=before,
        after=after,
        evidence=Evidence.of(fitter, steps),
        seconds=time.perf_counter() - begun,
        model="" if model is None else model.name,
    )


def _check(plant: Plant, model: Subject) -> None:
    got = (model.dynamics.robot.digest, model.dynamics.dt)
    if got != (plant.robot.digest, plant.dt):
        raise ModelError(
            f"The model {model.name} is for robot {got[0][:12]} in steps of {got[1]:g} s, the plant for "
            f"{plant.robot.digest[:12]} in steps of {plant.dt:g} s."
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
    sure = uncertainty(selection.fitter, fit, free_values(fit.terms, selection.scales))
    robot, answer, start = selection.fitter.windows.robot, [], 0
    for term in fit.terms:
        stop = start + len(term.values)
        here = slice(start, stop)
        answer.append(found(term, sure.deviations[here], sure.by_step[here], robot))
        start = stop
    return tuple(answer)


def _errors(fitter: Fitter, before: Fit, after: Fit) -> Errors:
    return Errors(fitter.windows.sigma, fitter.rms(before), fitter.rms(after))


def _held_out(
    under_test: UnderTest, recordings: Sequence[Trajectory], terms: Terms, fitted_on: Windows
) -> Errors:
    """Errors with terms that stay as they are."""
    seconds = fitted_on.steps * fitted_on.dt
    fitter, before = under_test.fitted(recordings, seconds, fitted_on.sigma, around=terms)
    same = terms == before.terms
    return _errors(fitter, before, before if same else fitted(fitter, terms, seed=under_test.seed))
