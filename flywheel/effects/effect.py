"""One physical cause, which a plant can have or not.

An effect has *sizes*, zero if the cause is absent, and may have *shapes* (time and length
constants), which are meaningless while the sizes are zero. It acts in one of four ways, each a base
class here: on MuJoCo's model, on the commands, on the winches while they move, or on the tension of
the cables. A plant without effects, or with effects of size zero, equals the MJCF bit by bit.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import mujoco
import numpy as np

from flywheel.effects.scales import Scales
from flywheel.errors import RobotError
from flywheel.records import Floats
from flywheel.robots import Body, Cable, Robot, TrackedPoint, Winch
from flywheel.robots.parts import WinchKind

RESTS: tuple[WinchKind, ...] = ("rate", "position")  # winches of which something is a rest length
Where = Literal["robot", "cable", "point", "winch", "body", "end"]
Numbers = Mapping[str, float]
Values = Mapping[str, Floats]
Memory = Floats


@dataclass(frozen=True)
class Parameter:
    """A number of an effect.

    Attributes:
      name, unit: as printed.
      typical: a realistic size, for a robot of given scales.
      low, high: bounds of the fit, in typical sizes. If the true value is beyond them, a residual
        remains, mostly so large that the verdict is PARTIAL or OUTSIDE_LIBRARY.
      grid: for shapes, the tested multiples of the typical value.
    """

    name: str
    unit: str
    typical: Callable[[Scales], float]
    low: float = 0.0
    high: float = 20.0
    grid: tuple[float, ...] = ()

    @property
    def one_sided(self) -> bool:
        """True if the parameter cannot be negative."""
        return self.low >= 0.0


class Effect(ABC):
    """Base of the four kinds. Effects are stateless; `EFFECTS` has one of each.

    Attributes:
      name: as in `EFFECTS`.
      where: kind of its place: the whole robot, one cable, one tracked point, one winch, one body,
        or one end of a cable.
      sizes, shapes: its parameters.
      equation: in the symbols of docs/effects.md.
      source: of the law.
      shown_by: the experiment that shows it best.
      acts_on: kind of part that one of the whole robot acts on, each by itself; "robot" for none.
      form: difference from the effect of its family; "" for that effect.
      winch_kinds: kinds of winches on which it has a meaning, or on whose cables.
    """

    name: ClassVar[str]
    where: ClassVar[Where] = "robot"
    acts_on: ClassVar[Where] = "robot"
    form: ClassVar[str] = ""
    winch_kinds: ClassVar[tuple[WinchKind, ...]] = ("rate", "position", "tension")
    sizes: ClassVar[tuple[Parameter, ...]]
    shapes: ClassVar[tuple[Parameter, ...]] = ()
    equation: ClassVar[str]
    source: ClassVar[str]
    shown_by: ClassVar[str]

    @property
    def family(self) -> str:
        """Name of the effect with the same physical cause; its own, except for other forms."""
        return self.name

    @property
    def part(self) -> Where:
        """Kind of place where it can act alone: its own, or the parts on which an effect of the
        whole robot acts.
        """
        return self.acts_on if self.where == "robot" else self.where

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters: sizes, then shapes."""
        return self.sizes + self.shapes

    def places(self, robot: Robot) -> tuple[int | None, ...]:
        """Possible places on a robot: indices of its parts of that kind, or None for all of it.

        There is none if the effect has no meaning on any part of the robot.
        """
        parts = self.parts_on(robot)
        return (None,) if self.where == "robot" and parts else parts

    def parts_on(self, robot: Robot) -> tuple[int, ...]:
        """Indices of the parts, of the kind `part`, on which the effect has a meaning on a robot."""
        able = [winch.kind in self.winch_kinds for winch in robot.winches]
        if isinstance(self, WinchEffect):  # the load of antagonists is another
            able = [each and w.alike for each, w in zip(able, robot.winches, strict=True)]
        cables = [cable.winch < 0 or able[cable.winch] for cable in robot.cables]
        if self.part == "robot":
            return (0,) if any(cables) or not cables else ()
        means = {"winch": able, "cable": cables}.get(self.part)
        count = len(parts_of(robot, self.part))
        return tuple(i for i in range(count) if means is None or means[i])

    def require_place(self, robot: Robot) -> None:
        """Reject a robot on which the effect has no meaning.

        Raises:
          RobotError: the robot has no part of the kind on which it acts.
        """
        if not self.places(robot):
            has_some = bool(parts_of(robot, self.part))
            why = f"which has no {self.part}"
            if has_some:
                tensions = robot.tension_driven
                why = f"whose winches {'take tensions' if tensions else 'drive antagonists'}"
            raise RobotError(f"{self.name} has no meaning on {robot.name}, {why}.")


class ModelEffect(Effect):
    """Compiled into MuJoCo's model: costs nothing while stepping.

    Attributes:
      moves_mass: it moves the centre of mass of a body.
    """

    moves_mass: ClassVar[bool] = False

    @abstractmethod
    def edit(self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Numbers) -> None:
        """Change the model, a private copy. `mj_setConst` is called afterwards."""


class CommandEffect(Effect):
    """Between the commands and the winches.

    Attributes:
      stage: of the way from the computer (0) to the spool; effects act in this order.
    """

    stage: ClassVar[int]

    acts_on = "winch"

    @abstractmethod
    def command(self, controls: Floats, values: Values, robot: Robot, dt: float) -> Floats:
        """Commands (n, T, W) that reach the winches.

        Args:
          controls: (n, T, W) commands from the beginning of an episode on.
          values: name -> (n, W), of each winch.
          dt: control step [s].
        """

    def lateness(self, values: Numbers) -> float:
        """Time by which points are measured later than channels; commands are late in their time [s]."""
        return 0.0


