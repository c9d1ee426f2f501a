"""The answer of a diagnosis, as read from `Diagnosis.summary()` or from a file."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, StrictFloat, field_validator, model_validator

from flywheel.diagnosis.results.verdict import Verdict
from flywheel.diagnosis.settings import NUMBER, Limits
from flywheel.effects import WrittenTerm
from flywheel.effects.own import MOST_FILES, LawReference
from flywheel.effects.written import MOST_PARAMETERS
from flywheel.effects.written import Value as EffectValue
from flywheel.errors import DataError
from flywheel.quantities import Bounds, Name
from flywheel.registry import lookup
from flywheel.validation import validated

FORMAT = 2  # of the JSON that is written
EVIDENCE = ("verdict", "error", "held_out", "residual", "recordings", "held_out_recordings")
MOST_SETTINGS = 1000
MOST_ANSWERS = 1000  # also of the effects of one
MOST_NAMED = 20  # alternatives, in a message
LARGEST_EVIDENCE = 200_000  # characters, as JSON: a plant's file must stay one that is read


class _Part(BaseModel):
    """A part of an answer; unknown fields are ignored."""

    model_config = ConfigDict(frozen=True, extra="ignore")


class Fitted(_Part):
    """A value of an effect, with its 95 % interval.

    Attributes:
      value, low, high: in the unit; the value is within the interval.
      in_plant: the value that fits the plant's own time steps; None for the same.
    """

    value: EffectValue
    low: StrictFloat
    high: StrictFloat
    unit: Name
    in_plant: EffectValue | None = None

    @model_validator(mode="after")
    def _within(self) -> Self:
        if self.value < self.low or self.value > self.high:
            raise ValueError(
                f"must be within its interval from {self.low:g} to {self.high:g}; got {self.value:g}"
            )
        return self


class FoundEffect(_Part):
    """An effect with its values; `Found.summary()`."""

    effect: Name
    location: Name = ""
    parameters: dict[Name, Fitted] = Field(max_length=MOST_PARAMETERS)

    def written(self) -> WrittenTerm:
        """In the form of a plant."""
        values = {
            name: each.value if each.in_plant is None else each.in_plant
            for name, each in self.parameters.items()
        }
        return WrittenTerm(effect=self.effect, location=self.location, parameters=values)

    def intervals(self) -> dict[str, Any]:
        """As evidence."""
        values = {name: [each.low, each.high, each.unit] for name, each in self.parameters.items()}
        return {"effect": self.effect, "location": self.location, **values}


Together = Annotated[tuple[FoundEffect, ...], Field(max_length=MOST_ANSWERS)]


class HeldOut(_Part):
    """Root mean squares on held-out recordings, before and after, and that of noise [m]. May be NaN."""

    baseline: StrictFloat
    augmented: StrictFloat
    noise: StrictFloat = math.nan

    @property
    def explained(self) -> float:
        """Removed share of the mean square beyond noise; NaN if unknown."""
        if not self.baseline > self.noise:
            return math.nan
        beyond = (self.baseline - self.noise) * (self.baseline + self.noise)
        return (self.baseline - self.augmented) * (self.baseline + self.augmented) / beyond


class AboutRobot(_Part):
    """The diagnosed robot.

    Attributes:
      name, digest: of its MJCF.
      effects: labels of the effects that its plant had; None if unknown.
    """

    name: Name = ""
    digest: Name = ""
    effects: Annotated[tuple[Name, ...], Field(max_length=MOST_ANSWERS)] | None = None


class Suspect(_Part):
    """A number of the MJCF that may be wrong; `explained` where it explains more than the answer."""

    name: Name
    explained: Annotated[StrictFloat, Bounds(0, 1e9)] | None = None


class Answer(_Part):
    """The part of `Diagnosis.summary()`, or of the JSON of `flywheel diagnose`, that is read.

    Attributes:
      verdict: in a word.
      answer_set: alternatives, each of effects that act together.
      calibration: uncertain numbers of the plant.
      interrupted: it is the best answer at an early stop.
      suspect_parameters: numbers of the MJCF that may be wrong instead.
      held_out: errors on held-out recordings; None for nothing.
      robot: diagnosed robot.
      effects_from: law files of the effects.
      settings: changed ones of the diagnosis, by their paths.
      format: of the JSON.
    """

    format: Annotated[int, Bounds(1, 1000)]
    verdict: Verdict
    answer_set: tuple[Together, ...] = Field(default=(), max_length=MOST_ANSWERS)
    calibration: Together = ()
    interrupted: bool = False
    suspect_parameters: tuple[Suspect, ...] = Field(default=(), max_length=MOST_ANSWERS)
    held_out: HeldOut | None = None
    robot: AboutRobot = AboutRobot()
    effects_from: tuple[LawReference, ...] = Field(default=(), max_length=MOST_FILES)
    settings: dict[Name, Annotated[float, NUMBER]] = Field(default={}, max_length=MOST_SETTINGS)

    @field_validator("verdict", mode="before")
    @classmethod
    def _known(cls, name: object) -> object:
        return lookup(Verdict.__members__, name, "verdict") if isinstance(name, str) else name

    @classmethod
    def of(cls, summary: Mapping[str, Any]) -> Self:
        """Read it.

        Raises:
          DataError: a field has a wrong type, or the format differs.
        """
        answer = validated(cls, dict(summary), "The answer cannot be used", DataError)
        if answer.format != FORMAT:
            raise DataError(f"The answer has format {answer.format}; this version reads {FORMAT}.")
        return answer

    @property
    def alternatives(self) -> tuple[Together, ...]:
        """Those with an effect."""
        return tuple(each for each in self.answer_set if each)

    @property
    def worth_having(self) -> float:
        """The smallest share of the held-out error beyond noise for an unnamed adoption, see `Limits`."""
        return self.settings.get("limits.most", Limits().most)

    @property
    def is_clear(self) -> bool:
        """True if the first alternative may be adopted without naming it.

        It may be one of `EFFECT`; the only one of `PARTIAL`; and the only one beside something else that is
        left, if it explains most of what held-out recordings have beyond noise. The best answer so far of a
        diagnosis that was interrupted has to be named; so has any beside a number that explains more.
        """
        if self.interrupted or self._wrong_numbers:
            return False
        if self.verdict == Verdict.EFFECT:
            return True
        alone = len(self.alternatives) == 1
        if self.verdict == Verdict.PARTIAL:
            return alone
        alone = alone and self.verdict == Verdict.OUTSIDE_LIBRARY
        return alone and self.held_out is not None and self.held_out.explained >= self.worth_having

    def chosen(self, number: int | None) -> tuple[FoundEffect, ...]:
        """The effects of an alternative, from 1, or of the first if that is clear.

        Raises:
          DataError: there is none, or the choice is not clear.
        """
        alternatives = self.alternatives
        if not alternatives and self.verdict == Verdict.NOISE_ONLY and self.calibration:
            return ()
        if not alternatives:
            raise DataError(f"The verdict is {self.verdict}: there is no effect to adopt.")
        if number is None and not self.is_clear:
            named = "; ".join(
                f"{number}: {' with '.join(each.effect for each in alternative)}"
                for number, alternative in enumerate(alternatives[:MOST_NAMED], 1)
            )
            early = "The diagnosis was interrupted. " if self.interrupted else ""
            if self._wrong_numbers:
                early += (
                    f"Another {self._wrong_numbers} in the MJCF explains more than any effect. "
                )
            raise DataError(
                f"{early}The verdict is {self.verdict}: choose the answer to adopt. There are "
                f"{named}.{self._too_little()}"
            )
        number = 1 if number is None else number
        if not 1 <= number <= len(alternatives):
            raise DataError(f"There are answers 1 to {len(alternatives)}, got {number}.")
        return alternatives[number - 1]

    @property
    def _wrong_numbers(self) -> str:
        """Numbers of the MJCF that explain more than the answer does; "" for none."""
        return ", ".join(s.name for s in self.suspect_parameters if s.explained is not None)

    def _too_little(self) -> str:
        """Reason why the only answer is not adopted unnamed, if an error remains."""
        if self.verdict != Verdict.OUTSIDE_LIBRARY or len(self.alternatives) != 1:
            return ""
        if self.held_out is None or math.isnan(self.held_out.explained):
            return " Held-out recordings would show its value."
        return (
            f" It removes {self.held_out.explained:.0%} of the error beyond noise on held-out "
            f"recordings; from {self.worth_having:.0%} on it is adopted unnamed."
        )

    def check_held_out(self) -> None:
        """Reject effects contradicted by held-out recordings.

        Raises:
          DataError: they do.
        """
        if self.held_out is None:
            return
        before, after = self.held_out.baseline, self.held_out.augmented
        if not (math.isfinite(after) and after < before):
            raise DataError(
                f"On the held-out recordings the error is {1000 * after:.3g} mm with these "
                f"effects and {1000 * before:.3g} mm without: they do not carry over. Name the "
                "answer to adopt it anyway."
            )


def evidence_of(summary: Mapping[str, Any]) -> dict[str, Any]:
    """The evidence kept with an adopted answer: for people, unchanged.

    Raises:
      DataError: it is too large.
    """
    kept = {key: summary[key] for key in EVIDENCE if summary.get(key) is not None}
    size = len(json.dumps(kept, default=str))
    if size > LARGEST_EVIDENCE:
        raise DataError(
            f"The answer's evidence ({', '.join(EVIDENCE)}) has {size:,} characters as JSON; at most "
            f"{LARGEST_EVIDENCE:,} are kept with a plant."
        )
    return kept
