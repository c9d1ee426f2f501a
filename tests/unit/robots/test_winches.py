"""Which actuators are a winch, and where it is."""

from pathlib import Path

import numpy as np
import pytest

from flywheel.dynamics.plant import Plant
from flywheel.robots import read_robot

XML = (Path(__file__).parents[2] / "contracts/robots/seesaw.xml").read_text()


@pytest.mark.parametrize(("measured", "at"), [("west_reel", 1.45), ("east_reel", 1.55)])
def test_a_winch_of_several_cables_is_where_the_measured_one_is(measured: str, at: float) -> None:
    robot = read_robot(XML.replace('objname="east_reel" dim', f'objname="{measured}" dim'))
    winch, plant = robot.winches[0], Plant(robot)
    assert (winch.name, winch.sensor) == ("both", "reel_position")
    assert plant.winch(plant.rest())[0, 0] == at
    assert robot.cables[winch.cables[0]].rest_length == at
    low, high = winch.rest_range
    assert np.isclose([low, high], [at - 0.95, at + 0.55]).all()
