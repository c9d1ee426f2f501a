"""Which effects, together: forward by score, with joint refits, pairs, and a look back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from flywheel.diagnosis.fitting.jacobian_cache import Held
from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.multistart import begun_elsewhere
from flywheel.diagnosis.fitting.nuisance import as_said, asked
from flywheel.diagnosis.fitting.parameters import free_values
from flywheel.diagnosis.fitting.refinement import in_other_steps, shorter_steps
from flywheel.diagnosis.fitting.stopping import HOPE, ROUNDS, hopeless, worth_a_round
from flywheel.diagnosis.selection.candidates import Candidate
from flywheel.diagnosis.selection.deduplication import different, places
from flywheel.diagnosis.selection.pairs import promising_pairs
from flywheel.diagnosis.selection.score_test import Score, score_test
from flywheel.diagnosis.selection.screening import at_first_sight
from flywheel.diagnosis.selection.step import Step
from flywheel.effects import Scales, Term, Terms
from flywheel.records import Floats

SHORTLIST = 4  # candidates that are refitted in each turn
SHARE = 0.5  # of the best candidate's power that one needs to be refitted
PER_FAMILY = 2  # places of one effect on the short list
TURNS = 6  # of the selection, at most
MOST = 3  # effects found together
# Of what an answer leaves beyond noise, that another effect must promise to explain; and the last one that
# may be added, without which the answer is not the whole one anyway.
SLIGHT, MOSTLY = 0.2, 0.4
TOLERATED_BY_NOTHING = 0.05  # `TOLERATED` of time steps, before nothing is said to be there
LAST_HOPE = 1.0  # `HOPE`, where it is about the last effect that may be added
SLIGHT_FALL = 5.0  # of the cost in a round, by which no race is decided [sigma^2]


class Selection:
    """Adds effects to a fitted model until none explains any more.

    Args:
      fitter: of the windows; its time steps may become shorter as effects are found.
      library: what may be added.
      threshold: score from which an effect counts as seen.
      progress: told what has been done.
      probes: laws that are tested like candidates, and never added.
    """

    def __init__(
        self,
        fitter: Fitter,
        library: Sequence[Candidate],
        threshold: float,
        progress: Callable[[str], None] = lambda note: None,
        probes: Sequence[Candidate] = (),
    ) -> None:
        self.fitter, self.library, self.threshold = fitter, tuple(library), threshold
        self.probes = tuple(probes)
        self.progress = progress
        self.scales = Scales.of(fitter.windows.robot)

    def run(self, first: Step) -> list[Step]:
        """The model as it was, with one effect more, and so on; the last step is the answer.

        Where nothing is found that a model lacks, and it may lack nothing, it is asked again in time steps
        that are shorter than a fit needs: what contacts in coarse steps do may hide a small effect.
        """
        steps = self._run(first)
        if self.new(steps) or worth_a_round(self.fitter, steps[-1].fit):
            return steps
        fit = steps[-1].fit
        fitter, fit = shorter_steps(
            self.fitter, fit, free_values(fit.terms, self.scales), TOLERATED_BY_NOTHING
        )
        if fitter is self.fitter:
            return steps
        self.fitter = fitter
        # A plant whose own effects had other values is still the first step.
        return [*steps[:-1], *self._run(self.look(self._from_elsewhere(self.pursued(fit))))]

    def _run(self, first: Step) -> list[Step]:
        """See `run`, in the time steps that the fitter has."""
        steps, most = [first], len(first.fit.terms) + MOST
        if changed := self._moved(first):
            steps.append(self.look(changed))
        for _ in range(TURNS):
            room = most - len(steps[-1].fit.terms)
            least = SLIGHT if room > 1 else MOSTLY
            if room < 1 or (self.new(steps) and not steps[-1].explained(least)):
                break
            better = self._next(steps[-1], room)
            # A score is a promise of the linearisation; a fit need not keep it.
            if better is None or self.criterion(better) >= self.criterion(steps[-1].fit):
                break
            # Only the fit was not good enough yet; other values of what the plant had are an answer.
            if places(better.terms) == places(steps[-1].fit.terms) and (
                len(steps) > 1 or not self._moves(steps[0], better)
            ):
                steps.pop()
            steps.append(self.look(better))
        return steps

    def _moved(self, first: Step) -> Fit | None:
        """The model as it was with other values of the effects that it had; None if they were right."""
        if not asked(first.fit.terms):
            return None
        fit = self.pursued(replace(first.fit, converged=False))  # with its values held so far
        return fit if self._moves(first, fit) else None

    def _moves(self, first: Step, fit: Fit) -> bool:
        """Whether a fit explains enough to say that what the model had has other values."""
        had = asked(first.fit.terms)
        return bool(had) and first.fit.cost - fit.cost > sum(self._worth(term) for term in had)

    def new(self, steps: Sequence[Step]) -> Terms:
        """Terms of the last step that the first does not have."""
        before = places(steps[0].fit.terms)
        return tuple(
            t for t in asked(steps[-1].fit.terms) if (t.effect.name, t.place) not in before
        )

    def shortened(self, fit: Fit, term: Term) -> Fit:
        """A fit without a term, fitted anew."""
        return self.pursued(self.fitter.under(fit, without(fit.terms, term)))

    def look(self, fit: Fit) -> Step:
        """Test all candidates and probes on top of a model."""
        linear = self.fitter.linear(fit)
        fit = replace(fit, held=Held.fresh(linear))
        numbers, sizes = self.fitter.step_error(fit), self.known(fit)
        taken = numbers if sizes is None else np.concatenate([numbers, sizes], axis=2)
        test = score_test(self.fitter, fit, (*self.library, *self.probes), taken, linear)
        count, scores = len(self.library), test.scores()
        ranking = sorted(scores[:count], key=lambda s: -s.score)
        self.progress(f"scored {count} candidates on top of {len(fit.terms)} effects")
        return Step(fit, linear, sizes, test, tuple(ranking), tuple(scores[count:]))

    def known(self, fit: Fit) -> Floats | None:
        """(K, D, n) sensitivities with all values of the model's terms; None without terms."""
        free = free_values(fit.terms, self.scales)
        return self.fitter.by_size(fit, free) if free else None

    def _next(self, step: Step, room: int) -> Fit | None:
        """The model with another effect, or two if there is `room`, fitted; None if none is seen."""
        best = step.scores[0]
        if best.score < self.threshold:
            return None
        short = self.short(step)
        proposals: list[Terms] = [
            (score.candidate.term(score.sizes, score.shape),) for score in short
        ]
        proposals += at_first_sight(self.fitter, step, self.library, short)
        if room > 1:
            proposals += promising_pairs(step.test, step.scores, self.threshold)
        begun = different([self.begun(step, (*step.fit.terms, *terms)) for terms in proposals])
        fitted = [self._a_round(fit) for fit in begun]
        first, *others = self.race(fitted, HOPE if room > 1 else LAST_HOPE)
        return self.pruned(first, (step.fit, *others))

    def race(self, begun: Sequence[Fit], hope: float = HOPE) -> list[Fit]:
        """Several models, each fitted on for as long as it may become the best; the best one first.

        Starts that had to make up for a wrong model find back slowly: after a few rounds the wrong one
        of two may be ahead. Of models that are one by several names, one is fitted.

        Args:
          begun: the one that promised the most first. If it is not ahead, windows of it may have got
            stuck, and begin elsewhere before anything else.
          hope: see `pursued`.
        """
        favourite, *others = different(begun)
        if any(self.criterion(fit) < self.criterion(favourite) for fit in others):
            favourite = self.fitter.elsewhere(favourite)
        first, *others = sorted((favourite, *others), key=self.criterion)
        first, *others = self._in_steps_of_the_first(first, others)
        ended = [self.pursued(first, slight=SLIGHT_FALL)]
        for fit in others:
            target = min(map(self.criterion, ended))
            ended.append(self.pursued(fit, target, hope, slight=SLIGHT_FALL))
        best, *beaten = sorted(ended, key=self.criterion)
        return [self.pursued(self.in_time_steps(self._from_elsewhere(best))), *beaten]

    def _in_steps_of_the_first(self, first: Fit, others: Sequence[Fit]) -> list[Fit]:
        """Models in time steps that will do for the first: cliffs of coarse ones may decide a race."""
        before = self.fitter
        first = self._stepped(first)
        if self.fitter is before:
            return [first, *others]
        changed = before.time_steps != self.fitter.time_steps
        return [first, *(in_other_steps(self.fitter, fit, changed) for fit in others)]

    def in_time_steps(self, fit: Fit) -> Fit:
        """A fit in time steps that will do for it, fitted on if they are others."""
        before = self.fitter
        fit = self._stepped(fit)
        return fit if self.fitter is before else self._from_elsewhere(self.pursued(fit))

    def _stepped(self, fit: Fit) -> Fit:
        """A fit in time steps that will do for it, which are those of all fits from here on.

        Without the effect that it has now, nobody could see what shorter steps make better.
        """
        free = free_values(fit.terms, self.scales)
        self.fitter, fit = shorter_steps(self.fitter, fit, free)
        return fit

    def _from_elsewhere(self, fit: Fit) -> Fit:
        """A fit, fitted on where windows that got stuck begin better elsewhere."""
        elsewhere = begun_elsewhere(self.fitter, fit)
        return fit if elsewhere is fit else self.pursued(elsewhere)

    def pursued(
        self, fit: Fit, target: float = np.inf, hope: float = HOPE, slight: float = 0.0
    ) -> Fit:
        """A fit, fitted on until it converges or its criterion clearly stays above the target.

        A model that is clearly wrong is not fitted to the last digit, and one that still diverges after a
        round not at all.

        Args:
          slight: fall of the cost in a round, below which the rest is left for later.
        """
        free = free_values(fit.terms, self.scales)
        for _ in range(ROUNDS):
            if fit.converged:
                break
            enough = worth_a_round(self.fitter, fit)
            before, fit = fit, self.fitter.fit(fit, free, rounds=1, enough=enough)
            fell = before.cost - fit.cost
            if fell < slight or hopeless(self.criterion(fit) - target, fell, hope):
                break
        return fit

    def begun(self, step: Step, terms: Terms) -> Fit:
        """The model with these terms instead, at the step's starts or as first estimated; no fit yet.

        What is not known exactly begins where it is, or as it was said: what made up for a wrong model
        may be far off, and hardly finds back.
        """
        free = free_values(terms, self.scales)
        begun = (
            self.fitter.under_or_anew(step.fit, each, free)
            for each in dict.fromkeys((terms, as_said(terms)))
        )
        return min(begun, key=lambda fit: fit.cost)

    def _a_round(self, fit: Fit) -> Fit:
        """A fit after its first round."""
        self.progress(f"fitting {', '.join(term.effect.name for term in fit.terms)}")
        return self.fitter.fit(fit, free_values(fit.terms, self.scales), rounds=1)

    def pruned(self, fit: Fit, others: Sequence[Fit] = ()) -> Fit:
        """The model without the terms that it does nearly as well without.

        That may be all of them: starts that found a better place on the way are no evidence for an
        effect. What a term explains, fitted, must be as much as the score asks for.

        Args:
          fit: with all terms.
          others: further models; one of them may be what is left.
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
        """What a term of a fit explains beside one without it, over what counts as seen."""
        return (less.cost - fit.cost) / self._worth(term)

    def _worth(self, term: Term) -> float:
        """What a term has to explain to be seen."""
        return self.threshold * len(term.effect.sizes)

    def dropped(self, fit: Fit, term: Term, others: Sequence[Fit] = ()) -> Fit:
        """A fit without a term, as far as that may be as good; `others` may know better starts."""
        less = self.fitter.under(fit, without(fit.terms, term))
        for other in others:
            if places(other.terms) == places(less.terms):  # fitted, but maybe in other time steps
                again = self.fitter.under(other, other.terms)
                less = self.fitter.best_of(less, again)
        return self.pursued(less, self.criterion(fit) + self._worth(term))

    def combined(self, fit: Fit, other: Fit, target: float = np.inf) -> Fit:
        """The better of two fits of one model, with the starts that are better in the other, fitted on."""
        return self.pursued(self.fitter.best_of(fit, other), target)

    def criterion(self, fit: Fit) -> float:
        """Cost with what every fitted value costs (BIC)."""
        measured = np.isfinite(self.fitter.windows.measured).sum()
        values = sum(len(term.values) for term in fit.terms)
        return fit.cost + values * float(np.log(measured))

    def short(self, step: Step) -> list[Score]:
        """Candidates worth a refit, best first."""
        found: list[Score] = []
        families: dict[str, int] = {}
        for score in step.scores:
            family = score.candidate.effect.name
            enough = score.power >= SHARE * step.scores[0].power
            if enough and score.score >= self.threshold and families.get(family, 0) < PER_FAMILY:
                found.append(score)
                families[family] = families.get(family, 0) + 1
        return found[:SHORTLIST]


def without(terms: Terms, term: Term) -> Terms:
    """All terms but one."""
    return tuple(t for t in terms if t is not term)
