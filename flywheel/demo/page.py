"""The page of a demonstration: its story in one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from flywheel.demo.assessment import RIGHT, key_of, label_of, library_values
from flywheel.demo.demonstration import GIVEN, HELD_OUT, Demonstration, compared_words
from flywheel.diagnosis import Verdict
from flywheel.diagnosis.comparison import Comparison, Outcome
from flywheel.diagnosis.results.verdict import Value
from flywheel.outputs import write_output
from flywheel.reports import comparison_figures, diagnosis_figures, diagnosis_page
from flywheel.reports.comparison_video import SLOWER
from flywheel.reports.diagnosis_video import WorstWindow
from flywheel.reports.html import Shown, data_uri, render
from flywheel.reports.pictures import shown

BEFORE, ANSWER, AFTER = ("heat", "cables"), ("ranking", "worst"), ("lead_time",)
LIMITS = (
    "This robot is simulated, too (by independent code), and lacks one thing at a time; a real "
    "one lacks several.",
    "The hidden effect has twice its typical size. Some effects are still smaller than the noise "
    "here, and cannot be found.",
    "Predictions start from measured points, so noise in the starts is a part of every error "
    "here. The diagnosis fits the starts, and is more sensitive.",
    (
        "One story is no statistics: docs/results/diagnosis.md counts how often the diagnosis is "
        "right."
    ),
)


@dataclass(frozen=True)
class Step:
    """A line of the story.

    Attributes:
      name: of the step.
      mark: "yes", "no" or "open": its colour.
      words: outcome.
    """

    name: str
    mark: str
    words: str


@dataclass(frozen=True)
class RecordingRow:
    """A row of the table of recordings.

    Attributes:
      script: of the commands.
      seconds: duration [s].
      purpose: use of the recording.
    """

    script: str
    seconds: float
    purpose: str


@dataclass(frozen=True)
class HiddenValue:
    """A row of the table of hidden parameters.

    Attributes:
      label: of the effect.
      parameter, unit: of it.
      value: true one.
      found: in the first answer that has the effect; None if there is none.
    """

    label: str
    parameter: str
    value: float
    unit: str
    found: Value | None


def write_demo(story: Demonstration, path: str | Path, command: str, film: Path | str) -> Path:
    """Write the page.

    Args:
      story: to tell.
      path: of the HTML file.
      command: that repeats the story.
      film: mp4 of the `worst_window`, or the reason why there is none.
    """
    page = render(
        "demo",
        story=story,
        steps=steps(story),
        recordings=_recordings(story),
        fails=story.before.models[0].outcome is Outcome.MORE_THAN_NOISE,
        before=compared_words(story.before),
        answer=diagnosis_page.sentence(story.diagnosis),
        after="" if story.after is None else compared_words(story.after),
        notes=_notes(story),
        figures_before=shown(comparison_figures.PICTURES, story.before, BEFORE),
        figures_answer=shown(diagnosis_figures.PICTURES, story.diagnosis, ANSWER),
        figures_after=shown(comparison_figures.PICTURES, story.beside, AFTER),
        horizon=story.before.windows.steps * story.before.windows.dt,
        millimetres=1000.0 * story.before.windows.sigma,
        video=_video(story, film),
        filmed=_filmed(story),
        truth=truth(story),
        commands=_commands(command),
        about=_about(story),
        limits=LIMITS,
    )
    return write_output(path, page)


def worst_window(story: Demonstration) -> WorstWindow:
    """The window of the video: the diagnosed window with the largest error of the unchanged MJCF."""
    fit = [each.trajectory for each in story.recordings if each.split != HELD_OUT]
    return WorstWindow.of(story.diagnosis, story.robot, fit)


def steps(story: Demonstration) -> list[Step]:
    """The story, one line per step."""
    verdict = story.diagnosis.verdict
    clear = verdict in (Verdict.NOISE_ONLY, Verdict.EFFECT)
    answer = f"{verdict}: {diagnosis_page.sentence(story.diagnosis)}"
    found = [
        _compared_step(story.before),
        Step("answer", "yes" if clear else "open", answer),
        Step("adopted" if story.adopted else "kept", "yes" if story.adopted else "open", story.why),
    ]
    if story.after is not None:
        found.append(_compared_step(story.after))
    right = story.assessment.outcome in RIGHT
    return [*found, Step("truth", "yes" if right else "no", story.assessment.sentence)]


def truth(story: Demonstration) -> list[HiddenValue]:
    """The hidden parameters with their estimates; empty without a hidden effect."""
    hidden = story.hidden
    if hidden is None:
        return []
    mine = key_of(hidden.name, hidden.place)
    same = [
        {value.name: value for value in each.values}
        for answer in story.diagnosis.answers
        for each in answer
        if key_of(each.effect, each.location) == mine
    ]
    known: Mapping[str, Value] = same[0] if same else {}
    label = label_of(hidden.name, hidden.place)
    return [
        HiddenValue(
            label, name, value, hidden.units.get(name) or _unit(known, name), known.get(name)
        )
        for name, value in library_values(hidden).items()
    ]


def _unit(known: Mapping[str, Value], name: str) -> str:
    return known[name].unit if name in known else ""


def _compared_step(found: Comparison) -> Step:
    (model,) = found.models
    noise = model.outcome is Outcome.NOISE_ONLY
    return Step("noise" if noise else "more", "yes" if noise else "no", compared_words(found))


def _recordings(story: Demonstration) -> list[RecordingRow]:
    purposes = {HELD_OUT: "held out, for evaluation"}
    return [
        RecordingRow(
            episode.provenance.controller.partition(":")[2],
            episode.trajectory.steps * episode.trajectory.dt,
            purposes.get(episode.split, "diagnosed"),
        )
        for episode in story.recordings
    ]


def _notes(story: Demonstration) -> list[str]:
    """Further results of the diagnosis."""
    found = story.diagnosis
    form = diagnosis_page.other_form(found)
    notes = [
        f"Its form differs from the effects of the library: {form}." if form else "",
        diagnosis_page.at_bounds(found),
        diagnosis_page.suspects(found),
        diagnosis_page.numbers(found),
    ]
    if (where := found.location) is not None:
        cable = f"; most similar to an effect of the cable {where.cable}" if where.cable else ""
        notes.append(
            f"Most of what is unexplained is in recording {where.recording}, from {where.begin:.2f} to "
            f"{where.end:.2f} s, at {where.point}{cable}."
        )
    experiment = found.next_experiment
    return [*(note for note in notes if note), f"The next experiment: {experiment.aim}"]


def _video(story: Demonstration, film: Path | str) -> Shown:
    if not isinstance(film, Path):
        return Shown("video", "", film, "")
    shown = worst_window(story)
    larger = f" Deviations are drawn {shown.times} times their size." if shown.times > 1 else ""
    words = (
        f"Recording {shown.recording}, {shown.begin:.2f} to {shown.end:.2f} s: the window with "
        f"the largest error of {GIVEN} with a fitted start. The robot is drawn as predicted; the "
        f"orange ghosts are the measured points, smoothed.{larger} {SLOWER} times slower than "
        "real time."
    )
    return Shown("video", "", words, data_uri(film.read_bytes(), "video/mp4"))


def _filmed(story: Demonstration) -> list[str]:
    """Models of the left and the right prediction."""
    answers = [answer for answer in story.diagnosis.answers if answer]
    names = [" with ".join(each.label for each in answer) for answer in answers[:1]]
    return [GIVEN, *(f"with {name}" for name in names)]


def _commands(command: str) -> dict[str, str]:
    """Command -> its purpose."""
    return {
        command: "this story again",
        "flywheel demo --effect none": "nothing is hidden: is anything named?",
        "flywheel list effects": "what can be named",
        "flywheel compare log.csv --robot my_robot.xml": (
            "a log of your robot compared with its MJCF"
        ),
        "flywheel diagnose log.csv --robot my_robot.xml": (
            "effects of your robot that its MJCF lacks"
        ),
    }


def _about(story: Demonstration) -> dict[str, str]:
    config, robot, windows = story.config, story.robot, story.before.windows
    return {
        "robot": f"{robot.name} ({robot.digest[:12]})",
        "seed": str(story.seed),
        "noise": f"{1000 * windows.sigma:.2f} mm, from fourth differences of the measurements",
        "predictions": f"{len(windows)} of {windows.steps * windows.dt:g} s, after a past of "
        f"{windows.lead * windows.dt:.2f} s",
        "control step": f"{config.dt:g} s, MuJoCo steps of {robot.timestep:g} s",
        "computing time": f"{story.seconds:.0f} s, of which the diagnosis took "
        f"{story.diagnosis.seconds:.0f} s",
    }
