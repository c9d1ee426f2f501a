"""Cases of the regression slice: short commands whose answers cover most of the code."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flywheel.robots import load_robot
from flywheel.truth_simulator import hidden_effect
from flywheel.truth_simulator.measurement import Measurement
from flywheel.truth_simulator.recording import record

SECONDS = 1.5  # of a recording: two windows of the smallest robot
PLAIN = Measurement()


@dataclass(frozen=True)
class Log:
    """One log to make with the truth simulator.

    Attributes:
      effects: hidden effects, name -> multiple of their typical size.
      robot: name of a shipped robot.
      script: name of the command script.
      seed: of commands, places and noise.
      seconds: duration [s].
      measurement: its settings.
    """

    effects: dict[str, float]
    robot: str = "prism3"
    script: str = "random_steps"
    seed: int = 0
    seconds: float = SECONDS
    measurement: Measurement = PLAIN

    def write(self, folder: Path, name: str) -> Path:
        """Write `name`.csv, and return its path."""
        robot = load_robot(self.robot)
        hidden = tuple(
            hidden_effect(effect).typical(robot, np.random.default_rng(self.seed)).scaled(size)
            for effect, size in self.effects.items()
        )
        made = record(
            robot,
            hidden,
            script_name=self.script,
            seconds=self.seconds,
            seed=self.seed,
            measurement=self.measurement,
        )
        return made.write(folder, name, robot)[0]


@dataclass(frozen=True)
class Case:
    """One command that writes an answer as JSON.

    Attributes:
      name: of the case.
      logs: that it is about.
      command: from those logs' paths and the path of the smoke run to the command's arguments.
      needs_run: it is about the smoke run's network.
    """

    name: str
    logs: tuple[Log, ...]
    command: Callable[[list[Path], Path], list[str]]
    needs_run: bool = False


def _diagnosis(name: str, *logs: Log, options: str = "", held_out: bool = False) -> Case:
    def command(paths: list[Path], run: Path) -> list[str]:
        seen, judged = (paths[:-1], paths[-1:]) if held_out else (paths, [])
        words = ["diagnose", *map(str, seen), "--robot", logs[0].robot, *options.split()]
        for path in judged:
            words += ["--held-out", str(path)]
        return [*words, "--threads", "1"]

    return Case(name, logs, command)


def _of_network(paths: list[Path], run: Path) -> list[str]:
    effects = "cable_damping,winch_gain,payload,command_delay"
    options = f"--robot prism3 --model {run} --effects {effects} --threads 1"
    return ["diagnose", *map(str, paths), *options.split()]


def _comparison(paths: list[Path], run: Path) -> list[str]:
    options = f"--robot prism3 --model plant --model net={run} --horizon 0.5 --draws 40 --threads 1"
    return ["compare", *map(str, paths), *options.split()]


def _power(paths: list[Path], run: Path) -> list[str]:
    return ["power", str(paths[0]), *["--robot", "prism3", "--threads", "1"]]


def _design(paths: list[Path], run: Path) -> list[str]:
    options = "--robot prism3 --seconds 1.5 --candidates 4 --threads 1"
    return ["design", "cable_damping", "stiffening", *options.split(), "--out", "commands.csv"]


FEW = "cable_friction,cable_damping,winch_gain,payload,slope"
WINCH = "sensor_latency,command_delay,actuator_lag,winch_gain,winch_backlash"

CASES: tuple[Case, ...] = (
    _diagnosis("nothing", Log({})),
    _diagnosis("one-effect", Log({"winch_gain": 1.0}, seed=7)),
    _diagnosis("placed", Log({"weak_cable": 2.0}, seed=3)),
    _diagnosis(
        "two-effects",
        Log({"cable_damping": 2.0, "winch_gain": 2.0}, seed=1),
        options=f"--effects {FEW}",
    ),
    _diagnosis(
        "ambiguous",
        Log({"command_delay": 2.0}, "platform4", seed=5),
        options=f"--effects {WINCH}",
    ),
    _diagnosis(
        "memory",
        Log({"hysteresis": 2.0}, "platform4", "slow_sine", seed=2),
        options="--effects hysteresis,creep,cable_friction,winch_backlash",
    ),
    _diagnosis(
        "winches",
        Log({"actuator_lag": 1.0}, "platform4", seed=4),
        options=f"--effects {WINCH}",
    ),
    _diagnosis(
        "outside",
        Log({"quadratic_damping": 3.0}, seed=6),
        options="--effects winch_gain,payload,weak_cable",
    ),
    _diagnosis(
        "another-law",
        Log({"cable_friction": 3.0}, seed=8),
        options="--effects cable_damping,winch_gain",
    ),
    _diagnosis(
        "unsure",
        Log({"payload": 1.0}, seed=9),
        options=f"--effects {FEW} --unsure cable_stiffness=5% --unsure body_mass=3%",
    ),
    _diagnosis(
        "held-out",
        Log({"payload": 2.0}, seed=10, measurement=Measurement(dropout=0.2, burst=0.1)),
        Log({"payload": 2.0}, seed=10, script="slow_sine"),
        Log({"payload": 2.0}, seed=10, script="pretension"),
        options=f"--effects {FEW}",
        held_out=True,
    ),
    _diagnosis(
        "six-rods",
        Log({"ground_friction": 2.0}, "icosa6", seed=11),
        options="--effects ground_friction,winch_gain,slope",
    ),
    Case("network", (Log({"cable_damping": 3.0}, seed=12, seconds=3.0),), _of_network, True),
    Case("comparison", (Log({"winch_gain": 2.0}, seed=13, seconds=2.0),), _comparison, True),
    Case("power", (Log({}, seed=14),), _power),
    Case("design", (), _design),
)
