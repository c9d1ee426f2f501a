"""Make what a diagnosis found part of the plant."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from flywheel import __version__
from flywheel.diagnosis.results.answer import Answer, evidence_of
from flywheel.effects import NAMED, AdoptedPlant, Effect, WrittenTerm
from flywheel.effects.adopted import next_version
from flywheel.effects.own import LawFile, LawReference, check_given, law_files
from flywheel.errors import ConfigError
from flywheel.robots import Robot
from flywheel.seals import file_sha256


def adopt(
    summary: Mapping[str, Any],
    robot: Robot,
    folder: str | Path,
    answer: int | None = None,
    parent: Path | None = None,
    library: Mapping[str, Effect] = NAMED,
) -> Path:
    """Write the next version of a robot's plant, with the effects of an answer.

    An answer holds all effects that the plant is to have, those of the version before (fitted anew)
    included: it replaces them. What the plant was not sure of is adopted as it was fitted.

    Args:
      summary: `Diagnosis.summary()`, or the JSON of `flywheel diagnose`.
      robot: that was diagnosed.
      folder: of the versions.
      answer: which alternative, from 1; None for the first of a clear verdict.
      parent: file of the adopted plant that was diagnosed; None for the MJCF alone.
      library: that the effects' names are from.

    Returns:
      The new version's file.

    Raises:
      DataError: there is nothing to adopt, the answer is not clear, or held-out recordings speak
        against it; the message says what to give to adopt it none the less.
      ConfigError, UnknownNameError: values that the effects cannot have, or a law file that is absent or
        another one.
    """
    said = Answer.of(summary)
    effects = adoptable(summary, answer)
    if unknown := [effect.effect for effect in effects if effect.effect not in library]:
        check_given(said.effects_from, law_files(library.values()), f"The answer, {unknown[0]},")
    terms = [effect.term(robot, library) for effect in effects]  # refuses what cannot be
    laws = law_files(term.effect for term in terms)
    _check_same(laws, said.effects_from)
    found = (*said.chosen(answer), *said.calibration)
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


def _check_same(laws: Iterable[LawFile], said: Sequence[LawReference]) -> None:
    """Refuse law files that are not those by which an answer was found.

    Raises:
      ConfigError: one is another.
    """
    for law in laws:
        if law.reference in said:
            continue
        then = ", ".join(map(str, said)) or "none"
        raise ConfigError(
            f"{law} is not the law file that the answer was found with ({then}): diagnose again, or give the "
            "file as it was."
        )


def adoptable(summary: Mapping[str, Any], answer: int | None = None) -> tuple[WrittenTerm, ...]:
    """The effects that a plant should have after a diagnosis.

    Args:
      summary, answer: see `adopt`.

    Raises:
      DataError: see `adopt`.
    """
    said = Answer.of(summary)
    chosen = said.chosen(answer)
    if answer is None:
        said.check_held_out()
    return tuple(each.written() for each in (*chosen, *said.calibration))
