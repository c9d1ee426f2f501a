"""Structures that are no MJCF become robots in metres with z up, at the tensions that they ask for."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
import yaml

from flywheel.errors import MjcfError
from flywheel.options import AdaptOptions
from flywheel.robots import read_robot
from flywheel.robots.adapt import Adapted, adapt
from flywheel.robots.mjcf_source import compiled

# A prism of three rods in decimetres, y up, as NTRT has it: triangles turned by 150 degrees.
ANGLES = np.deg2rad([0, 120, 240])
NODES = {f"low{i}": [5 * np.cos(a), 0.0, 5 * np.sin(a)] for i, a in enumerate(ANGLES)} | {
    f"top{i}": [5 * np.cos(a + 5 / 6 * np.pi), 8.0, 5 * np.sin(a + 5 / 6 * np.pi)]
    for i, a in enumerate(ANGLES)
}
STRINGS = [[f"{at}{i}", f"{at}{(i + 1) % 3}"] for at in ("low", "top") for i in range(3)] + [
    [f"low{(i + 1) % 3}", f"top{i}"] for i in range(3)
]
NET = {
    "nodes": {name: [float(x) for x in place] for name, place in NODES.items()},
    "pair_groups": {"rod": [[f"low{i}", f"top{i}"] for i in range(3)], "string": STRINGS},
    "builders": {
        "rod": {"class": "tgRodInfo", "parameters": {"density": 0.5, "radius": 0.2}},
        "string": {
            "class": "tgBasicActuatorInfo",
            "parameters": {"stiffness": 1000, "damping": 20, "pretension": 400, "history": True},
        },
    },
}
PLATFORM = {
    "mass": 2.0,
    "position": [0, 0, 1.0],
    "exit_points": [[x, y, 2] for x in (-1, 1) for y in (-1, 1)],
    "attachment_points": [[0.1 * x, 0.1 * y, 0.05] for x in (-1, 1) for y in (-1, 1)],
    "cables": {"stiffness": 5000, "damping": 30, "pretension": 12},
}


def made(values: object, folder: Path, name: str = "robot.yaml", **options: str) -> Adapted:
    path = folder / name
    path.write_text(json.dumps(values) if name.endswith("json") else yaml.safe_dump(values))
    return adapt(path, AdaptOptions(**options))


def at_start(xml: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = compiled(xml)[2]
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return model, data


def test_nodes_in_decimetres_become_a_robot_with_the_tension_that_was_asked_for(tmp_path):
    result = made(NET, tmp_path)
    assert result.left == ()
    twice = made(
        NET | {"pair_groups": NET["pair_groups"] | {"string": STRINGS + STRINGS}}, tmp_path
    )
    assert twice.left == () and len(read_robot(twice.xml).winches) == 18
    robot = read_robot(result.xml)
    assert len(robot.bodies) == 3 and len(robot.winches) == 9 and robot.grounded
    model, data = at_start(result.xml)
    # 400 kg dm/s^2 are 40 N; rods of .5 kg/dm^3.
    np.testing.assert_allclose(data.actuator_force, -40.0, rtol=1e-9)
    length = np.linalg.norm(np.subtract(NODES["low0"], NODES["top0"]))
    np.testing.assert_allclose(
        [b.mass for b in robot.bodies], 0.5 * np.pi * 0.2**2 * length, rtol=1e-12
    )
    places = np.array([data.site(name).xpos for name in NODES])
    theirs = np.array(list(NODES.values()))[:, [2, 0, 1]] * 0.1 + [0, 0, 0.02]
    np.testing.assert_allclose(places, theirs, atol=1e-12)
    assert model.opt.gravity[2] == -9.81


def test_a_unit_and_an_axis_that_are_told_are_no_guess(tmp_path):
    guessed, told = made(NET, tmp_path), made(NET, tmp_path, unit="dm", up="y")
    assert [r.changes[0][1].certainty for r in (guessed, told)] == ["guess", "certain"]
    assert guessed.xml == told.xml
    upright = made(NET, tmp_path, unit="m", up="z")
    _, data = at_start(upright.xml)
    np.testing.assert_allclose(
        data.site("top1").xpos - data.site("low1").xpos,
        np.subtract(NODES["top1"], NODES["low1"]),
        atol=1e-12,
    )


@pytest.mark.parametrize("name", ["p.yaml", "p.json"])
def test_a_platform_hangs_at_its_tension(name, tmp_path):
    result = made(PLATFORM, tmp_path, name)
    assert result.left == ()
    robot = read_robot(result.xml)
    assert [b.mass for b in robot.bodies] == [2.0] and len(robot.winches) == 4
    _, data = at_start(result.xml)
    np.testing.assert_allclose(data.actuator_force, -12.0, rtol=1e-9)
    np.testing.assert_allclose(data.site("exit3").xpos, [1, 1, 2])
    np.testing.assert_allclose(data.site("attachment3").xpos, [0.1, 0.1, 1.05])


def test_winches_of_a_platform_let_it_hang_anywhere_between_its_exits(tmp_path):
    robot = read_robot(made(PLATFORM, tmp_path).xml)
    np.testing.assert_allclose(robot.rest_high, np.hypot(2, 2), rtol=1e-12)  # to the far corner
    net = read_robot(made(NET, tmp_path).xml)  # nothing of it is fixed
    longest = [cable.rest_length + 40.0 / cable.stiffness for cable in net.cables]
    np.testing.assert_allclose(net.rest_high, longest, rtol=1e-9)


def test_a_platform_in_millimetres_with_its_inertia(tmp_path):
    places = ("position", "exit_points", "attachment_points")
    scaled = {key: (1000 * np.array(PLATFORM[key])).tolist() for key in places}
    result = made(PLATFORM | scaled | {"inertia": [1e4, 2e4, 2.5e4]}, tmp_path, unit="mm", up="z")
    model, data = at_start(result.xml)
    np.testing.assert_allclose(sorted(model.body("platform").inertia), [0.01, 0.02, 0.025])
    np.testing.assert_allclose(data.actuator_force, -12.0, rtol=1e-9)


REFUSED = [
    ({**NET, "substructures": {}}, "built of others: write all nodes"),
    (
        {"substructures": {"a": {"path": "base/3Prism.yaml"}}},
        "of others .'base/3Prism.yaml'.: write",
    ),
    ({**NET, "builders": {}}, "no builders. A file that others include has theirs"),
    ({**NET, "nodes": {"low0": [0, 0, 0]}}, "Pairs name nodes that there are not: low1"),
    ({**NET, "builders": {"rod": NET["builders"]["rod"]}}, "'string' have 0 builders"),
    ({**NET, "builders": NET["builders"] | {"string": {"class": "tgBoxInfo"}}}, "are tgBoxInfo"),
    ({**NET, "pair_groups": {"rod": NET["pair_groups"]["rod"]}}, "one rod and one string"),
    ({**NET, "nodes": NODES | {"top0": [1, 2]}}, "nodes.top0.2: is required"),
    ({**PLATFORM, "cables": {"stiffness": 5, "pretension": 12}}, "would need a rest length of -"),
    ({**PLATFORM, "attachment_points": []}, "4 exit points and 0 attachment points"),
    ({**PLATFORM, "mass": -1}, "mass: must be"),
    ({"mass": 1}, "exit_points: is required"),
    ([1, 2], "no mapping"),
]


@pytest.mark.parametrize(("values", "message"), REFUSED)
def test_what_is_no_structure_is_refused_with_what_is_wrong(values, message, tmp_path):
    with pytest.raises(MjcfError, match=message):
        made(json.loads(json.dumps(values)), tmp_path)


def test_numbers_are_read_as_in_other_readers_of_yaml(tmp_path):
    text = (
        yaml.safe_dump(NET)
        .replace("density: 0.5", "density: .5e0")
        .replace("pretension: 400", "pretension: 4e2")
    )
    (tmp_path / "a.yaml").write_text(text)
    assert ".5e0" in text and "4e2" in text
    plain = made(NET, tmp_path, "b.yaml")
    assert adapt(tmp_path / "a.yaml").xml == plain.xml.replace('model="b"', 'model="a"')


def test_tags_that_run_code_are_refused(tmp_path):
    (tmp_path / "a.yaml").write_text("nodes: !!python/object/apply:os.system [ls]\n")
    with pytest.raises(MjcfError):
        adapt(tmp_path / "a.yaml")
