"""`flywheel diagnose`: which physical effect is missing."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

from flywheel.cli.logs import read_logs
from flywheel.cli.models import open_trained
from flywheel.cli.options import number
from flywheel.cli.plants import open_plant
from flywheel.cli.show import Out, console, table
from flywheel.diagnosis import Diagnosis, diagnose
from flywheel.diagnosis.checks.localisation import Location
from flywheel.effects import EFFECTS, NAMED, Effect
from flywheel.errors import ConfigError
from flywheel.files import shown
from flywheel.outputs import check_outputs, write_output
from flywheel.quantities import FACTOR
from flywheel.registry import lookup
from flywheel.reports.diagnosis_page import (
    held_back,
    numbers,
    other_form,
    sentence,
    suspects,
    write_diagnosis,
)

SHOWN = 10  # candidates in the table


def explain(
    logs: Sequence[Path],
    held_out: Sequence[Path],
    robot_name: str,
    model: str | None,
    effects: str,
    unsure: Sequence[str],
    window: float | None,
    dt: float,
    threads: int,
    page: Path,
    answer: Path | None,
) -> int:
    """Diagnose logs, print the answer, write the page, and return the verdict's exit code."""
    check_outputs({"page": page, "JSON": answer}, inputs=[*logs, *held_out, robot_name])
    plant = open_plant(robot_name, dt, threads)
    robot, out = plant.robot, console()
    found = diagnose(
        plant,
        [each.trajectory for each in read_logs(logs, robot, dt, out)],
        [each.trajectory for each in read_logs(held_out, robot, dt, out)],
        library_of(effects),
        window_seconds=window,
        model=None if model is None else open_trained(model, robot).subject(robot, threads),
        unsure=unsure_of(unsure),
    )
    _show(out, found, robot_name)
    about = {
        "robot": f"{robot.name} ({robot.digest[:12]})",
        "model under test": found.model or "the plant",
        "recordings": ", ".join(path.name for path in logs),
        "held out": ", ".join(path.name for path in held_out) or "none",
        "effects it had": ", ".join(t.label(robot) for t in plant.terms) or "none",
        "control step": f"{dt:g} s, MuJoCo steps of {robot.timestep:g} s",
    }
    out.say(f"Page: {write_diagnosis(found, page, about)}")
    if answer is not None:
        summary = {
            **found.summary(),
            "robot": {"name": robot.name, "digest": robot.digest},
            "recordings": [path.name for path in logs],
            "held_out_recordings": [path.name for path in held_out],
        }
        write_output(answer, json.dumps(summary, indent=1, allow_nan=False) + "\n")
        out.say(f"JSON: {answer}")
    return found.exit_code


def _unexplained(location: Location) -> str:
    """Where something acts that no effect explains."""
    cable = f"; of all cables most like {location.cable}" if location.cable else ""
    return (
        f"unexplained: most of it in recording {location.recording}, "
        f"from {location.begin:.2f} to {location.end:.2f} s, at {location.point}{cable}"
    )


def library_of(effects: str) -> Mapping[str, Effect]:
    """The effects named, with commas between; all of the library for none."""
    names = [name.strip() for name in effects.split(",") if name.strip()]
    return {name: lookup(NAMED, name, "effect") for name in names} or EFFECTS


def unsure_of(statements: Sequence[str]) -> dict[str, float]:
    """Effect -> standard deviation of what is known of its number, of "effect=number" or "effect=5%".

    Raises:
      ConfigError: not of that form.
    """
    known = {}
    for statement in statements:
        name, given, text = statement.partition("=")
        if not given:
            raise ConfigError(
                f"Say how unsure as effect=number or effect=5%, got {shown(statement)}."
            )
        what = f"How unsure one is of {shown(name)}, as a number or 5%,"
        value = number(text.removesuffix("%"), what, FACTOR)
        known[name.strip()] = value / (100.0 if text.endswith("%") else 1.0)
    return known


def _show(out: Out, found: Diagnosis, robot: str) -> None:
    out.say(f"{found.verdict}: {sentence(found)}", style="bold")
    named = [(str(number), answer) for number, answer in enumerate(found.answers, 1)]
    rows = [
        (label if not k else "", f.effect, f.location, v.name, v.value, v.low, v.high, v.unit)
        for label, alternative in [*named, ("calibration", found.calibration)]
        for f in alternative
        for k, v in enumerate(f.values)
    ]
    if rows:
        columns = ("answer", "effect", "at", "parameter", "#value", "#low", "#high", "unit")
        out.print(table("effects", columns, rows))
    if form := other_form(found):
        out.say(f"another form than the effects of the library: {form}")
    for note in (suspects(found), held_back(found), numbers(found)):
        if note:
            out.say(note)
    scores = [
        (s.candidate.effect.name, s.candidate.location, s.score, s.sizes[0], s.smallest)
        for s in found.ranking[:SHOWN]
    ]
    heads = ("effect", "at", "#score", "#size / typical", "#smallest to be seen / typical")
    out.print(table(f"candidates ({found.threshold:g} counts as seen)", heads, scores))
    out.say(f"next: {found.next_experiment.aim}")
    if found.next_experiment.command:
        out.say(f"      {found.next_experiment.command} --robot {shlex.quote(robot)}")
    if found.location is not None:
        out.say(_unexplained(found.location))
    for name, errors in (("recordings", found.errors), ("held out", found.held_out)):
        if errors is not None:
            out.say(
                f"{name}: noise {1000 * errors.noise:.2f} mm, as it was {1000 * errors.baseline:.2f} mm, "
                f"with the answer {1000 * errors.augmented:.2f} mm"
            )
