"""The diagnosis inside a run: which effects the plant lacks to explain the recordings in the store."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from flywheel.diagnosis import Diagnosis, diagnose
from flywheel.dynamics.plant import Plant
from flywheel.effects import Effect
from flywheel.records import Episode, Trajectory
from flywheel.runtime.config.run_config import DiagnoseConfig
from flywheel.runtime.pool.heartbeat import Heartbeat
from flywheel.runtime.pool.progress import notes_of
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
    """Find the effects that a plant lacks to explain recordings.

    Args:
      config: what is not known exactly, and how much of the recordings is used.
      plant: with the effects adopted so far.
      effects: those effects.
      fit, held_out: recordings.
      heartbeat: is told about every step of the search.
      library: effects that may be missing.

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
        progress=notes_of(heartbeat.progress),
        unsure={name: share for name, share in config.unsure.items() if name not in has},
    )


def excerpt(
    episodes: Iterable[Episode], seconds: float, each: float | None = None
) -> list[Trajectory]:
    """The first episodes, up to `seconds` [s] in all; the last of them is cut.

    Args:
      episodes: recordings.
      seconds: of all together [s].
      each: of each of them, at most [s]; None for as long as they are.
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
