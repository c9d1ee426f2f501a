"""Winches that take tensions: in the MJCF, the plant, recordings, compare and diagnose."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from flywheel.data.recordings import read_recording, write_recording
from flywheel.data.recordings.geometry import check_commands
from flywheel.data.recordings.mapping import RecordingMap
from flywheel.data.recordings.tables.columns import Log
from flywheel.diagnosis import diagnose
from flywheel.diagnosis.comparison import Subject, compare
from flywheel.dynamics.gnn import ChunkNetwork, NetworkConfig
from flywheel.dynamics.plant import EffectivePlant, Plant
from flywheel.effects import EFFECTS, NAMED, Scales, Term
from flywheel.errors import DataError, RobotError
from flywheel.options import ComparisonOptions
from flywheel.records import Episode, Floats, Observation, Provenance, Trajectory
from flywheel.robots import Robot, read_robot
from flywheel.truth_simulator.simulator import TruthSimulator

NOISE = 2e-4  # [m]
CORNERS = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
PULL = (
    'dyntype="filterexact" dynprm="0.02" ctrllimited="true" ctrlrange="0 40" gainprm="-1" '
    'biastype="affine" biasprm="0 0 -2" forcelimited="true" forcerange="-40 0"'
)


def sites(name: str, x: float, y: float, z: float) -> str:
    return "".join(
        f'<site name="{name}{i}" pos="{x * a} {y * b} {z}"/>' for i, (a, b) in enumerate(CORNERS)
    )


PLATFORM = f"""<mujoco model="pulled">
  <worldbody>
    {sites("a", 1, 1, 2.5)}<site name="floor"/>
    <body name="box" pos="0 0 1"><freejoint/>
      <geom type="box" size=".15 .1 .08" mass="3"/>{sites("p", 0.15, 0.1, 0.08)}
      <site name="belly" pos="0 0 -.08"/>
    </body>
  </worldbody>
  <tendon>
    {
    "".join(
        f'<spatial name="c{i}"><site site="a{i}"/><site site="p{i}"/></spatial>' for i in range(4)
    )
}
    <spatial name="stay" stiffness="60" damping="6" springlength="0 .6">
      <site site="floor"/><site site="belly"/>
    </spatial>
  </tendon>
  <actuator>
    {"".join(f'<general name="w{i}" tendon="c{i}" {PULL}/>' for i in range(4))}
  </actuator>
  <sensor>
    {"".join(f'<framepos name="m{i}" objtype="site" objname="p{i}"/>' for i in range(4))}
  </sensor>
  <keyframe><key qpos="0 0 1 1 0 0 0" act="16 16 16 16"/></keyframe>
