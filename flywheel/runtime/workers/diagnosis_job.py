"""A diagnosis inside a run: of the plant that data are simulated on, by the recordings in the store."""

from __future__ import annotations

from collections.abc import Iterable

from flywheel.diagnosis import Diagnosis, diagnose
from flywheel.diagnosis.adoption import adoptable
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS, NAMED, WrittenTerm
from flywheel.errors import DataError
from flywheel.records import Episode, Trajectory
from flywheel.runtime.config.run_config import DiagnoseConfig
from flywheel.runtime.pool.heartbeat import Watch
from flywheel.runtime.results import DiagnosisNote
from flywheel.runtime.workers.episode_plan import Effects

ROUNDS = 20  # roughly how often a diagnosis tells that it is alive


def missing(
    config: DiagnoseConfig,
    plant: Plant,
    effects: Effects,
    fit: Iterable[Episode],
    held_out: Iterable[Episode],
    watch: Watch,
) -> tuple[DiagnosisNote, Diagnosis]:
    """What a plant lacks, and which effects the next one should have.

    Args:
      config: how to ask.
      plant: with these effects.
      effects: that it has.
      fit, held_out: recordings.
      watch: told that it goes on.

    Raises:
      DataError: recordings that cannot be used.
    """
    told = 0
    has = {effect.effect for effect in effects}

    def progress(note: str) -> None:
        nonlocal told
        told += 1
        watch.progress(told / (told + ROUNDS), note)

    found = diagnose(
        plant,
        excerpt(fit, config.seconds),
        excerpt(held_out, config.seconds),
        {name: NAMED[name] for name in config.effects or EFFECTS},
        window_seconds=config.window_seconds,
        progress=progress,
        unsure={name: share for name, share in config.unsure.items() if name not in has},
    )
    after, reason = _next(found, effects)
    held = found.held_out
    note = DiagnosisNote(
        verdict=found.verdict,
        effects=after,
        adopted=after != effects,
        reason=reason,
        noise=found.errors.noise,
        baseline=found.errors.baseline,
        augmented=found.errors.augmented,
        held_out_baseline=None if held is None else held.baseline,
        held_out_augmented=None if held is None else held.augmented,
        answer=found.summary(),
    )
    return note, found


def excerpt(episodes: Iterable[Episode], seconds: float) -> list[Trajectory]:
    """The first recordings, up to so many seconds in all; the last of them is cut."""
    taken, left = [], seconds
    for episode in episodes:
        trajectory = episode.trajectory
        steps = min(trajectory.steps, round(left / trajectory.dt))
        if steps < 1:
            break
        seen = trajectory.observations[: steps + 1]
        taken.append(Trajectory(seen, trajectory.controls[:steps], trajectory.dt))
        left -= steps * trajectory.dt
    return taken


def _next(found: Diagnosis, effects: Effects) -> tuple[Effects, str]:
    """Effects of the plant from here on, and why."""
    try:
        after = adoptable(found.summary())
    except DataError as error:
        return effects, str(error)
    return after, f"{found.verdict}: the plant now has {_labels(after)}."


def _labels(effects: Iterable[WrittenTerm]) -> str:
    return ", ".join(effect.label for effect in effects)
