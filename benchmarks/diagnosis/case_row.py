"""One case of the diagnosis benchmark as a row of a table."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.diagnosis.case_result import Answer, CaseResult, Named


@dataclass(frozen=True)
class CaseRow:
    """Result of a case, without nesting.

    Attributes:
      set: set of cases ("main", "fresh", "network", "as-built-half").
      name, group, robot: of the case.
      model: the first digits of the digest of the weights under test, or "" for the plant.
      kind: names of the hidden effects, joined by "+", or "nothing".
      truth: hidden effects, in words.
      answer: the first answer, in words, each value with its 95 % interval.
      verdict: of the diagnosis, or "failed".
      answers: number of alternatives.
      right: the first answer is the truth, or it was rightly called too small.
      first_is_right: the first answer is the truth, places included.
      family_is_right: the first answer names the right effects, at any place.
      contains_truth: one of the answers is the truth.
      said_unseen: rightly called too small to be visible.
      said_outside: the answer is that something outside the library is missing.
      sizes, covered: values of a right first answer, and number of their intervals that contain the
        true one.
      size_error: relative error of a right first answer.
      visible: root mean square change of the points by the hidden effects, over the noise.
      smallest: smallest visible size of the hidden effect, over its true size.
      noise: of a coordinate, as estimated [m].
      baseline, augmented: error on the recordings without and with the answer, over the noise.
      held_out_baseline, held_out: the same on the held-out recording.
      seconds: of the diagnosis.
    """

    set: str
    name: str
    group: str
    robot: str
    model: str
    kind: str
    truth: str
    answer: str
    verdict: str
    answers: int
    right: bool
    first_is_right: bool
    family_is_right: bool
    contains_truth: bool
    said_unseen: bool
    said_outside: bool
    sizes: int
    covered: int
    size_error: float
    visible: float
    smallest: float
    noise: float
    baseline: float
    augmented: float
    held_out_baseline: float
    held_out: float
    seconds: float

    @classmethod
    def of(cls, result: CaseResult, of_set: str = "main") -> CaseRow:
        """The row of a result."""
        return cls(
            set=of_set,
            name=result.name,
            group=result.group,
            robot=result.robot,
            model=result.model[:12],
            kind=result.kind,
            truth=in_words(result.truth),
            answer=in_words(result.best),
            verdict=result.verdict or "failed",
            answers=len(result.answers),
            right=result.right,
            first_is_right=result.first_is_right,
            family_is_right=result.family_is_right,
            contains_truth=result.contains_truth,
            said_unseen=result.said_unseen,
            said_outside=result.said_outside,
            sizes=len(result.covered),
            covered=sum(result.covered),
            size_error=result.size_error,
            visible=result.visible,
            smallest=result.smallest,
            noise=result.noise,
            baseline=result.baseline / result.noise,
            augmented=result.augmented / result.noise,
            held_out_baseline=result.held_out_baseline / result.noise,
            held_out=result.held_out / result.noise,
            seconds=result.seconds,
        )


def in_words(answer: Answer) -> str:
    """Effects with places and values: "payload at s3: mass 11.4 [7.68, 15.1]"."""
    return "; ".join(_effect(each) for each in answer)


def _effect(named: Named) -> str:
    where = f" at {named.location}" if named.location else ""
    values = ", ".join(
        f"{name} {value:.4g}"
        + (f" [{named.low[name]:.4g}, {named.high[name]:.4g}]" if name in named.low else "")
        for name, value in named.values.items()
    )
    return f"{named.effect}{where}" + (f": {values}" if values else "")
