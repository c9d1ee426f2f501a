"""Episodes as ragged arrays and back, exact to the bit.

The episodes of a segment are laid end to end. Controls have one row per step, the rest one per
observation; `lengths` tells where an episode ends.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flywheel.errors import DataError
from flywheel.records import Episode, Observation, Outcome, Provenance, State, Trajectory

SCHEMA = 1
_STATE = ("qpos", "qvel", "act")
Arrays = dict[str, NDArray[Any]]


def pack(episodes: Sequence[Episode]) -> tuple[Arrays, dict[str, Any]]:
    """Arrays and attributes of a segment.

    Raises:
      DataError: an episode holds something that must not be stored; it is named.
    """
    if not episodes:
        raise DataError("A segment needs at least one episode, got none.")
    shapes = {_shape(e) for e in episodes}
    if len(shapes) > 1:
        raise DataError(
            f"Episodes of one segment have the same points, winches and states; got {shapes}."
        )
    for episode in episodes:
        _check(episode)
    tracks = [e.trajectory for e in episodes]
    columns: dict[str, list[NDArray[Any]]] = {
        "lengths": [np.array([t.steps], np.int64) for t in tracks],
        "points": [t.observations.points for t in tracks],
        "winch": [t.observations.winch for t in tracks],
        "controls": [t.controls for t in tracks],
    }
    if tracks[0].states is not None:
        columns |= {name: [getattr(t.states, name) for t in tracks] for name in _STATE}
    arrays = {name: np.concatenate(parts) for name, parts in columns.items()}
    return arrays, {"schema": SCHEMA, "episodes": [_describe(e) for e in episodes]}


def unpack(arrays: Arrays, attributes: dict[str, Any]) -> list[Episode]:
    """The episodes that `pack` packed, without their timing."""
    if attributes.get("schema") != SCHEMA:
        raise DataError(
            f"A segment of schema {attributes.get('schema')!r} cannot be read; this version reads "
            f"schema {SCHEMA}."
        )
    steps = arrays["lengths"]
    rows = np.concatenate([[0], np.cumsum(steps + 1)])
    episodes = []
    for i, about in enumerate(attributes["episodes"]):
        seen = slice(rows[i], rows[i + 1])
        between = slice(rows[i] - i, rows[i] - i + steps[i])
        states = State(*(arrays[n][seen] for n in _STATE)) if "qpos" in arrays else None
        episodes.append(
            Episode(
                id=about["id"],
                trajectory=Trajectory(
                    Observation(arrays["points"][seen], arrays["winch"][seen]),
                    arrays["controls"][between],
                    about["dt"],
                    states,
                ),
                provenance=Provenance(**about["provenance"]),
                split=about["split"],
                outcome=Outcome(**about["outcome"]) if about["outcome"] else None,
            )
        )
    return episodes


def _describe(episode: Episode) -> dict[str, Any]:
    return {
        "id": episode.id,
        "split": episode.split,
        "dt": episode.trajectory.dt,
        "provenance": dataclasses.asdict(episode.provenance),
        "outcome": dataclasses.asdict(episode.outcome) if episode.outcome else None,
    }


def _shape(episode: Episode) -> tuple[Any, ...]:
    seen, states = episode.trajectory.observations, episode.trajectory.states
    sizes = () if states is None else tuple(getattr(states, n).shape[-1] for n in _STATE)
    return (seen.points.shape[-2], seen.winch.shape[-1], sizes)


def _check(episode: Episode) -> None:
    track = episode.trajectory
    if track.controls.ndim != 2 or track.steps < 1:
        raise DataError(
            f"Episode {episode.id}: controls are (T, W) with T >= 1, got {track.controls.shape}."
        )
    if np.isinf(track.observations.points).any() or np.isinf(track.observations.winch).any():
        raise DataError(f"Episode {episode.id}: a measurement is infinite; missing ones are NaN.")
    if track.states is not None:
        for name in _STATE:
            values = getattr(track.states, name)
            if len(values) != track.steps + 1 or not np.isfinite(values).all():
                raise DataError(
                    f"Episode {episode.id}: {name} must be finite and have {track.steps + 1} rows, "
                    f"got {values.shape}, {np.count_nonzero(~np.isfinite(values))} not finite."
                )
    names = {"train", "validation", "test"}
    if episode.split not in names:
        raise DataError(f"Episode {episode.id}: split is one of {names}, got {episode.split!r}.")
