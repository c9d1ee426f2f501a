"""Stepwise selection of effects: forward by score, with joint refits, pairs, and backward elimination."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

from scipy.stats import chi2

from flywheel.diagnosis.fitting.least_squares import Fit, Restart
from flywheel.diagnosis.fitting.nuisance import asked
from flywheel.diagnosis.fitting.refinement import in_other_steps, shorter_steps
from flywheel.diagnosis.heartbeat import Interrupted
from flywheel.diagnosis.selection.candidates import places
from flywheel.diagnosis.selection.other_forms import in_other_forms, promised_per_part
from flywheel.diagnosis.selection.proposals import proposals
from flywheel.diagnosis.selection.scores import ScoredModel
from flywheel.diagnosis.selection.search import Search, added
from flywheel.diagnosis.statistics import RARE
from flywheel.effects import Terms, usual

# Standard deviations of a number of a robot as built, up to which an effect with the same change is no answer
# in addition to another one in place of these numbers.
USUALLY_OFF = 2.0
SAME = 1e-9  # relative difference of the costs of two models that predict the same


def stepwise(search: Search, first: ScoredModel) -> tuple[Search, list[ScoredModel]]:
    """Add effects until none explains any more.

    If nothing is found, and the model may be complete, the search is repeated in time steps shorter
    than a fit needs: coarse steps at contacts may hide a small effect.

    Returns:
      The search in its time steps at the end, and the initial model, with one effect more, and so on; the
      last is the answer.
    """
    search, models = _forward(search, first)
    with suppress(Interrupted):
        heartbeat = search.heartbeat
        if models[-1].fit.kept is not None and not heartbeat.stopped():
            given = heartbeat.spared(partial(_as_given, search, models), None, "the MJCF as given")
            search, models = given or (search, models)
        if not heartbeat.stopped():
            finer = partial(_in_shortest_steps, search, models)
            search, models = heartbeat.spared(finer, (search, models), "shorter time steps")
    return search, models


def _in_shortest_steps(
    search: Search, models: list[ScoredModel]
) -> tuple[Search, list[ScoredModel]]:
    """A search that found nothing, where nothing is missing, again in the shortest time steps.

    A weak cable of prism3 (seed 12) is found in these only: contacts in coarse ones change as much.
    """
    fitter, fit = search.fitter, models[-1].fit
    if added(models) or fitter.worthwhile(fit):
        return search, models
    tolerated = fitter.settings.refinement.tolerated_by_nothing
    finer, fit = shorter_steps(fitter, fit, fitter.free(fit.terms), tolerated)
    if finer is fitter:
        return search, models
    search, last = replace(search, fitter=finer), models[-1]
    fit = search.unstuck(search.fit_until(fit))
    if not any(term.known for term in fit.terms):
        # What such steps change is the residual; sensitivities tell whether it is worth others.
        again = search.ranked(replace(last, fit=fit, test=last.test.at(fit.residual)))
        if again.scores[0].score < search.settings.share * search.threshold:
            return search, [*models[:-1], again]
    search, further = _forward(search, search.score_all(fit))
    # A plant whose own effects had other values is still the first model.
    return search, [*models[:-1], *further]


def in_time_steps(search: Search, fit: Fit) -> tuple[Search, Fit]:
    """A fit in sufficiently short time steps, continued if they differ."""
    finer, (fit,) = _in_shorter_steps(search, fit)
    return (finer, fit) if finer is search else (finer, finer.unstuck(finer.fit_until(fit)))


def deduplicated(fits: Sequence[Fit]) -> list[Fit]:
    """Fits without those whose cost equals a previous one to the last digit; diverging ones all differ."""
    found: list[Fit] = []
    for fit in fits:
        twins = [math.isclose(fit.cost, each.cost, rel_tol=SAME) for each in found]
        if math.isinf(fit.cost) or not any(twins):
            found.append(fit)
    return found


def _forward(
    search: Search, begun: ScoredModel, before: ScoredModel | None = None
) -> tuple[Search, list[ScoredModel]]:
    """The forward steps of `stepwise`, in the time steps of the fitter or those required by an effect.

    They begin with the model `begun`; `before` is the initial one, if that is another.
    """
    models = [begun] if before is None else [before, begun]
    with suppress(Interrupted):
        if before is None and (changed := _with_other_values(search, begun)):
            models.append(search.score_all(changed))
        for _ in range(2 * search.settings.max_effects):
            stepped = partial(_step, search, models)
            further = search.heartbeat.spared(stepped, (search, models, False), "one more effect")
            search, models, goes_on = further
            if not goes_on:
                break
    return search, models


def _step(search: Search, models: Sequence[ScoredModel]) -> tuple[Search, list[ScoredModel], bool]:
    """A forward step: the search, its models with one more, and True if there is another step."""
    settings, models = search.settings, list(models)
    first, last = models[0], models[-1]
    if search.tolerates(last):
        return search, models, False
    room = len(asked(first.fit.terms)) + settings.max_effects - len(asked(last.fit.terms))
    if built := _as_built(search, last):
        search.heartbeat("testing a robot whose numbers are all slightly off")
        # Not fitted yet: what these numbers would make up for is what an effect is told by.
        models.append(last := built)
    least = settings.least_share * (1.0 if room > 1 else 2.0)
    if room < 1 or (added(models) and not last.promises(least, settings.by_chance)):
        better = None
    else:
        search, better = _next(search, last, room)
    # A score is a promise of the linearisation; a fit need not keep it.
    if better is None and built:
        better = search.fit_until(last.fit)
    if better is None or search.criterion(better) >= search.criterion(last.fit):
        return search, models, False
    # Only the fit was not good enough yet; other values of what the plant had are an answer.
    same = places(better.terms) == places(last.fit.terms)
    if built or (same and (len(models) > 1 or not _has_other_values(search, first, better))):
        models.pop()
    model = search.score_all(search.settled(better))
    formed = partial(in_other_forms, search, last, model)
    model = search.heartbeat.spared(formed, model, "other forms of an effect")
    return search, [*models, model], True


def _as_given(
    search: Search, models: Sequence[ScoredModel]
) -> tuple[Search, list[ScoredModel]] | None:
    """The search with the robot of the MJCF, if effects alone are as good; None if they are not.

    Numbers of a robot that are all slightly off can compensate for an effect, too. The effects
    found together with them are therefore fitted without them, and more effects are added as long
    as they promise to compensate.
    """
    first, last = models[0], models[-1]
    alone = replace(search, as_built=())
    limit = search.criterion(last.fit)
    effects = tuple(t for t in last.fit.terms if not places((t,)) <= places(search.as_built))
    known = [each for each in models if places(each.fit.terms) == places(effects)]
    if known and not _may_make_good(alone, known[-1], limit):
        return None
    begun = search.fitter.warm_start(replace(last.fit, cache=None), effects)
    model = alone.score_all(alone.fit_until(begun))
    room = len(asked(first.fit.terms)) + search.settings.max_effects - len(asked(effects))
    while (missing := alone.criterion(model.fit) - limit) >= 0.0:
        if room < 1 or not _may_make_good(alone, model, limit):
            return None
        begun = alone.warm_start(model, (*model.fit.terms, model.scores[0].term))
        more = alone.fit_until(begun)
        if alone.criterion(model.fit) - alone.criterion(more) < search.settings.share * missing:
            return None
        model, room = alone.score_all(more), room - 1
    alone, models = _forward(alone, model, first)
    return None if _numbers_are_needed(search, models, last) else (alone, models)


def _may_make_good(search: Search, model: ScoredModel, limit: float) -> bool:
    """True if the best candidate promises a part of what a model needs to reach a criterion.

    A small one beside no effect, whose linearisation says little of a large effect.
    """
    best, missing = model.scores[0], search.criterion(model.fit) - limit
    share = search.settings.share if asked(model.fit.terms) else search.settings.least_share
    return missing < 0.0 or (best.score >= search.threshold and best.statistic >= share * missing)


def _numbers_are_needed(search: Search, alone: Sequence[ScoredModel], last: ScoredModel) -> bool:
    """True if the numbers of the `last` model explain more than effects `alone`.

    They do if one of several effects is such a number within its usual tolerance, or if they
    explain more beyond those effects than so many right numbers would of noise.
    """
    found = added(alone)
    if len(found) > 1 and any(usual(term, search.as_built, USUALLY_OFF) for term in found):
        return True
    numbers = sum(len(term.values) for term in search.as_built)
    least = float(chi2.isf(RARE, numbers))
    return alone[-1].fit.cost - last.fit.cost > least


def _as_built(search: Search, model: ScoredModel) -> ScoredModel | None:
    """The model of a robot whose numbers are all slightly off; None if that explains less than an
    effect, or than a law outside the library.

    Nor if the model has these numbers already, or they are not worth their price.
    """
    more = search.settings.more
    best = max(score.statistic for score in (*model.scores, *model.probes))
    promise = search.promised_as_built(model, max(search.threshold, more * best))
    if promise is None:
        return None
    short, terms = search.shortlist(model), model.fit.terms
    uneven = (promised_per_part(search, model, terms, score.term) for score in short)
    if any(each and promise.explained < more * each.explained for each in uneven):
        return None
    # Effects of no size change nothing in the Jacobian.
    return search.score_all(promise.fit, model.jacobian)


def _with_other_values(search: Search, first: ScoredModel) -> Fit | None:
    """The initial model with other values of its effects; None if they were right."""
    if not asked(first.fit.terms):
        return None
    fit = search.fit_until(replace(first.fit, converged=False))  # with its values held so far
    return fit if _has_other_values(search, first, fit) else None


def _has_other_values(search: Search, first: ScoredModel, fit: Fit) -> bool:
    """True if a fit explains enough to justify other values of the model's effects."""
    had = asked(first.fit.terms)
    least = sum(search.least_explained(term) for term in had)
    return bool(had) and first.fit.cost - fit.cost > least


