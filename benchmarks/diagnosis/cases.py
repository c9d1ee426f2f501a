"""The list of cases for the examination of a diagnosis."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from flywheel.errors import ConfigError
from flywheel.registry import lookup
from flywheel.robots import Robot
from flywheel.truth_simulator import HIDDEN, OTHER_FORMS, OUTSIDE, UNKNOWN_LAWS, AsBuilt
from flywheel.truth_simulator.contact import Contact
from flywheel.truth_simulator.effect import HiddenEffect
from flywheel.truth_simulator.measurement import Measurement
from flywheel.truth_simulator.recording import HiddenRecording, record
from flywheel.truth_simulator.scripts import SCRIPTS

Group = Literal[
    "none", "single", "pairs", "triples", "outside", "hard",
    "messy-none", "messy-single", "messy-pairs", "forms",
]  # fmt: skip
GROUPS: tuple[Group, ...] = ("none", "single", "pairs", "triples", "outside", "hard")
# Robots whose every number is a little off, and laws that the library does not have.
MESSY_GROUPS: tuple[Group, ...] = ("messy-none", "messy-single", "messy-pairs", "forms")
SIZES = (0.5, 1.0, 2.0)
SECONDS = 3.0
PLAIN = Measurement()
HARD = {
    "dropout": Measurement(dropout=0.2, burst=0.1),
    "swapped": Measurement(swap=True),
    "50hz": Measurement(dt=0.02),
}
TOLD = ("cable_stiffness", "mass")
UNSURE = 0.03  # standard deviation of what is told
# Two causes that are easily told apart, and two that are easily taken for one another.
PAIRS = (
    ("cable_damping", "winch_gain"),
    ("creep", "ground_friction"),
    ("weak_cable", "payload"),
    ("slope", "command_delay"),
    ("cable_friction", "capstan"),
    ("sensor_latency", "torque_speed"),
    ("winch_backlash", "actuator_lag"),
    ("cable_damping", "air_drag"),
    ("stiffening", "torque_speed"),
    ("hysteresis", "winch_gain"),
    ("payload", "cable_friction"),
    ("marker_offset", "actuator_lag"),
)
TRIPLES = (
    ("cable_damping", "winch_gain", "payload"),
    ("creep", "ground_friction", "sensor_latency"),
    ("weak_cable", "payload", "cable_friction"),
    ("slope", "winch_gain", "hysteresis"),
    ("capstan", "actuator_lag", "payload"),
    ("winch_backlash", "ground_friction", "stiffening"),
    ("torque_speed", "cable_damping", "marker_offset"),
    ("hysteresis", "slope", "command_delay"),
    ("air_drag", "winch_gain", "weak_cable"),
    ("actuator_lag", "cable_friction", "slope"),
    ("stiffening", "payload", "winch_gain"),
    ("marker_offset", "creep", "torque_speed"),
)


@dataclass(frozen=True)
class Plan:
    """One recording to make.

    Attributes:
      script: name of the command script.
      seed: of commands and noise.
      seconds: duration [s].
    """

    script: str
    seed: int
    seconds: float = SECONDS


@dataclass(frozen=True)
class Recorded:
    """The recordings of a case.

    Attributes:
      fit: for the diagnosis.
      held_out: for the evaluation.
    """

    fit: tuple[HiddenRecording, ...]
    held_out: HiddenRecording


@dataclass(frozen=True)
class Case:
    """One question: the difference of this robot from its MJCF.

    Attributes:
      name: stable, "prism3.single.creep.x2.s0".
      robot: name of the robot.
      group: kind of question.
      effects: hidden in all of its recordings, with the same values.
      built: additional deviations in all its numbers; None without any.
      fit: recordings for the diagnosis.
      held_out: recording for the evaluation; another script, other seeds.
      measurement: of all recordings.
      contact: kind of ground contact of the truth.
      told: the examinee's knowledge of the robot, as scales of the truth; each may be wrong by some
        `UNSURE`.
    """

    name: str
    robot: str
    group: Group
    effects: tuple[HiddenEffect, ...]
    fit: tuple[Plan, ...]
    held_out: Plan
    measurement: Measurement = PLAIN
    contact: Contact = "elliptic"
    told: Mapping[str, float] = field(default_factory=dict)
    built: AsBuilt | None = None

    def record(self, robot: Robot) -> Recorded:
        """Simulate and measure its recordings.

        Raises:
          ConfigError: another robot.
        """
        if robot.name != self.robot:
            raise ConfigError(f"The case {self.name} is about {self.robot}, got {robot.name}.")
        made = [
            record(
                robot,
                (*self.effects, *((self.built,) if self.built else ())),
                script_name=plan.script,
                seconds=plan.seconds,
                seed=plan.seed,
                measurement=self.measurement,
                contact=self.contact,
            )
            for plan in (*self.fit, self.held_out)
        ]
        return Recorded(tuple(made[:-1]), made[-1])


def cases(
    robot: Robot,
    groups: Sequence[Group] = GROUPS,
    sizes: Sequence[float] = SIZES,
    seeds: Sequence[int] = (0, 1, 2),
    contact: Contact = "elliptic",
    spread: float = 1.0,
) -> list[Case]:
    """All cases of the groups for a robot, in a fixed order.

    A case depends on its own name only, never on the other cases; cases that differ in size alone
    have the same places, scripts and noise. Effects without influence on the robot are left out.

    Args:
      sizes: multiples of the typical size, for the groups "single" and "messy-single".
      spread: factor on `Spread` for messy robots.

    Raises:
      UnknownNameError: no such group.
    """
    made = [
        replace(case, contact=contact)
        for group in groups
        for seed in seeds
        for case in lookup(_MAKERS, group, "group of cases")(robot, seed, tuple(sizes))
    ]
    return [
        case if case.built is None else replace(case, built=case.built.scaled(spread))
        for case in made
    ]


def _none(robot: Robot, seed: int, sizes: tuple[float, ...]) -> Iterator[Case]:
    yield _case(robot, "none", "nothing", seed, ())


def _single(robot: Robot, seed: int, sizes: tuple[float, ...]) -> Iterator[Case]:
    for name, kind in HIDDEN.items():
        if kind.applies(robot):
            for size in sizes:
                yield _case(robot, "single", name, seed, (kind,), size)


def _pairs(robot: Robot, seed: int, sizes: tuple[float, ...]) -> Iterator[Case]:
    return _together(robot, "pairs", PAIRS, seed)


def _triples(robot: Robot, seed: int, sizes: tuple[float, ...]) -> Iterator[Case]:
    return _together(robot, "triples", TRIPLES, seed)


def _together(
    robot: Robot, group: Group, sets: Sequence[tuple[str, ...]], seed: int
) -> Iterator[Case]:
    for names in sets:
        kinds = tuple(HIDDEN[name] for name in names)
        if all(kind.applies(robot) for kind in kinds):
            yield _case(robot, group, "+".join(names), seed, kinds)


def _outside(robot: Robot, seed: int, sizes: tuple[float, ...]) -> Iterator[Case]:
    for name, kind in OUTSIDE.items():
        if kind.applies(robot):
            yield _case(robot, "outside", name, seed, (kind,))


def _hard(robot: Robot, seed: int, sizes: tuple[float, ...]) -> Iterator[Case]:
    able = [name for name, kind in HIDDEN.items() if kind.applies(robot)]
    for trouble, measurement in HARD.items():
        name = able[_digest(f"{robot.name}.{trouble}.s{seed}") % len(able)]
        case = _case(robot, "hard", f"{trouble}.{name}", seed, (HIDDEN[name],))
        yield replace(case, measurement=measurement)
    name = able[_digest(f"{robot.name}.calibration.s{seed}") % len(able)]
    case = _case(robot, "hard", f"calibration.{name}", seed, (HIDDEN[name],))
    rng = np.random.default_rng(_digest(case.name))
    yield replace(case, told={number: float(np.exp(rng.normal(0.0, UNSURE))) for number in TOLD})


def _messy_none(robot: Robot, seed: int, sizes: tuple[float, ...]) -> Iterator[Case]:
    yield _messy(_case(robot, "messy-none", "nothing", seed, ()), robot)


def _messy_single(robot: Robot, seed: int, sizes: tuple[float, ...]) -> Iterator[Case]:
    for name, kind in HIDDEN.items():
        if kind.applies(robot):
            for size in sizes:
                yield _messy(_case(robot, "messy-single", name, seed, (kind,), size), robot)


def _messy_pairs(robot: Robot, seed: int, sizes: tuple[float, ...]) -> Iterator[Case]:
    for case in _together(robot, "messy-pairs", PAIRS, seed):
        yield _messy(case, robot)


def _forms(robot: Robot, seed: int, sizes: tuple[float, ...]) -> Iterator[Case]:
    for name, kind in {**OTHER_FORMS, **UNKNOWN_LAWS}.items():
        if kind.applies(robot):
            yield _case(robot, "forms", name, seed, (kind,))


def _messy(case: Case, robot: Robot) -> Case:
    """The same question about a robot with small errors in all numbers, independent of its size."""
    name = ".".join(part for part in case.name.split(".") if not part.startswith("x"))
    rng = np.random.default_rng(_digest(f"built {name}"))
    return replace(case, built=AsBuilt.typical(robot, rng))


_MAKERS = {
    "none": _none,
    "single": _single,
    "pairs": _pairs,
    "triples": _triples,
    "outside": _outside,
    "hard": _hard,
    "messy-none": _messy_none,
    "messy-single": _messy_single,
    "messy-pairs": _messy_pairs,
    "forms": _forms,
}


def _case(
    robot: Robot,
    group: Group,
    what: str,
    seed: int,
    kinds: tuple[type[HiddenEffect], ...],
    size: float | None = None,
) -> Case:
    name = f"{robot.name}.{group}.{what}{'' if size is None else f'.x{size:g}'}.s{seed}"
    rng = np.random.default_rng(_digest(f"{robot.name}.{group}.{what}.s{seed}"))
    effects = tuple(
        kind.typical(robot, rng).scaled(1.0 if size is None else size) for kind in kinds
    )
    scripts = rng.permutation(list(SCRIPTS))[:3]
    plans = [Plan(str(script), int(rng.integers(2**31))) for script in scripts]
    return Case(name, robot.name, group, effects, tuple(plans[:2]), plans[2])


def _digest(text: str) -> int:
    return zlib.crc32(text.encode())
