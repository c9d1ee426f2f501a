"""Result of one case, as plain numbers, and its correctness."""

from __future__ import annotations

import math

from pydantic import Field

from flywheel.demo.assessment import key_of
from flywheel.results import ResultRecord


class Named(ResultRecord):
    """An effect at a place.

    Attributes:
      effect: its name.
      location: name of the cable or point, or "".
      values: of its parameters.
      low, high: ends of their 95 % intervals; empty for the truth.
    """

    effect: str
    location: str = ""
    values: dict[str, float] = Field(default_factory=dict)
    low: dict[str, float] = Field(default_factory=dict)
    high: dict[str, float] = Field(default_factory=dict)

    @property
    def family(self) -> str:
        """The effect, or the one declared to be the same."""
        return self.key[0]

    @property
    def key(self) -> tuple[str, str]:
        """Identity of an effect for comparison."""
        return key_of(self.effect, self.location)


Answer = tuple[Named, ...]


class CaseResult(ResultRecord):
    """One case.

    Attributes:
      name, group, robot: of the case.
      model: digest of the weights under test, or "" for the plant.
      told: the diagnosis knew the distribution of the robots' deviations.
      scripts: commands of the fitted recordings.
      truth: hidden effects.
      visible: root mean square change of the recordings' points by them, over their noise.
      verdict: of the diagnosis.
      answers: its alternatives, best first.
      runner_up: the best score of a candidate that is not the answer, over the answer's.
      smallest: smallest visible size of the (first) hidden effect, over its true size.
      noise, baseline, augmented: errors on the recordings [m].
      held_out_baseline, held_out: on the held-out one [m].
      left: variance, correlation, inconstancy and largest window of the residual, see `Adequacy`.
      left_before: the same of the initial model.
      other_law, other_score, other_share, other_gain: see `Misspecification`.
      time_steps: of each window in the end [s].
      seconds: of the diagnosis.
      failure: error, or "".
    """

    name: str
    group: str
    robot: str
    model: str = ""
    told: bool = False
    scripts: tuple[str, ...] = ()
    truth: Answer = ()
    visible: float = math.nan
    verdict: str = ""
    answers: tuple[Answer, ...] = ()
    runner_up: float = math.nan
    smallest: float = math.nan
    noise: float = math.nan
    baseline: float = math.nan
    augmented: float = math.nan
    held_out_baseline: float = math.nan
    held_out: float = math.nan
    left: tuple[float, ...] = ()
    left_before: tuple[float, ...] = ()
    other_law: str = ""
    other_score: float = math.nan
    other_share: float = math.nan
    other_gain: float = math.nan
    time_steps: tuple[float, ...] = ()
    seconds: float = math.nan
    failure: str = ""

    @property
    def kind(self) -> str:
        """The hidden effects' names, joined by "+", or "nothing"."""
        return "+".join(each.effect for each in self.truth) or "nothing"

    @property
    def best(self) -> Answer:
        """The first alternative."""
        return self.answers[0] if self.answers else ()

    @property
    def first_is_right(self) -> bool:
        """The best answer is the truth, places included."""
        return same(self.best, self.truth)

    @property
    def right(self) -> bool:
        """The best answer is the truth, or the effect was rightly called too small."""
        return self.first_is_right or self.said_unseen

    @property
    def contains_truth(self) -> bool:
        """One of the answers is."""
        return any(same(answer, self.truth) for answer in self.answers)

    @property
    def family_is_right(self) -> bool:
        """The best answer names the right effects, at any place."""
        return {n.family for n in self.best} == {n.family for n in self.truth}

    @property
    def said_unseen(self) -> bool:
        """The answer is that nothing is visible, and its smallest visible size is above the effect's.

        The other simulator agrees: the effect changes the measurements by less than the noise.
        """
        nothing = self.verdict in ("NOISE_ONLY", "DATA_INSUFFICIENT")
        return nothing and self.smallest > 1.0 and self.visible < 1.0

    @property
    def said_outside(self) -> bool:
        """The answer is that something outside the library is missing."""
        return self.verdict in ("OUTSIDE_LIBRARY", "PARTIAL")

    @property
    def size_error(self) -> float:
        """Relative error of the sizes of a right first answer; NaN of a wrong one, or without sizes."""
        if not self.first_is_right or not self.truth:
            return math.nan
        pairs = list(matched(self.best, self.truth))
        true = math.sqrt(sum(b**2 for _, b, _, _ in pairs))
        return math.sqrt(sum((a - b) ** 2 for a, b, _, _ in pairs)) / true if true else math.nan

    @property
    def covered(self) -> list[bool]:
        """For each value of a right first answer: True if its interval contains the true one."""
        if not self.first_is_right:
            return []
        return [low <= truth <= high for _, truth, low, high in matched(self.best, self.truth)]


def same(answer: Answer, truth: Answer) -> bool:
    """True if two answers name the same effects at the same places, in any order."""
    return sorted(n.key for n in answer) == sorted(n.key for n in truth)


def matched(answer: Answer, truth: Answer) -> list[tuple[float, float, float, float]]:
    """Value, true value, and the interval's ends, of each value that both name."""
    by_key = {n.key: n for n in answer}
    found = []
    for each in truth:
        other = by_key[each.key]
        for name in each.values.keys() & other.values.keys():
            ends = (other.low.get(name, math.nan), other.high.get(name, math.nan))
            found.append((other.values[name], each.values[name], *ends))
    return found
