"""Tests of the contract of effects, on a robot in less than a second.

The contract is that of the package's effects: an absent cause changes nothing, numbers are finite
within the bounds, simulations of a batch are independent, and simulations can be split at any time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from itertools import product
from typing import Any

import mujoco
import numpy as np

from flywheel.dynamics.plant.augmented import AugmentedPlant, Motion, edited
from flywheel.dynamics.plant.plant import Plant
from flywheel.effects import (
    Cables,
    CommandEffect,
    Effect,
    ModelEffect,
    Scales,
    TensionEffect,
    Term,
    Terms,
    WinchEffect,
    Winches,
)
from flywheel.effects.own import described
from flywheel.errors import ConfigError
from flywheel.files import shown
from flywheel.records import Floats, State
from flywheel.robots import Robot
from flywheel.robots.mujoco_warnings import collected_warnings

ROWS, INSTANTS = 5, 4  # simulations, and how often each is asked
STEPS = 20  # control steps of what is simulated
CUT = 7  # where it is cut
SETTLED = 0.5  # before that [s]
SPREAD = 0.1  # of cable lengths, as a share
FORCE = 0.5  # of the fastest that winches are told
ROUNDING = 1e-9  # that may be left where nothing changes
SAME = 1e-6  # of the robot's length, that an absent change of the model may make in those steps


def check_laws(effects: Iterable[Effect], plant: Plant) -> None:
    """Check the contract of effects on a robot.

    Args:
      effects: those of law files.
      plant: whose robot, parameters and control step are used, without effects.

    Raises:
      ConfigError: an effect raises, returns a wrong shape or a non-finite number, changes something
        with sizes of zero, couples simulations, or depends on earlier calls.
    """
    trial: _Trial | None = None
    for effect in effects:
        if effect.places(plant.robot):
            trial = trial or _Trial.of(plant)
            trial.check(effect)


@dataclass(frozen=True)
class _Trial:
    """Test inputs for effects.

    Attributes:
      augmented: the robot.
      cables: at some instants.
      winches: at the same.
      rates: (INSTANTS, ROWS, W) commanded to winches [m/s].
      start: a settled state.
      controls: (ROWS, STEPS, W) that haul in and pay out, each in a different way.
    """

    augmented: AugmentedPlant
    cables: tuple[Cables, ...]
    winches: tuple[Winches, ...]
    rates: Floats
    start: State
    controls: Floats

    @classmethod
    def of(cls, plant: Plant) -> _Trial:
        bare, rng = Plant(plant.robot, plant.dt), np.random.default_rng(0)
        robot = bare.robot
        start = bare.settle(SETTLED)
        low, high, winch = robot.control_low, robot.control_high, bare.winch(start)[0]
        way = rng.uniform(-FORCE, FORCE, (ROWS, 1, len(low))) * _to_and_fro()[:, None]
        controls = np.clip(robot.holding(winch) + way * (high - low), low, high)
        shape = (INSTANTS, ROWS, len(winch))
        scales = Scales.of(robot)
        position = winch + SPREAD * scales.length * rng.uniform(-1, 1, shape)
        load = scales.weight * np.maximum(rng.uniform(-1, 2, shape), 0.0)
        return cls(
            AugmentedPlant(bare),
            tuple(_some_cables(robot, rng) for _ in range(INSTANTS)),
            tuple(Winches(_fixed(p), _fixed(f)) for p, f in zip(position, load, strict=True)),
            _fixed(scales.length / scales.time * rng.uniform(-0.3, 0.3, shape)),
            start,
            _fixed(controls),
        )

    def check(self, effect: Effect) -> None:
        """Test one effect.

        Raises:
          ConfigError: see `check_laws`.
        """
        with np.errstate(all="ignore"):  # what matters is what comes out
            for factors in _corners(effect):
                self._check_finite(effect, factors)
            for shapes in _shapes(effect):
                self._check_neutral(effect, (*(0.0 for _ in effect.sizes), *shapes))
            self._check_simulated(effect)

    def _check_finite(self, effect: Effect, factors: Sequence[float]) -> None:
        """Check that numbers are finite, of the right shape, and the same for a part of the simulations."""
        values = self._values(effect, factors)
        given = ", ".join(f"{name} {value:.3g}" for name, value in values.items())
        if isinstance(effect, ModelEffect):
            term = Term(effect, effect.places(self.augmented.robot)[0], tuple(values.values()))
            self._edited(effect, (term,), f"with {given}")
            return
        whole = self._answers(effect, values, slice(None))
        part = self._answers(effect, values, slice(1, 3))
        for name, (got, shape) in whole.items():
            if got.shape != shape:
                raise ConfigError(
                    f"{described(effect)} returns {name} of the shape {got.shape}; {shape} is "
                    "needed."
                )
            if not np.isfinite(got).all():
                raise ConfigError(
                    f"{described(effect)} returns {name} that are not finite, with {given}."
                )
        for name, (got, _) in part.items():
            if not np.array_equal(got, whole[name][0][:, 1:3]):
                raise ConfigError(
                    f"{described(effect)} returns other {name} when fewer simulations are stepped "
                    "together: each must depend on itself alone, and on nothing that the effect "
                    "keeps."
                )

    def _check_neutral(self, effect: Effect, factors: Sequence[float]) -> None:
        """Check that sizes of zero change nothing."""
        values = self._values(effect, factors)
        if isinstance(effect, ModelEffect):
            self._check_neutral_model(effect, tuple(values.values()))
            return
        answers = self._answers(effect, values, slice(None))
        name: str
        want: Floats
        if isinstance(effect, TensionEffect):
            name, want = "tensions", np.zeros(1)
        elif isinstance(effect, WinchEffect):
            name, want = "rates", self.rates
        else:
            name, want = "commands", self.controls
        if not np.allclose(answers[name][0], want, rtol=ROUNDING, atol=ROUNDING):
            raise ConfigError(
                f"{described(effect)} changes {name} although its sizes are zero, where the cause is absent."
            )

    def _check_neutral_model(self, effect: ModelEffect, values: tuple[float, ...]) -> None:
        robot = self.augmented.robot
        term = Term(effect, effect.places(robot)[0], values)
        model = self._edited(effect, (term,), "with sizes of zero")
        here, there = self._rolled(self._base(effect)), self._rolled(model)
        if not np.abs(here - there).max() <= SAME * robot.length:
            raise ConfigError(
                f"{described(effect)} changes the model although its sizes are zero, where the cause is "
                "absent."
            )

    def _base(self, effect: ModelEffect) -> mujoco.MjModel:
        """The model of which an effect changes a copy."""
        return self.augmented._movable if effect.moves_mass else self.augmented._model

    def _rolled(self, model: mujoco.MjModel) -> Floats:
        """Positions after some steps on a model."""
        plant = self.augmented.plant
        driven = np.repeat(plant.commands(self.controls[:1, :CUT]), plant.substeps, axis=1)
        commands = np.zeros((1, driven.shape[1], model.nu))
        commands[..., : driven.shape[2]] = driven
        begun, data = plant.packed(self.start), [mujoco.MjData(model)]
        with collected_warnings():
            _, before = self.augmented._engine.rollout([model], data, begun, commands)
        return np.asarray(before[0, -1, plant._points])

    def _edited(self, effect: ModelEffect, terms: Terms, how: str) -> mujoco.MjModel:
        """A copy of the model with terms, with finite numbers only."""
        before = self._base(effect)
        with collected_warnings():
            after = edited(before, self.augmented.robot, terms)
        for name in dir(before):
            value = None if name.startswith("_") else getattr(before, name)
            if isinstance(value, np.ndarray) and value.dtype.kind == "f":
                lost = np.isfinite(value) & ~np.isfinite(getattr(after, name))
                if lost.any():
                    raise ConfigError(f"{described(effect)} makes {name} not finite, {how}.")
        return after

    def _check_simulated(self, effect: Effect) -> None:
        """Check that only the effect's own simulation changes in a batch, and that time can be
        split anywhere.
        """
        augmented, scales = self.augmented, Scales.of(self.augmented.robot)
        values = tuple(min(max(1.0, p.low), p.high) * p.typical(scales) for p in effect.parameters)
        term = Term(effect, effect.places(augmented.robot)[-1], values)
        batch = [(), (term,), ()]
        whole = self._simulated(batch)
        if not whole.finite.all():
            raise ConfigError(
                f"{described(effect)} makes {augmented.robot.name} diverge at its typical size."
            )
        alone = self._simulated([()]).points[0]
        if not all(np.array_equal(whole.points[row], alone) for row in (0, 2)):
            raise ConfigError(f"{described(effect)} changes simulations that do not have it.")
        again = self._simulated([(term,)], CUT).points[0]
        if not np.array_equal(again, whole.points[1]):
            raise ConfigError(
                f"{described(effect)} depends on earlier calls: a memory belongs in the `memory` "
                "of a TensionEffect, and nowhere else."
            )

    def _simulated(self, terms: Sequence[Terms], cut: int = STEPS) -> Motion:
        """Simulations from the start, stopped after `cut` steps and continued."""
        count, augmented = len(terms), self.augmented
        states = self.start[np.zeros(count, int)]
        told = augmented.commands(np.repeat(self.controls[:1], count, axis=0), terms)
        first = augmented.simulate(states, told[:, :cut], terms)
        if cut == STEPS:
            return first
        rest = augmented.simulate(first.states[:, -1], told[:, cut:], terms, first.memory)
        points = np.concatenate([first.points, rest.points[:, 1:]], axis=1)
        finite = first.finite & rest.finite
        return Motion(points, rest.states, finite, rest.memory, rest.channels)

    def _values(self, effect: Effect, factors: Sequence[float]) -> dict[str, float]:
        scales = Scales.of(self.augmented.robot)
        pairs = zip(effect.parameters, factors, strict=True)
        return {each.name: factor * each.typical(scales) for each, factor in pairs}

    def _answers(
        self, effect: Effect, values: dict[str, float], rows: slice
    ) -> dict[str, tuple[Floats, tuple[int, ...]]]:
        """Results of a law at all instants for some of the simulations, and the required shape."""
        robot, count = self.augmented.robot, len(range(ROWS)[rows])
        if isinstance(effect, CommandEffect):
            controls = self.controls[rows]
            wide = _wide(values, (count, len(robot.winches)))
            got = effect.command(controls, wide, robot, self.augmented.dt)
            return {"commands": (_numbers(effect, "commands", [got]), (1, *controls.shape))}
        if isinstance(effect, WinchEffect):
            wide = _wide(values, (count, len(robot.winches)))
            pairs = zip(self.rates, self.winches, strict=True)
            rates = [effect.rate(rate[rows], winches[rows], wide) for rate, winches in pairs]
            shape = (INSTANTS, count, len(robot.winches))
            return {"rates": (_numbers(effect, "rates", rates), shape)}
        assert isinstance(effect, TensionEffect)
        return self._tensions(effect, _wide(values, (count, len(robot.cables))), rows)

    def _tensions(
        self, effect: TensionEffect, wide: dict[str, Floats], rows: slice
    ) -> dict[str, tuple[Floats, tuple[int, ...]]]:
        """The tensions of a law at successive instants, and its memory."""
        shape = (INSTANTS, *self.cables[0][rows].length.shape)
        memory, tensions, memories = np.zeros(shape[1:]), [], []
        for cables in self.cables:
            got = effect.tension(cables[rows], _fixed(memory), wide)
            if not isinstance(got, tuple) or len(got) != 2:
                raise ConfigError(
                    f"{described(effect)} must return a tension and the memory at the next "
                    f"instant, as a tuple of two arrays; got {shown(got)}."
                )
            tensions.append(got[0])
            memories.append(got[1])
            if effect.remembers and np.shape(got[1]) == shape[1:]:
                memory = np.array(got[1], float)
        found = {"tensions": (_numbers(effect, "tensions", tensions), shape)}
        if effect.remembers:
            found["memories"] = (_numbers(effect, "memories", memories), shape)
        return found


def _numbers(effect: Effect, name: str, answers: list[Any]) -> Floats:
    """Results of a law, stacked.

    Raises:
      ConfigError: one is not an array of numbers.
    """
    try:
        return np.array(answers, float)
    except (TypeError, ValueError):
        raise ConfigError(
            f"{described(effect)} returns {name} that are not an array of numbers: "
            f"{shown(answers[0])}."
        ) from None


def _corners(effect: Effect) -> Iterator[tuple[float, ...]]:
    """Multiples of the typical values: all sizes at a bound or typical, with each shape."""
    sizes = (
        tuple(size.low for size in effect.sizes),
        tuple(min(max(1.0, size.low), size.high) for size in effect.sizes),
        tuple(size.high for size in effect.sizes),
    )
    return ((*size, *shape) for size, shape in product(sizes, _shapes(effect)))


def _shapes(effect: Effect) -> list[tuple[float, ...]]:
    """Shapes at their bounds, and at the first of their grid."""
    return list(
        dict.fromkeys(
            (
                tuple(shape.low for shape in effect.shapes),
                tuple(shape.grid[0] for shape in effect.shapes),
                tuple(shape.high for shape in effect.shapes),
            )
        )
    )


def _some_cables(robot: Robot, rng: np.random.Generator) -> Cables:
    """(ROWS, C) cables, taut and slack, moving and still."""
    scales, shape = Scales.of(robot), (ROWS, len(robot.cables))
    rest = np.array([c.rest_length for c in robot.cables]) * np.ones(shape)
    stiffness = np.array([c.stiffness for c in robot.cables]) * np.ones(shape)
    length = rest * (1.0 + SPREAD * rng.uniform(-1, 1, shape))
    speed = scales.length / scales.time * rng.uniform(-1, 1, shape) * (rng.random(shape) < 0.8)
    elastic = stiffness * np.maximum(length - rest, 0.0)
    if robot.tension_driven:
        told = np.flatnonzero([cable.winch >= 0 for cable in robot.cables])
        rest[:, told] = length[:, told] = robot.length
        elastic += robot.told_tensions(
            rng.uniform(robot.control_low, robot.control_high, (ROWS, len(robot.winches)))
        )
    found = Cables(length, speed, rest, stiffness, elastic, robot.timestep, scales.slow)
    for each in fields(found):
        if isinstance(value := getattr(found, each.name), np.ndarray):
            _fixed(value)
    return found


def _to_and_fro() -> Floats:
    return np.where(np.arange(STEPS) < STEPS // 2, 1.0, -1.0)


def _wide(values: dict[str, float], shape: tuple[int, ...]) -> dict[str, Floats]:
    return {name: _fixed(np.full(shape, value)) for name, value in values.items()}


def _fixed(values: Floats) -> Floats:
    """An array that a law cannot change in place."""
    values.setflags(write=False)
    return values
