"""Names in a picture of a robot are where its parts are drawn."""

import numpy as np
import pytest

from flywheel.dynamics.plant.portrait import SHOT, portrait
from flywheel.robots import load_robot, read_robot

MJCF = load_robot("platform4").xml


@pytest.mark.parametrize("name", ["front", "left", "right"])
def test_a_point_s_name_is_where_its_marker_is_drawn(name: str) -> None:
    marker = f'name="marker_{name}" class="marker"'
    assert marker in MJCF
    robot = read_robot(MJCF.replace(marker, f'{marker} rgba="1 0 1 1" material=""'))
    pixels, labels = portrait(robot)
    red, green, blue = (pixels[..., i].astype(float) for i in range(3))
    rows, columns = np.nonzero((red > 2 * green + 20) & (blue > 2 * green + 20))
    (at,) = (label.at for label in labels if (label.kind, label.text) == ("point", name))
    assert len(rows) > 5
    np.testing.assert_allclose([columns.mean(), rows.mean()], at, atol=5)


def test_every_part_has_a_name_within_the_picture() -> None:
    robot = read_robot(MJCF)
    _, labels = portrait(robot)
    assert len(labels) == len(robot.bodies) + len(robot.cables) + len(robot.points)
    assert all(((label.at >= 0) & (label.at < SHOT.size)).all() for label in labels)
    driven = {label.text for label in labels if label.kind == "cable"}
    assert {
        f"{c.name} ({robot.winches[c.winch].name})" for c in robot.cables if c.winch >= 0
    } <= driven
