"""What a diagnosis says: the verdict and everything it rests on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flywheel.diagnosis.checks.adequacy import Adequacy
from flywheel.diagnosis.checks.localisation import Whereabouts
from flywheel.diagnosis.results.evidence import Evidence
from flywheel.diagnosis.results.next_experiment import NextExperiment, next_experiment
from flywheel.diagnosis.results.verdict import EXIT_CODES, Alternative, Verdict
from flywheel.diagnosis.selection.misspecification import NONE, OtherLaw
from flywheel.diagnosis.selection.score_test import Score
from flywheel.diagnosis.selection.suspect_parameters import Doubtful


@dataclass(frozen=True)
class Errors:
    """Root mean square of measured minus predicted, after the starts were fitted [m].

    Attributes:
      noise: that is in the measurements.
      baseline: of the plant as it was.
      augmented: with the effects that were found.
    """

    noise: float
    baseline: float
    augmented: float

    def summary(self) -> dict[str, Any]:
        """As in JSON."""
        return {
            "noise": self.noise,
            "baseline": self.baseline,
            "augmented": self.augmented,
            "unit": "m",
        }


@dataclass(frozen=True)
class Likeness:
    """How much of what a learned law does an effect of the library would do.

    Attributes:
      effect, location: which.
      share: of the squared change, by its best size; 1 for all of it.
    """

    effect: str
    location: str
    share: float

    def summary(self) -> dict[str, Any]:
        """As in JSON."""
        return {"effect": self.effect, "location": self.location, "share": self.share}


@dataclass(frozen=True)
class StandIn:
    """A law of the cables, learned from the recordings for what the library does not have.

    Attributes:
      errors: on the recordings that it was learned from; the baseline has all effects that were found.
      held_out: on those that it was not, where the baseline is the plant as it was; None without any.
      likeness: effects that do most nearly what it does, the nearest first.
    """

    errors: Errors
    held_out: Errors | None
    likeness: tuple[Likeness, ...]

    def summary(self) -> dict[str, Any]:
        """As in JSON."""
        return {
            "error": self.errors.summary(),
            "held_out": None if self.held_out is None else self.held_out.summary(),
            "like": [each.summary() for each in self.likeness],
        }


@dataclass(frozen=True)
class TimeSteps:
    """How finely windows had to be simulated: what is numbers is told from what is physics.

    Attributes:
      own: the plant's [s].
      taken: (K,) in each window [s].
    """

    own: float
    taken: tuple[float, ...]

    @property
    def shorter(self) -> int:
        """Windows in which the plant's own are too long."""
        return sum(each < self.own for each in self.taken)

    def summary(self) -> dict[str, Any]:
        """As in JSON."""
        return {"own": self.own, "taken": list(self.taken), "unit": "s"}


@dataclass(frozen=True)
class Diagnosis:
    """The whole answer.

    Attributes:
      verdict: in a word.
      answers: alternatives, the best first; each is a set of effects that act together.
      ranking: of every candidate on top of the plant as it was, best first.
      threshold: score from which an effect counts as seen.
      errors: on the recordings that were fitted.
      held_out: on those that were not; None without any.
      before, after: what the plant as it was leaves, and what the augmented one leaves.
      evidence: to look at.
      seconds: it took.
      model: name of the model under test; "" for the plant itself.
      other_law: that explains the most beside the first answer.
      other_form: it explains so much that what was found must have another form.
      where: what no effect explains acts; None where nothing is left.
      stand_in: a learned law for it, likewise.
      calibration: what the plant was not sure of, as fitted beside the first answer; in JSON, with what
        was `held_back` (see `Found`).
      time_steps: of the simulations.
      doubtful: numbers of the MJCF that may be what is wrong instead.
    """

    verdict: Verdict
    answers: tuple[Alternative, ...]
    ranking: tuple[Score, ...]
    threshold: float
    errors: Errors
    held_out: Errors | None
    before: Adequacy
    after: Adequacy
    evidence: Evidence
    seconds: float = 0.0
    model: str = ""
    other_law: OtherLaw = NONE
    other_form: bool = False
    where: Whereabouts | None = None
    stand_in: StandIn | None = None
    calibration: Alternative = ()
    time_steps: TimeSteps = TimeSteps(0.0, ())
    doubtful: tuple[Doubtful, ...] = ()

    @property
    def next_experiment(self) -> NextExperiment:
        """What to record next."""
        law = self.other_law.instead or self.other_law.name
        other = law if self.other_form and self.where is None else ""
        return next_experiment(self.verdict, self.answers, self.ranking, self.evidence, other)

    @property
    def exit_code(self) -> int:
        """Of the command."""
        return EXIT_CODES[self.verdict]

    def summary(self) -> dict[str, Any]:
        """As in JSON."""
        return {
            "verdict": str(self.verdict),
            "model": self.model or "plant",
            "answer_set": [[found.summary() for found in each] for each in self.answers],
            "calibration": [
                {**each.summary(), "held_back": each.held_back} for each in self.calibration
            ],
            "doubtful_numbers": [each.summary() for each in self.doubtful],
            "ranking": [ranked(score) for score in self.ranking],
            "threshold": self.threshold,
            "error": self.errors.summary(),
            "held_out": None if self.held_out is None else self.held_out.summary(),
            "residual": {
                "noise": self.after.noise,
                "correlation": self.after.correlation,
                "inconstancy": self.after.inconstancy,
                "loudest": self.after.loudest,
            },
            "other_law": self.other_law.summary() if self.other_form else None,
            "unexplained": None if self.where is None else self.where.summary(),
            "stand_in": None if self.stand_in is None else self.stand_in.summary(),
            "next_experiment": self.next_experiment.summary(),
            "time_steps": self.time_steps.summary(),
            "seconds": self.seconds,
        }


def ranked(score: Score) -> dict[str, Any]:
    """A line of the ranking, with sizes in their units."""
    candidate = score.candidate
    return {
        "effect": candidate.effect.name,
        "location": candidate.location,
        "score": score.score,
        "sizes": {
            parameter.name: {"value": size * typical, "unit": parameter.unit}
            for parameter, size, typical in zip(
                candidate.effect.sizes, score.sizes, candidate.typical, strict=True
            )
        },
        "smallest_detectable": score.smallest if np.isfinite(score.smallest) else None,
    }