</mujoco>"""


@pytest.fixture(scope="module")
def robot() -> Robot:
    return read_robot(PLATFORM)


def commands(steps: int, seed: int) -> Floats:
    """(steps, 4) tensions [N], each for 0.2 s."""
    told = np.random.default_rng(seed).uniform(12, 20, (-(-steps // 20), 4))
    told[0] = 16.0  # as at the keyframe
    return np.repeat(told, 20, axis=0)[:steps]


def recorded(plant: Plant | EffectivePlant, steps: int, seed: int) -> Episode:
    controls, rng = commands(steps, seed), np.random.default_rng(seed)
    points = plant.simulate(plant.settle(4.0), controls[None]).observations.points[0]
    seen = Observation(points + rng.normal(0, NOISE, points.shape), np.full((steps + 1, 4), np.nan))
    track = Trajectory(seen, controls, 0.01)
    return Episode("e", track, Provenance(plant.robot.digest), "train")


def test_a_winch_takes_its_tension_at_any_length_of_its_cable(robot: Robot):
    assert [winch.unit for winch in robot.winches] == ["N"] * 4
    assert [cable.stiffness for cable in robot.cables] == [0, 0, 0, 0, 60]
    plant = Plant(robot)
    states = plant.simulate(plant.settle(4.0), np.full((1, 60, 4), 13.0)).states
    data = mujoco.MjData(plant.model)
    data.qpos[:], data.act[:] = states.qpos[0, -1], states.act[0, -1]  # at rest: no damping
    mujoco.mj_forward(plant.model, data)
    assert data.actuator_force == pytest.approx([-13.0] * 4, abs=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('gainprm="-1"', 'gainprm="-2"', 'must have gaintype "fixed" and gainprm "-1"; got -2'),
        (
            'ctrlrange="0 40"',
            'ctrlrange="-9 40"',
            "must have no ctrlrange below 0: it is a tension",
        ),
        ('biasprm="0 0 -2"', 'biasprm="0 0 2"', 'must have biastype "affine" and biasprm "0 0 -c"'),
        ('act="16 16 16 16"', 'act="16 16 16 41"', "at tension 41, allowed 0 to 40 N"),
    ],
)
def test_what_a_winch_of_tensions_lacks_is_told(old: str, new: str, told: str):
    with pytest.raises(RobotError, match=told.replace("(", r"\(")):
        read_robot(PLATFORM.replace(old, new))


def test_winches_of_tensions_and_of_rest_lengths_are_not_mixed():
    rest = PULL.replace('gainprm="-1"', 'gainprm="900"').replace("0 0 -2", "0 -900 -2")
    mixed = PLATFORM.replace(f'tendon="c3" {PULL}', f'tendon="c3" {rest}').replace(
        "16 16", "16 1.8"
    )
    with pytest.raises(RobotError, match="w0, w1, w2 take tensions, and the others rest lengths"):
        read_robot(mixed.replace('act="16 1.8 16 1.8"', 'act="16 16 16 1.8"'))


def test_laws_of_cables_see_the_tension_that_is_told(robot: Robot):
    told = commands(40, 3)[None]
    plain = Plant(robot)
    start = plain.settle(4.0)
    free = plain.simulate(start, told).observations.points
    for name, changes in (("capstan", True), ("creep", True), ("cable_damping", True)):
        effect = EFFECTS[name]  # creep is of the stay alone
        usual = tuple(p.typical(Scales.of(robot)) for p in effect.parameters)
        moved = EffectivePlant(plain, (Term(effect, None, usual),)).simulate(start, told)
        assert np.isfinite(moved.observations.points).all()
        assert (np.abs(moved.observations.points - free).max() > 1e-7) == changes
        none = (0.0,) * len(effect.sizes) + usual[len(effect.sizes) :]
        still = EffectivePlant(plain, (Term(effect, None, none),)).simulate(start, told)
        assert np.array_equal(still.observations.points, free)


def test_effects_that_have_no_meaning_with_tensions_are_refused_by_name(robot: Robot):
    for name in ("winch_backlash", "torque_speed", "drum_radius"):
        with pytest.raises(
            RobotError, match=f"{name} has no meaning on pulled, whose winches take"
        ):
            NAMED[name].require_place(robot)
    assert NAMED["weak_cable"].places(robot) == (4,)  # the stay
    assert NAMED["winch_gain"].places(robot) == NAMED["command_delay"].places(robot) == (None,)


def test_a_log_in_kilonewtons_comes_back_and_its_model_is_noise_only(robot: Robot, tmp_path: Path):
    episode = recorded(Plant(robot), 250, 1)
    path = tmp_path / "log.csv"
    write_recording(episode, path, robot)
    lines = path.read_text().splitlines()
    control = [i for i, name in enumerate(lines[0].split(",")) if name.startswith("ctrl.")]
    for number, line in enumerate(lines[1:-1], 1):
        cells = line.split(",")
        for i in control:
            cells[i] = repr(float(cells[i]) / 1000)
        lines[number] = ",".join(cells)
    path.write_text("\n".join(lines))
    how = RecordingMap.model_validate({"units": {"tension": "kN"}})
    (back,) = read_recording(path, robot, how=how).episodes
    assert back.trajectory.controls == pytest.approx(episode.trajectory.controls, rel=1e-12)
    found = compare(
        [Subject.of_plant("plant", Plant(robot))], [back.trajectory], ComparisonOptions(draws=40)
    )
    assert found.models[0].outcome == "NOISE_ONLY"


@pytest.mark.slow
def test_a_diagnosis_finds_a_force_constant_that_is_off(robot: Robot):
    gain = Term(EFFECTS["winch_gain"], None, (-0.08,))
    logs = [recorded(EffectivePlant(Plant(robot), (gain,)), 120, 1).trajectory]
    asked = {name: EFFECTS[name] for name in ("winch_gain", "air_drag")}
    found = diagnose(Plant(robot), logs, library=asked)
    assert found.verdict.value == "EFFECT"
    assert found.summary()["ranking"][0]["effect"] == "winch_gain"


def test_no_unit_of_lengths_is_offered_for_tensions_out_of_range(robot: Robot):
    rows, (count, points) = 10, (len(robot.winches), len(robot.points))
    told = np.full((rows, count), 100.0) * robot.control_high  # in range as centimetres
    places, winch = np.zeros((rows, points, 3)), np.zeros((rows, count))
    log = Log(np.arange(rows) / 100, told, places, winch, np.arange(rows))
    with pytest.raises(DataError, match="allowed are") as refused:
        check_commands(log, robot)
    assert "would fit" not in str(refused.value)


def test_networks_and_the_truth_simulator_need_rest_lengths(robot: Robot):
    with pytest.raises(
        RobotError, match="cannot be predicted by a network: its winches take tensions"
    ):
        ChunkNetwork(robot, NetworkConfig.lean())
    with pytest.raises(RobotError, match="cannot be simulated by the truth simulator"):
        TruthSimulator(robot)
