"""Result of a diagnosis: the verdict and its evidence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flywheel.diagnosis.checks.adequacy import Adequacy
from flywheel.diagnosis.checks.discrepancy import DiscrepancyModel
from flywheel.diagnosis.checks.first_lengths import FirstLength
from flywheel.diagnosis.checks.held_out import Errors
from flywheel.diagnosis.checks.held_out_gain import Gain
from flywheel.diagnosis.checks.localisation import Location
from flywheel.diagnosis.checks.suspect_parameters import SuspectParameter
from flywheel.diagnosis.heartbeat import Failure
from flywheel.diagnosis.results.answer import FORMAT
from flywheel.diagnosis.results.evidence import Evidence
from flywheel.diagnosis.results.next_experiment import NextExperiment, next_experiment
from flywheel.diagnosis.results.numbers_as_built import AsBuiltNumbers
from flywheel.diagnosis.results.verdict import EXIT_CODES, INTERRUPTED, Alternative, Verdict
from flywheel.diagnosis.selection.misspecification import NONE, Misspecification
from flywheel.diagnosis.selection.scores import Score
from flywheel.diagnosis.settings import Settings, unusual
from flywheel.effects.own import law_files


@dataclass(frozen=True)
class TimeSteps:
    """Time steps of the windows: separates numerics from physics.

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
        """In JSON form."""
        return {"own": self.own, "taken": list(self.taken), "unit": "s"}


@dataclass(frozen=True)
class Diagnosis:
    """The whole answer.

    Attributes:
      verdict: in a word.
      answers: alternatives, the best first; each is a set of effects that act together.
      ranking: of every candidate on top of the initial plant, best first.
      threshold: score from which an effect counts as visible.
      other_forms: the first answer by other laws, which explain the recordings as well: its form is
        undecided.
      errors: on the fitted recordings.
      held_out: on the others; None without any.
      gain: of all added effects of the first answer, on windows that were not fitted; None for
        none.
      model_discrepancy: unexplained error, as the standard deviation of equally disturbing white
        noise [m]; scores and intervals use this and noise. 0 if the best model fits to noise level.
      before, after: residuals of the initial and of the augmented plant.
      evidence: for display.
      seconds: duration.
      model: name of the model under test; "" for the plant itself.
      misspecification: laws of no library that explain something in addition to the first answer.
      other_form: they explain so much that the answer must have another form.
      location: of an unexplained error; None without one.
      discrepancy: a learned law for it, likewise.
      calibration: uncertain numbers of the plant, as fitted together with the first answer; in
        JSON, with the `held_back` ones (see `Found`).
      as_built: numbers of the robot that are all slightly off, likewise; None if not needed.
      time_steps: of the simulations.
      suspects: numbers of the MJCF that may be wrong instead.
      settings: of the diagnosis; in JSON, the changed ones.
      interrupted: this is the best answer at an early stop.
      failures: parts of the search lost to a bug.
      first_lengths: winches whose first lengths must differ for the recordings to be explained.
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
    other_forms: tuple[Alternative, ...] = ()
    gain: Gain | None = None
    model_discrepancy: float = 0.0
    seconds: float = 0.0
    model: str = ""
    misspecification: Misspecification = NONE
    other_form: bool = False
    location: Location | None = None
    discrepancy: DiscrepancyModel | None = None
    calibration: Alternative = ()
    as_built: AsBuiltNumbers | None = None
    time_steps: TimeSteps = TimeSteps(0.0, ())
    suspects: tuple[SuspectParameter, ...] = ()
    settings: Settings = Settings()
    interrupted: bool = False
    failures: tuple[Failure, ...] = ()
    first_lengths: tuple[FirstLength, ...] = ()

    @property
    def next_experiment(self) -> NextExperiment:
        """The next experiment."""
        law = self.misspecification.instead or self.misspecification.name
        other = law if self.other_form and self.location is None else ""
        return next_experiment(
            self.verdict, self.answers, self.ranking, self.evidence, other, self.interrupted
        )

    @property
    def exit_code(self) -> int:
        """Exit code of the command: the verdict as a number, unless that was interrupted."""
        return INTERRUPTED if self.interrupted else EXIT_CODES[self.verdict]

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        wrong_form = self.misspecification.summary() if self.other_form else None
        return {
            "format": FORMAT,
            "verdict": str(self.verdict),
            "interrupted": self.interrupted,
            **({"failures": [f.summary() for f in self.failures]} if self.failures else {}),
            "model": self.model or "plant",
            "answer_set": [[found.summary() for found in each] for each in self.answers],
            "other_forms": [[found.summary() for found in each] for each in self.other_forms],
            "calibration": [
                {**each.summary(), "held_back": each.held_back} for each in self.calibration
            ],
            "as_built": None if self.as_built is None else self.as_built.summary(),
            "first_lengths": [each.summary() for each in self.first_lengths],
            "suspect_parameters": [each.summary() for each in self.suspects],
            "ranking": [ranked(score) for score in self.ranking],
            "threshold": self.threshold,
            "model_discrepancy": {"value": self.model_discrepancy, "unit": "m"},
            "error": self.errors.summary(),
            "held_out": None if self.held_out is None else self.held_out.summary(),
            "held_out_gain": None if self.gain is None else self.gain.summary(),
            "residual": {
                "noise": self.after.noise,
                "correlation": self.after.correlation,
                "inconstancy": self.after.inconstancy,
                "loudest": self.after.loudest,
            },
            "misspecification": wrong_form,
            "unexplained": None if self.location is None else self.location.summary(),
            "discrepancy_model": None if self.discrepancy is None else self.discrepancy.summary(),
            "next_experiment": self.next_experiment.summary(),
            "time_steps": self.time_steps.summary(),
            "seconds": self.seconds,
            **({"effects_from": self.effects_from} if self.effects_from else {}),
            **({"settings": changes} if (changes := unusual(self.settings)) else {}),
        }

    @property
    def effects_from(self) -> list[dict[str, str]]:
        """The law files of the library's effects."""
        files = law_files(score.candidate.effect for score in self.ranking)
        return [file.reference.model_dump() for file in files]


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
