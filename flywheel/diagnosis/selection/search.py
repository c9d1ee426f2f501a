"""The state of a search for effects that a model lacks: scoring, fitting and comparing models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter, Jacobian
from flywheel.diagnosis.fitting.multistart import unstuck
from flywheel.diagnosis.fitting.nuisance import as_said, asked, shaken_terms
from flywheel.diagnosis.fitting.stopping import out_of_reach
from flywheel.diagnosis.heartbeat import Heartbeat
from flywheel.diagnosis.selection.candidates import Candidate, places
from flywheel.diagnosis.selection.criterion import Promise, promised
from flywheel.diagnosis.selection.scores import (
    Linearised,
    Score,
    ScoredModel,
    score_test,
)
from flywheel.diagnosis.settings import Limits, SelectionSettings
from flywheel.diagnosis.statistics import chance
from flywheel.effects import Term, Terms, handed_back, handed_over

# Fits of a robot as built that are started around the result, and the deviation of these moves, in those of
# the priors: just enough to move a fit off the edges that contacts make in its cost.
SHAKES, SHAKE = 3, 0.1
# Largest decrease of the cost by them [sigma^2]: 100 to 170 were seen.
MOST_BY_SHAKING = 500.0


@dataclass(frozen=True)
class Search:
    """The state of a search for effects that a model lacks.

    Attributes:
      fitter: of the windows; a later state may have one with shorter time steps.
      library: candidates.
      limits: in force; a trained model's own errors raise them.
      settings: of the diagnosis.
      probes: laws that are scored like candidates, and never added.
      as_built: numbers of the robot that may all be slightly off, added if they explain more than
        any effect; none if not requested.
      seed: of random numbers.
      heartbeat: receives the steps; knows the time limit, and failures.
    """

    fitter: Fitter
    library: tuple[Candidate, ...]
    limits: Limits = Limits()
    settings: SelectionSettings = SelectionSettings()
    probes: tuple[Candidate, ...] = ()
    as_built: Terms = ()
    seed: int = 0
    heartbeat: Heartbeat = field(default_factory=Heartbeat)

    @property
    def threshold(self) -> float:
        """Score from which an effect counts as visible."""
        return self.limits.threshold

    def linearised(self, fit: Fit, jacobian: Jacobian | None = None) -> Linearised:
        """A model with its sensitivities; its Jacobian may be available."""
        fitter, free = self.fitter, self.fitter.free(fit.terms)
        jacobian = jacobian or fitter.jacobian(fit)
        fit = replace(fit, cache=replace(fitter.cached(jacobian), kept=fit.kept))
        return Linearised(fit, jacobian, fitter.by_value(fit, free))

    def score_all(self, fit: Fit, jacobian: Jacobian | None = None) -> ScoredModel:
        """Score all candidates and probes on top of a model, whose Jacobian may be available."""
        return self.scored(self.linearised(fit, jacobian))

    def scored(self, model: Linearised) -> ScoredModel:
        """Score all candidates and probes on top of a model, unless that was done."""
        if isinstance(model, ScoredModel):
            return model
        fitter, fit, by_value = self.fitter, model.fit, model.by_value
        known = np.concatenate([fitter.step_error(fit), by_value], axis=2)
        everything = (*self.library, *self.probes)
        prior = [(f.value(fit.terms), f.prior) for f in fitter.free(fit.terms)]
        jacobian = model.jacobian
        test = score_test(fitter, fit, everything, known, jacobian, prior, self.threshold)
        self.heartbeat(f"scored {len(self.library)} candidates on top of {len(fit.terms)} effects")
        return self.ranked(ScoredModel(fit, jacobian, by_value, test, (), ()))

    def ranked(self, model: ScoredModel) -> ScoredModel:
        """A model with the scores of its test by the search's threshold, which may have risen."""
        test, count = replace(model.test, threshold=self.threshold), len(self.library)
        scores = test.scores()
        ranking = sorted(scores[:count], key=lambda s: -s.score)
        return replace(model, test=test, scores=tuple(ranking), probes=tuple(scores[count:]))

    def tolerates(self, model: ScoredModel) -> bool:
        """True if the residual of a model beyond noise is within the tolerance."""
        most = self.limits.tolerance
        return most > 0.0 and model.test.beyond_noise(self.fitter) <= most

    def criterion(self, fit: Fit) -> float:
        """The number by which models are compared, the less the better [sigma^2]; see `criterion`."""
        values = sum(term.unknown for term in fit.terms)
        price = sum(term.price for term in fit.terms)
        return fit.cost + values * float(np.log(self.fitter.windows.noisy.sum())) + price

    def fit_until(
        self, fit: Fit, target: float = np.inf, max_rounds: float | None = None, slight: float = 0.0
    ) -> Fit:
        """A fit, continued until it converges or its criterion clearly stays above the target.

        A model that is clearly wrong is not fitted to the last digit, and one that still diverges
        after a round is abandoned.

        Args:
          target: criterion to be reached.
          max_rounds: further rounds like the last one, within which it must be; None for the
            settings'.
          slight: decrease of the cost in a round, below which the rest is left for later [sigma^2].
        """
        stopping = self.fitter.settings.stopping
        if max_rounds is None:
            max_rounds = stopping.max_rounds_to_target
        for _ in range(stopping.rounds):
            if fit.converged:
                break
            before, fit = fit, self.after_rounds(fit, enough=self.fitter.worthwhile(fit))
            fell = before.cost - fit.cost
            if fell < slight or out_of_reach(self.criterion(fit) - target, fell, max_rounds):
                break
        return fit

    def after_rounds(self, fit: Fit, rounds: int = 1, enough: float = 0.0) -> Fit:
        """A fit of all values after further rounds; see `Fitter.fit`."""
        return self.fitter.fit(fit, self.fitter.free(fit.terms), rounds=rounds, enough=enough)

    def refitted(
        self, fit: Fit, terms: Terms, target: float = np.inf, max_rounds: float | None = None
    ) -> Fit:
        """A fit of other terms from the parameters of one; see `fit_until`."""
        return self.fit_until(self.fitter.with_terms(fit, terms), target, max_rounds)

    def effects_first(self, fit: Fit) -> Fit:
        """A fit of effects and initial states alone, with constant numbers of a robot as built.

        So many numbers would compensate for an effect that is not fitted yet, and hardly recover.
        """
        effects = [each for each in self.fitter.free(fit.terms) if fit.terms[each.term].asked]
        fit = self.fitter.fit(fit, effects, enough=self.fitter.worthwhile(fit))
        return replace(fit, converged=False)

    def settled(self, fit: Fit, target: float = np.inf) -> Fit:
        """A fit whose kept sensitivities are those at its place, or near it if that ends lower.

        A residual of other places would count as an effect. A fit whose criterion clearly stays above
        the target is abandoned.
        """
        if fit.kept is None:
            return fit
        stopping = self.fitter.settings.stopping
        for _ in range(stopping.rounds):
            before, fit = fit, self._after_rounds_anew(fit)
            fell = before.cost - fit.cost
            if fell < self.threshold:
                break
            if out_of_reach(self.criterion(fit) - target, fell, stopping.rounds):
                return fit
        if self.criterion(fit) - target > MOST_BY_SHAKING:
            return fit
        rng = np.random.default_rng(self.seed)
        for _ in range(SHAKES):
            terms = self.within_bounds(shaken_terms(fit.terms, SHAKE, rng))
            begun = self.fitter.with_terms(fit, terms).outdated(np.ones(len(fit.local), bool))
            found = self._after_rounds_anew(begun, rounds=2)
            fit = min(fit, found, key=lambda each: each.cost)
        return fit

    def _after_rounds_anew(self, fit: Fit, rounds: int = 1) -> Fit:
        """A fit after further rounds, with all sensitivities recomputed before them."""
        return self.after_rounds(self.fitter.kept_anew(fit), rounds)

    def warm_start(self, model: Linearised, terms: Terms) -> Fit:
        """A model with other terms, before anything else is fitted to them.

        Its initial states are the model's, or as first estimated. Uncertain numbers start at their
        present or their prior values: those that compensated for a wrong model may be far off, and
        hardly recover.
        """
        terms = handed_over(terms)
        free = self.fitter.free(terms)
        begun = (
            self.fitter.warm_start(model.fit, each, free)
            for each in dict.fromkeys((terms, as_said(terms)))
        )
        return min(begun, key=lambda fit: fit.cost)

    def unstuck(self, fit: Fit) -> Fit:
        """A fit, continued with better starts of stuck windows."""
        elsewhere = unstuck(self.fitter, fit)
        return fit if elsewhere is fit else self.fit_until(elsewhere)

    def begun_without(self, fit: Fit, term: Term) -> Fit:
        """A fit without a term, before anything is fitted: numbers of the same quantity take over
        its value.
        """
        return self.fitter.with_terms(fit, self.within_bounds(handed_back(fit.terms, term)))

    def within_bounds(self, terms: Terms) -> Terms:
        """Terms with uncertain values limited to the allowed deviations."""
        for value in self.fitter.free(terms):
            if value.prior < np.inf:
                terms = value.moved(terms, 0.0)
        return terms

    def dropped(self, fit: Fit, term: Term, others: Sequence[Fit] = ()) -> Fit:
        """A fit without a term, as far as that may be as good; others may have better initial states."""
        less = self.begun_without(fit, term)
        for other in others:
            if places(other.terms) == places(less.terms):  # fitted, but maybe in other time steps
                again = self.fitter.with_terms(other, other.terms)
                less = self.fitter.best_of(less, again)
        return self.fit_until(less, self.criterion(fit) + self.least_explained(term))

    def pruned(self, fit: Fit, others: Sequence[Fit] = ()) -> Fit:
        """The model without its unnecessary terms.

        That may be all of them: better initial states found on the way are no evidence for an
        effect. The explanation by a fitted term must reach the threshold of the score. One of the
        others may be what remains.
        """
        while terms := asked(fit.terms):
            shorter = [self.dropped(fit, term, others) for term in terms]
            shares = [self.share(fit, less, t) for less, t in zip(shorter, terms, strict=True)]
            least = int(np.argmin(shares))
            if shares[least] > 1.0:
                break
            fit = shorter[least]
        return fit

    def share(self, fit: Fit, less: Fit, term: Term) -> float:
        """Explanation by a term of a fit relative to one without it, over the visible amount."""
        return (less.cost - fit.cost) / self.least_explained(term)

    def least_explained(self, term: Term) -> float:
        """Smallest visible explanation by a term [sigma^2]."""
        return self.threshold * chance(len(term.effect.sizes), self.threshold)

    def promised_as_built(self, model: ScoredModel, least: float) -> Promise | None:
        """Promise of all numbers of a robot, each slightly off; None if not asked for, or below the least.

        The tolerances of a robot are not known beforehand: of several fractions of the standard deviations
        the most likely one is used. With too wide priors the numbers cost more than they explain, and
        single effects would be named instead.
        """
        fitter, fit = self.fitter, model.fit
        if not self.as_built or fit.kept is not None or model.beyond_noise < self.threshold:
            return None
        begun = fitter.with_terms(fit, (*fit.terms, *self.as_built))
        begun = fitter.keeping(begun, self.as_built)
        promise = promised(fitter, model, begun, self.settings.as_built_shares)
        return promise if promise.explained >= least else None

    def known_share(self, fit: Fit) -> float:
        """The fraction of the usual standard deviations in a fit with numbers of a robot as built."""
        usual = self.as_built[0]
        taken = next(t for t in fit.terms if t.effect is usual.effect and t.place == usual.place)
        return taken.known[0] / usual.known[0]

    def shortlist(self, model: ScoredModel) -> list[Score]:
        """Candidates worth a fit, best first."""
        settings, found = self.settings, list[Score]()
        for score in model.scores:
            enough = score.statistic >= settings.share * model.scores[0].statistic
            same = sum(each.candidate.effect.name == score.candidate.effect.name for each in found)
            if enough and score.score >= self.threshold and same < settings.per_family:
                found.append(score)
        return found[: settings.shortlist]


def added(models: Sequence[ScoredModel]) -> Terms:
    """Terms of the last model that the first does not have."""
    before = places(models[0].fit.terms)
    last = asked(models[-1].fit.terms)
    return tuple(t for t in last if (t.effect.name, t.place) not in before)


def without(terms: Terms, term: Term) -> Terms:
    """All terms but one."""
    return tuple(t for t in terms if t is not term)
