"""The diagnosis: from recordings to a verdict."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from flywheel.diagnosis.checks.adequacy import Adequacy, adequacy, own_errors
from flywheel.diagnosis.checks.detectability import detectable
from flywheel.diagnosis.checks.discrepancy import DiscrepancyModel, learned_law, resemblances
from flywheel.diagnosis.checks.held_out import HeldOut, errors
from flywheel.diagnosis.checks.localisation import localise
from flywheel.diagnosis.checks.uncertainty import uncertainty
from flywheel.diagnosis.fitting.least_squares import Fit, Fitter, Jacobian, Restart
from flywheel.diagnosis.fitting.model import ModelUnderTest
from flywheel.diagnosis.fitting.multistart import restarted_with_care
from flywheel.diagnosis.fitting.nuisance import as_built_terms, calibrated, unsure_terms
from flywheel.diagnosis.fitting.subject import Subject
from flywheel.diagnosis.heartbeat import Heartbeat
from flywheel.diagnosis.results.as_built import AsBuiltNumbers
from flywheel.diagnosis.results.diagnosis import Diagnosis, TimeSteps
from flywheel.diagnosis.results.evidence import Evidence
from flywheel.diagnosis.results.verdict import (
    Alternative,
    Verdict,
    beyond,
    carries_over,
    constant,
    found,
    only_noise,
    other_form,
    verdict_of,
)
from flywheel.diagnosis.selection.alternatives import exchanged
from flywheel.diagnosis.selection.candidates import Candidate, candidates, places
from flywheel.diagnosis.selection.misspecification import (
    PROBES,
    Misspecification,
    misspecification,
    probed,
)
from flywheel.diagnosis.selection.score_test import ScoredModel
from flywheel.diagnosis.selection.stepwise import Search, added, in_time_steps, stepwise
from flywheel.diagnosis.selection.suspect_parameters import suspect_parameters
from flywheel.diagnosis.settings import CheckSettings, Limits, Settings
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS, NAMED, Effect, Terms, taken_apart
from flywheel.errors import DataError, ModelError
from flywheel.records import Trajectory

EXPLAINED = (Verdict.EFFECT, Verdict.PARTIAL)
UNEXPLAINED = (Verdict.OUTSIDE_LIBRARY, Verdict.PARTIAL)


def diagnose(
    plant: Plant,
    recordings: Sequence[Trajectory],
    held_out: Sequence[Trajectory] = (),
    library: Mapping[str, Effect] = EFFECTS,
    settings: Settings = Settings(),
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
      settings: tuned numbers, what counts as seen among them (`Limits`).
      window_seconds: length of the windows [s]; None for what suits the robot.
      seed: of the search for initial states.
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
    heartbeat = Heartbeat(progress)
    under_test = ModelUnderTest(plant, model, seed, heartbeat.again, settings)
    terms = unsure_terms(unsure, plant.terms, {**NAMED, **library})
    if model is not None and terms:
        raise ModelError("A trained model has no numbers of an MJCF that one can be unsure of.")
    asked = {name: effect for name, effect in library.items() if name not in unsure}
    if not asked:
        raise DataError("There is no effect to ask about, but those that the plant is unsure of.")
    if held_out:
        _check_usable(under_test, held_out, window_seconds)
    everything = candidates(plant.robot, asked)
    searched = _searched(under_test, recordings, window_seconds, everything, terms, heartbeat)
    answer = _concluded(under_test, searched, held_out)
    return replace(answer, seconds=time.perf_counter() - begun)


def _check_usable(
    under_test: ModelUnderTest, held_out: Sequence[Trajectory], seconds: float | None
) -> None:
    """Refuse recordings that cannot be judged by, before a search that takes minutes."""
    try:
        under_test.windows(held_out, seconds)
    except DataError as error:
        raise DataError(f"Held-out recordings: {error}") from error


@dataclass(frozen=True)
class _Searched:
    """How far a search came.

    Attributes:
      first: the model as it was.
      search: its state.
      models: of it, the first with what the plant was not sure of.
      limits: that it was held to.
      checks: settings of what is asked of the answer.
    """

    first: Fit
    search: Search
    models: list[ScoredModel]
    limits: Limits
    checks: CheckSettings


def _searched(
    under_test: ModelUnderTest,
    recordings: Sequence[Trajectory],
    seconds: float | None,
    library: tuple[Candidate, ...],
    unsure: Terms,
    progress: Callable[[str], None],
) -> _Searched:
    """Add effects until none explains any more."""
    settings, around = under_test.settings, None
    for _ in range(1 if under_test.model is None else settings.fitting.network.passes):
        fitter, first = under_test.fitted(recordings, seconds, around=around, calibrated=not unsure)
        probes = candidates(fitter.windows.robot, PROBES)
        limits = settings.limits
        search = Search(fitter, library, limits.threshold, settings.selection, progress, probes)
        if under_test.model is None:
            present = (*under_test.plant.terms, *unsure)
            named = {candidate.effect.name for candidate in library}
            usual = settings.fitting.as_built
            numbers = as_built_terms(fitter.windows.robot, usual, present, named)
            search = replace(search, as_built=numbers)
        search, fit = _calibrated(search, first, unsure)
        scored = search.score_all(fit)
        if (own := own_errors(fitter, scored.test)) is not None:
            limits = beyond(limits, own)
            search = replace(search, threshold=limits.threshold)
        search, models = stepwise(search, scored)
        if len(models) == 1:
            break
        around = models[-1].fit.terms
    return _Searched(first, search, models, limits, settings.checks)


def _calibrated(search: Search, fit: Fit, unsure: Terms) -> tuple[Search, Fit]:
    """The model with what it was not sure of, in time steps that will do unless it lacks more."""
    if not unsure:
        return search, fit
    fit = calibrated(search.fitter, fit, unsure)
    return (search, fit) if search.fitter.worthwhile(fit) else in_time_steps(search, fit)


@dataclass(frozen=True)
class _Judged:
    """What the models of a search say.

    Attributes:
      models: of it.
      effects: of the last model, with intervals.
      answer: those of them that were asked about; none where nothing was found.
      before, after: what the first and the last model leave.
      law: what laws that are none of the library explain that it does not.
      verdict: before it is asked whether others explain the recordings as well.
    """

    models: list[ScoredModel]
    effects: Alternative
    answer: Alternative
    before: Adequacy
    after: Adequacy
    law: Misspecification
    verdict: Verdict


def _concluded(
    under_test: ModelUnderTest, searched: _Searched, held_out: Sequence[Trajectory]
) -> Diagnosis:
    """What a search says."""
    search, limits, checks = searched.search, searched.limits, searched.checks
    judged = _without_unsure_effects(searched, _judged(searched, searched.models))
    judged = _without_unsure_effects(searched, _restarted(searched, judged, under_test.seed))
    judged, others = _with_alternatives(searched, judged)
    fitter, last = search.fitter, judged.models[-1]
    judge = HeldOut(under_test, held_out, fitter.windows)
    held = judge.errors(last.fit.terms)
    unexplained = judged.verdict in UNEXPLAINED
    # Effects that are the same everywhere and leave only noise: there is no place to look for more.
    nothing_left = only_noise(limits, judged.after) and constant(limits, judged.after)
    left = unexplained and not nothing_left
    ambiguous = others and judged.verdict is Verdict.EFFECT
    built = _as_built(search, last.fit, judged.effects)
    verdict = Verdict.AMBIGUOUS if ambiguous else judged.verdict
    if built and verdict is Verdict.NOISE_ONLY and not carries_over(limits, held):
        verdict = Verdict.OUTSIDE_LIBRARY
    rng = np.random.default_rng(under_test.seed)
    return Diagnosis(
        verdict=verdict,
        answers=(judged.answer, *(_asked(_effects(search, fit)) for fit in others)),
        ranking=detectable(fitter, judged.models[0], rng, checks),
        threshold=limits.threshold,
        errors=errors(fitter, searched.first, last.fit),
        held_out=held,
        before=judged.before,
        after=judged.after,
        misspecification=judged.law,
        other_form=other_form(limits, judged.law),
        evidence=Evidence.of(fitter, judged.models),
        location=localise(fitter, last.test, checks) if left else None,
        discrepancy=_discrepancy(fitter, last, judge, under_test) if left else None,
        model="" if under_test.model is None else under_test.model.name,
        calibration=tuple(e for e in judged.effects if e.term.known and e not in built),
        as_built=AsBuiltNumbers(built) if built else None,
        time_steps=TimeSteps(fitter.windows.robot.timestep, tuple(fitter.time_steps.tolist())),
        suspects=(
            () if under_test.model else suspect_parameters(search, judged.models, unexplained)
        ),
        settings=under_test.settings,
    )


def _judged(searched: _Searched, models: list[ScoredModel], instead: Sequence[Fit] = ()) -> _Judged:
    """What models say, and other models `instead` with a law in the place of an effect."""
    search, first, last = searched.search, models[0], models[-1]
    before, after = (
        adequacy(search.fitter, each.fit, each.test, each.by_value, searched.checks)
        for each in (first, last)
    )
    effects = _effects(search, last.fit, last.jacobian)
    answer = _asked(effects) if len(models) > 1 else ()
    law = misspecification(first.fit, last.fit, last.probes, instead, search.criterion)
    verdict = verdict_of(searched.limits, last, answer, before, after, law)
    return _Judged(models, effects, answer, before, after, law, verdict)


def _without_unsure_effects(searched: _Searched, judged: _Judged) -> _Judged:
    """Without effects of which nobody can say that they are there, beside others that are."""
    search = searched.search
    while len(new := added(judged.models)) > 1:
        unsure = [each for each in judged.answer if each.term in new and not each.shown]
        if not unsure:
            break
        weakest = min(unsure, key=lambda each: each.certainty)
        fit = search.without_term(judged.models[-1].fit, weakest.term)
        judged = _judged(searched, [*_before(judged.models, fit), search.score_all(fit)])
    return judged


def _before(models: Sequence[ScoredModel], fit: Fit) -> list[ScoredModel]:
    """Models that are part of a model."""
    return [each for each in models[:-1] if places(each.fit.terms) < places(fit.terms)]


def _restarted(searched: _Searched, judged: _Judged, seed: int) -> _Judged:
    """Before something is said to be left: other initial states for every window that is loud."""
    search, last = searched.search, judged.models[-1]
    if judged.verdict not in UNEXPLAINED:
        return judged
    restart = Restart(seed + 1, stuck=search.settings.restart_mean_square, usual=1.0)
    begun = restarted_with_care(search.fitter, last.fit, restart)
    if begun is last.fit:
        return judged
    fit = search.fit_until(replace(begun, converged=False))
    return _judged(searched, [*judged.models[:-1], search.score_all(fit)])


def _with_alternatives(searched: _Searched, judged: _Judged) -> tuple[_Judged, list[Fit]]:
    """The best of all models that explain the recordings as well, and the others.

    Those with a law that is none of the library are no answer, but may say that this one is none.
    """
    search, last = searched.search, judged.models[-1].fit
    if judged.verdict not in EXPLAINED:
        return judged, []
    margin = searched.limits.equally_good
    exchange = exchanged(search, judged.models, margin)
    if model := exchange.shorter(search):
        shorter = _judged(searched, [*_before(judged.models, model.fit), model])
        return _with_alternatives(searched, _without_unsure_effects(searched, shorter))
    known = [fit for fit in exchange.others if not probed(fit.terms)]
    first, *rivals = sorted([exchange.last, *known], key=search.criterion)
    instead = [fit for fit in exchange.others if probed(fit.terms)]
    limit = search.criterion(first) + margin
    if first is not last or instead:
        models = judged.models
        if first is not last:
            models = [*models[:-1], search.score_all(first)]
        judged = _judged(searched, models, instead)
        shorter = _without_unsure_effects(searched, judged)
        if shorter is not judged:
            return _with_alternatives(searched, shorter)
    return judged, [fit for fit in rivals if search.criterion(fit) < limit]


def _as_built(search: Search, fit: Fit, effects: Alternative) -> Alternative:
    """Those of the effects of a fit that are numbers of the robot as it was built."""
    if fit.kept is None:
        return ()
    numbers = places(taken_apart(search.as_built))
    return tuple(e for e in effects if e.term.known and (e.effect, e.term.place) in numbers)


def _asked(effects: Alternative) -> Alternative:
    return tuple(each for each in effects if not each.term.known)


def _effects(search: Search, fit: Fit, jacobian: Jacobian | None = None) -> Alternative:
    """All effects of a fit, with intervals."""
    if not fit.terms:
        return ()
    fitter = search.fitter
    sure = uncertainty(fitter, fit, jacobian)
    robot, believed = fitter.windows.robot, fitter.settings.jacobian.believed
    effects, start = [], 0
    for term in taken_apart(fit.terms):
        here = slice(start, start + len(term.values))
        effects.append(found(term, sure.deviations[here], sure.by_step[here], robot, believed))
        start = here.stop
    return tuple(effects)


def _discrepancy(
    fitter: Fitter, last: ScoredModel, judge: HeldOut, under_test: ModelUnderTest
) -> DiscrepancyModel:
    """A learned law on top of the last model, and what it resembles."""
    settings = under_test.settings.checks.discrepancy
    fit = learned_law(fitter, last, under_test.seed, settings)
    return DiscrepancyModel(
        errors=errors(fitter, last.fit, fit),
        held_out=judge.errors(fit.terms),
        resembles=resemblances(fitter, fit, last.test, settings.shown),
    )
