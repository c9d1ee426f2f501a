"""Messages of ROS and MCAP, each topic as a table of numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from flywheel.data.recordings.formats.arrays import WIDEST, check_size
from flywheel.data.recordings.formats.stream import Contents, Stream
from flywheel.errors import DataError
from flywheel.records import Floats

DEEPEST = 12  # messages within messages
SAME_CLOCK = 60.0  # [s] between a message's own stamp and when it was logged
NAMES = ("name", "names", "joint_names")  # of the numbers in the other lists of a message
SUBNORMAL = np.finfo(float).tiny


class Topic:
    """The numbers of a topic's messages, which may have different fields."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.logged: list[int] = []
        self.stamped: list[int] = []
        self.columns: dict[str, list[float]] = {}

    def add(self, message: Any, logged: int) -> None:
        """Append a message that was logged at a time [ns]."""
        row = dict(flat(message))
        for name, value in row.items():
            if name not in self.columns:
                if len(self.columns) >= WIDEST:
                    continue
                self.columns[name] = [np.nan] * len(self.logged)
            self.columns[name].append(value)
        self.logged.append(logged)
        self.stamped.append(stamp(message))
        for values in self.columns.values():
            if len(values) < len(self.logged):
                values.append(np.nan)
        check_size(len(self.columns) * len(self.logged), f"the topic {self.name}")

    def stream(self) -> Stream | None:
        """Its columns `topic.field`, in the order of their times; None without numbers.

        The messages' own stamps are their times, unless they are of another clock than the log's.
        """
        if not self.columns or len(self.logged) < 2:
            return None
        logged, stamped = (np.array(each) / 1e9 for each in (self.logged, self.stamped))
        own = (stamped > 0).all() and np.median(np.abs(stamped - logged)) < SAME_CLOCK
        time = stamped if own else logged
        order = np.argsort(time, kind="stable")
        return Stream(
            {f"{self.name}.{name}": np.array(v)[order] for name, v in self.columns.items()},
            time[order],
        )


def stamp(message: Any) -> int:
    """The stamp in a message's header [ns]; 0 without one."""
    about = parts(message)
    found = parts(about.get("header", message)).get("stamp")
    inner = parts(found)
    seconds = inner.get("sec", inner.get("secs"))
    nanoseconds = inner.get("nanosec", inner.get("nsecs", inner.get("nsec", 0)))
    if isinstance(seconds, int) and isinstance(nanoseconds, int):
        return seconds * 1_000_000_000 + nanoseconds
    return 0


def flat(message: Any, name: str = "", depth: int = 0) -> Iterator[tuple[str, float]]:
    """Names and values of the numbers in a message; those of lists are called after the names beside them."""
    if depth > DEEPEST:
        return
    if isinstance(message, bool | int | float | np.number | np.bool_):
        yield name, float(message)
    elif isinstance(message, list | tuple | np.ndarray):
        if len(message) <= WIDEST:
            for i, each in enumerate(message):
                frame = parts(each).get("child_frame_id") if depth < DEEPEST else None
                yield from flat(each, f"{name}[{frame or i}]", depth + 1)
    else:
        yield from _fields(parts(message), name, depth)


def _fields(about: Mapping[str, Any], name: str, depth: int) -> Iterator[tuple[str, float]]:
    labels = next((about[each] for each in NAMES if _is_texts(about.get(each))), None)
    for key, value in about.items():
        if key == "header":
            continue
        inner = f"{name}.{key}" if name else key
        listed = isinstance(value, list | tuple | np.ndarray)
        if labels is not None and listed and len(value) == len(labels) and not _is_texts(value):
            for label, each in zip(labels, value, strict=True):
                yield from flat(each, f"{inner}[{label}]", depth + 1)
        else:
            yield from flat(value, inner, depth + 1)


def parts(message: Any) -> Mapping[str, Any]:
    """Fields of a message of any of the decoders, or of JSON; empty for what has none."""
    if isinstance(message, Mapping):
        return message
    names: Any = getattr(message, "__dataclass_fields__", getattr(message, "__slots__", ()))
    return {name: getattr(message, name) for name in names if not name.startswith("_")}


def _is_texts(value: Any) -> bool:
    return (
        isinstance(value, list | tuple)
        and len(value) > 0
        and all(isinstance(v, str) for v in value)
    )


def subnormal(values: Floats) -> bool:
    """True where numbers are so small that they must be whole numbers written as the bits of others."""
    return bool(((values != 0) & (np.abs(values) < SUBNORMAL)).any())


def contents(topics: dict[str, Topic], notes: list[str]) -> Contents:
    """The topics that have numbers.

    Raises:
      DataError: none has, or a number is the bits of another.
    """
    streams = [found for topic in topics.values() if (found := topic.stream()) is not None]
    if not streams:
        why = "".join(f" {note}." for note in notes)
        raise DataError(f"none of its {len(topics)} topics has two messages with numbers.{why}")
    for each in streams:
        for name, values in each.columns.items():
            if subnormal(values):
                raise DataError(
                    f"{name} has numbers below 1e-307: were whole numbers written into a field of fractions?"
                )
    return Contents(tuple(streams), tuple(notes))
