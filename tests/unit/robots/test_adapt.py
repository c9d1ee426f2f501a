"""Files of laboratories become robots, or are refused for their first reason."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from flywheel.dynamics.plant import Plant, unseen_axes
from flywheel.errors import MjcfError
from flywheel.options import AdaptOptions
from flywheel.robots import read_robot
from flywheel.robots.adapt import ADAPTATIONS, Adapted, Certainty, Change, adapt, adapting, with_key
from flywheel.robots.adapt.draft import Scale
from flywheel.robots.adapt.proof import ALIKE, apart
from flywheel.robots.mjcf_source import compiled
from flywheel.robots.remarks import without_winches
from tests.unit.robots import lab_files
from tests.unit.robots.lab_files import ADAPTABLE, DRIVEN_FROM_PYTHON, REFUSED


def adapted(make, folder: Path, **options) -> Adapted:
    winches = DRIVEN_FROM_PYTHON.get(make.__name__, ())
    return adapt(make(folder), AdaptOptions(**{"winches": winches} | options))


def model_of(text: str) -> mujoco.MjModel:
    return compiled(text)[2]


def attributes(result: Adapted, element: str, name: str) -> dict[str, str]:
    (found,) = re.findall(rf'<{element} [^>]*name="{name}"[^>]*>', result.xml)
    return dict(re.findall(r'(\w+)="([^"]*)"', found))


@pytest.mark.parametrize("make", ADAPTABLE, ids=lambda make: make.__name__)
def test_a_laboratory_s_file_becomes_a_robot_that_moves(make, tmp_path):
    result = adapted(make, tmp_path)
    assert result.left == ()
    assert all(result.mended.values()), result.mended
    assert all(change.evidence for _, change in result.changes if change.certainty == "equivalent")
    plant = Plant(read_robot(result.xml))
    robot = plant.robot
    controls = np.random.default_rng(0).uniform(
        robot.control_low, robot.control_high, (1, 20, len(robot.winches))
    )
    assert np.isfinite(plant.simulate(plant.rest(), controls).observations.points).all()


@pytest.mark.parametrize("make", REFUSED, ids=lambda make: make.__name__)
def test_what_cannot_become_a_robot_is_refused_for_its_first_reason(make, tmp_path):
    result = adapted(make, tmp_path)
    assert result.left[0].startswith(REFUSED[make])


@pytest.mark.parametrize("make", [*ADAPTABLE, *REFUSED], ids=lambda make: make.__name__)
def test_a_problem_is_told_as_mended_where_it_is_gone_and_only_there(make, tmp_path):
    result = adapted(make, tmp_path)
    endings = {problem[-60:] for problem in result.left}  # their elements may be fewer
    for problem, name in result.mended.items():
        assert (problem[-60:] in endings) == (not name)


def test_each_reason_of_an_arm_without_names_is_told_once(tmp_path):
    many = "".join(f'<joint name="j{i}" axis="1 0 0"/>' for i in range(40))
    route = '<site site="o"/><geom geom="drum"/>' * 5
    text = f"""<mujoco><worldbody><site name="o"/><geom name="drum" type="cylinder" size=".1 .1" pos="1 0 0"/>
  <body><joint/><geom size=".1"/><site name="a" pos="2 0 0"/>{many}</body></worldbody>
  <tendon><spatial>{route}<site site="a"/></spatial></tendon></mujoco>"""
    result = adapt(lab_files.written(tmp_path, text))
    for problems in (list(result.mended), result.left):
        (joints,) = (each for each in problems if "joints" in each and "straight" not in each)
        start = "It has the joints without a name (hinge, of the body 'body0'), 'j0' (hinge, of the body"
        assert (
            problems[0] == joints and joints.startswith(start) and "and 35 more. Robots" in joints
        )
        (bent,) = (each for each in problems if "straight" in each)
        assert bent.endswith("got site -> geom -> site -> geom -> site -> geom -> ... (11 in all).")


def test_an_adapted_file_needs_no_more_changes(tmp_path):
    first = adapted(lab_files.prism_with_springs_beside_servos, tmp_path)
    again = adapt(lab_files.written(tmp_path, first.xml))
    assert again.changes == () and again.left == ()
    assert read_robot(again.xml).digest == read_robot(first.xml).digest


def test_copies_are_written_out_as_mujoco_makes_them(tmp_path):
    path = lab_files.weights_in_a_row(tmp_path)
    result = adapt(path)
    text = path.read_text().replace('<clock name="clock"/>', "").replace('sleep="allowed"', "")
    theirs, ours = model_of(text), model_of(result.xml)
    for kind in ("body", "tendon", "actuator"):
        count = {"body": theirs.nbody, "tendon": theirs.ntendon, "actuator": theirs.nu}[kind]
        names = [getattr(theirs, kind)(i).name for i in range(count)]
        assert [getattr(ours, kind)(i).name for i in range(count)] == names
        assert {"body": "weight-2", "tendon": "spring1-2", "actuator": "motor-2"}[kind] in names
    for field in ("body_pos", "body_quat", "tendon_length0"):
        np.testing.assert_allclose(getattr(ours, field), getattr(theirs, field), atol=1e-12)
    (edits,) = (change.edits for name, change in result.changes if name == "copies")
    assert edits[-1] == "no <clock>, which MuJoCo doubles with each copy"


def test_copies_of_what_mujoco_refuses_are_refused_for_its_reason(tmp_path):
    path = lab_files.weights_in_a_row(tmp_path)
    path.write_text(path.read_text().replace('kp="90"', 'kp="90" replicas="2"'))
    assert "unrecognized attribute: 'replicas'" in adapt(path).left[0]


def test_sensors_that_mujoco_doubles_with_each_copy_are_refused_before_they_fill_the_memory():
    many = '<replicate count="2" offset="1 0 0"><site name="s"/></replicate>'
    with pytest.raises(MjcfError, match=r"sensor of nothing beside <replicate> \(<e_kinetic>\)"):
        model_of(f"<mujoco><worldbody>{many}</worldbody><sensor><e_kinetic/></sensor></mujoco>")


def test_drums_become_winches_of_the_same_tension(tmp_path):
    result = adapted(lab_files.platform_with_drums, tmp_path)
    drum = attributes(result, "general", "drum0")
    assert (drum["gear"], drum["gainprm"], drum["biasprm"]) == ("1", "3600", "0 -3600 -8")
    (change,) = (change for name, change in result.changes if name == "servos")
    assert change.certainty == "equivalent" and "old ones times 50" in change.edits[0]


def test_an_offset_goes_into_the_rest_length_and_a_lag_in_steps_into_an_exact_one(tmp_path):
    servo = attributes(adapted(lab_files.prism_with_filtered_servos, tmp_path), "general", "m0")
    # 200 u + 25 - 250 length = 250 (.8 u + .1 - length), with commands from .1 to .7
    low, high = map(float, servo["ctrlrange"].split())
    assert (low, high) == pytest.approx((0.18, 0.66), abs=1e-15)
    kept = np.exp(-0.002 / float(servo["dynprm"]))  # of a deviation in a step, as 1 - .002 / .05
    assert kept == pytest.approx(1 - 0.002 / 0.05, abs=1e-15)


def test_a_spring_that_a_motor_pulls_is_a_spring_of_another_rest_length(tmp_path):
    result = adapted(lab_files.six_rods_with_tension_motors, tmp_path)
    (change,) = (change for name, change in result.changes if name == "tensions")
    assert change.certainty == "equivalent"
    winch, length = attributes(result, "general", "b0b1"), 0.25  # of the cable, and of its spring
    assert (winch["gainprm"], winch["biasprm"]) == ("200", "0 -200 0")
    low, high = map(float, winch["ctrlrange"].split())
    assert (low, high) == pytest.approx((length - 9 / 200, length), abs=1e-6)
    assert attributes(result, "spatial", "b0-b1")["stiffness"] == "0"
    rest = read_robot(result.xml).keyframe.act
    assert rest == pytest.approx([cable.rest_length for cable in read_robot(result.xml).cables])
    assert rest[0] == pytest.approx(length, abs=1e-6)  # no tension of the motor, as at first


def test_a_servo_that_would_need_a_rest_length_below_0_is_joined_with_its_spring(tmp_path):
    result = adapted(lab_files.rods_with_weak_servos, tmp_path)
    (change,) = (change for name, change in result.changes if name == "tensions")
    assert change.certainty == "equivalent"
    winch = attributes(result, "general", "m0")
    assert winch["gainprm"] == "162"  # 150 + 3 * 2^2
    length = np.hypot(0.25 * 2 * np.sin(np.deg2rad(120 + 150) / 2), 0.45)
    low, high = map(float, winch["ctrlrange"].split())  # (150 length + 2 * 3 u) / 162
    assert (low, high) == pytest.approx(((150 * length - 36) / 162, 150 * length / 162), abs=1e-5)


@pytest.mark.parametrize("axis", ["1 0 0", "-1 0 0", "0 1 0", "0 -1 0", "0 0 -1"])
def test_a_world_that_lies_on_its_side_is_turned_with_its_keyframe(axis, tmp_path):
    path = lab_files.prism_with_springs_beside_servos(tmp_path)
    up = np.array(axis.split(), float)
    pose = '<keyframe><key qpos="{}" qvel="{}"/></keyframe></mujoco>'.format(
        " ".join(["0.1 0.2 0.3 0.5 0.5 -0.5 0.5", "1 0 0 1 0 0 0", "0 1 0 1 0 0 0"]), "1 2 3 " * 6
    )
    gravity = f'<option gravity="{" ".join(map(str, -9.81 * up))}" '
    text = path.read_text().replace("<option ", gravity).replace("</mujoco>", pose)
    before = mujoco.MjModel.from_xml_string(text)
    result = adapt(lab_files.written(tmp_path, text))
    (change,) = (change for name, change in result.changes if name == "upright")
    assert change.certainty == "equivalent" and result.left == ()
    after = model_of(result.xml)
    assert after.opt.gravity == pytest.approx([0, 0, -9.81])
    heights = after.key_qpos[0].reshape(3, 7)[:, 2]
    assert heights == pytest.approx(before.key_qpos[0].reshape(3, 7)[:, :3] @ up)
    rising = after.key_qvel[0].reshape(3, 6)
    assert rising[:, 2] == pytest.approx(before.key_qvel[0].reshape(3, 6)[:, :3] @ up)
    assert rising[:, 3:] == pytest.approx(before.key_qvel[0].reshape(3, 6)[:, 3:])


def test_keyframes_keep_their_meaning(tmp_path):
    path = lab_files.platform_with_drums(tmp_path)
    key = '<keyframe><key name="a" ctrl=".0324 .0324 .0324 .0324"/></keyframe></mujoco>'
    lab_files.written(tmp_path, path.read_text().replace("</mujoco>", key))
    model = model_of(adapt(path).xml)
    assert model.key_act[0] == pytest.approx(1.62) and model.key_ctrl[0] == pytest.approx(1.62)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('gear=".02"', 'gear=".02" delay=".01" nsample="10"', "has a state beyond positions"),
        ('kp="9e6"', 'kp="9e6" class="own"', "moves otherwise after what should change nothing"),
    ],
)
def test_what_an_actuator_has_beside_its_stiffness_is_not_lost(old, new, words, tmp_path):
    path = lab_files.platform_with_drums(tmp_path)
    own = '<default><default class="own"><general damping="7"/></default></default><worldbody>'
    text = path.read_text().replace(old, new).replace("<worldbody>", own)
    result = adapt(lab_files.written(tmp_path, text))
    assert words in result.left[0]


def test_springs_of_polynomials_become_no_winches(tmp_path):
    path = lab_files.crossed_bars(tmp_path)
    lab_files.written(tmp_path, path.read_text().replace('stiffness="500"', 'stiffness="500 20"'))
    assert "matches no passive cable" in adapt(path, AdaptOptions(winches=("*",))).left[0]


def test_two_actuators_on_a_cable_become_one(tmp_path):
    result = adapted(lab_files.platform_of_stiff_and_damping_servos, tmp_path)
    assert "kv0" not in result.xml
    assert attributes(result, "general", "kp0")["biasprm"] == "0 -5000 -60"
    (change,) = (change for name, change in result.changes if name == "joined")
    assert change.certainty == "guess" and "e-" in change.evidence


def limited(folder: Path, limit: str, servo: str, also: str = "") -> Adapted:
    """A platform on servos whose class of cables has an actuatorfrcrange; `also` is one more actuator."""
    text = lab_files.platform_with_drums(folder).read_text()
    text = text.replace('kp="9e6" kv="2e4" gear=".02"', f'kp="3600" kv="8" {servo}')
    cables = f'<default><tendon actuatorfrcrange="{limit}"/></default><worldbody>'
    text = text.replace("<worldbody>", cables).replace("</actuator>", f"{also}</actuator>")
    return adapt(lab_files.written(folder, text))


@pytest.mark.parametrize(
    ("limit", "servo", "force"),
    [
        ("-300 0", "", "-300 0"),
        ("-300 0", 'gear="2"', "-600 0"),  # MuJoCo limits before it multiplies
        ("-300 0", 'forcerange="-500 0"', "-300 0"),
        ("-300 40", 'forcerange="-200 90"', "-200 0"),
    ],
)
def test_the_limit_of_a_cable_with_one_servo_is_that_servo_s(limit, servo, force, tmp_path):
    result = limited(tmp_path, limit, servo)
    assert result.left == ()
    assert [change.certainty for name, change in result.changes if name == "limits"] == [
        "equivalent"
    ]
    model = model_of(result.xml)
    assert attributes(result, "general", "drum0")["forcerange"] == force
    assert not model.tendon_actfrclimited.any() and model.actuator_forcelimited.all()


@pytest.mark.parametrize(
    ("limit", "also"),
    [("0 300", ""), ("-300 0", '<motor name="more" tendon="p0-c0" ctrlrange="-9 0"/>')],
)
def test_a_cable_s_limit_stays_where_none_may_pull_or_two_do(limit, also, tmp_path):
    left = " ".join(limited(tmp_path, limit, "", also).left)
    assert "'drum0'" in left and "not as its tendon's actuatorfrcrange" in left


def test_a_spring_beside_a_winch_becomes_another_cable_with_all_its_digits(tmp_path):
    make = lab_files.prism_with_springs_beside_servos
    path = make(tmp_path)
    lab_files.written(
        tmp_path, path.read_text().replace('stiffness="90"', 'stiffness="90.123456789012"')
    )
    spring = attributes(adapt(path), "spatial", "b0-t1_spring")
    assert spring["stiffness"] == "90.123456789012" and spring["springlength"] == "0 0.3"
    assert attributes(adapt(path), "spatial", "b0-t1")["stiffness"] == "0"


def test_ropes_become_stiff_springs_that_are_slack_below_their_length(tmp_path):
    robot = read_robot(adapted(lab_files.ropes, tmp_path).xml)
    assert {cable.rest_length for cable in robot.cables} == {1.7}
    assert [cable.stiffness for cable in robot.cables] == pytest.approx([3 * 9.81 / 0.017] * 4)


def test_a_sensor_of_a_rope_s_limit_stays(tmp_path):
    path = lab_files.ropes(tmp_path)
    sensor = '<sensor><tendonlimitfrc name="f" tendon="p0-c0"/></sensor></mujoco>'
    lab_files.written(tmp_path, path.read_text().replace("</mujoco>", sensor))
    assert adapt(path, AdaptOptions(winches=("*",))).left == ()


def test_an_adaptation_that_mujoco_refuses_mends_nothing(tmp_path, monkeypatch):
    def broken(draft):
        next(draft.root.iter("spatial")).set("stiffness", "-")
        yield Change(("nothing",), "a fault", Certainty.CERTAIN)

    monkeypatch.setitem(adapting.OF_ROBOT, "pull-only", broken)
    result = adapted(lab_files.prism_with_springs_beside_servos, tmp_path)
    refused = "The adaptation 'pull-only' makes an MJCF that is refused: MuJoCo cannot compile"
    assert result.left[0].startswith(refused)
    assert "pull-only" not in result.mended.values()


def test_springs_become_winches_that_hold_what_the_springs_did(tmp_path):
    result = adapted(lab_files.crossed_bars, tmp_path)
    robot = read_robot(result.xml)
    assert [winch.kind for winch in robot.winches] == ["rate"] * 4
    assert {(cable.stiffness, cable.damping) for cable in robot.cables} == {(500.0, 9.0)}
    lengths = [cable.rest_length for cable in robot.cables]
    assert lengths == pytest.approx(np.full(4, np.hypot(0.6 * np.cos(np.pi / 4), 0.06)), abs=1e-12)
    positions = read_robot(adapted(lab_files.crossed_bars, tmp_path, winch_kind="position").xml)
    assert [winch.kind for winch in positions.winches] == ["position"] * 4


def test_a_pattern_that_matches_no_passive_cable_is_told_with_those_that_there_are(tmp_path):
    result = adapt(lab_files.crossed_bars(tmp_path), AdaptOptions(winches=("z*",)))
    assert (
        result.left[0].startswith("--winch 'z*' matches no passive cable")
        and "a0-b0" in result.left[0]
    )


def test_a_file_without_winches_is_told_which_cables_could_be_some(tmp_path):
    result = adapt(lab_files.crossed_bars(tmp_path))
    (told,) = without_winches(read_robot(result.xml))
    assert not result.left
    assert "'a0-b0', 'a1-b1', 'a0-b1', 'a1-b0') become winches by robot adapt --winch" in told


def test_files_are_taken_in_with_the_masses_of_meshes_that_are_only_looked_at(tmp_path):
    path = lab_files.platform_in_several_files(tmp_path)
    (tmp_path / "wood.png").write_bytes(b"")  # never read
    text = re.sub(
        r'<include file="(\w+).xml"/>', lambda m: _inside(tmp_path, m[1]), path.read_text()
    )
    spec = mujoco.MjSpec.from_string(
        re.sub(r"<texture[^>]*/>|<material[^>]*/>| material=\"wood\"", "", text)
    )
    spec.modelfiledir = str(tmp_path)
    before, result = spec.compile().body("plate"), adapt(path)
    after = model_of(result.xml).body("plate")
    assert ".obj" not in result.xml and "include" not in result.xml
    assert "posts of aluminium" in result.xml  # comments stay
    assert result.xml.index("<asset") < result.xml.index("<default")  # where the include was
    for number in ("mass", "inertia", "ipos"):
        assert getattr(after, number) == pytest.approx(
            getattr(before, number), rel=1e-12, abs=1e-15
        )


def _inside(folder: Path, name: str) -> str:
    return re.sub(r"</?mujoco(include)?>", "", (folder / f"{name}.xml").read_text())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            '<mujoco><include file="none.xml"/></mujoco>',
            "includes 'none.xml', which is not in the folder",
        ),
        ('<mujoco><include file="robot.xml"/></mujoco>', "includes 'robot.xml' twice"),
    ],
)
def test_includes_that_cannot_be_are_told(text, words, tmp_path):
    assert words in adapt(lab_files.written(tmp_path, text)).left[0]


def test_included_files_count_as_elements(tmp_path):
    for name in "abc":
        text = f"<mujoco><worldbody>{3000 * '<site/>'}</worldbody></mujoco>"
        lab_files.written(tmp_path, text, f"{name}.xml")
    includes = "".join(f'<include file="{name}.xml"/>' for name in "abc")
    path = lab_files.written(tmp_path, f"<mujoco>{includes}</mujoco>")
    assert "elements with its included files" in adapt(path).left[0]


def test_the_docs_list_all_adaptations_in_their_order():
    page = Path(__file__).parents[3] / "docs" / "adapting.md"
    assert re.findall(r"^\| `([\w-]+)` \|", page.read_text(), re.MULTILINE) == list(ADAPTATIONS)


def test_a_file_that_is_none_is_bad_input(tmp_path):
    with pytest.raises(MjcfError, match="is not valid XML"):
        adapt(lab_files.written(tmp_path, "<mujoco>"))


def test_meshes_that_can_be_touched_become_primitives_of_their_size_and_mass(tmp_path):
    path = lab_files.platform_in_several_files(tmp_path)
    lab_files.written(tmp_path, path.read_text().replace('contype="0" ', ""))
    result = adapt(path)
    assert result.left == ()
    model = model_of(result.xml)
    (geom,) = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_BOX)
    assert np.sort(model.geom_size[geom]) == pytest.approx([0.03, 0.12, 0.15], rel=1e-6)
    assert model.body("plate").mass == pytest.approx(8 * 0.15 * 0.12 * 0.03 * 700)
    (change,) = (
        change for name, change in result.changes if change.reason.startswith("Primitives")
    )
    assert change.certainty == "guess"


def test_a_mesh_with_a_mass_whose_file_is_missing_is_told(tmp_path):
    path = lab_files.platform_in_several_files(tmp_path)
    (tmp_path / "shapes" / "cube.obj").unlink()
    assert "has meshes with masses, and MuJoCo cannot compile them" in adapt(path).left[0]


@pytest.mark.parametrize("pose", ['quat="0 1 0 0"', 'pos="0 0 1e-3"', 'xyaxes="1 0 0 0 1 0"'])
def test_global_coordinates_of_bodies_that_are_elsewhere_are_left_to_the_user(pose, tmp_path):
    path = lab_files.old_paper(tmp_path)
    lab_files.written(tmp_path, path.read_text().replace('name="strut1"', f'name="strut1" {pose}'))
    assert "global coordinates no longer supported" in adapt(path).left[0]


def test_an_adaptation_that_is_left_out_leaves_its_problems(tmp_path):
    result = adapted(lab_files.crossed_bars, tmp_path, without=frozenset({"points"}))
    assert [each for each in result.left if "no framepos sensor" in each]


def test_all_names_are_made_from_what_is_joined_and_differ(tmp_path):
    robot = read_robot(adapted(lab_files.prism_driven_from_python, tmp_path).xml)
    names = [cable.name for cable in robot.cables]
    assert names[0] == "b0_b1" and len(set(names)) == 9
    assert robot.name == "robot"


def test_all_winches_of_a_first_keyframe_pull_as_much_as_the_robot_weighs(tmp_path):
    robot = read_robot(adapted(lab_files.platform_without_ranges, tmp_path).xml)
    lengths = robot.cable_lengths(robot.keyframe.qpos[None, None])[0]
    pulls = [
        c.stiffness * (now - c.rest_length) for c, now in zip(robot.cables, lengths, strict=True)
    ]
    assert sum(pulls) == pytest.approx(3 * 9.81)


def test_a_limit_of_forces_stays_where_it_pulls(tmp_path):
    result = adapted(lab_files.integrated_velocity, tmp_path)
    assert attributes(result, "general", "w0")["forcerange"] == "-900 0"


def test_contacts_by_pairs_only_stay_so(tmp_path):
    model = model_of(adapted(lab_files.old_paper, tmp_path).xml)
    assert not model.geom_contype.any() and not model.geom_conaffinity.any() and model.npair == 6


def test_tracked_points_are_spheres_where_there_are_some(tmp_path):
    result = adapted(lab_files.old_paper, tmp_path)
    (change,) = (change for name, change in result.changes if name == "points")
    assert change.edits[0] == "'strut0_0' at a sphere of 'strut0'"


def test_tracked_points_are_at_the_ends_of_rods(tmp_path):
    robot = read_robot(adapted(lab_files.crossed_bars, tmp_path).xml)
    ends = [point.offset for point in robot.points]
    assert np.array(ends) == pytest.approx(np.array([[0, 0, -0.3], [0, 0, 0.3]] * 2))


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ('<geom type="cylinder" size=".2 .02" mass="3"/>', "an end of a cable"),
        (
            '<geom type="box" size=".15 .15 .03" mass="3"/><geom type="capsule" size=".05 .1"/>',
            "an upper corner",
        ),
    ],
    ids=["a disc", "a box with a camera"],
)
def test_tracked_points_tell_the_pose_of_what_is_no_rod(body, words, tmp_path):
    world, cables = lab_files.platform(4, 'stiffness="900" springlength="0 1.5"', body)
    text = f"<mujoco model='plate'><worldbody>{world}</worldbody><tendon>{cables}</tendon></mujoco>"
    result = adapt(lab_files.written(tmp_path, text), AdaptOptions(winches=("*",)))
    (change,) = (change for name, change in result.changes if name == "points")
    assert [words in each for each in change.edits] == [True] * 4
    assert not unseen_axes(read_robot(result.xml))


def test_the_proof_tells_robots_apart_and_none_from_itself(tmp_path):
    text = adapted(lab_files.platform_with_drums, tmp_path).xml
    model = model_of(text)
    assert apart(model, model, {}) == 0
    assert apart(model, model_of(text.replace('gainprm="3600"', 'gainprm="3601"', 1)), {}) > ALIKE
    assert apart(model, model, {"drum0": Scale(1.0, 0.001)}) > ALIKE


def test_a_keyframe_at_rest_keeps_all_digits_and_the_commands_of_position_winches(tmp_path):
    text = adapted(lab_files.platform_with_drums, tmp_path).xml
    qpos, act = np.array([0.1, 0, 1 / 3, 1, 0, 0, 0]), np.full(4, 1.6 + 1 / 3e5)
    model = model_of(with_key(text, qpos, act))
    assert (model.key_qpos[0] == qpos).all()
    assert (model.key_act[0] == act).all() and (model.key_ctrl[0] == act).all()
