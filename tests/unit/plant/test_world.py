"""What is added to a robot's MJCF touches as its ground does, whatever else the MJCF says."""

import mujoco
import numpy as np
import pytest

from flywheel.dynamics.plant import AugmentedPlant, Plant
from flywheel.dynamics.plant.world import scene
from flywheel.effects import EFFECTS, Term
from flywheel.errors import ModelError
from flywheel.records import State
from flywheel.robots import Box, Robot, load_robot, read_robot
from flywheel.terrain import Terrain, with_boxes
from tests.physics.small_robots import hanging

DEEP, ABOVE = 0.003, 0.005  # where a ball begins: in the ground, or above one that attracts it [m]
PLATE = Box(center=(0.0, 0.0, 0.4), half_size=(2.0, 2.0, 0.1))
FLAT = Terrain(np.full((9, 9), 0.5), 0.5, (-2.0, -2.0))
GROUNDS = {
    "like any other": "",
    "slippery": 'friction="0.1 0.01 0.001"',
    "rough and alone to say so": 'friction="0.05 0.01 0.001" priority="3" condim="6"',
    "soft": 'solref="0.1 0.7" solmix="9" solimp="0.5 0.6 0.01 0.5 2"',
    "felt from afar": 'margin="0.02" gap="0.01"',
    "sticky": 'adhesion="30"',
    "magnetic": 'adhesion="30" gap="0.01"',
    "of its own kind": 'contype="4" conaffinity="2"',
    "of another kind": 'contype="4" conaffinity="0"',
    "listed in a pair": 'contype="0" conaffinity="0"',
}
BALL = {
    "of its own kind": 'contype="2" conaffinity="8"',
    "of another kind": 'contype="8" conaffinity="4"',
    "listed in a pair": 'contype="0"',
}
PAIR = """<contact> <pair geom1="ball" geom2="ground" condim="6" friction="2 1 0.1 0.2 0.3"
  solref="-900 -30" margin="0.01"/> </contact> <tendon>"""


def standing(ground: str) -> Robot:
    """A ball on a cable, above a ground with such numbers, under defaults that nobody asked for."""
    xml = hanging(z=0.1 + (ABOVE if ground == "magnetic" else -DEEP), rest=2.5).xml
    edits = [
        ("<geom friction", '<geom contype="8" conaffinity="4" priority="5" margin="0.1" friction'),
        (
            '<geom type="plane"',
            f'<geom name="ground" type="plane" {with_numbers(GROUNDS[ground])}',
        ),
        ('<geom name="bob"', f'<geom name="ball" {with_numbers(BALL.get(ground, ""))}'),
    ]
    if ground == "listed in a pair":
        edits.append(("<tendon>", PAIR))
    for old, new in edits:
        assert old in xml
        xml = xml.replace(old, new)
    return read_robot(xml)


def with_numbers(said: str) -> str:
    """What is said, and MuJoCo's own numbers for what the defaults would say."""
    own = {"contype": "1", "conaffinity": "1", "priority": "0", "margin": "0"}
    return " ".join((said, *(f'{k}="{v}"' for k, v in own.items() if f"{k}=" not in said)))


def contacts(robot: Robot, height: float, **around) -> tuple[list[tuple[float, ...]], np.ndarray]:
    """Numbers of the ball's contacts, without their place, and its acceleration."""
    model = scene(robot, **around).compile()
    data = mujoco.MjData(model)
    data.qpos[:] = robot.keyframe.qpos
    data.qpos[2] += height
    data.qvel[:2] = 0.3, 0.1  # it slides
    data.act[:] = 9.0  # the cable hangs slack
    mujoco.mj_forward(model, data)
    found = [
        (c.dim, round(c.dist, 9), c.includemargin, *c.friction, *c.solref, *c.solimp)
        for c in data.contact
    ]
    return found, data.qacc.copy()


