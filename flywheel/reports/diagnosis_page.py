"""The page of a diagnosis: one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from flywheel.diagnosis import Diagnosis, Verdict
from flywheel.diagnosis.checks.first_lengths import FirstLength
from flywheel.diagnosis.checks.held_out_gain import Gain
from flywheel.diagnosis.checks.suspect_parameters import SuspectParameter
from flywheel.diagnosis.results.verdict import Alternative, Value, tolerated
from flywheel.outputs import write_output
from flywheel.reports.diagnosis_figures import PICTURES
from flywheel.reports.html import render
from flywheel.reports.pictures import shown

SHOWN = 3  # numbers of a robot that are named
NEARER = (
    "This robot is closer to its MJCF than usual: its recordings are most likely with {:.3g} "
    "of that standard deviation for each number."
)
LIMITS = (
    "Sizes and intervals assume that nothing but the named effects is missing: 95 %, from the "
    "curvature of the fit or from the variation between windows, whichever is larger, and from "
    "the time step's influence.",
    'A plant with long time steps fits best with values that compensate for them ("in this plant"; '
    "these are adopted); the values of the robot are without that compensation.",
    (
        "An effect whose detectable size is above the robot's possible sizes cannot be ruled out by "
        "these data."
    ),
    "Only effects of the library have names. See docs/own_effect.md for adding one of your own.",
)


def write_diagnosis(found: Diagnosis, path: str | Path, about: Mapping[str, str]) -> Path:
    """Write the page.

    Args:
      found: to show.
      path: of the HTML file.
      about: its provenance, as lines of two columns.
    """
    return write_output(path, diagnosis_page(found, about))


def diagnosis_page(found: Diagnosis, about: Mapping[str, str]) -> str:
    """The page as text; arguments as for `write_diagnosis`."""
    return render(
        "diagnosis",
        found=found,
        sentence=sentence(found),
        other_form=other_form(found),
        **{note.__name__: note(found) for note in NOTES},
        figures=shown(PICTURES, found),
        about=about,
        limits=LIMITS,
    )


def sentence(found: Diagnosis) -> str:
    """The verdict in words."""
    if found.verdict is Verdict.NOISE_ONLY:
        return _nothing_missing(found)
    if found.verdict is Verdict.DATA_INSUFFICIENT:
        return "These recordings are too quiet to show any effect of the library."
    if found.verdict is Verdict.NOT_CONVERGED:
        if found.interrupted:
            return "The search was stopped before it knew whether an effect is missing, and which."
        return (
            "No initial states were found that fit: the simulation of these recordings diverges, or most "
            "windows fit far worse than they did before the fit."
        )
    if found.verdict is Verdict.OUTSIDE_LIBRARY:
        return _outside(found)
    names = _names(found.answers[0])
    if found.verdict is Verdict.PARTIAL:
        form = ", in another form than the library's," if found.other_form else ""
        share = "" if found.gain is None else f": {found.gain.share:.0%} of the error beyond noise"
        either = " or ".join(_names(answer) for answer in found.answers)
        alike = ", and these recordings do not distinguish them" if len(found.answers) > 1 else ""
        return (
            f"{either}{form} explains a part of the error{share}{alike}. Something else is missing as "
            "well."
        )
    if found.verdict is Verdict.AMBIGUOUS:
        others = "; or ".join(_names(answer) for answer in found.answers[1:])
        return f"{names}; or {others}: these recordings do not distinguish them."
    return f"The {_subject(found)} lacks {names}."


def _nothing_missing(found: Diagnosis) -> str:
    """The sentence if nothing, or nothing relevant, is missing."""
    if tolerated(found.settings.limits, found.after):
        left = millimetres(found.after.beyond_noise)
        return (
            f"The {_subject(found)} has an error of {left} beyond noise, which is within the "
            "tolerance."
        )
    if found.as_built:
        return (
            "No effect is missing: numbers of the MJCF that are all slightly off explain "
            "these recordings."
        )
    if found.first_lengths:
        return f"Nothing beyond noise is left, but {_only_if(found)}."
    return f"The {_subject(found)} explains these recordings: nothing beyond noise is left."


def first_lengths(found: Diagnosis) -> str:
    """Winches whose first lengths would have to differ; "" for none, or if the verdict says so."""
    if not found.first_lengths or sentence(found).endswith(f"{_only_if(found)}."):
        return ""
    said = _only_if(found)
    return f"{said[0].upper()}{said[1:]}."


def _only_if(found: Diagnosis) -> str:
    """Required first lengths of winches, in words."""
    by_cables: dict[tuple[str, ...], list[FirstLength]] = {}
    for each in found.first_lengths:
        by_cables.setdefault(each.cables, []).append(each)
    recordings = len(np.unique(found.evidence.recording))
    shown = [_began(lengths, recordings) for lengths in list(by_cables.values())[:SHOWN]]
    more = f"; and {rest} more so" if (rest := len(by_cables) - SHOWN) > 0 else ""
    return f"explained only if {'; and if '.join(shown)}{more}"


def _began(lengths: Sequence[FirstLength], recordings: int) -> str:
    """Where a winch would have to have begun, in some recordings."""
    first = max(lengths, key=lambda each: abs(each.longer))
    names = ", ".join(first.cables)
    way = "longer" if first.longer > 0 else "shorter"
    begins = "begins elsewhere"
    like = "a log that begins elsewhere"
    if all(each.slack for each in lengths):
        begins, like = "is slack from the beginning", "a cut cable or an empty winch"
    elif first.longer < 0:
        begins, like = "is tighter from the beginning", "a cable that is caught"
    than = "as measured" if first.measured else "in the keyframe"
    numbers = ", ".join(str(each.recording) for each in lengths)
    where = f" in recording {numbers}" if len(lengths) < recordings else ""
    return (
        f"{names} {begins}{where}: its rest length would be {abs(first.longer):.2g} m {way} than {than}; "
        f"{like} looks the same"
    )


def _outside(found: Diagnosis) -> str:
    """The sentence if something outside the library is missing."""
    if found.as_built and found.location is None:
        return (
            "Something is missing: numbers of the MJCF that are all slightly off explain the "
            "fitted recordings, but not the held-out ones. Diagnose with more, or other, "
            "recordings."
        )
    if not any(found.answers):
        return "Something is missing, and it is none of the library's effects."
    names = " or ".join(_names(answer) for answer in found.answers)
    return (
        "Something is missing that is none of the library's effects; the most similar one: "
        f"{names}."
    )


def millimetres(length: float) -> str:
    """A length [m] in words."""
    return f"{1000 * length:.2g} mm"


def interrupted(found: Diagnosis) -> str:
    """The unfinished part; "" for none."""
    if not found.interrupted:
        return ""
    return (
        f"Stopped after {found.seconds:.0f} s: this is the best answer so far. More effects may be missing, "
        "and other ones may explain the recordings as well."
    )


def failures(found: Diagnosis) -> str:
    """Parts of the search that were lost to a bug; "" for none."""
    if not found.failures:
        return ""
    lost = "; ".join(f"{each.what} ({each.error}; {each.at})" for each in found.failures[:SHOWN])
    more = f"; and {rest} more" if (rest := len(found.failures) - SHOWN) > 0 else ""
    return (
        f"A bug of flywheel cost a part of this search: {lost}{more}. The answer is what the rest of it "
        "says; please report this."
    )


def scale(found: Diagnosis) -> str:
    """The error scale of scores and intervals, if it is not noise alone; "" otherwise."""
    if not found.model_discrepancy:
        return ""
    return (
        f"No model fits to the noise level of {millimetres(found.errors.noise)}. The residual of "
        f"the best one ({millimetres(found.after.beyond_noise)}) is correlated in time, and "
        f"disturbs a fit like white noise of {millimetres(found.model_discrepancy)}: scores and "
        "intervals use that scale."
    )


def gains(found: Diagnosis) -> str:
    """The gain of the first answer on windows that were not fitted; "" if not computed."""
    gain = found.gain
    if gain is None or not found.answers[0] or not np.isfinite(gain.share):
        return ""
    held_out = f" ({gain.held_out} of them of held-out recordings)" if gain.held_out else ""
    alone = [each for each in found.answers[0] if each.gain is not None]
    by_itself = ", ".join(f"{each.label} {_share(each.gain)}" for each in alone if each.gain)
    parts = f" The unique contribution of each: {by_itself}." if len(alone) > 1 else ""
    return (
        f"On {gain.windows} windows that were not fitted{held_out}, the answer removes "
        f"{_share(gain)} of the error of the {_subject(found)} beyond noise.{parts} Beyond noise, "
        f"the fitted recordings have {millimetres(found.before.beyond_noise)} without it, and "
        f"{millimetres(found.after.beyond_noise)} with it (root mean square)."
    )


def _share(gain: Gain) -> str:
    """A share with its interval, in percent."""
    return f"{gain.share:.0%} ({gain.low:.0%} to {gain.high:.0%})"


def other_form(found: Diagnosis) -> str:
    """Evidence that the answer has another form than the effects of the library; "" without any."""
    law = found.misspecification
    if not found.other_form:
        return ""
    if law.gain > found.settings.limits.equally_good:
        return (
            f"{law.instead}, which is outside the library, explains more in place of the answer "
            f"(by {law.gain:.0f}, BIC)"
        )
    both = f", {law.share:.0%} of the explanation by both" if found.answers[0] else ""
    added = " in addition to the answer" if found.answers[0] else ""
    return f"{law.name}, which is outside the library, scores {law.score:.4g}{added}{both}"


def forms(found: Diagnosis) -> str:
    """The decision between forms of the answer; "" if no other was tried, or needed."""
    first = {each.described for each in found.answers[0]}
    others = {each.described for answer in found.other_forms for each in answer} - first
    if not others:
        return ""
    return (
        f"The form is undecided: {' or '.join(sorted(others))} explains these recordings as well. "
        "The cause is the same; other motions may differ."
    )


def numbers(found: Diagnosis) -> str:
    """Note on too long time steps of the plant for these recordings; "" if they are short enough."""
    steps = found.time_steps
    if not steps.shorter:
        return ""
    return (
        f"The plant's own time steps of {1000 * steps.own:g} ms are too long for {steps.shorter} "
        f"of {len(steps.taken)} windows, which fit better in steps of down to "
        f"{1000 * min(steps.taken):g} ms. The difference is numerical, and not attributed to an "
        "effect."
    )


def held_back(found: Diagnosis) -> str:
    """Uncertain numbers of the plant that these recordings put at their limit; "" for none."""
    names = ", ".join(each.effect for each in found.calibration if each.held_back)
    if not names:
        return ""
    believed = found.settings.fitting.believed
    return (
        f"These recordings require more of {names} than is allowed ({believed:g} of the given "
        "standard deviations). Give a larger standard deviation, or look for something else that "
        "is missing."
    )


def as_built(found: Diagnosis) -> str:
    """The part of numbers of the robot as built in the answer; "" for none."""
    built = found.as_built
    if built is None:
        return ""
    first = ", ".join(each.label for each in built.farthest[:SHOWN])
    return (
        f"{built.count} numbers of the MJCF, all slightly off, explain more than any other "
        f"effect. Each deviates by {built.root_mean_square:.1f} of its usual standard deviation "
        f"(root mean square), most of all {first}. They are fitted together with the answer, and "
        "not adopted." + (f" {NEARER.format(built.share)}" if built.share < 1.0 else "")
    )


def at_bounds(found: Diagnosis) -> str:
    """Fitted values of the answers at a bound; "" for none."""
    ended = {
        f"{value.name} of {each.label} is at its bound, {value.in_plant:.4g} {value.unit.strip('-')}".strip()
        + f" (its interval reaches to {_farther(value):.4g})"
        for answer in found.answers
        for each in answer
        for value in each.at_bound
    }
    if not ended:
        return ""
    return (
        f"{'; '.join(sorted(ended))}. The true value may be beyond it; a part of the error then "
        "remains, as if something else were missing."
    )


def suspects(found: Diagnosis) -> str:
    """Number of the MJCF that may be wrong instead; "" for none."""
    if not found.suspects:
        return ""
    first, *others = found.suspects
    if first.explained is not None:
        far = (each for each in others if each.explained is not None)
        further = (
            f" {each.name} of {1.0 + each.off:.3g} times explains {each.explained:.0%}."
            for each in far
        )
        return _far_off(first) + "".join(further)
    ways = f"{abs(first.off):.1%} {'more' if first.off > 0 else 'less'} of {first.name}"
    does = "more than" if first.more else "nearly as much as"
    explains = f"{does} {first.instead}" if first.instead else "some of the residual"
    names = " or ".join(each.name for each in others)
    also = f" Another {names} would explain about as much." if others else ""
    share = max(1, round(100 * abs(first.off)))
    return (
        f"Or a number of the MJCF is wrong: {ways} would explain {explains} (score "
        f"{first.score:.0f}).{also} If you are not sure of it, repeat the diagnosis with --unsure "
        f"{first.name}={share}%."
    )


def _farther(value: Value) -> float:
    """The end of an interval that is farther from zero."""
    return max(value.low, value.high, key=abs)


def _far_off(suspect: SuspectParameter) -> str:
    """A number of the MJCF that explains more than the answer."""
    beside = (
        f", with {suspect.damping:.3g} N s/m more damping of every cable,"
        if suspect.damping
        else ""
    )
    than = f" more than {suspect.instead}" if suspect.instead else ""
    bound = (
        " That is the bound of its fit: the true one may be farther off."
        if suspect.at_bound
        else ""
    )
    return (
        f"A number of the MJCF is wrong rather: {suspect.name} of {1.0 + suspect.off:.3g} times what it says"
        f"{beside} explains {suspect.explained:.0%} of the error beyond noise,{than or ' by itself'}.{bound} "
        f"Correct the MJCF, or ask with --effects {suspect.name}, before an effect is adopted."
    )


def _subject(found: Diagnosis) -> str:
    """The subject of the test."""
    return f"model {found.model}" if found.model else "plant"


def _names(answer: Alternative) -> str:
    *others, last = [each.described for each in answer] or ["nothing"]
    return f"{', '.join(others)} and {last}" if others else last


NOTES = (
    interrupted,
    failures,
    scale,
    forms,
    gains,
    as_built,
    at_bounds,
    first_lengths,
    suspects,
    held_back,
    numbers,
)
"""Remarks on an answer, "" for none, in the order of the console."""
