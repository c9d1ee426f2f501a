"""Numbers of the MJCF that may be wrong instead of a missing effect; they are never an answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.fitting.nuisance import asked
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.scores import Score, ScoredModel, further_scores
from flywheel.diagnosis.selection.search import Search, added
from flywheel.effects import CALIBRATIONS, EFFECTS, Term

MOST_OFF = 0.25  # of a number of the MJCF; one that would be farther off has a fit of its own
FAR = (-0.5, 1.0, 3.0, 7.0)  # shares from the best of which a fit of a number begins
NEAR = 0.999  # of a bound
STIFFNESS, DAMPING = "cable_stiffness", "cable_damping"


@dataclass(frozen=True)
class SuspectParameter:
    """A number of the MJCF whose change would explain nearly as much as an effect.

    Attributes:
      name: of the number.
      off: required change, as a fraction.
      score: like a candidate's.
      instead: added effect in whose place it was tested; "" if it explains something in addition to
        the answer.
      more: it promises more than that explained.
      explained: share of the error beyond noise that it explained in a fit of its own; None without one.
      damping: of the cables, that was fitted beside it [N s/m].
      at_bound: that fit ended at a bound of the number.
    """

    name: str
    off: float
    score: float
    instead: str
    more: bool
    explained: float | None = None
    damping: float = 0.0
    at_bound: bool = False

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        return {
            "name": self.name,
            "off": self.off,
            "score": self.score,
            "instead_of": self.instead or None,
            "more": self.more,
            "explained": self.explained,
            "cable_damping": self.damping,
            "at_bound": self.at_bound,
        }


def suspect_parameters(
    search: Search, models: Sequence[ScoredModel], unexplained: bool
) -> tuple[SuspectParameter, ...]:
    """Numbers not given as uncertain, highest score first.

    Args:
      search, models: of the answer.
      unexplained: the answer has a residual, which a number may explain in addition.
    """
    found: dict[str, SuspectParameter] = {}
    for model, after in zip(models, [*models[1:], None], strict=True):
        if after is None and not unexplained:
            break
        explained = max(score.statistic for score in model.scores)
        if after is not None:  # which may be more than its score promised
            explained = max(explained, model.fit.cost - after.fit.cost)
        for score in _scores(search, model):
            name, off = score.candidate.effect.name, score.sizes[0] * score.candidate.typical[0]
            near = score.statistic >= search.settings.rival * explained and abs(off) <= MOST_OFF
            if score.score >= search.threshold and near and name not in found:
                instead = "" if after is None else _added(search, model, after)
                more = score.statistic > explained
                found[name] = SuspectParameter(name, float(off), score.score, instead, more)
    return tuple(sorted(found.values(), key=lambda each: -each.score))


def far_off_parameters(
    search: Search, models: Sequence[ScoredModel], most: float
) -> tuple[SuspectParameter, ...]:
    """Numbers that would be far off, and by themselves explain more than the answer, by fits of their own.

    A linearisation says little of a stiffness that is several times the MJCF's. Springs that somebody guessed
    have a guessed damping, too: a stiffness is fitted with it and without. So is one that is a
    candidate: an effect has narrower bounds.

    Args:
      search, models: that led to an answer that leaves something.
      most: smallest share of the error beyond noise that such a number explains.
    """
    fitter, begun, last = search.fitter, models[0], models[-1]
    fit = fitter.with_terms(begun.fit, begun.fit.terms)
    instead = _added(search, begun, last) if len(models) > 1 else ""
    found = []
    for score in _scores(search, begun, also_candidates=True):
        best = _fitted_alone(search, replace(begun, fit=fit), score)
        number, *dampings = best.terms[len(fit.terms) :]
        share = (fit.cost - best.cost) / max(fit.cost - fitter.freedom, 1.0)
        explains = share >= most and best.cost < last.fit.cost - search.threshold
        off, (size,), (typical,) = number.values[0], number.effect.sizes, score.candidate.typical
        if abs(off) > MOST_OFF and explains:
            damping = sum(each.values[0] for each in dampings)
            at_bound = not NEAR * size.low * typical < off < NEAR * size.high * typical
            found.append(
                SuspectParameter(
                    number.effect.name, off, score.score, instead, True, share, damping, at_bound
                )
            )
    # One that stopped at its bound explains by a value that nobody knows.
    return tuple(sorted(found, key=lambda each: (each.at_bound, -(each.explained or 0.0))))


def _fitted_alone(search: Search, model: ScoredModel, score: Score) -> Fit:
    """A fit with a number from the best of several sizes, a stiffness also with a damping of all cables."""
    candidate = score.candidate
    tried = dict.fromkeys(candidate.term((share / candidate.typical[0],)) for share in FAR)
    starts = [search.warm_start(model, (*model.fit.terms, term)) for term in tried]
    fit = search.fit_until(min(starts, key=lambda each: each.cost))
    if candidate.effect.name != STIFFNESS or any(t.effect.name == DAMPING for t in model.fit.terms):
        return fit
    damped = (*fit.terms, Term(EFFECTS[DAMPING], None, (0.0,)))
    return min(fit, search.refitted(fit, damped), key=search.criterion)


def _added(search: Search, model: ScoredModel, after: ScoredModel) -> str:
    """Additions of a model to the previous one, or else its effects."""
    terms = added([model, after]) or asked(after.fit.terms)
    return " with ".join(term.label(search.fitter.windows.robot) for term in terms)


def _scores(search: Search, model: ScoredModel, also_candidates: bool = False) -> list[Score]:
    """Scores of all numbers that are not in the model, nor candidates unless those are included."""
    fitter, had = search.fitter, {term.effect.name for term in model.fit.terms}
    if not also_candidates:
        had |= {candidate.effect.name for candidate in search.library}
    library = {
        name: each
        for name, each in CALIBRATIONS.items()
        if name not in had and each.where == "robot"
    }
    numbers = candidates(fitter.windows.robot, library)
    if not numbers:
        return []
    fit = fitter.with_terms(model.fit, model.fit.terms)  # in the fitter's present time steps
    return further_scores(fitter, fit, model.test, numbers)
