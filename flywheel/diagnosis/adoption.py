"""Make what a diagnosis found part of the plant."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from flywheel import __version__
from flywheel.diagnosis.verdict import Verdict
from flywheel.effects import NAMED, AdoptedPlant, Effect, WrittenTerm
from flywheel.effects.adopted import file_digest, next_version
from flywheel.errors import DataError
from flywheel.robots import Robot

CLEAR = (Verdict.EFFECT, Verdict.PARTIAL)
KEPT = ("verdict", "error", "held_out", "residual", "recordings", "held_out_recordings")


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
      ConfigError, UnknownNameError: values that the effects cannot have.
    """
    effects = adoptable(summary, answer)
    for effect in effects:
        effect.term(robot, library)  # refuses what cannot be
    evidence = {key: summary[key] for key in KEPT if summary.get(key) is not None}
    plant = AdoptedPlant(
        robot=robot.name,
        digest=robot.digest,
        version=next_version(folder, robot),
        parent="" if parent is None else file_digest(parent),
        effects=effects,
        evidence={
            **evidence,
            "intervals": _intervals([*_chosen(summary, answer), *_calibration(summary)]),
            "code": __version__,
        },
    )
    return plant.write(folder, robot)


def adoptable(summary: Mapping[str, Any], answer: int | None = None) -> tuple[WrittenTerm, ...]:
    """The effects that a plant should have after a diagnosis.

    Args:
      summary, answer: see `adopt`.

    Raises:
      DataError: see `adopt`.
    """
    chosen = _chosen(summary, answer)
    _check_held_out(summary, answer)
    return tuple(_written(each) for each in (*chosen, *_calibration(summary)))


def _calibration(summary: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return list(summary.get("calibration") or ())


def _chosen(summary: Mapping[str, Any], answer: int | None) -> list[Mapping[str, Any]]:
    alternatives = [each for each in summary.get("answer_set", ()) if each]
    verdict = summary.get("verdict", "(none)")
    if not alternatives and verdict == Verdict.NOISE_ONLY and _calibration(summary):
        return []
    if not alternatives:
        raise DataError(f"The verdict is {verdict}: there is no effect to adopt.")
    if answer is None and verdict not in set(CLEAR):
        named = "; ".join(
            f"{number}: {' with '.join(each['effect'] for each in alternative)}"
            for number, alternative in enumerate(alternatives, 1)
        )
        raise DataError(f"The verdict is {verdict}: say which answer to adopt. There are {named}.")
    number = 1 if answer is None else answer
    if not 1 <= number <= len(alternatives):
        raise DataError(f"There are answers 1 to {len(alternatives)}, got {number}.")
    return list(alternatives[number - 1])


def _check_held_out(summary: Mapping[str, Any], answer: int | None) -> None:
    held_out = summary.get("held_out")
    if held_out is None or answer is not None:
        return
    before, after = held_out["baseline"], held_out["augmented"]
    if not (math.isfinite(after) and after < before):
        raise DataError(
            f"On the held-out recordings the error is {1000 * after:.3g} mm with these effects and "
            f"{1000 * before:.3g} mm without: they do not carry over. Name the answer to adopt it none "
            "the less."
        )


def _written(found: Mapping[str, Any]) -> WrittenTerm:
    values = {
        name: each.get("in_plant", each["value"]) for name, each in found["parameters"].items()
    }
    return WrittenTerm(effect=found["effect"], location=found["location"], parameters=values)


def _intervals(chosen: list[Mapping[str, Any]]) -> list[dict[str, Any]]:
    return [
        {
            "effect": found["effect"],
            "location": found["location"],
            **{
                name: [float(each["low"]), float(each["high"]), each["unit"]]
                for name, each in found["parameters"].items()
            },
        }
        for found in chosen
    ]
