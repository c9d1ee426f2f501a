"""The records shared by the packages: small, frozen, named fields, arrays batch first.

**Time.** `states[t]` precedes `controls[t]`; `controls[t]` acts on the interval `[t, t + 1)` of
length `dt`. A trajectory of T controls therefore has T + 1 observations and states.

**Shapes.** `...` is any number of leading batch axes, T control steps, P tracked points (end caps),
W winches (one control each), nq/nv/na MuJoCo's sizes. **Units** are SI, world z is up.
**Missing** measurements are NaN.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from flywheel.errors import DataError
from flywheel.quantities import CONTROL_STEP
from flywheel.terrain import Terrain

Floats = NDArray[np.floating]


@dataclass(frozen=True)
class State:
    """The full mechanical state of a plant.

    Attributes:
      qpos: (..., nq) generalised positions [m, unit wxyz quaternions].
      qvel: (..., nv) generalised velocities [m/s, rad/s].
      act: (..., na) actuator activations; a winch's is its rest length [m].
    """

    qpos: Floats
    qvel: Floats
    act: Floats

    def __getitem__(self, index: Any) -> State:
        """Index the leading (batch or time) axes of every field."""
        return State(self.qpos[index], self.qvel[index], self.act[index])

    @property
    def arrays(self) -> tuple[Floats, Floats, Floats]:
        """Its fields, in order."""
        return self.qpos, self.qvel, self.act

    @classmethod
    def joined(cls, states: Sequence[State], axis: int = 0) -> State:
        """States one after the other along a batch or time axis."""
        fields = zip(*(state.arrays for state in states), strict=True)
        return cls(*(np.concatenate(arrays, axis) for arrays in fields))


@dataclass(frozen=True)
class Observation:
    """The measurements of the robot's sensors.

    Attributes:
      points: (..., P, 3) positions of the tracked points [m]; NaN where missing.
      winch: (..., W) winch positions, as rest length paid out [m]; NaN where not measured.
    """

    points: Floats
    winch: Floats

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(..., P) bool: True for a measured point."""
        return np.asarray(np.isfinite(self.points).all(axis=-1))

    def __getitem__(self, index: Any) -> Observation:
        """Index the leading (batch or time) axes of every field."""
        return Observation(self.points[index], self.winch[index])


ChannelKind = Literal["tension", "length", "winch"]


@dataclass(frozen=True)
class MeasuredChannel:
    """Measurements beside the points, with noise of their own.

    Attributes:
      kind: "tension" of a cable [N], "length" of one between its ends [m], or position of a "winch" [m or N].
      name: of the cable or winch.
      values: (T + 1,); NaN where missing.
      noise: standard deviation; None to estimate it from the values.
    """

    kind: ChannelKind
    name: str
    values: Floats
    noise: float | None = None

    def __getitem__(self, index: Any) -> MeasuredChannel:
        """Index its values."""
        return dataclasses.replace(self, values=self.values[index])

    @property
    def key(self) -> tuple[ChannelKind, str]:
        """Kind and name."""
        return self.kind, self.name


@dataclass(frozen=True)
class Trajectory:
    """Observations, controls and, on a plant, full states over time.

    Attributes:
      observations: T + 1 along the last leading axis.
      controls: (..., T, W) commands within the MJCF's ctrlrange.
      dt: control step [s].
      states: T + 1 full states, or None without a plant (a recording).
      channels: of an unbatched recording, T + 1 values each.
    """

    observations: Observation
    controls: Floats
    dt: float
    states: State | None = None
    channels: tuple[MeasuredChannel, ...] = ()

    @property
    def steps(self) -> int:
        """T, the number of control steps."""
        return self.controls.shape[-2]

    def first(self, steps: int) -> Trajectory:
        """The first control steps of an unbatched one, without states."""
        channels = tuple(channel[: steps + 1] for channel in self.channels)
        seen = self.observations[: steps + 1]
        return Trajectory(seen, self.controls[:steps], self.dt, channels=channels)

    def __post_init__(self) -> None:
        counts = {len(channel.values) for channel in self.channels}
        for got in sorted({self.observations.points.shape[-3], *counts} - {self.steps + 1}):
            raise DataError(
                f"A trajectory of {self.steps} controls has {self.steps + 1} observations, got {got}."
            )
        if not np.isfinite(self.controls).all():
            raise DataError("A trajectory's controls must be finite; got NaN or infinity.")
        CONTROL_STEP.check(self.dt, "A control step, dt,", DataError)


Source = Literal["sim", "recording"]
RECORDING: Final = "recording"  # source and data set of what a robot measured
Split = Literal["train", "validation", "test"]


@dataclass(frozen=True)
class Provenance:
    """Provenance of an episode; everything needed to reproduce it.

    Attributes:
      robot: digest of the robot (`Robot.digest`).
      source: "sim" or "recording".
      dataset: name of the data set for the network's one-hot ("nominal", "friction_low",
        "recording").
      controller: name of the controller ("gait:roll", "random", "mppi", ...).
      model: digest of the weights the controller planned with, or "" without one.
      task: name of the task, or "".
      seed: of the episode.
      iteration: of the flywheel that collected it; -1 outside of one.
      config: digest of the resolved run configuration, or "".
      code: version of the code.
      plant: parameters of the plant that differ from the MJCF, e.g. {"friction": 0.6}.
      effects: name -> parameters of effects added to the plant.
      conditions: free text about a recording ("new cables").
    """

    robot: str
    source: Source = "sim"
    dataset: str = "nominal"
    controller: str = ""
    model: str = ""
    task: str = ""
    seed: int = 0
    iteration: int = -1
    config: str = ""
    code: str = ""
    plant: dict[str, float] = field(default_factory=dict)
    effects: dict[str, dict[str, float]] = field(default_factory=dict)
    conditions: str = ""


