"""The diagnosis inside a run: identification of missing effects from the recordings in the store."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from flywheel.diagnosis import Diagnosis, diagnose
from flywheel.dynamics.plant import Plant
from flywheel.effects import Effect
from flywheel.records import Episode, Trajectory
from flywheel.runtime.config.run_config import DiagnoseConfig
from flywheel.runtime.pool.heartbeat import Heartbeat
from flywheel.runtime.workers.episode_plan import Effects


def diagnose_plant(
    config: DiagnoseConfig,
    plant: Plant,
    effects: Effects,
    fit: Iterable[Episode],
    held_out: Iterable[Episode],
    heartbeat: Heartbeat,
    library: Mapping[str, Effect],
) -> Diagnosis:
    """Identify the effects missing from a plant, with recordings.

    Args:
      config: uncertain numbers, and amount of recordings.
      plant: with the effects adopted so far.
      effects: those effects.
      fit, held_out: recordings.
      heartbeat: receives every step of the search.
      library: candidate effects.

    Raises:
      DataError: the recordings cannot be used.
    """
    has = {effect.effect for effect in effects}
    return diagnose(
        plant,
        excerpt(fit, config.seconds, config.episode_seconds),
        excerpt(held_out, config.seconds, config.episode_seconds),
        library,
        window_seconds=config.window_seconds,
        progress=heartbeat.progress,
        unsure={name: share for name, share in config.unsure.items() if name not in has},
    )


def excerpt(
    episodes: Iterable[Episode], seconds: float, each: float | None = None
) -> list[Trajectory]:
    """The first episodes, up to `seconds` [s] in all; the last of them is cut.

    Args:
      episodes: recordings.
      seconds: largest total duration [s].
      each: longest part of each of them [s]; None for all of it.
    """
    taken, left = [], seconds
    for episode in episodes:
        trajectory = episode.trajectory
        most = left if each is None else min(left, each)
        steps = min(trajectory.steps, round(most / trajectory.dt))
        if steps < 1:
            break
        seen = trajectory.observations[: steps + 1]
        taken.append(Trajectory(seen, trajectory.controls[:steps], trajectory.dt))
        left -= steps * trajectory.dt
    return taken