@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize(
    "around", [{"terrain": with_boxes(None, [PLATE])}, {"terrain": FLAT}], ids=["box", "terrain"]
)
def test_an_obstacle_and_a_terrain_touch_as_the_ground_does(ground: str, around: dict) -> None:
    robot = standing(ground)
    wanted, falling = contacts(robot, 0.0)
    got, here = contacts(robot, 0.5, **around)
    assert len(wanted) == 1 and set(got) == set(wanted)
    # A height field may touch in several triangles; a box in one place.
    if len(got) == 1:
        np.testing.assert_allclose(here, falling, rtol=1e-6, atol=1e-6)


def test_without_a_ground_an_obstacle_has_mujocos_own_numbers() -> None:
    xml = standing("slippery").xml
    start = xml.index('<geom name="ground"')
    robot = read_robot(xml[:start] + xml[xml.index("/>", start) + 2 :])
    spec = scene(robot, with_boxes(None, [PLATE]))
    box, own = spec.geoms[0], mujoco.MjSpec().worldbody.add_geom()
    assert box.type == mujoco.mjtGeom.mjGEOM_BOX
    for name in ("contype", "conaffinity", "priority", "condim", "margin"):
        assert getattr(box, name) == getattr(own, name)
    assert [*box.friction, *box.solref] == [*own.friction, *own.solref]


def test_a_terrain_takes_the_place_of_a_ground_in_a_turned_frame() -> None:
    plain = hanging(z=1.0, rest=2.0).xml
    ground = '<geom type="plane" size="9 9 .1"/>'
    nested = (
        '<body pos="1 2 3" euler="90 0 0"> <frame pos="0 0 1" euler="-90 0 0">'
        '<geom type="plane" size="9 9 .1" pos="0 0 -3"/> </frame> </body>'
    )
    there = [
        scene(read_robot(xml), terrain=FLAT).compile()
        for xml in (plain, plain.replace(ground, nested))
    ]
    for model in there:
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        plane = int(np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)[0])
        assert data.geom_xpos[plane, 2] == pytest.approx(FLAT.plane)
        np.testing.assert_allclose(data.geom_xmat[plane].reshape(3, 3)[:, 2], [0, 0, 1], atol=1e-12)


@pytest.mark.parametrize("turn", ['euler="5 0 0"', 'zaxis="0.1 0 1"', 'xyaxes="1 0 0.1 0 1 0"'])
def test_a_terrain_takes_the_place_of_no_slope(turn: str) -> None:
    xml = hanging().xml.replace('size="9 9 .1"', f'size="9 9 .1" {turn}')
    with pytest.raises(ModelError, match="level ground plane"):
        scene(read_robot(xml), terrain=FLAT)


def felt(robot: Robot) -> np.ndarray:
    """Where friction of the cables takes a robot."""
    augmented = AugmentedPlant(Plant(robot))
    start = augmented.plant.rest()
    speed = np.random.default_rng(3).normal(size=start.qvel.shape)
    controls = np.repeat(robot.control_high[None, None] / 2, 20, axis=1)
    term = Term(EFFECTS["cable_friction"], None, (20.0,))
    return augmented.simulate(State(start.qpos, speed, start.act), controls, [(term,)]).points


def test_effects_pull_where_the_mjcf_switches_their_group_of_actuators_off() -> None:
    xml = hanging(damping=3.0).xml
    switched = xml.replace("<option", '<option actuatorgroupdisable="0 2"').replace(
        '<general name="winch"', '<general name="winch" group="1"'
    )
    robots = [read_robot(each) for each in (xml, switched)]
    assert np.array_equal(*map(felt, robots))


def test_what_is_only_looked_at_may_be_anywhere() -> None:
    robot = load_robot("prism3")
    lit = robot.xml.replace('<light name="sun"', '<light name="sun" texture="ground"')
    shiny = lit.replace('class="cable"', "").replace("<site ", '<site material="red" ', 1)
    assert np.array_equal(felt(read_robot(shiny)), felt(robot))
