"""Numbers set by users: their meaning, and their sensible bounds.

A number without an upper bound is an episode without an end, or all of the memory. So every number
of every setting is `Annotated` with `Bounds`: with those of one of the names below, or with its own
tighter ones. The bounds are far beyond any need, and products are checked separately, see
`runtime.config.demand`.
"""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import MaxLen

from flywheel.errors import FlywheelError

if TYPE_CHECKING:  # the command line imports this, and `--help` is instant
    from pydantic import GetCoreSchemaHandler
    from pydantic_core import CoreSchema


@dataclass(frozen=True)
class Bounds:
    """The allowed range of a number; in an `Annotated` type, all others are rejected.

    Text, true and false are not numbers, and NaN is outside all bounds.

    Attributes:
      low, high: least and largest.
      unit: of both.
      above, below: `low` itself is not allowed; `high` itself is not.
    """

    low: float
    high: float
    unit: str = ""
    above: bool = False
    below: bool = False

    def __contains__(self, value: Any) -> bool:
        if isinstance(value, bool) or not isinstance(value, Real):
            return False
        number: Any = value  # as it is: float(10**400) would overflow
        high_enough = number > self.low if self.above else number >= self.low
        return bool(high_enough and (number < self.high if self.below else number <= self.high))

    def __str__(self) -> str:
        if self.above or self.below:
            low = f"above {self.low:,.12g}" if self.above else f"at least {self.low:,.12g}"
            high = f"below {self.high:,.12g}" if self.below else f"at most {self.high:,.12g}"
            words = f"{low} and {high}"
        else:
            words = f"from {self.low:,.12g} to {self.high:,.12g}"
        return f"{words} {self.unit}".rstrip()

    def check(self, value: float, what: str, error: type[FlywheelError]) -> float:
        """The value, if it is within the bounds.

        Args:
          value: any.
          what: its name, at the beginning of a sentence: "The timestep".
          error: class to raise.

        Raises:
          error: it is out of bounds.
        """
        if value not in self:
            from flywheel.files import shown  # start-up time: takes YAML along

            raise error(f"{what} must be a number {self}; got {shown(value)}.")
        return value

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Validation by pydantic of a type annotated with these bounds."""
        # Start-up time: the command line imports this module, and `--help` is instant.
        from pydantic_core import PydanticCustomError, core_schema

        kind = "a whole number" if source is int else "a number"

        def checked(value: Any) -> Any:
            if value not in self or (source is int and value % 1):
                raise PydanticCustomError(
                    "bounds", "must be {allowed}", {"allowed": f"{kind} {self}"}
                )
            return value

        return core_schema.no_info_before_validator_function(checked, handler(source))


# Pure numbers.
Share = Annotated[float, Bounds(0, 1)]
PartialShare = Annotated[float, Bounds(0, 1, below=True)]
FACTOR = Bounds(0, 1e9, above=True)  # beside a typical one of 1; demonstrations exaggerate by 1e7
Factor = Annotated[float, FACTOR]
Weight = Annotated[float, Bounds(0, 1e9)]  # of a part of a sum, beside others around 1
SEED = Bounds(0, 2**32 - 1)  # torch counts no more bits: larger ones repeat these
Seed = Annotated[int, SEED]

# Counts of what takes time or memory.
Episodes = Annotated[int, Bounds(0, 10_000)]  # of a kind: their names count in four digits
SAMPLES = Bounds(1, 10_000)  # plans, windows or draws that are predicted at once
Samples = Annotated[int, SAMPLES]
DRAWS = Bounds(40, 10_000)  # of noise; with fewer no error could be more than it, at a level of 5 %
OptimiserSteps = Annotated[int, Bounds(1, 10_000_000)]  # at ten a second a million take a day
THREADS = Bounds(1, 1024)  # of one process; ours gain nothing beyond a few
Threads = Annotated[int, THREADS]
TYPICAL_SIZES = Bounds(0.01, 1000)  # of an effect

# Times.
CONTROL_STEP = Bounds(1e-4, 10, "s")  # the shortest of motors, the longest of cranes
ControlStep = Annotated[float, CONTROL_STEP]
EPISODE_SECONDS = Bounds(0, 3600, "s", above=True)  # the longest of ours have two minutes
EpisodeSeconds = Annotated[float, EPISODE_SECONDS]
DEMO_SECONDS = Bounds(0.2, 30, "s")  # of one recording; diagnosed in minutes
DemoSeconds = Annotated[float, DEMO_SECONDS]
HORIZON_SECONDS = Bounds(0, 600, "s", above=True)  # predicted ahead, or looked at together
HorizonSeconds = Annotated[float, HORIZON_SECONDS]
Patience = Annotated[float, Bounds(0, 86_400, "s", above=True)]  # of one process with another
WaitingSeconds = Annotated[float, Bounds(0, 86_400, "s")]
MINUTES = Bounds(0, 1440, "min", above=True)  # of a command that somebody waits for

# Lengths: in units of the robot's length L, and where something stands.
RobotLengths = Annotated[float, Bounds(0, 1000, "L")]
PositiveRobotLengths = Annotated[float, Bounds(0, 1000, "L", above=True)]
Metres = Annotated[float, Bounds(-1e5, 1e5, "m")]  # single precision still tells centimetres there
PositiveMetres = Annotated[float, Bounds(0, 1e5, "m", above=True)]
NOISE = Bounds(1e-9, 1e6)  # of a channel [m or N]

# Texts.
Name = Annotated[
    str, MaxLen(200)
]  # of people, things and places: makes titles, file names and tags
Place = Annotated[str, MaxLen(4000)]  # a path or a URL
