"""Messages between a robot and its driver over TCP: a line of JSON each, in UTF-8.

The driver begins with `hello`, and the robot answers with `robot`. After that the driver sends

| message | answer |
|---|---|
| `{"type": "reset", "seed": 0}` | `{"type": "ready"}` |
| `{"type": "observe"}` | `{"type": "sample", ...}`, once the next control period has started |
| `{"type": "send", "controls": [...], "valid_until": 1.25}` | none |
| `{"type": "stop"}` | `{"type": "stopped"}` |

The robot rejects a request with `{"type": "error", "message": "..."}`, and stops; a rejected `send`
is answered so at the next message. Unmeasured values are null. Numbers are SI units.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError

from flywheel.errors import LinkError
from flywheel.quantities import CONTROL_STEP, Bounds
from flywheel.records import Floats
from flywheel.robot_link.protocol import LONGEST, RobotInfo, Sample
from flywheel.validation import Frozen

FORMAT = 1
LONGEST_LINE = 1_000_000  # [bytes]; a sample of a hundred points takes some 6,000
MOST = 1000  # points, or winches
FARTHEST = 1e6  # [m]; a point beyond is not measured
Coordinate = Annotated[float, Bounds(-FARTHEST, FARTHEST, "m")]
Coordinates = tuple[Coordinate, Coordinate, Coordinate]
Command = Annotated[float, Bounds(-FARTHEST, FARTHEST, "m or m/s")]
Time = Annotated[float, Bounds(-LONGEST, LONGEST, "s")]
Format = Annotated[int, Bounds(1, 1_000_000)]
Name = Annotated[str, Field(max_length=200)]
Expected = TypeVar("Expected", bound="Message")


class Message(Frozen):
    """Base of the messages. Unknown fields are rejected."""

    def line(self) -> bytes:
        """The bytes on the wire."""
        return self.model_dump_json().encode() + b"\n"


class Hello(Message):
    """The driver's first message."""

    type: Literal["hello"] = "hello"
    format: Format = FORMAT


class Reset(Message):
    """Start an episode."""

    type: Literal["reset"] = "reset"
    seed: Annotated[int, Bounds(0, 2**63 - 1)] = 0


class Observe(Message):
    """Ask for the next measurement."""

    type: Literal["observe"] = "observe"


class Send(Message):
    """A command, and the time of the robot's clock after which it expires [s]."""

    type: Literal["send"] = "send"
    controls: Annotated[tuple[Command, ...], Field(max_length=MOST)]
    valid_until: Time


class Stop(Message):
    """Hold the winches."""

    type: Literal["stop"] = "stop"


class Ready(Message):
    """The robot rests at the start of an episode."""

    type: Literal["ready"] = "ready"


class Stopped(Message):
    """The robot holds its winches."""

    type: Literal["stopped"] = "stopped"


class Refused(Message):
    """Reason for a rejected request."""

    type: Literal["error"] = "error"
    message: Annotated[str, Field(max_length=10_000)]


class About(Message):
    """Description of the robot, see `RobotInfo`."""

    type: Literal["robot"] = "robot"
    format: Format = FORMAT
    name: Name
    points: Annotated[tuple[Name, ...], Field(max_length=MOST)]
    winches: Annotated[tuple[Name, ...], Field(max_length=MOST)]
    control_low: Annotated[tuple[Command, ...], Field(max_length=MOST)]
    control_high: Annotated[tuple[Command, ...], Field(max_length=MOST)]
    period: Annotated[float, CONTROL_STEP]
    latency: Annotated[float, Bounds(0, 60, "s")] = 0.0
    dead_man: Annotated[float, Bounds(0, 60, "s", above=True)] = 0.5
    real_time: bool = False

    @classmethod
    def of(cls, info: RobotInfo) -> About:
        """The message with this content."""
        values = {name: getattr(info, name) for name in cls.model_fields if hasattr(info, name)}
        limits = {name: getattr(info, name).tolist() for name in ("control_low", "control_high")}
        return cls.model_validate({**values, **limits})

    @property
    def info(self) -> RobotInfo:
        """Its content."""
        values = self.model_dump(exclude={"type", "format"})
        limits = {name: np.array(values[name]) for name in ("control_low", "control_high")}
        return RobotInfo(**{**values, **limits})


