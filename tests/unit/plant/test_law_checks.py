"""Promises of effects: ours keep them, and a law that breaks one is told which."""

from pathlib import Path

import pytest

from flywheel.dynamics.plant import Plant
from flywheel.dynamics.plant.law_checks import check_laws
from flywheel.effects import NAMED
from flywheel.effects.own import LawFile
from flywheel.errors import ConfigError
from flywheel.robots import load_robot
from tests import own_laws

PRISM = Plant(load_robot("prism3"))
HEAD = """
import numpy as np
from flywheel.effects import CommandEffect, ModelEffect, Parameter, TensionEffect, WinchEffect

class Said:
    equation, source, shown_by = "x", "y", "z"
    sizes = (Parameter("a", "-", lambda s: 0.1),)
"""
TENSION = "\nclass Law(Said, TensionEffect):\n    name = 'law'\n"
WINCH = "\nclass Law(Said, WinchEffect):\n    name = 'law'\n"
COMMAND = "\nclass Law(Said, CommandEffect):\n    name, stage = 'law', 1\n"
MODEL = "\nclass Law(Said, ModelEffect):\n    name = 'law'\n"
RATE = "    def rate(self, rate, winches, values):\n"
PULL = "    def tension(self, cables, memory, values):\n"
TOLD = "    def command(self, controls, values, robot, dt):\n"
EDIT = "    def edit(self, model, robot, place, values):\n"


@pytest.mark.parametrize("robot", ["prism3", "platform4"])
def test_effects_of_the_package_keep_what_law_files_are_asked_for(robot: str) -> None:
    check_laws(NAMED.values(), Plant(load_robot(robot)))


def test_a_law_of_ones_own_keeps_it_too(tmp_path: Path) -> None:
    check_laws(LawFile.read(own_laws.law_file(tmp_path)).effects().values(), PRISM)


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (WINCH + RATE + "        return rate + 0.01", "changes rates although its sizes are zero"),
        (TENSION + PULL + "        return 1 + 0 * memory, memory", "changes tensions although"),
        (COMMAND + TOLD + "        return 0.9 * controls", "changes commands although"),
        (MODEL + EDIT + "        model.opt.gravity[2] = -5.0", "changes the model although"),
        (
            WINCH + RATE + "        return rate / values['a']",
            "returns rates that are not finite, with a 0",
        ),
        (
            TENSION + PULL + "        return 0 * memory / cables.elastic, memory",
            "tensions that are not fin",
        ),
        (
            TENSION
            + "    remembers = True\n"
            + PULL
            + "        return np.zeros_like(memory), np.log(memory)",
            "returns memories that are not finite",
        ),
        (
            MODEL + EDIT + "        model.body_mass[1] /= values['a']",
            "makes .* not finite, with a 0",
        ),
        (
            WINCH + RATE + "        return rate[:, 0]",
            r"returns rates of the shape \(4, 5\); \(4, 5, 6\) is",
        ),
        (WINCH + RATE + "        return 1.0", r"returns rates of the shape \(4,\); \(4, 5, 6\) is"),
        (
            TENSION + PULL + "        return 0 * memory",
            "must return a tension and the memory at the next instant, as a tuple of two arrays; got arr",
        ),
        (
            WINCH + RATE + "        rate *= 1 + values['a']\n        return rate",
            "raises ValueError in line 12.*read-only",
        ),
        (
            WINCH + RATE + "        return 'fast'",
            "returns rates that are not an array of numbers: 'fast'",
        ),
        (WINCH + RATE + "        return rate * values['b']", "raises KeyError in line 12: 'b'"),
        (
            WINCH + RATE + "        return rate * (1 + values['a'] * np.sign(rate.mean()))",
            "returns other rates when fewer simulations",
        ),
        (
            WINCH + RATE + "        self.n = getattr(self, 'n', 0) + 1\n"
            "        return rate * (1 + values['a'] * (self.n % 7))",
            "returns other rates when fewer simulations",
        ),
    ],
)
def test_a_law_that_breaks_a_promise_is_refused(tmp_path: Path, law: str, message: str) -> None:
    file = LawFile.read(own_laws.law_file(tmp_path, HEAD + law + "\n"))
    with pytest.raises(ConfigError, match=message) as caught:
        check_laws(file.effects().values(), PRISM)
    assert str(caught.value).startswith("law of my_laws.py ") and "\n" not in str(caught.value)