def _next(search: Search, model: ScoredModel, room: int) -> tuple[Search, Fit | None]:
    """The model with another effect, or two if there is `room`, fitted; None if none is visible."""
    heartbeat = search.heartbeat
    started = [(*model.fit.terms, *terms) for terms in proposals(search, model, room)]
    begun = deduplicated(heartbeat.each(partial(search.warm_start, model), started, _fitting))
    if model.fit.kept is not None:
        begun = heartbeat.each(search.effects_first, begun, _fitting)
    begun = _with_sensitivities_of_best(search, begun)
    fits = heartbeat.each(search.after_rounds, begun, _fitting)
    if not fits:
        return search, None
    fits = _with_sensitivities_of_best(search, fits)
    search, (first, *others) = _fitted_in_turn(search, fits)
    less = partial(search.pruned, first, (model.fit, *others))
    return search, heartbeat.spared(less, first, "models without an effect")


def _fitting(model: Fit | Terms) -> str:
    """The effects that are being fitted, for people."""
    terms = model.terms if isinstance(model, Fit) else model
    return "fitting " + ", ".join(dict.fromkeys(term.effect.name for term in asked(terms)))


def _with_sensitivities_of_best(search: Search, fits: Sequence[Fit]) -> list[Fit]:
    """Fits that keep the sensitivities to numbers of the robot at the best of them, not at their start."""
    if not fits or fits[0].kept is None:
        return list(fits)
    kept = search.fitter.kept_anew(min(fits, key=search.criterion)).kept
    return [
        replace(fit, cache=replace(search.fitter.renewed(fit), kept=kept), converged=False)
        for fit in fits
    ]


