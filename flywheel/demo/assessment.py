"""Assessment of a diagnosis of a hidden effect."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from flywheel.diagnosis import Verdict
from flywheel.diagnosis.selection.scores import Score
from flywheel.effects import EFFECTS, FORMS
from flywheel.truth_simulator import OTHER_FORMS, EffectTruth

# Effects that make the same motion exactly, or have one cause by several laws: naming either is right.
EQUIVALENT = {
    "sensor_latency": "command_delay",
    **{name: form.family for name, form in FORMS.items()},
    **{name: form.family for name, form in OTHER_FORMS.items()},
}
Named = tuple[str, str]  # an effect, and the cable or point that it is at, or ""


class Naming(StrEnum):
    """Outcome, in a few words."""

    NAMED = "named"
    AMONG = "named among others that cannot be distinguished"
    BESIDE = "named together with something wrong"
    NOT_NAMED = "not named"
    OUTSIDE = "rightly said to be none of the library's effects"
    NOTHING = "nothing hidden, nothing named"
    FALSE_ALARM = "nothing hidden, something named"


RIGHT = (Naming.NAMED, Naming.AMONG, Naming.OUTSIDE, Naming.NOTHING)


@dataclass(frozen=True)
class Assessment:
    """Assessment of a diagnosis.

    Attributes:
      outcome: in a few words.
      sentence: the hidden effect, and the answer.
    """

    outcome: Naming
    sentence: str


def assess(
    hidden: EffectTruth | None,
    verdict: Verdict,
    answers: Sequence[Sequence[Named]],
    smallest: float = math.nan,
) -> Assessment:
    """Compare an answer with the truth.

    Args:
      hidden: the effect; None for nothing.
      verdict: of the diagnosis.
      answers: its alternatives, each of effects that act together.
      smallest: smallest visible size in these recordings, in multiples of the true one.
    """
    named = [tuple(answer) for answer in answers if answer]
    if hidden is None:
        return _of_nothing(verdict, named)
    if key_of(hidden.name, hidden.place)[0] not in EFFECTS:
        return _of_unknown(hidden, verdict, named)
    return _of_known(hidden, verdict, named, smallest)


def key_of(effect: str, location: str) -> Named:
    """Identity of an effect for comparison: its name, or that of the equivalent one, and its place."""
    return (EQUIVALENT.get(effect, effect), location)


def library_values(effect: EffectTruth) -> dict[str, float]:
    """The values of a hidden effect by the names of the library's parameters."""
    values = dict(effect.values)
    if effect.name == "hysteresis":
        values["force"] = values.pop("stiffness") * values["length"]
    return values


def smallest_shown(
    ranking: Sequence[Score], effect: str, location: str, values: Mapping[str, float]
) -> float:
    """Smallest visible size of an effect over its true size; NaN if it was not a candidate.

    Args:
      ranking: every candidate of the diagnosis.
      effect, location: hidden effect and its place.
      values: true ones, by the names of the library's parameters.
    """
    for score in ranking:
        candidate = score.candidate
        if key_of(candidate.effect.name, candidate.location) == key_of(effect, location):
            sizes = [values.get(parameter.name, 0.0) for parameter in candidate.effect.sizes]
            true = np.linalg.norm(np.array(sizes) / np.array(candidate.typical))
            return float(score.smallest / true) if true else math.inf
    return math.nan


def label_of(effect: str, location: str) -> str:
    """Readable name: "weak_cable at long_03"."""
    return f"{effect} at {location}" if location else effect


def _of_nothing(verdict: Verdict, named: Sequence[Sequence[Named]]) -> Assessment:
    if verdict in (Verdict.NOISE_ONLY, Verdict.DATA_INSUFFICIENT):
        words = "Nothing was hidden, and nothing was named."
        return Assessment(Naming.NOTHING, words)
    words = f"{_either(named)} was named" if named else "something was said to be missing"
    if verdict is Verdict.NOT_CONVERGED:
        words = "no fit was found"
    return Assessment(Naming.FALSE_ALARM, f"Nothing was hidden, but {words}: a false alarm.")


def _of_unknown(
    hidden: EffectTruth, verdict: Verdict, named: Sequence[Sequence[Named]]
) -> Assessment:
    label = label_of(hidden.name, hidden.place)
    begin = f"Hidden was {label}, which is none of the library's effects"
    if verdict is Verdict.OUTSIDE_LIBRARY:
        return Assessment(Naming.OUTSIDE, f"{begin}, as the answer says.")
    if verdict is Verdict.PARTIAL:
        words = (
            f"the answer says that something else is missing, but {_either(named)} was named "
            "as well"
        )
        return Assessment(Naming.BESIDE, f"{begin}; {words}, which does not exist.")
    words = f"it was taken for {_either(named)}" if named else "nothing was found"
    return Assessment(Naming.NOT_NAMED, f"{begin}, but this was not said: {words}.")


def _of_known(
    hidden: EffectTruth, verdict: Verdict, named: Sequence[Sequence[Named]], smallest: float
) -> Assessment:
    truth, label = key_of(hidden.name, hidden.place), label_of(hidden.name, hidden.place)
    found = [[key_of(*each) for each in answer] for answer in named]
    if verdict is Verdict.OUTSIDE_LIBRARY or not named:
        words = _unnamed(verdict, named, smallest)
        return Assessment(Naming.NOT_NAMED, f"Hidden was {label}; it was not named: {words}.")
    if [truth] in found and verdict is Verdict.PARTIAL:
        words = "the answer says that something else is missing as well, and nothing is"
        return Assessment(Naming.BESIDE, f"Hidden was {label}; it was named, but {words}.")
    if [truth] in found and len(found) > 1:
        words = "it was named among others that these recordings cannot distinguish"
        return Assessment(Naming.AMONG, f"Hidden was {label}; {words}: {_either(named)}.")
    if [truth] in found:
        same = named[0][0] == (hidden.name, hidden.place)
        words = (
            "it was named" if same else f"{_either(named)}, which makes the same motion, was named"
        )
        return Assessment(Naming.NAMED, f"Hidden was {label}, and {words}.")
    if with_truth := [answer for answer in found if truth in answer]:
        wrong = ", ".join(label_of(*each) for each in with_truth[0] if each != truth)
        words = f"it was named, but together with {wrong}, which does not exist"
        return Assessment(Naming.BESIDE, f"Hidden was {label}; {words}.")
    elsewhere = any(each[0] == truth[0] for answer in found for each in answer)
    place = ", so that only the place is wrong" if elsewhere else ""
    words = f"it was not named: {_either(named)} was named instead{place}"
    return Assessment(Naming.NOT_NAMED, f"Hidden was {label}; {words}.")


def _unnamed(verdict: Verdict, named: Sequence[Sequence[Named]], smallest: float) -> str:
    """Reason why an effect of the library is not named in the answer."""
    if verdict is Verdict.NOT_CONVERGED:
        return "no fit was found"
    if verdict is Verdict.OUTSIDE_LIBRARY:
        like = f", most like {_either(named[:1])}" if named else ""
        return f"something was said to be missing that is none of the library's effects{like}"
    if smallest > 1:
        return f"it is visible in these recordings from {smallest:.2g} times its size on"
    return "nothing beyond noise was found"


def _either(named: Sequence[Sequence[Named]]) -> str:
    """Alternatives in words: "creep; or payload at s2 with capstan"."""
    return "; or ".join(" with ".join(label_of(*each) for each in answer) for answer in named)
