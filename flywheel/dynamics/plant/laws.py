"""The laws of cables and winches during a simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import mujoco
import numpy as np
from mujoco.batch import Batch

from flywheel.dynamics.plant.parameters import PlantParameters
from flywheel.effects import Cables, CommandEffect, TensionEffect, Term, Terms, WinchEffect, Winches
from flywheel.records import Floats
from flywheel.robots import Robot

Memories = dict[str, Floats]
E = TypeVar("E", CommandEffect, TensionEffect, WinchEffect)
Rows = np.ndarray | slice
Group = tuple[E, Rows, dict[str, Floats]]


@dataclass(frozen=True)
class Geometry:
    """Mapping from MuJoCo's numbers to those of cables, in the order of its tendons.

    Attributes:
      activation: (C,) index of each cable's rest length, or tension, in `act`, -1 for passive cables.
      rest: (C,) rest length at the keyframe [m].
      stiffness, damping: (C,).
      strongest: (C,) largest pull of each cable's actuator; infinite without one [N].
      loads: (W, C) bool, cables carried by each winch.
    """

    activation: np.ndarray
    rest: Floats
    stiffness: Floats
    damping: Floats
    strongest: Floats
    loads: np.ndarray

    @classmethod
    def of(cls, model: mujoco.MjModel, robot: Robot, parameters: PlantParameters) -> Geometry:
        activation = np.full(len(robot.cables), -1)
        loads = np.zeros((len(robot.winches), len(robot.cables)), bool)
        for index, winch in enumerate(robot.winches):
            activation[list(winch.cables)] = model.actuator_actadr[list(winch.actuators)]
            loads[index, list(winch.cables)] = True
        cables = robot.cables
        return cls(
            activation,
            np.array([cable.rest_length for cable in cables]),
            parameters.cable_stiffness * np.array([cable.stiffness for cable in cables]),
            parameters.cable_damping * np.array([cable.damping for cable in cables]),
            _strongest(model, len(cables)),
            loads,
        )


def _strongest(model: mujoco.MjModel, cables: int) -> Floats:
    strongest = np.full(cables, np.inf)
    limited = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON) & (
        model.actuator_forcelimited == 1
    )
    strongest[model.actuator_trnid[limited, 0]] = -model.actuator_forcerange[limited, 0]
    return strongest


class Laws:
    """The laws of n simulations, each applied to the rows that have it.

    Args:
      robot: of the cables and winches.
      geometry: of the cables.
      batch: the simulations, and maybe more after them.
      terms: of each.
      memory: effect name -> (n, C), changed in place over time.
      slow: speed below which a cable counts as still [m/s].
    """

    def __init__(
        self,
        robot: Robot,
        geometry: Geometry,
        batch: Batch,
        terms: Sequence[Terms],
        memory: Memories,
        slow: float,
    ) -> None:
        cables, winches = len(geometry.rest), len(geometry.loads)
        self._tensions = grouped(terms, TensionEffect, cables)  # type: ignore[type-abstract]
        self._rates = grouped(terms, WinchEffect, winches)  # type: ignore[type-abstract]
        self.memory = memory
        self._geometry = geometry
        self._robot, self._dt, self._slow = robot, robot.timestep, slow
        self._drums = [winch.activation for winch in robot.winches]
        names = ("ten_length", "ten_velocity", "act")
        self._length, self._speed, self._act = (batch.bind(name)[: len(terms)] for name in names)
        self._none = np.zeros((len(terms), cables))
        alone = bool((geometry.loads.sum(axis=1) == 1).all())
        self._single = geometry.loads.argmax(axis=1) if alone else None
        self._winched = np.flatnonzero(geometry.activation >= 0)
        self._spools = geometry.activation[self._winched]
        self._rest = np.tile(geometry.rest, (len(terms), 1))
        self._told = robot.tension_driven
        self._stiffness = np.tile(geometry.stiffness, (len(terms), 1))

    @property
    def on_rates(self) -> bool:
        """True if an effect changes the rates of winches."""
        return bool(self._rates)

    @property
    def on_tensions(self) -> bool:
        """True if an effect changes the tensions of cables."""
        return bool(self._tensions)

    def cables(self) -> Cables:
        """Present state of all cables."""
        rest, stiffness = self._rest.copy(), self._stiffness
        spools = self._act.take(self._spools, axis=1)
        rest[:, self._winched] = self._length[:, self._winched] if self._told else spools
        elastic = stiffness * np.maximum(self._length - rest, 0.0)
        if self._told:
            elastic[:, self._winched] = spools
        return Cables(self._length, self._speed, rest, stiffness, elastic, self._dt, self._slow)

    def told(self, told: Floats, cables: Cables) -> Floats:
        """Equivalent commands for nominal winches (n, W) that move as these do under load."""
        now = self._act.take(self._drums, axis=1)
        winches = Winches(now, self._load(cables.elastic))
        rates, asked = self._robot.rates(now, told, self._dt), told
        for effect, rows, values in self._rates:
            slower = effect.rate(rates[rows], winches[rows], values)
            rates = _with(rates, rows, slower)
            asked = _with(asked, rows, self._robot.telling(now[rows], slower, self._dt))
        return asked

    def _load(self, elastic: Floats) -> Floats:
        """(n, W) tension of the tightest cable of each winch, from those of the springs (n, C)."""
        if self._single is not None:
            return elastic.take(self._single, axis=1)
        return np.asarray((elastic[:, None] * self._geometry.loads).max(axis=-1))

    def tension(self, cables: Cables) -> Floats:
        """(n, C) additional tension [N]: on taut cables only, never pushing, and within the
        winches' limits.
        """
        extra: Floats = self._none
        for effect, rows, values in self._tensions:
            held = self.memory[effect.name][rows] if effect.remembers else self._none[rows]
            added, after = effect.tension(cables[rows], held, values)
            extra = _with(extra, rows, extra[rows] + added)
            if effect.remembers:
                self.memory[effect.name][rows] = after
        pull = np.maximum(cables.elastic + self._geometry.damping * cables.speed, 0.0)
        spare = self._geometry.strongest - pull  # below 0 where the springs alone are too strong
        within = np.minimum(np.maximum(extra, -pull), spare) - np.minimum(spare, 0.0)
        return np.where(cables.taut, within, 0.0)


def _with(whole: Floats, rows: Rows, part: Floats) -> Floats:
    """The whole (n, ...) with some rows replaced; not copied if all rows are."""
    if isinstance(rows, slice):
        return part
    whole = whole.copy()
    whole[rows] = part
    return whole


def has_laws(terms: Sequence[Terms]) -> bool:
    """True if an effect has to be computed at every step."""
    return any(
        isinstance(term.effect, TensionEffect | WinchEffect) and not term.absent
        for each in terms
        for term in each
    )


def grouped(terms: Sequence[Terms], kind: type[E], width: int) -> list[Group[E]]:
    """Effects of a kind: the simulations that have them, and their values (rows, width).

    An effect is the same with factors of its parts and without: missing factors are one.
    """
    effects: dict[str, E] = {}
    found: dict[str, dict[int, list[Term]]] = {}
    for row, each in enumerate(terms):
        for term in each:
            if isinstance(term.effect, kind) and not term.absent:
                effect = effects.setdefault(term.effect.name, term.effect)
                if len(term.effect.parameters) > len(effect.parameters):
                    effects[effect.name] = term.effect
                found.setdefault(effect.name, {}).setdefault(row, []).append(term)
    groups: list[Group[E]] = []
    for effect in effects.values():
        by_row = found[effect.name]
        names = [parameter.name for parameter in effect.parameters]
        values: dict[str, Floats] = {name: np.zeros((len(by_row), width)) for name in names}
        for index, here in enumerate(by_row.values()):
            for term in here:
                where = slice(None) if term.place is None else term.place
                for name, value in term.named.items():
                    values[name][index, where] = value
        everywhere = len(by_row) == len(terms)  # a slice copies nothing
        rows = slice(None) if everywhere else np.array(list(by_row))
        groups.append((effect, rows, values))
    return groups
