"""The diagnosis: from recordings to a verdict."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from flywheel.diagnosis.checks.adequacy import Adequacy, adequacy
from flywheel.diagnosis.checks.detectability import kept
from flywheel.diagnosis.checks.discrepancy import stand_in
from flywheel.diagnosis.checks.held_out import HeldOut, errors
from flywheel.diagnosis.checks.localisation import whereabouts
from flywheel.diagnosis.checks.uncertainty import uncertainty
from flywheel.diagnosis.fitting.jacobian_cache import Linear
from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.model import UnderTest
from flywheel.diagnosis.fitting.multistart import eased
from flywheel.diagnosis.fitting.network_fit import NetworkFitter
from flywheel.diagnosis.fitting.nuisance import calibrated, unsure_terms
from flywheel.diagnosis.fitting.parameters import free_values
from flywheel.diagnosis.fitting.stopping import worth_a_round
from flywheel.diagnosis.fitting.subject import Subject
from flywheel.diagnosis.pulse import Pulse
from flywheel.diagnosis.results.diagnosis import Diagnosis, StandIn, TimeSteps
from flywheel.diagnosis.results.evidence import Evidence
from flywheel.diagnosis.results.limits import Limits, verdict_of
from flywheel.diagnosis.results.verdict import Alternative, Verdict, found
from flywheel.diagnosis.selection.alternatives import exchanged
from flywheel.diagnosis.selection.candidates import Candidate, candidates
from flywheel.diagnosis.selection.deduplication import places
from flywheel.diagnosis.selection.misspecification import OtherLaw, other_law
from flywheel.diagnosis.selection.probes import PROBES, probed
from flywheel.diagnosis.selection.step import Step
from flywheel.diagnosis.selection.stepwise import Selection
from flywheel.diagnosis.selection.suspect_parameters import doubtful_numbers
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS, Effect, Terms
from flywheel.errors import DataError, ModelError
from flywheel.records import Trajectory

PASSES = 2  # for a model: where the plant starts depends on what it lacks
SUSPECT = 1.1  # mean square of a window from which its start is doubted before anything is said to be left
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
      DataError: recordings that cannot be used; something that one cannot be unsure of; or nothing that
        is asked about.
      ModelError: a model for another robot or control step, or that looks back further than windows go.
    """
    begun = time.perf_counter()
    pulse = Pulse(progress)
    under_test = UnderTest(plant, model, seed, pulse.again)
    terms = unsure_terms(unsure, plant.terms)
    if model is not None and terms:
        raise ModelError("A trained model has no numbers of an MJCF that one can be unsure of.")
    asked = {name: effect for name, effect in library.items() if name not in unsure}
    if not asked:
        raise DataError("There is no effect to ask about, but those that the plant is unsure of.")
    if held_out:
        _usable(under_test, held_out, window_seconds)
    search = _searched(
        under_test,
        recordings,
        window_seconds,
        candidates(plant.robot, asked),
        terms,
        limits,
        pulse,
    )
    found = _concluded(under_test, search, held_out)
    return replace(found, seconds=time.perf_counter() - begun)


def _usable(under_test: UnderTest, held_out: Sequence[Trajectory], seconds: float | None) -> None:
    """Whether recordings can be judged by, asked before a search that takes minutes."""
    try:
        under_test.windows(held_out, seconds)
    except DataError as error:
        raise DataError(f"Held-out recordings: {error}") from error


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
        fitter, first = under_test.fitted(recordings, seconds, around=around, calibrated=not unsure)
        probes = candidates(fitter.windows.robot, PROBES)
        selection = Selection(fitter, library, limits.threshold, progress, probes)
        look, here = selection.look(_calibrated(selection, first, unsure)), limits
        if isinstance(fitter, NetworkFitter):
            here = limits.beyond(fitter.own_errors(look.test))
            selection.threshold = here.threshold
        steps = selection.run(look)
        if len(steps) == 1:
            break
        around = steps[-1].fit.terms
    return _Search(first, selection, steps, here)


def _calibrated(selection: Selection, fit: Fit, unsure: Terms) -> Fit:
    """The model with what it was not sure of, in time steps that will do unless it lacks more."""
    if not unsure:
        return fit
    fit = calibrated(selection.fitter, fit, unsure)
    return fit if worth_a_round(selection.fitter, fit) else selection.in_time_steps(fit)


@dataclass(frozen=True)
class _Judged:
    """What the steps of a selection say.

    Attributes:
      steps: of it.
      effects: of the last step's model, with intervals.
      answer: those of them that were asked about; none where nothing was found.
      before, after: what the first and the last model leave.
      law: what laws that are none of the library explain that it does not.
      verdict: before it is asked whether others explain the recordings as well.
    """

    steps: list[Step]
    effects: Alternative
    answer: Alternative
    before: Adequacy
    after: Adequacy
    law: OtherLaw
    verdict: Verdict


