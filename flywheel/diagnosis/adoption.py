"""Add the answer of a diagnosis to the plant."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from flywheel import __version__
from flywheel.diagnosis.results.answer import Answer, FoundEffect, evidence_of
from flywheel.effects import NAMED, AdoptedPlant, Effect, Scales, Term, WrittenTerm
from flywheel.effects.adopted import next_version
from flywheel.effects.own import LawFile, LawReference, check_given, law_files
from flywheel.errors import ConfigError, DataError
from flywheel.quantities import Bounds
from flywheel.robots import Robot
from flywheel.seals import file_sha256

ROUNDING = 1e-9  # of a value that ended at a bound of its fit, relative


def adopt(
    summary: Mapping[str, Any],
    robot: Robot,
    folder: str | Path,
    answer: int | None = None,
    parent: Path | None = None,
    library: Mapping[str, Effect] = NAMED,
) -> Path:
    """Write the next version of a robot's plant, with the effects of an answer.

    An answer contains all effects of the new plant, including those of the previous version (fitted
    again): it replaces them. Uncertain numbers of the plant are adopted as fitted.

    Args:
      summary: `Diagnosis.summary()`, or the JSON of `flywheel diagnose`.
      robot: of the diagnosis.
      folder: of the versions.
      answer: number of the alternative, from 1; None for the first of a clear verdict.
      parent: file of the diagnosed adopted plant; None for the MJCF alone.
      library: of the effects' names.

    Returns:
      The new version's file.

    Raises:
      DataError: there is nothing to adopt, the answer is not clear, or held-out recordings
        contradict it, and the message says how to adopt it anyway; or no fit gives such values.
      ConfigError, UnknownNameError: impossible values of the effects, or a law file that is missing
        or differs.
    """
    said = Answer.of(summary)
    effects = adoptable(summary, answer)
    if unknown := [effect.effect for effect in effects if effect.effect not in library]:
        check_given(said.effects_from, law_files(library.values()), f"The answer, {unknown[0]},")
    terms = [effect.term(robot, library) for effect in effects]  # refuses what cannot be
    laws = law_files(term.effect for term in terms)
    _check_same(laws, said.effects_from)
    found = (*said.chosen(answer), *said.calibration)
    for each, term in zip(found, terms, strict=True):
        _check_values(each, term, Scales.of(robot))
    plant = AdoptedPlant(
        robot=robot.name,
        digest=robot.digest,
        version=next_version(folder, robot),
        parent="" if parent is None else file_sha256(parent, "adopted plant"),
        effects=effects,
        effects_from=tuple(law.reference for law in laws),
        evidence={
            **evidence_of(summary),
            "intervals": [each.intervals() for each in found],
            "code": __version__,
        },
    )
    return plant.write(folder, robot, laws)


def _check_values(found: FoundEffect, term: Term, scales: Scales) -> None:
    """Check that values are in the units and within the bounds of a fit.

    Raises:
      DataError: one is not.
    """
    for parameter, value in zip(term.effect.parameters, term.values, strict=True):
        what, usual = f"{parameter.name} of {term.effect.name}", parameter.typical(scales)
        if (unit := found.parameters[parameter.name].unit) != parameter.unit:
            raise DataError(f"{what} is in {parameter.unit!r}; the answer has it in {unit!r}.")
        bounds = Bounds(parameter.low * usual, parameter.high * usual, parameter.unit.strip("-"))
        if not parameter.low <= value / usual * (1.0 - ROUNDING) <= parameter.high:
            bounds.check(value, f"In the answer, {what}", DataError)


def _check_same(laws: Iterable[LawFile], said: Sequence[LawReference]) -> None:
    """Check that law files are those of the answer.

    Raises:
      ConfigError: one differs.
    """
    for law in laws:
        if law.reference in said:
            continue
        then = ", ".join(map(str, said)) or "none"
        raise ConfigError(
            f"{law} is not the law file of the answer ({then}): diagnose again, or give the "
            "original file."
        )


def adoptable(summary: Mapping[str, Any], answer: int | None = None) -> tuple[WrittenTerm, ...]:
    """The effects of a plant after a diagnosis.

    Args:
      summary, answer: see `adopt`.

    Raises:
      DataError: see `adopt`.
    """
    said = Answer.of(summary)
    chosen = said.chosen(answer)
    if answer is None:
        said.check_held_out()
    effects = tuple(each.written() for each in (*chosen, *said.calibration))
    labels = [effect.label for effect in effects]
    if twice := sorted({label for label in labels if labels.count(label) > 1}):
        raise DataError(f"The answer has {', '.join(twice)} twice; it would act twice as strongly.")
    return effects
