"""The diagnosis: from recordings to a verdict."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

from flywheel.diagnosis.adequacy import Adequacy, adequacy
from flywheel.diagnosis.baseline import fitted
from flywheel.diagnosis.calibration import calibrated, unsure_terms
from flywheel.diagnosis.candidates import Candidate, candidates
from flywheel.diagnosis.diagnosis import Diagnosis, Errors, StandIn
from flywheel.diagnosis.evidence import Evidence
from flywheel.diagnosis.fit import Fit, Fitter
from flywheel.diagnosis.free import free_values
from flywheel.diagnosis.limits import Limits, verdict_of
from flywheel.diagnosis.network_fit import NetworkFitter
from flywheel.diagnosis.selection import Selection, Step
from flywheel.diagnosis.stand_in import stand_in
from flywheel.diagnosis.subject import Subject
from flywheel.diagnosis.uncertainty import uncertainty
from flywheel.diagnosis.under_test import UnderTest
from flywheel.diagnosis.verdict import Alternative, Verdict, found
from flywheel.diagnosis.whereabouts import whereabouts
from flywheel.diagnosis.windows import Windows
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS, Effect, Terms
from flywheel.errors import ModelError
from flywheel.records import Trajectory

PASSES = 2  # for a model: where the plant starts depends on what it lacks
EXPLAINED = (Verdict.EFFECT, Verdict.PARTIAL)
UNEXPLAINED = (Verdict.OUTSIDE_LIBRARY, Verdict.PARTIAL)


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
    unsure: Mapping[str, float] = MappingProxyType({}),
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
      unsure: what the plant is not sure of, see `unsure_terms`: fitted beside everything else, within
        what is known of it, and not asked about.

    Raises:
      DataError: recordings that cannot be used; or something that one cannot be unsure of.
      ModelError: a model for another robot or control step, or that looks back further than windows go.
    """
    begun = time.perf_counter()
    under_test = UnderTest(plant, model, seed)
    terms = unsure_terms(unsure, plant.terms)
    if model is not None and terms:
        raise ModelError("A trained model has no numbers of an MJCF that one can be unsure of.")
    asked = {name: effect for name, effect in library.items() if name not in unsure}
    search = _searched(
        under_test,
        recordings,
        window_seconds,
        candidates(plant.robot, asked),
        terms,
        limits,
        progress,
    )
    found = _concluded(under_test, search, held_out)
    return replace(found, seconds=time.perf_counter() - begun)


@dataclass(frozen=True)
class _Search:
    """How far a search came.

    Attributes:
      first: the model as it was.
      selection: of effects.
      steps: of the selection, the first with what the plant was not sure of.
      limits: that it was held to.
    """

    first: Fit
    selection: Selection
    steps: list[Step]
    limits: Limits


def _searched(
    under_test: UnderTest,
    recordings: Sequence[Trajectory],
    seconds: float | None,
    library: Sequence[Candidate],
    unsure: Terms,
    limits: Limits,
    progress: Callable[[str], None],
) -> _Search:
    """Add effects until none explains any more."""
    around: Terms | None = None
    for _ in range(1 if under_test.model is None else PASSES):
        fitter, first = under_test.fitted(recordings, seconds, around=around)
        selection = Selection(fitter, library, limits.threshold, progress)
        look, here = selection.look(calibrated(fitter, first, unsure)), limits
        if isinstance(fitter, NetworkFitter):
            here = limits.beyond(fitter.own_errors(look.test))
            selection.threshold = here.threshold
        steps = selection.run(look)
        if len(steps) == 1:
            break
        around = steps[-1].fit.terms
    return _Search(first, selection, steps, here)


def _concluded(under_test: UnderTest, search: _Search, held_out: Sequence[Trajectory]) -> Diagnosis:
    """What a search says."""
    selection, steps, limits = search.selection, search.steps, search.limits
    fitter, last = selection.fitter, steps[-1]
    before, after = (_adequacy(selection, step) for step in (steps[0], last))
    effects = _effects(selection, last.fit)
    answer = tuple(each for each in effects if not each.term.known) if len(steps) > 1 else ()
    verdict = verdict_of(limits, steps, answer, before, after)
    others: tuple[Alternative, ...] = ()
    if verdict in EXPLAINED:
        fits = selection.others(steps, limits.equally_good)
        others = tuple(_answer(selection, fit) for fit in fits)
    unexplained = verdict in UNEXPLAINED
    return Diagnosis(
        verdict=Verdict.AMBIGUOUS if others and verdict is Verdict.EFFECT else verdict,
        answers=(answer, *others),
        ranking=steps[0].scores,
        threshold=limits.threshold,
        errors=_errors(fitter, search.first, last.fit),
        held_out=_held_out(under_test, held_out, last.fit.terms, fitter.windows),
        before=before,
        after=after,
        evidence=Evidence.of(fitter, steps),
        where=whereabouts(fitter, last.test) if unexplained else None,
        stand_in=_stand_in(under_test, fitter, last, held_out) if unexplained else None,
        model="" if under_test.model is None else under_test.model.name,
        calibration=tuple(each for each in effects if each.term.known),
    )


def _adequacy(selection: Selection, step: Step) -> Adequacy:
    return adequacy(selection.fitter, step.fit, step.test, selection.known(step.fit))


def _answer(selection: Selection, fit: Fit) -> Alternative:
    """The effects of a fit that were asked about."""
    return tuple(each for each in _effects(selection, fit) if not each.term.known)


def _effects(selection: Selection, fit: Fit) -> Alternative:
    """All effects of a fit, with intervals."""
    if not fit.terms:
        return ()
    sure = uncertainty(selection.fitter, fit, free_values(fit.terms, selection.scales))
    robot, effects, start = selection.fitter.windows.robot, [], 0
    for term in fit.terms:
        stop = start + len(term.values)
        here = slice(start, stop)
        effects.append(found(term, sure.deviations[here], sure.by_step[here], robot))
        start = stop
    return tuple(effects)


def _errors(fitter: Fitter, before: Fit, after: Fit) -> Errors:
    return Errors(fitter.windows.sigma, fitter.rms(before), fitter.rms(after))


def _held_out(
    under_test: UnderTest, recordings: Sequence[Trajectory], terms: Terms, fitted_on: Windows
) -> Errors | None:
    """Errors with terms that stay as they are; None without recordings."""
    if not recordings:
        return None
    seconds = fitted_on.steps * fitted_on.dt
    fitter, before = under_test.fitted(recordings, seconds, fitted_on.sigma, around=terms)
    same = terms == before.terms
    return _errors(fitter, before, before if same else fitted(fitter, terms, seed=under_test.seed))


def _stand_in(
    under_test: UnderTest, fitter: Fitter, last: Step, held_out: Sequence[Trajectory]
) -> StandIn:
    """A learned law on top of the last model, and what it is like."""
    learned = stand_in(fitter, last.fit, last.test, under_test.seed)
    terms = learned.fit.terms
    return StandIn(
        _errors(fitter, last.fit, learned.fit),
        _held_out(under_test, held_out, terms, fitter.windows),
        learned.likeness,
    )
