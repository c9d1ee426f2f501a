"""Episodes as ragged arrays and back, exact bit by bit.

The episodes of a segment are concatenated. Controls have one row per step, the rest one per
observation; `lengths` gives the ends of episodes. Numbers are float64, missing ones one and the
same NaN, so that equal episodes give equal bytes.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from flywheel.errors import DataError
from flywheel.records import (
    Episode,
    MeasuredChannel,
    Observation,
    Outcome,
    Provenance,
    Split,
    State,
    Trajectory,
)
from flywheel.terrain import NUMBERS, Box, Terrain, box_numbers, box_of

SCHEMA = 1
CHANNELS = "channels"  # array and attribute, where there are any
_STATE = ("qpos", "qvel", "act")
TERRAINS = ("terrain", "terrain_grid", "terrain_heights", "terrain_boxes")  # arrays
Arrays = dict[str, NDArray[Any]]


def pack(episodes: Sequence[Episode]) -> tuple[Arrays, dict[str, Any]]:
    """Arrays and attributes of a segment.

    Raises:
      DataError: an episode cannot be stored; the message names it.
    """
    if not episodes:
        raise DataError("A segment needs at least one episode, got none.")
    for episode in episodes:
        _check(episode)
    shapes = {_shape(e) for e in episodes}
    if len(shapes) > 1:
        raise DataError(
            "Episodes of one segment have the same points, winches and states; got "
            + ", ".join(map(str, sorted(shapes, key=str)))
        )
    tracks = [e.trajectory for e in episodes]
    columns = {
        "points": [t.observations.points for t in tracks],
        "winch": [t.observations.winch for t in tracks],
        "controls": [t.controls for t in tracks],
    }
    if tracks[0].states is not None:
        columns |= {name: [getattr(t.states, name) for t in tracks] for name in _STATE}
    arrays: Arrays = {"lengths": np.array([t.steps for t in tracks], "<i8")}
    for name, parts in columns.items():
        arrays[name] = _end_to_end(parts)
    if any(e.terrain is not None for e in episodes):
        around = packed_terrains([e.terrain for e in episodes])
        arrays |= {name: array for name, array in around.items() if array.size}
    about: dict[str, Any] = {"schema": SCHEMA, "episodes": [_describe(e) for e in episodes]}
    if channels := tracks[0].channels:
        each = [np.stack([c.values for c in t.channels], axis=1) for t in tracks]
        arrays[CHANNELS] = _end_to_end(each)
        about[CHANNELS] = [[c.kind, c.name, c.noise] for c in channels]
    return arrays, about


def unpack(arrays: Arrays, attributes: dict[str, Any]) -> list[Episode]:
    """The episodes of `pack`, without their telemetry."""
    if attributes.get("schema") != SCHEMA:
        raise DataError(
            f"A segment of schema {attributes.get('schema')!r} cannot be read; this version reads "
            f"schema {SCHEMA}."
        )
    steps = arrays["lengths"]
    terrains = unpacked_terrains(arrays) if "terrain" in arrays else [None] * len(steps)
    rows = np.concatenate([[0], np.cumsum(steps + 1)])
    channels = attributes.get(CHANNELS, [])
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
                    tuple(
                        MeasuredChannel(kind, name, arrays[CHANNELS][seen, column], noise)
                        for column, (kind, name, noise) in enumerate(channels)
                    ),
                ),
                provenance=Provenance(**about["provenance"]),
                split=about["split"],
                outcome=Outcome(**about["outcome"]) if about["outcome"] else None,
                terrain=terrains[i],
            )
        )
    return episodes


def packed_terrains(terrains: Sequence[Terrain | None]) -> Arrays:
    """Terrains of E episodes as arrays: an index for each episode, and each distinct terrain once.

    Returns:
      "terrain" (E,) their number, -1 for the plane; "terrain_grid" (G, 5) cells' corners along x and y, the
      side of a cell, and x and y of the first corner [m]; "terrain_heights" of all of them, end to end [m];
      "terrain_boxes" (B, 11) their boxes, after the number of the terrain. Empty ones are not stored.
    """
    distinct = [terrain for terrain in dict.fromkeys(terrains) if terrain is not None]
    number = {terrain: index for index, terrain in enumerate(distinct)}
    grids = [[*t.heights.shape, t.cell, *t.origin] for t in distinct]
    boxes = [np.insert(box_numbers(t.boxes), 0, number[t], axis=1) for t in distinct]
    return {
        "terrain": np.array([-1 if t is None else number[t] for t in terrains], "<i8"),
        "terrain_grid": np.array(grids, "<f8").reshape(-1, 5),
        "terrain_heights": np.concatenate([np.zeros(0), *(t.heights.ravel() for t in distinct)]),
        "terrain_boxes": np.concatenate([np.zeros((0, 1 + NUMBERS)), *boxes]),
    }


def unpacked_terrains(arrays: Arrays) -> list[Terrain | None]:
    """The terrains of `packed_terrains`."""
    grids, heights = arrays["terrain_grid"], arrays.get("terrain_heights", np.zeros(0))
    shapes = grids[:, :2].astype(int)
    ends = np.cumsum(shapes.prod(axis=1))
    around: list[list[Box]] = [[] for _ in grids]
    for number, *box in arrays.get("terrain_boxes", ()):  # segments of before have none
        around[int(number)].append(box_of(np.array(box)))
    distinct = [
        Terrain(
            heights[end - shape.prod() : end].reshape(shape),
            float(cell),
            (float(x), float(y)),
            tuple(boxes),
        )
        for shape, end, (cell, x, y), boxes in zip(shapes, ends, grids[:, 2:], around, strict=True)
    ]
    return [None if i < 0 else distinct[i] for i in arrays["terrain"].tolist()]


def _end_to_end(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Concatenate arrays, with one bit pattern for all NaNs; a single sound array is not copied."""
    long = np.concatenate(parts, dtype="<f8") if len(parts) > 1 else np.asarray(parts[0], "<f8")
    missing = np.isnan(long)
    if (long[missing].view("u8") != np.array(np.nan).view("u8")).any():
        long = np.where(missing, np.nan, long)
    return np.ascontiguousarray(long)


