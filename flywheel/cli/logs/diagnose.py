"""`flywheel diagnose`: identify the physical effect missing from the model of a robot."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flywheel.cli.console import Out, console, table
from flywheel.cli.options import PlantOptions, SettingStatements, length_of, number
from flywheel.options import DiagnosisOptions
from flywheel.outputs import check_outputs
from flywheel.quantities import FACTOR

if TYPE_CHECKING:
    from rich.table import Table

    from flywheel.diagnosis import Diagnosis, Settings
    from flywheel.diagnosis.checks.localisation import Location
    from flywheel.dynamics.plant import Plant
    from flywheel.records import Trajectory

SHOWN = 10  # candidates in the table
SETTINGS = "--set takes SETTING=NUMBER;"


def diagnose(
    recordings: Annotated[list[Path], "CSV..."],
    *,
    chosen: PlantOptions,
    held_out: tuple[Path, ...] = (),
    effects: str = "",
    unsure: Annotated[tuple[str, ...], "EFFECT=5%"] = (),
    options: DiagnosisOptions = DiagnosisOptions(),
    model: Annotated[str | None, "[LABEL=]SPEC"] = None,
    noise: Annotated[str | None, "LENGTH"] = None,
    tolerance: Annotated[str | None, "LENGTH"] = None,
    settings: SettingStatements = (),
    page: Path = Path("diagnosis.html"),
    json: Path | None = None,
) -> None:
    """Identify the physical effect of a robot that its MJCF, or a trained model, lacks.

    The exit code is the verdict: 0 NOISE_ONLY, 10 EFFECT, 11 AMBIGUOUS, 12 PARTIAL, 13 OUTSIDE_LIBRARY,
    20 DATA_INSUFFICIENT, 21 NOT_CONVERGED. Ctrl-C gives the best answer so far (130), a second one none.

    [bold]Example[/bold]

    flywheel diagnose monday.csv tuesday.csv --held-out friday.csv --robot my_robot.xml

    Args:
      recordings: Logs to explain.
      held_out: A further log, used only for the evaluation of the answer. Repeatable.
      effects: Effects to consider, by name; all of the library by default.
      unsure: An uncertain number of the MJCF (with its standard deviation; up to three of these are
        allowed), such as cable_stiffness or body_mass: fitted together with everything else. Repeatable.
      model: A trained model to test instead of the plant: a run's folder (its champion), RUN:NAME, or a
        file of weights.
      noise: Noise of each coordinate, such as 0.1mm, of logs that were filtered; by default it is estimated.
        A number without a unit is a fraction of the robot's length.
      tolerance: RMS model error that you accept, such as 2mm (beyond noise); the search stops below it.
      page: Output file of the page.
      json: Output file of the answer as JSON.
    """
    from flywheel import diagnosis
    from flywheel.cli.models import open_trained, opened
    from flywheel.reports.diagnosis_page import write_diagnosis
    from flywheel.runtime.pool.interrupts import StopRequest
    from flywheel.runtime.pool.progress import console_progress

    check_outputs({"page": page, "JSON": json}, inputs=[*recordings, *held_out, *chosen.files])
    (plant, library), out = opened(chosen), console()
    robot, known = plant.robot, unsure_of(unsure)
    asked, tuned = library.asked(effects, robot), _settings(settings, noise, tolerance, plant)
    tested = None if model is None else open_trained(model, robot).subject(robot, plant.threads)
    logs, kept_aside = _read(recordings, held_out, plant, tuned, out)
    with StopRequest() as stop:  # until the answer is written
        with console_progress().stage("diagnose", 1.0) as stage:
            told = options, stage.update, tested, known, stop
            found = diagnosis.diagnose(plant, logs, kept_aside, asked, tuned, *told)
        _show(out, found, _again(chosen))
        about = _about(plant, found, recordings, held_out) | library.about
        out.say(f"Page: {write_diagnosis(found, page, about)}")
        summary = _summary(plant, found, recordings, held_out) | library.provenance
        out.keep_json(json, summary, allow_nan=False)
    raise typer.Exit(found.exit_code)


def _summary(
    plant: Plant, found: Diagnosis, recordings: Sequence[Path], others: Sequence[Path]
) -> dict[str, Any]:
    """A diagnosis in the form of JSON, with its provenance."""
    robot = plant.robot
    effects = [term.label(robot) for term in plant.terms]
    return {
        **found.summary(),
        "robot": {"name": robot.name, "digest": robot.digest, "effects": effects},
        "recordings": [path.name for path in recordings],
        "held_out_recordings": [path.name for path in others],
    }


def _settings(
    statements: Sequence[str], noise: str | None, tolerance: str | None, plant: Plant
) -> Settings:
    """Settings with the user's values."""
    from flywheel.diagnosis.settings import Settings, changed

    lengths = {"windows.noise": noise, "limits.tolerance": tolerance}
    given = {
        path: length_of(text, plant.robot) for path, text in lengths.items() if text is not None
    }
    return changed(Settings(), changes_of(statements) | given)


def _read(
    recordings: Sequence[Path], held_out: Sequence[Path], plant: Plant, settings: Settings, out: Out
) -> list[list[Trajectory]]:
    """The logs to explain, and those held out; says a given noise in mm, or that they seem to be filtered."""
    from flywheel.cli.logs.reading import read_groups
    from flywheel.noise import noise_floor

    groups = read_groups((recordings, held_out), plant.robot, plant.dt, out)
    read = [[log.trajectory for log in logs] for logs in groups]
    given, least = settings.windows.noise, settings.windows.least_noise * plant.robot.length
    if given:
        out.say(
            f"Noise as given: {1000 * given:.3g} mm, {given / plant.robot.length:.1%} of the robot's length."
        )
    elif (noise := noise_floor([log.observations.points for log in read[0]])) < least:
        out.say(
            f"The estimated noise is {1000 * noise:.1g} mm: these logs seem to be filtered. Time steps and "
            "fits will follow digits that no sensor measured, which takes long, and rarely ends at an "
            "effect. Give the sensor's noise, such as --noise 0.1mm."
        )
    return read


