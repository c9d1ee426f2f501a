"""Symmetries: found by the robot's numbers, and true of its motion."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from flywheel.dynamics.plant import Plant, RestartedPlant
from flywheel.records import Observation, Past
from flywheel.robots import load_robot, symmetries_of


@pytest.mark.parametrize(("name", "count"), [("prism3", 3), ("icosa6", 12), ("platform4", 1)])
def test_a_robot_has_its_symmetries_and_each_two_of_them_make_another(
    name: str, count: int
) -> None:
    found = symmetries_of(load_robot(name))
    for orders in (found.points, found.winches):
        listed = {tuple(order) for order in orders.tolist()}
        assert len(listed) == len(orders) == count
        assert tuple(orders[0]) == tuple(range(orders.shape[1]))
        assert all(tuple(first[second].tolist()) in listed for first in orders for second in orders)


UPSIDE_DOWN = ([1, 0, 5, 4, 3, 2], [4, 5, 3, 2, 0, 1])  # prism3's cables, but not its motors


@pytest.mark.parametrize("name", ["prism3", "icosa6"])
def test_a_robot_moves_the_same_whatever_side_is_listed_first(name: str) -> None:
    robot = load_robot(name)
    plant, found = Plant(robot, 0.01), symmetries_of(robot)
    limits, rng = (robot.control_low, robot.control_high), np.random.default_rng(0)
    controls = np.repeat(rng.uniform(*limits, (1, 6, len(robot.winches))), 25, 1)
    track = plant.simulate(plant.rest(1), controls)
    assert track.states is not None
    points, winch, now = track.observations.points, plant.winch(track.states), slice(10, 31)

    def predicted(order: Any, winches: Any) -> np.ndarray:
        """(T, P, 3) from a moment of the motion on, with the parts in another order."""
        known = winch[:, now][..., winches]
        seen = Observation(points[:, now][:, :, order], known)
        past = Past(seen, controls[:, 10:30][..., winches], known)
        model = RestartedPlant(plant, 1, roll="relaxed")
        return np.asarray(model.rollout(past, controls[:, 30:][..., winches]).points[0, 1:])

    def beside(order: Any, winches: Any) -> float:
        apart = np.linalg.norm(predicted(order, winches) - given[:, order], axis=-1)
        return float(apart.mean() / robot.length)

    given = predicted(found.points[0], found.winches[0])
    assert max(map(beside, found.points, found.winches)) < 0.005
    if name == "prism3":
        assert beside(*UPSIDE_DOWN) > 0.05


@pytest.mark.parametrize("part", ["stiffness", "mass", "place", "range"])
def test_a_robot_with_one_other_part_has_none(part: str) -> None:
    robot = load_robot("prism3")
    cable, body, winch = robot.cables[0], robot.bodies[0], robot.winches[0]
    end = replace(cable.ends[1], offset=cable.ends[1].offset + 0.03 * robot.length)
    changed = {
        "stiffness": {
            "cables": (replace(cable, stiffness=1.1 * cable.stiffness), *robot.cables[1:])
        },
        "mass": {"bodies": (replace(body, mass=1.1 * body.mass), *robot.bodies[1:])},
        "place": {"cables": (replace(cable, ends=(cable.ends[0], end)), *robot.cables[1:])},
        "range": {"winches": (replace(winch, control_range=(-0.1, 0.1)), *robot.winches[1:])},
    }
    assert len(symmetries_of(replace(robot, **changed[part])).points) == 1