def _concluded(under_test: UnderTest, search: _Search, held_out: Sequence[Trajectory]) -> Diagnosis:
    """What a search says."""
    selection = search.selection
    judged = _trusted(search, _judged(search, search.steps))
    judged = _trusted(search, _doubted(search, judged, under_test.seed))
    judged, others = _settled(search, judged)
    fitter, last = selection.fitter, judged.steps[-1]
    judge = HeldOut(under_test, held_out, fitter.windows)
    unexplained = judged.verdict in UNEXPLAINED
    left = unexplained and not search.limits.nothing_left(judged.after)
    ambiguous = others and judged.verdict is Verdict.EFFECT
    return Diagnosis(
        verdict=Verdict.AMBIGUOUS if ambiguous else judged.verdict,
        answers=(judged.answer, *(_asked(_effects(selection, fit)) for fit in others)),
        ranking=kept(fitter, judged.steps[0], np.random.default_rng(under_test.seed)),
        threshold=search.limits.threshold,
        errors=errors(fitter, search.first, last.fit),
        held_out=judge.errors(last.fit.terms),
        before=judged.before,
        after=judged.after,
        other_law=judged.law,
        other_form=search.limits.other_form(judged.law),
        evidence=Evidence.of(fitter, judged.steps),
        where=whereabouts(fitter, last.test) if left else None,
        stand_in=_stand_in(fitter, last, judge, under_test.seed) if left else None,
        model="" if under_test.model is None else under_test.model.name,
        calibration=tuple(each for each in judged.effects if each.term.known),
        time_steps=TimeSteps(fitter.windows.robot.timestep, tuple(fitter.time_steps.tolist())),
        doubtful=() if under_test.model else doubtful_numbers(selection, judged.steps, unexplained),
    )


def _judged(search: _Search, steps: list[Step], instead: Sequence[Fit] = ()) -> _Judged:
    """What steps say, and models `instead` with a law in the place of an effect."""
    fitter, first, last = search.selection.fitter, steps[0], steps[-1]
    before, after = (adequacy(fitter, s.fit, s.test, s.sizes) for s in (first, last))
    effects = _effects(search.selection, last.fit, last.linear)
    answer = _asked(effects) if len(steps) > 1 else ()
    law = other_law(search.selection, first, last, instead)
    verdict = verdict_of(search.limits, last, answer, before, after, law)
    return _Judged(steps, effects, answer, before, after, law, verdict)


def _trusted(search: _Search, judged: _Judged) -> _Judged:
    """Without effects of which nobody can say that they are there, beside others that are."""
    selection = search.selection
    while len(new := selection.new(judged.steps)) > 1:
        doubtful = [each for each in judged.answer if each.term in new and not each.shown]
        if not doubtful:
            break
        weakest = min(doubtful, key=lambda each: each.certainty)
        fit = selection.shortened(judged.steps[-1].fit, weakest.term)
        judged = _judged(search, [*_before(judged.steps, fit), selection.look(fit)])
    return judged


def _before(steps: Sequence[Step], fit: Fit) -> list[Step]:
    """Steps whose models are part of a model."""
    return [step for step in steps[:-1] if places(step.fit.terms) < places(fit.terms)]


def _doubted(search: _Search, judged: _Judged, seed: int) -> _Judged:
    """Before something is said to be left: with other starts for every window that is loud."""
    selection, last = search.selection, judged.steps[-1]
    if judged.verdict not in UNEXPLAINED:
        return judged
    begun = eased(selection.fitter, last.fit, seed + 1, stuck=SUSPECT, usual=1.0)
    if begun is last.fit:
        return judged
    fit = selection.pursued(replace(begun, converged=False))
    return _judged(search, [*judged.steps[:-1], selection.look(fit)])


def _settled(search: _Search, judged: _Judged) -> tuple[_Judged, list[Fit]]:
    """The best of all models that explain the recordings as well, and the others.

    Those with a law that is none of the library are no answer, but may say that this one is none.
    """
    selection, last = search.selection, judged.steps[-1].fit
    if judged.verdict not in EXPLAINED:
        return judged, []
    margin = search.limits.equally_good
    exchange = exchanged(selection, judged.steps, margin)
    if step := exchange.shorter(selection):
        shorter = _judged(search, [*_before(judged.steps, step.fit), step])
        return _settled(search, _trusted(search, shorter))
    known = [fit for fit in exchange.others if not probed(fit.terms)]
    first, *rivals = sorted([exchange.last, *known], key=selection.criterion)
    instead = [fit for fit in exchange.others if probed(fit.terms)]
    limit = selection.criterion(first) + margin
    if first is not last or instead:
        steps = judged.steps if first is last else [*judged.steps[:-1], selection.look(first)]
        judged = _judged(search, steps, instead)
        shorter = _trusted(search, judged)
        if shorter is not judged:
            return _settled(search, shorter)
    return judged, [fit for fit in rivals if selection.criterion(fit) < limit]


def _asked(effects: Alternative) -> Alternative:
    return tuple(each for each in effects if not each.term.known)


def _effects(selection: Selection, fit: Fit, linear: Linear | None = None) -> Alternative:
    """All effects of a fit, with intervals."""
    if not fit.terms:
        return ()
    sure = uncertainty(selection.fitter, fit, free_values(fit.terms, selection.scales), linear)
    robot, effects, start = selection.fitter.windows.robot, [], 0
    for term in fit.terms:
        stop = start + len(term.values)
        here = slice(start, stop)
        effects.append(found(term, sure.deviations[here], sure.by_step[here], robot))
        start = stop
    return tuple(effects)


def _stand_in(fitter: Fitter, last: Step, judge: HeldOut, seed: int) -> StandIn:
    """A learned law on top of the last model, and what it is like."""
    learned = stand_in(fitter, last, seed)
    return StandIn(
        errors(fitter, last.fit, learned.fit), judge.errors(learned.fit.terms), learned.likeness
    )