def _about(
    plant: Plant, found: Diagnosis, recordings: Sequence[Path], others: Sequence[Path]
) -> dict[str, str]:
    """Lines about a diagnosis, for the head of its page."""
    from flywheel.cli.models import about_plant

    return {
        "model under test": found.model or "the plant",
        "recordings": ", ".join(path.name for path in recordings),
        "held out": ", ".join(path.name for path in others) or "none",
        **about_plant(plant),
        **about_settings(found.settings),
    }


def about_settings(settings: Settings) -> dict[str, str]:
    """A line about changed settings, for the head of a page; none if all are defaults."""
    from flywheel.diagnosis.settings import unusual

    changes = ", ".join(f"{path} {value:g}" for path, value in unusual(settings).items())
    return {"settings": changes} if changes else {}


def changes_of(statements: Sequence[str]) -> dict[str, float]:
    """Parse values of settings: "limits.threshold=36".

    Raises:
      ConfigError: not of this form.
    """
    from flywheel.diagnosis.settings import NUMBER

    return {path: number(text, path, NUMBER) for path, text in pairs_of(statements, SETTINGS)}


def unsure_of(statements: Sequence[str]) -> dict[str, float]:
    """Parse uncertainties: "effect=number" or "effect=5%".

    Returns:
      Effect -> standard deviation of its number.

    Raises:
      ConfigError: not of that form.
    """
    from flywheel.files import shown

    known = {}
    for name, text in pairs_of(statements, "Give an uncertainty as effect=number or effect=5%,"):
        what = f"The uncertainty of {shown(name)}, as a number or 5%,"
        value = number(text.removesuffix("%"), what, FACTOR)
        known[name] = value / (100.0 if text.endswith("%") else 1.0)
    return known


def pairs_of(statements: Sequence[str], form: str) -> Iterator[tuple[str, str]]:
    """Split "name=text".

    Raises:
      ConfigError: a statement is not of that form, or is about the same name as another one; the message
        begins with the text given for it.
    """
    from flywheel.errors import ConfigError
    from flywheel.files import shown

    seen = set[str]()
    for statement in statements:
        name, equals, text = statement.partition("=")
        name = name.strip()
        if not equals or name in seen:
            again = f" after another value of {shown(name)}" if equals else ""
            raise ConfigError(f"{form} got {shown(statement)}{again}.")
        seen.add(name)
        yield name, text


def _again(chosen: PlantOptions) -> str:
    """The options of another command about the same plant."""
    own = [word for path in chosen.effects_from for word in ("--effects-from", str(path))]
    return shlex.join(["--robot", chosen.robot, *own])


def _show(out: Out, found: Diagnosis, options: str) -> None:
    from flywheel.diagnosis import Verdict
    from flywheel.reports import diagnosis_page as words

    out.say(f"{found.verdict}: {words.sentence(found)}", style="bold")
    if any(found.answers) or found.calibration:
        out.print(effects_table(found))
    if form := words.other_form(found):
        out.say(f"its form differs from the effects of the library: {form}")
    for note in words.NOTES:
        if said := note(found):
            out.say(said)
    scores = [
        (s.candidate.effect.name, s.candidate.location, s.score, s.sizes[0], s.smallest)
        for s in found.ranking[:SHOWN]
    ]
    heads = ("effect", "at", "#score", "#size / typical", "#smallest visible / typical")
    out.print(table(f"candidates ({found.threshold:g} counts as visible)", heads, scores))
    out.say(f"next: {found.next_experiment.aim}")
    if found.next_experiment.command:
        out.say(f"      {found.next_experiment.command} {options}")
    if found.verdict is Verdict.OUTSIDE_LIBRARY:
        out.say("Test a law of your own with --effects-from (docs/own_effect.md).")
    if found.location is not None:
        out.say(_unexplained(found.location))
    for name, errors in (("recordings", found.errors), ("held out", found.held_out)):
        if errors is not None:
            out.say(
                f"{name}: noise {1000 * errors.noise:.2f} mm, before {1000 * errors.baseline:.2f} "
                f"mm, with the answer {1000 * errors.augmented:.2f} mm"
            )


def effects_table(found: Diagnosis) -> Table:
    """The effects of all answers, with their values and intervals."""
    named = [(str(number), answer) for number, answer in enumerate(found.answers, 1)]
    rows = [
        (label if not k else "", f.effect, f.location, v.name, v.value, v.low, v.high, v.unit)
        for label, alternative in [*named, ("calibration", found.calibration)]
        for f in alternative
        for k, v in enumerate(f.readable)
    ]
    columns = ("answer", "effect", "at", "parameter", "#value", "#low", "#high", "unit")
    return table("effects", columns, rows)


def _unexplained(location: Location) -> str:
    """Print where the unexplained error acts."""
    cable = f"; most similar to an effect of the cable {location.cable}" if location.cable else ""
    return (
        f"unexplained: most of it in recording {location.recording}, "
        f"from {location.begin:.2f} to {location.end:.2f} s, at {location.point}{cable}"
    )