def _fitted_in_turn(search: Search, begun: Sequence[Fit]) -> tuple[Search, list[Fit]]:
    """Several models, each fitted as long as it may become the best; the best one first.

    Initial states that had to compensate for a wrong model recover slowly: after a few rounds the
    wrong one of two may be ahead. Of models that are one by several names, one is fitted. If the
    most promising one, which comes first, is not ahead, windows of it may be stuck, or its steps too
    long, which is mended before anything else.
    """
    favourite, *others = deduplicated(begun)
    if any(search.criterion(fit) < search.criterion(favourite) for fit in others):
        favourite = search.fitter.restarted(favourite, Restart())
        search, (favourite, *others) = _in_shorter_steps(search, favourite, others)
    first, *others = sorted((favourite, *others), key=search.criterion)
    search, (first, *others) = _in_shorter_steps(search, first, others)
    slight = search.fitter.settings.stopping.slight_fall
    ended: list[Fit] = []
    for fit in (first, *others):
        target = min(map(search.criterion, ended), default=math.inf)
        on = partial(search.fit_until, target=target, slight=slight)
        ended += search.heartbeat.each(on, [fit], _fitting)
    best, *beaten = sorted(ended, key=search.criterion)
    search, best = in_time_steps(search, search.unstuck(best))
    return search, [search.fit_until(best), *beaten]


def _in_shorter_steps(
    search: Search, first: Fit, others: Sequence[Fit] = ()
) -> tuple[Search, list[Fit]]:
    """Models in sufficiently short time steps for the first, which are those of all fits from here on.

    Discontinuities of coarse ones may decide between models otherwise, and without its present effect
    the benefit of shorter steps would be invisible.
    """
    before = search.fitter
    fitter, first = shorter_steps(before, first, before.free(first.terms))
    if fitter is before:
        return search, [first, *others]
    changed = before.time_steps != fitter.time_steps
    there = (in_other_steps(fitter, fit, changed) for fit in others)
    return replace(search, fitter=fitter), [first, *there]