class Measured(Message):
    """A measurement, see `Sample`."""

    type: Literal["sample"] = "sample"
    time: Time
    stamp: Time
    points: Annotated[tuple[Coordinates | None, ...], Field(max_length=MOST)]
    winch: Annotated[tuple[Coordinate | None, ...], Field(max_length=MOST)]

    @classmethod
    def of(cls, sample: Sample) -> Measured:
        """The message with this content."""
        there = np.all(np.abs(sample.points) <= FARTHEST, axis=-1).tolist()  # NaN is not
        points = zip(sample.points.tolist(), there, strict=True)
        return cls(
            time=sample.time,
            stamp=sample.stamp,
            points=tuple(tuple(point) if measured else None for point, measured in points),
            winch=tuple(x if abs(x) <= FARTHEST else None for x in sample.winch.tolist()),
        )

    @property
    def sample(self) -> Sample:
        """Its content."""
        missing = (np.nan, np.nan, np.nan)
        points = np.array([p or missing for p in self.points], float).reshape(-1, 3)
        winch = np.array([np.nan if x is None else x for x in self.winch], float)
        return Sample(self.time, self.stamp, points, winch)


Request = Annotated[Hello | Reset | Observe | Send | Stop, Field(discriminator="type")]
Answer = Annotated[About | Ready | Measured | Stopped | Refused, Field(discriminator="type")]
_REQUEST: TypeAdapter[Request] = TypeAdapter(Request)
_ANSWER: TypeAdapter[Answer] = TypeAdapter(Answer)


def request_of(line: bytes) -> Request:
    """The driver's message in a line.

    Raises:
      LinkError: there is none.
    """
    return _read(_REQUEST, line, "driver")


def answer_of(line: bytes) -> Answer:
    """The robot's message in a line.

    Raises:
      LinkError: there is none.
    """
    return _read(_ANSWER, line, "robot")


def check_format(number: int, whose: str) -> None:
    """Check the format of messages.

    Raises:
      LinkError: it differs.
    """
    if number != FORMAT:
        raise LinkError(f"The {whose} uses format {number} of the messages; this is {FORMAT}.")


def command_of(controls: Floats, valid_until: float) -> Send:
    """The message that sends a command.

    Raises:
      LinkError: a number is not finite.
    """
    controls = np.asarray(controls, float)
    within = (np.abs(controls) <= FARTHEST).all() and abs(valid_until) <= LONGEST  # NaN is not
    if controls.ndim != 1 or not within:
        raise LinkError(
            "A command consists of finite numbers of reasonable size, one for each winch, got "
            f"{np.array2string(controls, threshold=20)} until {valid_until}."
        )
    return Send(controls=tuple(controls.tolist()), valid_until=float(valid_until))


class MessageLink(ABC):
    """A robot that answers messages, whatever carries them. Implements `RobotLink`, except `close`."""

    info: RobotInfo

    @abstractmethod
    def _tell(self, message: Message) -> None:
        """Send a message."""

    @abstractmethod
    def _ask(self, message: Message, expected: type[Expected]) -> Expected:
        """Send a message, and wait for its answer, which is of the expected kind."""

    def reset(self, seed: int = 0) -> None:
        """Let it rest at the start of an episode."""
        self._ask(Reset(seed=seed), Ready)

    def observe(self) -> Sample:
        """The newest measurement, once the next control period has started."""
        return self._ask(Observe(), Measured).sample

    def send(self, controls: Floats, valid_until: float) -> None:
        """Command (W,) until a time of the robot's clock [s]."""
        self._tell(command_of(controls, valid_until))

    def stop(self) -> None:
        """Let it hold its winches."""
        self._ask(Stop(), Stopped)


def _read(kind: TypeAdapter[Any], line: bytes, whose: str) -> Any:
    try:
        return kind.validate_json(line)
    except ValidationError as error:
        problem = error.errors()[0]
        where = ".".join(str(part) for part in problem["loc"])
        raise LinkError(
            f"The {whose} sent an invalid message: "
            f"{where + ': ' if where else ''}{problem['msg']}; got "
            f"{line[:100].decode(errors='replace').strip()!r}."
        ) from None
