"""The diagnosis: from recordings to a verdict."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType

import numpy as np

from flywheel.diagnosis.checks.adequacy import own_errors
from flywheel.diagnosis.checks.detectability import detectable
from flywheel.diagnosis.checks.discrepancy import DiscrepancyModel, learned_law, resemblances
from flywheel.diagnosis.checks.first_lengths import far_first_lengths
from flywheel.diagnosis.checks.held_out import HeldOut, errors
from flywheel.diagnosis.checks.localisation import localise
from flywheel.diagnosis.checks.model_discrepancy import model_discrepancy
from flywheel.diagnosis.checks.suspect_parameters import (
    SuspectParameter,
    far_off_parameters,
    suspect_parameters,
)
from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.model import ModelUnderTest
from flywheel.diagnosis.fitting.nuisance import as_built_terms, calibrated, unsure_terms
from flywheel.diagnosis.fitting.subject import Subject
from flywheel.diagnosis.heartbeat import PHASES, Heartbeat, never
from flywheel.diagnosis.judgement import (
    UNEXPLAINED,
    Searched,
    as_built,
    asked_about,
    effects_of,
    judge_in_time,
)
from flywheel.diagnosis.results.diagnosis import Diagnosis, TimeSteps
from flywheel.diagnosis.results.evidence import Evidence
from flywheel.diagnosis.results.numbers_as_built import AsBuiltNumbers
from flywheel.diagnosis.results.verdict import beyond, only_noise, other_form, verdict_of
from flywheel.diagnosis.selection.candidates import Candidate, candidates
from flywheel.diagnosis.selection.scores import ScoredModel
from flywheel.diagnosis.selection.search import Search
from flywheel.diagnosis.selection.stepwise import in_time_steps, stepwise
from flywheel.diagnosis.settings import Settings
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS, FORMS, NAMED, PROBES, Effect, Terms
from flywheel.errors import DataError, ModelError
from flywheel.options import DiagnosisOptions
from flywheel.records import Trajectory
from flywheel.robots import Robot

# Largest number of searches, each with what the one before left: a model discrepancy; for a network, the
# plant of its answer, whose start depends on its missing effects.
SEARCHES = 2


def diagnose(
    plant: Plant,
    recordings: Sequence[Trajectory],
    held_out: Sequence[Trajectory] = (),
    library: Mapping[str, Effect] = EFFECTS,
    settings: Settings = Settings(),
    options: DiagnosisOptions = DiagnosisOptions(),
    progress: Callable[[float, str], None] = lambda share, note: None,
    model: Subject | None = None,
    unsure: Mapping[str, float] = MappingProxyType({}),
    stop: Callable[[], bool] = never,
) -> Diagnosis:
    """Identify the effects that a plant, or a trained model, lacks, from recordings.

    Args:
      plant: the model under test. Its effects are fitted again together with new ones.
      recordings: unbatched, of its control step.
      held_out: further ones, for the evaluation only.
      library: candidate effects.
      settings: of the diagnosis, including limits (`Limits`).
      options: window, time limit, seed.
      progress: receives the elapsed fraction of the time, estimated from the phases so far, and the
        present step, every few seconds.
      model: a trained model to test instead of the plant, which is then used for the changes caused
        by effects, see `network_fit`.
      unsure: uncertain numbers of the plant, see `unsure_terms`: fitted together with everything
        else, within their priors, and not tested.
      stop: called now and then; True to return the best answer so far.

    Raises:
      Interrupted: it was stopped before there was any answer.
      DataError: recordings cannot be used; an effect cannot be uncertain; or there is no candidate.
      ModelError: a model for another robot or control step, or one whose past is longer than
        windows.
    """
    begun = time.perf_counter()
    heartbeat = Heartbeat(progress, stop=stop, seconds=60.0 * (options.minutes or math.inf))
    under_test = ModelUnderTest(plant, model, options.seed, heartbeat.again, settings)
    terms = unsure_terms(unsure, plant.terms, {**NAMED, **library})
    if model is not None and terms:
        raise ModelError("A trained model has no numbers of an MJCF that could be uncertain.")
    asked = {name: effect for name, effect in library.items() if name not in unsure}
    if not asked:
        raise DataError("Every candidate is listed under --unsure; leave at least one to test.")
    if held_out:
        _check_usable(under_test, held_out, options.window)
    everything = candidates(plant.robot, asked)
    longer = sum(log.steps for log in held_out) / max(1, sum(log.steps for log in recordings))
    search = partial(
        _searched, under_test, recordings, options.window, everything, terms, heartbeat, longer
    )
    # What a trained model is off by itself is known otherwise, see `network_fit`.
    searched = search() if model is not None else _in_two_scales(search, heartbeat)
    answer = heartbeat.insisted(partial(_concluded, under_test, searched, held_out, heartbeat))
    return replace(answer, seconds=time.perf_counter() - begun)


def _check_usable(
    under_test: ModelUnderTest, held_out: Sequence[Trajectory], seconds: float | None
) -> None:
    """Check held-out recordings before a search that takes minutes."""
    try:
        under_test.windows(held_out, seconds)
    except DataError as error:
        raise DataError(f"Held-out recordings: {error}") from error


def _in_two_scales(search: Callable[..., Searched], heartbeat: Heartbeat) -> Searched:
    """A search with noise, or, if no model fits to noise level, with an additional model discrepancy.

    The residual of the best model is estimated again until it is stable; one that is tolerated, never.

    Args:
      search: takes a model discrepancy [m].
      heartbeat: of the time limit.
    """
    searched, known = search(), 0.0
    least = searched.search.fitter.settings.discrepancy
    for _ in range(SEARCHES):
        fitter, last = searched.search.fitter, searched.models[-1]
        noise = fitter.windows.noise
        loud = np.hypot(noise, last.test.beyond_noise(fitter)) > least * noise
        if not (loud and np.isfinite(last.fit.cost)) or searched.search.tolerates(last):
            break
        found = model_discrepancy(fitter, last.fit)
        if max(found, known) <= least * min(found, known):
            break
        heartbeat("no model fits to noise level; repeating with a model discrepancy")
        known = found
        heartbeat.phase("fit", *PHASES[1:])
        again = partial(search, discrepancy=known)
        repeated = heartbeat.in_time(
            again, searched, "repeating with another estimate of the model discrepancy"
        )
        if heartbeat.stopped():  # in the middle of it: what was found before is more
            break
        searched = repeated
    return searched


def _searched(
    under_test: ModelUnderTest,
    recordings: Sequence[Trajectory],
    seconds: float | None,
    library: tuple[Candidate, ...],
    unsure: Terms,
    heartbeat: Heartbeat,
    held_out: float = 0.0,
    discrepancy: float = 0.0,
) -> Searched:
    """Add effects until none explains any more of the error beyond noise and a discrepancy [m].

    Of a limited time a part is reserved for held-out recordings, in proportion to their length.
    """
    settings, around = under_test.settings, None
    for _ in range(1 if under_test.model is None else SEARCHES):
        begun = time.monotonic()
        fitter, first = under_test.fitted(
            recordings, seconds, None, around, calibrated=not unsure, discrepancy=discrepancy
        )
        # What is held out, as it was and with an answer; and numbers of the MJCF.
        heartbeat.keep((2.0 * held_out + 3.0) * (time.monotonic() - begun))
        known_already = around is not None or discrepancy > 0.0
        heartbeat.phase("score")
        search = Search(
            fitter,
            library,
            settings.limits,
            settings.selection,
            _probes(fitter.windows.robot),
            seed=under_test.seed,
            heartbeat=heartbeat,
        )
        if under_test.model is None:
            present = (*under_test.plant.terms, *unsure)
            named = {candidate.effect.name for candidate in library}
            usual = settings.fitting.as_built
            numbers = as_built_terms(fitter.windows.robot, usual, present, named)
            search = replace(search, as_built=numbers)
        as_said = search, search.fitter.with_terms(first, (*first.terms, *unsure))
        search, fit = heartbeat.in_time(partial(_calibrated, search, first, unsure), as_said)
        score = partial(search.score_all, fit)
        scored = score() if known_already else heartbeat.in_grace(score)
        if (own := own_errors(fitter, scored.test)) is not None:
            search = replace(search, limits=beyond(search.limits, own))
            scored = search.ranked(scored)
        heartbeat.phase("search")
        search, models = stepwise(search, scored)
        if len(models) == 1 or heartbeat.stopped():
            break
        around = models[-1].fit.terms
    return Searched(first, search, models, heartbeat.stopped())


def _probes(robot: Robot) -> tuple[Candidate, ...]:
    """Candidate laws, and other forms of effects, if the robot can show the difference."""
    forms = {name: form for name, form in FORMS.items() if form.differs_on(robot)}
    return candidates(robot, {**PROBES, **forms})


def _calibrated(search: Search, fit: Fit, unsure: Terms) -> tuple[Search, Fit]:
    """The model with its uncertain numbers, in sufficiently short time steps unless it lacks more."""
    if not unsure:
        return search, fit
    fit = calibrated(search.fitter, fit, unsure)
    return (search, fit) if search.fitter.worthwhile(fit) else in_time_steps(search, fit)


def _concluded(
    under_test: ModelUnderTest,
    searched: Searched,
    held_out: Sequence[Trajectory],
    heartbeat: Heartbeat,
) -> Diagnosis:
    """Result of a search; only the most important parts if that was interrupted."""
    search, limits = searched.search, searched.search.limits
    kept_aside = HeldOut(under_test, held_out, search.fitter.windows)
    heartbeat.phase("judge")
    judged = judge_in_time(searched, kept_aside, under_test.seed, heartbeat)
    heartbeat.phase("conclude")
    heartbeat("predicting the held-out recordings")
    held = heartbeat.briefly(partial(kept_aside.errors, judged.models[-1].fit.terms), None)
    facts = replace(judged.facts, held_out=held, ambiguous=bool(judged.rivals))
    fitter, last = search.fitter, judged.models[-1]
    built = as_built(search, last.fit, judged.effects)
    unexplained = judged.verdict in UNEXPLAINED
    # Of effects that are the same everywhere and leave only noise, there is no more to look for.
    nothing = only_noise(limits, facts.after) and facts.after.constant
    left = unexplained and (fitter.windows.discrepancy > 0.0 or not nothing)
    suspects: tuple[SuspectParameter, ...] = ()
    if under_test.model is None:
        suspects = _suspects(search, judged.models, unexplained, limits.most)
    law = partial(_discrepancy, fitter, last, kept_aside, under_test)
    rng = np.random.default_rng(under_test.seed)
    sure = partial(heartbeat.each, partial(effects_of, search), what=_sizes)
    rivals, forms = sure(parts=judged.rivals), sure(parts=judged.forms)
    ranking = partial(detectable, fitter, judged.models[0], rng)
    return Diagnosis(
        verdict=verdict_of(facts),
        answers=(facts.answer, *(asked_about(each) for each in rivals)),
        ranking=heartbeat.briefly(ranking, judged.models[0].scores, "detectable sizes"),
        threshold=limits.threshold,
        other_forms=tuple(asked_about(each) for each in forms),
        errors=errors(fitter, searched.first, last.fit),
        held_out=held,
        gain=facts.gain,
        model_discrepancy=fitter.windows.discrepancy,
        before=facts.before,
        after=facts.after,
        misspecification=facts.law,
        other_form=other_form(limits, facts.law),
        evidence=Evidence.of(fitter, judged.models, judged.rivals),
        location=localise(fitter, last.test) if left else None,
        discrepancy=heartbeat.in_time(law, None, "a learned law") if left else None,
        model=under_test.name,
        calibration=tuple(e for e in judged.effects if not e.term.asked and e not in built),
        as_built=AsBuiltNumbers(built, search.known_share(last.fit)) if built else None,
        time_steps=TimeSteps(fitter.windows.robot.timestep, tuple(fitter.time_steps.tolist())),
        suspects=suspects,
        first_lengths=far_first_lengths(under_test.plant, fitter, last.fit),
        interrupted=heartbeat.stopped(),
        failures=tuple(heartbeat.failures),
        settings=under_test.settings,
    )


def _suspects(
    search: Search, models: Sequence[ScoredModel], unexplained: bool, most: float
) -> tuple[SuspectParameter, ...]:
    """Numbers of the MJCF that may be what is wrong; those that explain more than the answer first."""
    briefly = search.heartbeat.briefly
    search.heartbeat("testing numbers of the MJCF")
    nothing: tuple[SuspectParameter, ...] = ()
    fitted = partial(far_off_parameters, search, models, most)
    far = briefly(fitted, nothing) if unexplained else nothing
    names = {each.name for each in far}
    near = briefly(partial(suspect_parameters, search, models, unexplained), nothing)
    return (*far, *(each for each in near if each.name not in names))


def _sizes(fit: Fit) -> str:
    names = ", ".join(term.effect.name for term in fit.terms if term.asked)
    return f"judging the answer: how sure sizes of {names} are"


def _discrepancy(
    fitter: Fitter, last: ScoredModel, kept_aside: HeldOut, under_test: ModelUnderTest
) -> DiscrepancyModel:
    """A learned law on top of the last model, and its most similar effects."""
    fit = learned_law(fitter, last, under_test.seed)
    return DiscrepancyModel(
        errors=errors(fitter, last.fit, fit),
        held_out=kept_aside.errors(fit.terms),
        resembles=resemblances(fitter, fit, last.test),
    )