@dataclass(frozen=True)
class Outcome:
    """Outcome of a task.

    Attributes:
      success: the goal was reached in time.
      seconds: simulated time to the goal, or to the end of the episode [s].
      distance: CoM distance to the goal at the end [m].
    """

    success: bool
    seconds: float
    distance: float


@dataclass(frozen=True)
class Plans:
    """Predictions of a planner at each plan.

    Attributes:
      begins: (plans,) start, from the beginning of the episode [s].
      paths: (plans, K, M, 2) paths of the robot's centre of mass under K candidates, best first
        [m].
    """

    begins: Floats
    paths: Floats

    def at(self, seconds: float) -> Floats | None:
        """(K, M, 2) last prediction before a time [s]; None before the first plan."""
        index = int(np.searchsorted(self.begins, seconds + 1e-9, side="right")) - 1
        return None if index < 0 else self.paths[index]


@dataclass(frozen=True)
class Episode:
    """One recorded trajectory with identity and provenance. Immutable once committed.

    Attributes:
      id: unique name, [a-z0-9._-]+ ("i0001-mppi-0003").
      trajectory: unbatched (no leading axes before time).
      split: "train", "validation" or "test"; fixed at commit.
      outcome: of the task, if there was one.
      telemetry: additional numbers outside all digests, e.g. {"plan_seconds": (plans,)}.
      terrain: ground and boxes around the robot; None for the plane z = 0 alone.
    """

    id: str
    trajectory: Trajectory
    provenance: Provenance
    split: Split
    outcome: Outcome | None = None
    telemetry: dict[str, Floats] = field(default_factory=dict)
    terrain: Terrain | None = None

    @property
    def plans(self) -> Plans | None:
        """Predictions of its planner; None without planning or notes."""
        if not {"plan_begins", "plan_paths"} <= self.telemetry.keys():
            return None
        return Plans(self.telemetry["plan_begins"], self.telemetry["plan_paths"])


# (T + 1, W) best knowledge of an episode's winch positions [m].
KnownWinch = Callable[[Episode], Floats]


@dataclass(frozen=True)
class Past:
    """Knowledge at the present moment, the last entry of `observations`.

    Attributes:
      observations: (B, h + 1) of them, oldest first.
      controls: (B, h, W) the commands between them.
      winch: (B, h + 1, W) best estimate of the winch positions: measured if there is a channel,
        else dead-reckoned from the commands and the known effects of the plant [m].
      dataset: index of the data set (the network's one-hot).
      state: (B,) the plant's full state at the present, for the oracle only.
      terrains: around each of B, or one for all; None is the plane z = 0 alone.
      pending: (B, c, W) commands that are already fixed: sent, or part of a plan in execution. None
        for none.
    """

    observations: Observation
    controls: Floats
    winch: Floats
    dataset: int = 0
    state: State | None = None
    terrains: tuple[Terrain | None, ...] = (None,)
    pending: Floats | None = None

    def __post_init__(self) -> None:
        if len(self.terrains) not in (1, len(self.observations.points)):
            raise DataError(
                f"A past of {len(self.observations.points)} has as many terrains, or one for all; got "
                f"{len(self.terrains)}."
            )

    @property
    def history(self) -> int:
        """h, the number of past control steps."""
        return self.controls.shape[-2]

    def terrains_at(self, rows: slice) -> tuple[Terrain | None, ...]:
        """The terrains of a part of the batch; one for all stays one for all."""
        return self.terrains if len(self.terrains) == 1 else self.terrains[rows]

    def latest(self, history: int, hold: Floats) -> Past:
        """This past with exactly the last `history` steps.

        A shorter past (the start of an episode) is padded in front by a robot at rest: the first
        observation repeated, under the holding command.

        Args:
          history: number of past steps.
          hold: (B, W) command that holds the oldest winch position (`Robot.holding`).
        """
        have = self.history
        if have < history:
            return self._padded(history - have, hold)
        keep = slice(have - history, None)
        return dataclasses.replace(
            self,
            observations=self.observations[:, keep],
            controls=self.controls[:, keep],
            winch=self.winch[:, keep],
        )

    def _padded(self, missing: int, hold: Floats) -> Past:
        def front(array: Floats) -> Floats:
            return np.concatenate([np.repeat(array[:, :1], missing, axis=1), array], axis=1)

        held = np.repeat(np.asarray(hold, self.controls.dtype)[:, None], missing, axis=1)
        return dataclasses.replace(
            self,
            observations=Observation(
                front(self.observations.points), front(self.observations.winch)
            ),
            controls=np.concatenate([held, self.controls], axis=1),
            winch=front(self.winch),
        )


@dataclass(frozen=True)
class Rollout:
    """A trajectory predicted by a model.

    Attributes:
      points: (B, H + 1, P, 3) predicted points [m]; entry 0 is the model's present.
      winch: (B, H + 1, W) predicted winch positions [m].
    """

    points: Floats
    winch: Floats
