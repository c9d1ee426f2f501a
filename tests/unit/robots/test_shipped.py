"""Numbers that the shipped robots must have."""

import numpy as np
import pytest

from flywheel.cli.models import open_plant
from flywheel.robots import load_robot


@pytest.mark.parametrize(
    ("name", "robot_mass", "inertia"),
    [
        ("prism3", 728.7, (215.783, 215.783, 2.948)),
        ("icosa6", 1457.4, (211.339, 211.339, 2.713)),
    ],
)
def test_rods_weigh_and_turn_as_published(name, robot_mass, inertia):
    robot = load_robot(name)
    assert sum(b.mass for b in robot.bodies) == pytest.approx(robot_mass)
    for body in robot.bodies:
        np.testing.assert_allclose(body.inertia, inertia, atol=1e-3)
        first, last = (robot.points[i].offset for i in body.points)
        assert np.linalg.norm(last - first) == pytest.approx(2.95)
    assert robot.length == pytest.approx(2.95)
    assert {p.radius for p in robot.points} == {0.175}


def test_prism3_is_strung_as_published() -> None:
    robot = load_robot("prism3")
    pairs = [tuple(sorted(end.point for end in cable.ends)) for cable in robot.cables]
    short = [(3, 5), (1, 3), (1, 5), (0, 2), (0, 4), (2, 4)]
    assert pairs == [*short, *short, (2, 5), (0, 3), (1, 4)]
    assert [c.winch for c in robot.cables] == [*range(6), *[-1] * 9]
    assert [c.stiffness for c in robot.cables] == [1e5] * 6 + [1e3] * 6 + [2e4] * 3
    assert [c.rest_length for c in robot.cables] == [1.5] * 6 + [0.65] * 6 + [1.3] * 3
    assert set(robot.control_high) == {0.645}
    ends = np.array([end.offset for cable in robot.cables for end in cable.ends])
    assert np.linalg.norm(ends[:, :2], axis=1).min() == pytest.approx(
        0.175, abs=1e-5
    )  # on the surface


def test_icosa6_is_strung_as_published_and_every_cable_has_a_winch() -> None:
    robot = load_robot("icosa6")
    published = (
        "0-10 1-4 2-6 1-3 4-8 2-5 5-6 7-11 7-8 0-9 9-10 3-11 0-8 0-4 1-10 3-10 9-11 7-9 2-4 1-2 3-6 "
        "6-11 5-7 5-8"
    )
    pairs = ["-".join(str(end.point) for end in cable.ends) for cable in robot.cables]
    assert pairs == published.split()
    assert [c.winch for c in robot.cables] == list(range(24))
    ends = np.bincount([end.point for cable in robot.cables for end in cable.ends])
    assert ends.tolist() == [4] * 12  # an icosahedron without its six rods' edges


def test_platform4_has_every_kind_of_winch() -> None:
    robot = load_robot("platform4")
    kinds = {w.name: (w.kind, len(w.cables), w.measured) for w in robot.winches}
    assert kinds == {
        "winch_fl": ("rate", 1, True),
        "winch_fr": ("rate", 1, False),
        "rear": ("position", 2, True),
    }
    offsets = np.array([p.offset for p in robot.points])
    assert np.linalg.matrix_rank(offsets - offsets.mean(axis=0)) == 2
    assert all(cable.ends[0].body == -1 for cable in robot.cables)


@pytest.mark.parametrize(
    ("dt", "step"), [(1 / 120, 1 / 240), (1 / 30, 1 / 210), (0.004, 0.004), (0.0083333333, 1 / 240)]
)
def test_commands_may_come_at_any_rate(dt: float, step: float) -> None:
    plant = open_plant("platform4", dt)
    assert plant.robot.timestep == pytest.approx(step, rel=1e-7)
    states = plant.simulate(plant.rest(), np.zeros((1, 3, len(plant.robot.winches)))).states
    assert states is not None and np.isfinite(states.qpos).all()
    assert load_robot("platform4").stepped(0.02).timestep == 0.005
