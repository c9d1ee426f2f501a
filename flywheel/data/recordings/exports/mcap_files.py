"""An episode as an MCAP file of JSON messages, which viewers plot."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from flywheel.data.recordings.writing import Logged, created
from flywheel.errors import ConfigError
from flywheel.records import Episode
from flywheel.robots import Robot

NUMBER = {"type": "number"}
PLACE = {"type": "object", "properties": dict.fromkeys("xyz", NUMBER)}


def write_mcap(episode: Episode, path: str | Path, robot: Robot) -> tuple[str, ...]:
    """Write an episode; its time begins at 0.

    The topics are `/points` (positions of the tracked points that were seen [m]), `/commands` (of each winch
    [m/s], or [m] for position-controlled ones), `/winches` (measured positions [m]), `/tension` [N] and
    `/length` [m] (of cables).

    Returns:
      Content that a log cannot hold, see `Logged`.

    Raises:
      ConfigError: the package mcap is not installed.
      DataError: the file exists already, or the episode is of another robot.
    """
    try:
        from mcap.writer import Writer  # an extra
    except ImportError:
        raise ConfigError("MCAP needs mcap: install flywheel[formats].") from None
    log = Logged.of(episode, robot)
    topics: dict[str, dict[str, Any]] = {
        "/points": dict.fromkeys((point.name for point in robot.points), PLACE),
        "/commands": dict.fromkeys((winch.name for winch in robot.winches), NUMBER),
        "/winches": dict.fromkeys(log.sensors, NUMBER),
    }
    for channel in log.channels:
        topics[f"/{channel.kind}"] = topics.get(f"/{channel.kind}", {}) | {channel.name: NUMBER}
    about = {"episode": episode.id, "robot": robot.name, "digest": robot.digest}
    with created(path) as place, place.open("xb") as file:
        writer = Writer(file)
        writer.start(library="flywheel")
        writer.add_metadata("flywheel", about)
        channels = {}
        for topic, properties in topics.items():
            if properties:
                schema = json.dumps({"type": "object", "properties": properties}).encode()
                number = writer.register_schema(topic.removeprefix("/"), "jsonschema", schema)
                channels[topic] = writer.register_channel(topic, "json", number)
        for topic, now, message in _messages(log, robot):
            if topic in channels:
                data, stamp = json.dumps(message).encode(), round(now * 1e9)
                writer.add_message(channels[topic], log_time=stamp, data=data, publish_time=stamp)
        writer.finish()
    return log.left


def _messages(log: Logged, robot: Robot) -> Iterator[tuple[str, float, dict[str, Any]]]:
    """Topic, time [s] and content of each message."""
    points, winches = [p.name for p in robot.points], [w.name for w in robot.winches]
    for step, now in enumerate(log.time.tolist()):
        places = zip(points, log.points[step], strict=True)
        seen = {name: place.tolist() for name, place in places if np.isfinite(place).all()}
        yield "/points", now, {n: dict(zip("xyz", place, strict=True)) for n, place in seen.items()}
        if step < len(log.controls):
            yield "/commands", now, dict(zip(winches, log.controls[step].tolist(), strict=True))
        measured = dict(zip(log.sensors, log.winch[step].tolist(), strict=True))
        yield "/winches", now, {n: value for n, value in measured.items() if np.isfinite(value)}
        for kind in dict.fromkeys(channel.kind for channel in log.channels):
            values = {c.name: float(c.values[step]) for c in log.channels if c.kind == kind}
            yield f"/{kind}", now, {n: value for n, value in values.items() if np.isfinite(value)}