def _describe(episode: Episode) -> dict[str, Any]:
    about = {
        "id": episode.id,
        "split": episode.split,
        "dt": episode.trajectory.dt,
        "provenance": dataclasses.asdict(episode.provenance),
        "outcome": dataclasses.asdict(episode.outcome) if episode.outcome else None,
    }
    try:
        back = json.loads(json.dumps(about, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise DataError(
            f"Episode {episode.id}: provenance and outcome are text, finite numbers and yes or no: "
            f"{error}."
        ) from error
    if back != about:
        raise DataError(
            f"Episode {episode.id}: provenance and outcome must survive JSON unchanged; sent "
            f"{about}, got {back}."
        )
    return about


def _shape(episode: Episode) -> tuple[Any, ...]:
    """Points, winches, sizes of the state, and channels with their noise."""
    seen, states = episode.trajectory.observations, episode.trajectory.states
    sizes = () if states is None else tuple(getattr(states, n).shape[-1] for n in _STATE)
    channels = tuple((*c.key, c.noise) for c in episode.trajectory.channels)
    return (seen.points.shape[-2], seen.winch.shape[-1], sizes, channels)


def _check(episode: Episode) -> None:
    track, name = episode.trajectory, episode.id
    if track.controls.ndim != 2 or track.steps < 1:
        raise DataError(
            f"Episode {name}: controls are (T, W) with T >= 1, got {track.controls.shape}."
        )
    seen, (steps, winches) = track.observations, track.controls.shape
    if seen.points.shape[-1:] != (3,) or seen.points.ndim != 3:
        raise DataError(f"Episode {name}: points are (T + 1, P, 3), got {seen.points.shape}.")
    if seen.winch.shape != (steps + 1, winches):
        raise DataError(
            f"Episode {name}: winch positions are ({steps + 1}, {winches}), all NaN without such "
            f"a channel; got {seen.winch.shape}."
        )
    if not np.isfinite(track.controls).all():
        raise DataError(f"Episode {name}: controls must be finite, got NaN or infinity.")
    measured = (seen.points, seen.winch, *(channel.values for channel in track.channels))
    if any(np.isinf(values).any() for values in measured):
        raise DataError(f"Episode {name}: a measurement is infinite; missing ones are NaN.")
    for field in _STATE if track.states is not None else ():
        values = getattr(track.states, field)
        if values.ndim != 2 or len(values) != steps + 1 or not np.isfinite(values).all():
            raise DataError(
                f"Episode {name}: {field} must be finite and have {steps + 1} rows, got "
                f"{values.shape}, {np.count_nonzero(~np.isfinite(values))} not finite."
            )
    if episode.split not in get_args(Split):
        allowed = ", ".join(get_args(Split))
        raise DataError(f"Episode {name}: split is one of {allowed}; got {episode.split!r}.")
