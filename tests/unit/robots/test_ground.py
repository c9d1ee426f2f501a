"""Which plane is the ground, however many there are and wherever they stand in the MJCF."""

from itertools import permutations

import mujoco
import numpy as np
import pytest

from flywheel.robots import Ground, collides, ground_of, read_robot
from tests.physics.small_robots import hanging

PLANES = {
    "cellar": '<geom name="cellar" type="plane" size="9 9 .1" pos="0 0 -3"/>',
    "floor": '<body pos="0 0 1"> <geom name="floor" type="plane" size="9 9 .1" pos="1 2 -.5" euler="0 0 7"/> '
    "</body>",
    "wall": '<geom name="wall" type="plane" size="9 9 .1" pos="-5 0 0" zaxis="1 0 0"/>',
    "carpet": '<geom name="carpet" type="plane" size="9 9 .1" pos="0 0 2" contype="0" conaffinity="0"/>',
}


def ground_among(*planes: str, listed: str = "") -> tuple[mujoco.MjModel, Ground | None]:
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody>{"".join(planes)}
          <body><freejoint/><geom name="ball" size=".1"/></body></worldbody>
          <contact>{listed}</contact></mujoco>"""
    )
    return model, ground_of(model)


@pytest.mark.parametrize("names", list(permutations(PLANES)), ids="-".join)
def test_it_is_the_highest_level_plane_that_can_be_touched(names: tuple[str, ...]) -> None:
    model, ground = ground_among(*(PLANES[name] for name in names))
    assert ground is not None and ground.level
    assert model.geom(ground.geom).name == "floor"
    assert ground.height == pytest.approx(0.5)
    np.testing.assert_allclose(ground.place, [1, 2, 0.5])


def test_a_wall_alone_is_a_ground_that_is_not_level() -> None:
    _, ground = ground_among(PLANES["wall"])
    assert ground is not None and not ground.level


def test_what_cannot_be_touched_is_no_ground_unless_it_is_listed_in_a_pair() -> None:
    assert ground_among(PLANES["carpet"])[1] is None
    model, ground = ground_among(PLANES["carpet"], listed='<pair geom1="carpet" geom2="ball"/>')
    assert ground is not None and collides(model)[ground.geom]
    xml = hanging().xml.replace('size="9 9 .1"', 'size="9 9 .1" contype="0" conaffinity="0"')
    assert not read_robot(xml).grounded