@dataclass(frozen=True)
class Cables:
    """The cables of n simulations at one instant; every array is (n, C).

    Attributes:
      length: [m].
      speed: rate of the length [m/s].
      rest: rest length [m]; the present length where a winch takes tensions.
      stiffness: [N/m]; 0 where a winch takes tensions.
      elastic: tension of the spring alone [N]; 0 where slack. What the winch is told where it takes tensions.
      dt: time to the next instant [s].
      slow: speed that counts as still [m/s].
    """

    length: Floats
    speed: Floats
    rest: Floats
    stiffness: Floats
    elastic: Floats
    dt: float
    slow: float

    @property
    def taut(self) -> np.ndarray:
        """True for each cable longer than its rest length."""
        return self.elastic > 0

    @property
    def extension(self) -> Floats:
        """Length beyond the rest length [m]; 0 where slack, and where a winch takes tensions."""
        soft = np.where(self.stiffness > 0, self.stiffness, np.inf)
        return np.asarray(self.elastic / soft)

    @property
    def direction(self) -> Floats:
        """Sign of the speed, smooth around zero."""
        return np.tanh(self.speed / self.slow)

    def __getitem__(self, rows: Any) -> Cables:
        if isinstance(rows, slice) and rows == slice(None):
            return self
        return Cables(
            self.length[rows],
            self.speed[rows],
            self.rest[rows],
            self.stiffness[rows],
            self.elastic[rows],
            self.dt,
            self.slow,
        )


class TensionEffect(Effect):
    """Adds tension to taut cables, step by step.

    Attributes:
      remembers: it has a memory of one number per cable.
    """

    remembers: ClassVar[bool] = False

    acts_on = "cable"

    @abstractmethod
    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        """Additional tension (n, C) [N], and the memory (n, C) at the next instant.

        Args:
          cables: of n simulations.
          memory: (n, C); zero at the beginning of an episode.
          values: name -> (n, C).
        """


@dataclass(frozen=True)
class Winches:
    """The winches of n simulations at one instant; every array is (n, W).

    Attributes:
      position: rest length of the first cable [m].
      load: tension of the tightest cable, by its spring alone [N].
    """

    position: Floats
    load: Floats

    def __getitem__(self, rows: Any) -> Winches:
        return Winches(self.position[rows], self.load[rows])


class WinchEffect(Effect):
    """Changes the rate of the winches depending on their position and load, step by step."""

    acts_on = "winch"

    @abstractmethod
    def rate(self, rate: Floats, winches: Winches, values: Values) -> Floats:
        """Rates (n, W) [m/s] of winches with commands `rate` (n, W).

        Args:
          rate: positive pays out [m/s].
          winches: of n simulations.
          values: name -> (n, W).
        """


@dataclass(frozen=True)
class Term:
    """An effect at a place, with its values: an addition to a plant.

    Attributes:
      effect: the effect.
      place: index of the part, as in `Effect.places`, or None.
      values: of all its parameters [their units].
      known: standard deviations of their prior, around zero, infinite without one; empty without
        any prior.
      price: of its values with a prior where models are compared [sigma^2]; 0 until it is known.
    """

    effect: Effect
    place: int | None
    values: tuple[float, ...]
    known: tuple[float, ...] = ()
    price: float = 0.0

    @property
    def named(self) -> dict[str, float]:
        """Parameter name -> value."""
        names = (parameter.name for parameter in self.effect.parameters)
        return dict(zip(names, self.values, strict=True))

    @property
    def unknown(self) -> int:
        """Number of its values without a prior."""
        return sum(map(math.isinf, self.known)) if self.known else len(self.values)

    @property
    def asked(self) -> bool:
        """True for a candidate, False for a merely uncertain number."""
        return self.unknown > 0

    @property
    def absent(self) -> bool:
        """True if all sizes are zero."""
        return not any(self.values[: len(self.effect.sizes)])

    def label(self, robot: Robot) -> str:
        """Readable name: "weak_cable at long_03"."""
        if self.place is None:
            return self.effect.name
        return f"{self.effect.name} at {place_name(self.effect, self.place, robot)}"


def points_late(terms: Terms) -> float:
    """Time by which points are measured later than channels [s]."""
    effects = ((term.effect, term.named) for term in terms)
    return sum(e.lateness(values) for e, values in effects if isinstance(e, CommandEffect))


def parts_of(robot: Robot, where: Where) -> tuple[str, ...]:
    """Names of a robot's parts of a kind; the ends of a cable are its first and its last."""
    if where == "robot":
        return ("",)
    if where == "end":
        return tuple(f"{cable.name}.{end}" for cable in robot.cables for end in ("first", "last"))
    parts: dict[str, Sequence[Cable | TrackedPoint | Winch | Body]] = {
        "cable": robot.cables, "point": robot.points, "winch": robot.winches, "body": robot.bodies,
    }  # fmt: skip
    return tuple(part.name for part in parts[where])


def place_name(effect: Effect, place: int | None, robot: Robot) -> str:
    """Name of the part; "" for the whole robot."""
    return "" if place is None else parts_of(robot, effect.part)[place]


Terms = tuple[Term, ...]
