"""From the models of a search to a verdict: tests of the answer, and alternative models."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from flywheel.diagnosis.checks.adequacy import adequacy
from flywheel.diagnosis.checks.held_out import HeldOut
from flywheel.diagnosis.checks.held_out_gain import Gain, UnseenWindows
from flywheel.diagnosis.checks.uncertainty import uncertainty
from flywheel.diagnosis.fitting.least_squares import Fit, Jacobian
from flywheel.diagnosis.fitting.multistart import restarted_where_loud
from flywheel.diagnosis.heartbeat import Heartbeat
from flywheel.diagnosis.results.verdict import (
    Alternative,
    Facts,
    Verdict,
    found,
    verdict_of,
)
from flywheel.diagnosis.selection.alternatives import exchanged, model_without
from flywheel.diagnosis.selection.candidates import families, places
from flywheel.diagnosis.selection.criterion import promised
from flywheel.diagnosis.selection.misspecification import is_probe, misspecification, probed
from flywheel.diagnosis.selection.scores import Linearised, ScoredModel
from flywheel.diagnosis.selection.search import Search, added
from flywheel.effects import PerPart, Term, at_same_size, taken_apart

EXPLAINED = (Verdict.EFFECT, Verdict.PARTIAL)
UNEXPLAINED = (Verdict.OUTSIDE_LIBRARY, Verdict.PARTIAL)


@dataclass(frozen=True)
class Searched:
    """State of a search at its end.

    Attributes:
      first: the initial model.
      search: its state.
      models: of it, the first with the uncertain numbers.
      stopped: it was stopped before it ended.
    """

    first: Fit
    search: Search
    models: list[ScoredModel]
    stopped: bool = False


@dataclass(frozen=True)
class Judged:
    """Result of the models of a search.

    Attributes:
      models: of it.
      effects: of the last model, with intervals.
      facts: so far; the answer in them has the candidates among the effects.
      shorter: models without one of the effects, as far as they were fitted.
      rivals: other models that explain the recordings as well.
      forms: likewise, of the same effects by other laws.
      exchanged: its effects were replaced by others, which gave `rivals`.
    """

    models: list[ScoredModel]
    effects: Alternative
    facts: Facts
    shorter: tuple[Linearised, ...] = ()
    rivals: tuple[Fit, ...] = ()
    forms: tuple[Fit, ...] = ()
    exchanged: bool = False

    @property
    def verdict(self) -> Verdict:
        """The verdict, before alternatives and held-out recordings are considered."""
        return verdict_of(self.facts)


def judge_in_time(searched: Searched, held_out: HeldOut, seed: int, heartbeat: Heartbeat) -> Judged:
    """Test of the answer of a search; partial if that is interrupted."""
    judged = heartbeat.insisted(partial(_judged, searched))
    for what, stage in (
        ("unsure effects", without_unsure_effects),
        ("windows with large residuals", partial(with_loud_windows_restarted, seed=seed)),
        ("unsure effects", without_unsure_effects),
        ("sizes of parts", partial(without_unclear_factors, held_out=held_out)),
        ("alternative models", with_alternatives),
        ("gains on other windows", partial(with_gains, held_out=held_out)),
    ):
        heartbeat(f"judging the answer: {what}")
        judged = heartbeat.in_time(partial(stage, searched, judged), judged)
    heartbeat("judging the answer: effects with the same predictions")
    return heartbeat.briefly(partial(with_rivals, searched, judged), judged)


def _judged(searched: Searched) -> Judged:
    """Result of the longest assessable models of a search."""
    models, spared = searched.models, searched.search.heartbeat.spared
    for count in range(len(models), 1, -1):
        judged = spared(partial(judge, searched, models[:count]), None, "judging the answer")
        if judged is not None:
            return judged
    return judge(searched, models[:1])


def judge(searched: Searched, models: list[ScoredModel], instead: Sequence[Fit] = ()) -> Judged:
    """Result of models, with other models `instead` that have a law in place of an effect."""
    search, first, last = searched.search, models[0], models[-1]
    before, after = (
        adequacy(search.fitter, each.fit, each.test, each.by_value) for each in (first, last)
    )
    effects = effects_of(search, last.fit, last.jacobian)
    answer = asked_about(effects) if len(models) > 1 else ()
    laws = [each for each in last.probes if is_probe(each.candidate.effect)]
    law = misspecification(first.fit, last.fit, laws, instead, search.criterion)
    facts = Facts(
        limits=search.limits,
        answer=answer,
        before=before,
        after=after,
        law=law,
        converged=math.isfinite(last.fit.cost) and after.converged,
        blind=all(each.smallest > each.candidate.effect.sizes[0].high for each in last.scores),
        discrepancy=search.fitter.windows.discrepancy > 0.0,
        unfinished=searched.stopped and last.scores[0].score >= search.threshold,
        as_built=bool(as_built(search, last.fit, effects)),
    )
    return Judged(models, effects, facts)


def without_unsure_effects(searched: Searched, judged: Judged) -> Judged:
    """Without uncertain effects, if others are certain."""
    search = searched.search
    while len(new := added(judged.models)) > 1:
        unsure = [each for each in judged.facts.answer if each.term in new and not each.shown]
        if not unsure:
            break
        weakest = min(unsure, key=lambda each: each.certainty)
        fit = search.fit_until(search.begun_without(judged.models[-1].fit, weakest.term))
        judged = judge(searched, [*_before(judged.models, fit), search.score_all(fit)])
    return judged


def _before(models: Sequence[ScoredModel], fit: Fit) -> list[ScoredModel]:
    """Models that are part of a model."""
    return [each for each in models[:-1] if places(each.fit.terms) < places(fit.terms)]


def with_loud_windows_restarted(searched: Searched, judged: Judged, seed: int) -> Judged:
    """Before a residual is reported: other initial states for every window with a large residual."""
    search, last = searched.search, judged.models[-1]
    if judged.verdict not in UNEXPLAINED:
        return judged
    begun = restarted_where_loud(search.fitter, last.fit, seed)
    if begun is last.fit:
        return judged
    fit = search.fit_until(replace(begun, converged=False))
    return judge(searched, [*judged.models[:-1], search.score_all(fit)])


def without_unclear_factors(searched: Searched, judged: Judged, held_out: HeldOut) -> Judged:
    """With one size for all parts, if one for each gains nothing on windows that were not fitted."""
    search, last = searched.search, judged.models[-1]
    unseen = UnseenWindows(search.fitter, judged.models[0], held_out)
    for uneven in (t for t in added(judged.models) if isinstance(t.effect, PerPart)):
        terms = tuple(at_same_size(t) if t is uneven else t for t in last.fit.terms)
        fit = search.refitted(last.fit, terms)
        even = search.score_all(fit)
        if math.isfinite(fit.cost) and not unseen.gain_everywhere(even, last).clear:
            judged = judge(searched, [*_before(judged.models, fit), even])
            return without_unclear_factors(searched, judged, held_out)
    return judged


def with_alternatives(searched: Searched, judged: Judged) -> Judged:
    """The best of all models that explain the recordings as well, and the others.

    Those with a law outside the library are no answer, but may refute this one.
    """
    search, last = searched.search, judged.models[-1].fit
    if judged.verdict not in EXPLAINED:
        return judged
    exchange = exchanged(search, judged.models)
    if model := exchange.shorter(search):
        shorter = judge(searched, [*_before(judged.models, model.fit), model])
        return with_alternatives(searched, without_unsure_effects(searched, shorter))
    known = [fit for fit in exchange.others if not probed(fit.terms)]
    instead = [fit for fit in exchange.others if probed(fit.terms)]
    first, *others = sorted([exchange.last, *known], key=partial(_simplest, search))
    if first is not last:
        judged = judge(searched, [*judged.models[:-1], search.score_all(first)], instead)
    elif instead:
        judged = judge(searched, judged.models, instead)
    shorter = without_unsure_effects(searched, judged)
    if shorter is not judged:
        return with_alternatives(searched, shorter)
    limit, own = search.criterion(first) + search.limits.equally_good, families(first.terms)
    others = [fit for fit in others if search.criterion(fit) < limit]
    return replace(
        judged,
        shorter=tuple(model for _, model in exchange.without),
        rivals=tuple(fit for fit in others if families(fit.terms) != own),
        forms=tuple(fit for fit in others if families(fit.terms) == own),
        exchanged=True,
    )


def with_rivals(searched: Searched, judged: Judged) -> Judged:
    """An answer that results from its gains, or a smaller one, with equally good models.

    With a residual, or at the time limit, only those with the same predictions.
    """
    search, verdict = searched.search, judged.verdict
    if judged.exchanged or verdict not in (*EXPLAINED, *UNEXPLAINED) or not added(judged.models):
        return judged
    only_twins = verdict not in EXPLAINED or search.heartbeat.stopped()
    exchange = exchanged(search, judged.models, only_twins)
    own = families(judged.models[-1].fit.terms)
    others = [fit for fit in exchange.others if not probed(fit.terms)]
    rivals = tuple(fit for fit in others if families(fit.terms) != own)
    return replace(judged, rivals=rivals, exchanged=True)


def _simplest(search: Search, fit: Fit) -> float:
    """Criterion of a model; a law outside the library must be clearly better to be used."""
    other = any(term.asked and term.effect.family != term.effect.name for term in fit.terms)
    return search.criterion(fit) + search.limits.equally_good * other


def with_gains(searched: Searched, judged: Judged, held_out: HeldOut) -> Judged:
    """An answer with its gain on windows that were not fitted.

    If the model is known to be wrong, the likelihood promises too much: an effect without a clear
    gain there is not part of the answer. Nor is one that numbers of a robot as built compensate.
    """
    search = searched.search
    unseen = UnseenWindows(search.fitter, judged.models[0], held_out)
    while new := added(judged.models):
        last, known = judged.models[-1], (*judged.models, *judged.shorter)
        doubted, built = judged.verdict in UNEXPLAINED, last.fit.kept is not None
        groups = [*([term] for term in new), *([new] if len(new) > 1 else [])]
        # Beside one that was given up while it was only not the best, every effect would gain.
        target = search.criterion(last.fit) + search.threshold if doubted or built else None
        less = [model_without(search, known, last.fit, terms, target) for terms in groups]
        if built and (better := _from_shorter(search, last.fit, less, groups)):
            judged = judge(searched, [*judged.models[:-1], search.score_all(better)])
            continue
        shorter, bare = less[: len(new)], less[-1]
        gains = [unseen.gain(model, last) for model in shorter]
        unclear = [
            (gain, model)
            for gain, model, term in zip(gains, shorter, new, strict=True)
            if (doubted and not gain.clear)
            or (built and search.share(last.fit, model.fit, term) < 1.0)
        ]
        if not unclear:
            return _with_gain(judged, gains, unseen.gain_everywhere(bare, last))
        _, model = min(unclear, key=lambda each: each[0].low)
        models = [*_before(judged.models, model.fit), search.scored(model)]
        judged = replace(judge(searched, models), shorter=tuple(shorter))
    return judged


def _from_shorter(
    search: Search, fit: Fit, less: Sequence[Linearised], groups: Sequence[Sequence[Term]]
) -> Fit | None:
    """A fit restarted from a clearly better one without some of its terms; None if there is none.

    A model with fewer effects cannot cost less: it only ended in another minimum. Effects that are
    not visible on top of that one are not fitted to it.
    """
    shorter, terms = min(zip(less, groups, strict=True), key=lambda each: each[0].fit.cost)
    if shorter.fit.cost > fit.cost - search.threshold:
        return None
    fitter, more = search.fitter, (*shorter.fit.terms, *terms)
    promise = promised(fitter, shorter, fitter.with_terms(shorter.fit, more))
    if promise.explained < sum(map(search.least_explained, terms)):
        return None
    found = search.settled(search.fit_until(search.warm_start(shorter, more)))
    return found if found.cost < fit.cost - search.threshold else None


def _with_gain(judged: Judged, gains: Sequence[Gain], together: Gain) -> Judged:
    """An answer with the gain of each of its new effects, and of all of them."""
    by_place = {
        (term.effect.name, term.place): each
        for term, each in zip(added(judged.models), gains, strict=True)
    }
    answer = tuple(
        replace(each, gain=by_place.get((each.effect, each.term.place)))
        for each in judged.facts.answer
    )
    return replace(judged, facts=replace(judged.facts, answer=answer, gain=together))


def as_built(search: Search, fit: Fit, effects: Alternative) -> Alternative:
    """The effects of a fit that are numbers of the robot as built."""
    if fit.kept is None:
        return ()
    numbers = places(taken_apart(search.as_built))
    return tuple(e for e in effects if not e.term.asked and (e.effect, e.term.place) in numbers)


def asked_about(effects: Alternative) -> Alternative:
    return tuple(each for each in effects if each.term.asked)


def effects_of(search: Search, fit: Fit, jacobian: Jacobian | None = None) -> Alternative:
    """All effects of a fit, with intervals; by its last Jacobian at the time limit."""
    if search.heartbeat.stopped() and fit.cache is not None:
        jacobian = jacobian or fit.cache.jacobian
    if not fit.terms:
        return ()
    fitter = search.fitter
    known_to = 0.0 if fit.kept is None else search.threshold  # see `Search.settled`
    sure = uncertainty(fitter, fit, jacobian, known_to)
    robot, believed = fitter.windows.robot, fitter.settings.believed
    effects, start = [], 0
    for term in taken_apart(fit.terms):
        here = slice(start, start + len(term.values))
        effects.append(found(term, sure.deviations[here], sure.by_step[here], robot, believed))
        start = here.stop
    return tuple(effects)
