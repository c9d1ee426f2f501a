"""A platform that swings on locked winches: a robot without winches, and logs without commands."""

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from flywheel.cli.main import app
from flywheel.data.recordings import read_recording, write_recording
from flywheel.diagnosis.comparison import Subject, compare
from flywheel.dynamics.plant import Plant
from flywheel.options import ComparisonOptions
from flywheel.records import Episode, Observation, Provenance, State, Trajectory
from flywheel.robots import Robot, load_robot

NOISE = 2e-4  # [m]
CORNERS = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
SITES = "".join(
    f'<site name="p{i}" pos="{0.15 * x} {0.1 * y} .08"/>' for i, (x, y) in enumerate(CORNERS)
)
PLATFORM = f"""<mujoco model="platform">
  <worldbody>
    {"".join(f'<site name="a{i}" pos="{x} {y} 2.5"/>' for i, (x, y) in enumerate(CORNERS))}
    <body name="box" pos="0 0 1"><freejoint/>
      <geom type="box" size=".15 .1 .08" mass="5"/>{SITES}
    </body>
  </worldbody>
  <tendon>
    {
    "".join(
        f'<spatial name="c{i}" stiffness="3000" damping="4" springlength="0 1.86"><site site="a{i}"/>'
        f'<site site="p{i}"/></spatial>'
        for i in range(4)
    )
}
  </tendon>
  <sensor>
    {"".join(f'<framepos name="m{i}" objtype="site" objname="p{i}"/>' for i in range(4))}
  </sensor>
  <keyframe><key qpos="0 0 1.0245 1 0 0 0"/></keyframe>
</mujoco>"""


def said(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


def swinging(robot: Robot, seconds: float, seed: int) -> Episode:
    """The robot thrown from rest, its points measured."""
    plant, rng = Plant(robot), np.random.default_rng(seed)
    rest = plant.settle(1.0)
    thrown = State(rest.qpos, rng.normal(size=(1, 6)) * [0.5, 0.5, 0.1, 0.6, 0.6, 0.6], rest.act)
    points = plant.simulate(thrown, np.zeros((1, round(seconds / 0.01), 0))).observations.points[0]
    seen = Observation(points + rng.normal(0, NOISE, points.shape), np.zeros((len(points), 0)))
    track = Trajectory(seen, np.zeros((len(points) - 1, 0)), 0.01)
    return Episode("e", track, Provenance(robot.digest), "train")


@pytest.fixture(autouse=True)
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in a folder with the MJCF, a right log, and one of a platform with more damping."""
    monkeypatch.chdir(tmp_path)
    Path("platform.xml").write_text(PLATFORM)
    Path("damped.xml").write_text(PLATFORM.replace('damping="4"', 'damping="24"'))
    for name, seed in (("platform", 1), ("damped", 2)):
        robot = load_robot(f"{name}.xml")
        write_recording(swinging(robot, 2.0, seed), f"{name}.csv", robot)


def test_the_check_takes_a_robot_that_nothing_commands():
    done = said("robot", "check", "platform.xml")
    assert done.exit_code == 0, done.output
    told = re.sub(r"\s+", " ", done.output)
    assert "It has no winch: nothing can be commanded." in told
    assert "thrown at random" in told and "Run it with" not in told


def test_logs_without_commands_are_imported_and_compared():
    imported = said(
        "recordings", "import", "platform.csv", "--robot", "platform.xml", "--store", "s"
    )
    assert imported.exit_code == 0, imported.output
    robot = load_robot("platform.xml")
    for name, outcome in (("platform", "NOISE_ONLY"), ("damped", "MORE_THAN_NOISE")):
        (episode,) = read_recording(f"{name}.csv", robot).episodes
        found = compare(
            [Subject.of_plant("plant", Plant(robot))],
            [episode.trajectory],
            ComparisonOptions(draws=40),
        )
        assert found.models[0].outcome == outcome


@pytest.mark.slow
def test_a_free_decay_shows_the_damping_that_the_mjcf_lacks():
    done = said(
        *["diagnose", "damped.csv", "--robot", "platform.xml"],
        *["--effects", "cable_damping,air_drag"],
    )
    assert done.exit_code == 10, done.output
    assert "cable_damping" in done.output


def test_effects_of_winches_have_no_meaning_without_any():
    done = said("diagnose", "damped.csv", "--robot", "platform.xml", "--effects", "winch_gain")
    assert done.exit_code == 2
    assert "winch_gain has no meaning on platform" in re.sub(r"\s+", " ", done.output)


def test_runs_need_a_winch():
    done = said("run", "prism3", "model=platform.xml")
    assert done.exit_code == 2
    assert "platform cannot be run: it has no winch" in re.sub(r"\s+", " ", done.output)


def test_a_log_without_commands_is_one_of_locked_winches_if_its_map_says_so():
    robot = load_robot("platform4")
    plant = Plant(robot)
    rest = plant.settle(1.0)
    hold = np.repeat(robot.holding(plant.winch(rest))[:, None], 50, axis=1)
    seen = plant.simulate(rest, hold).observations[0]
    track = Trajectory(seen, hold[0], 0.01)
    write_recording(Episode("e", track, Provenance(robot.digest), "train"), "log.csv", robot)
    rows = [line.split(",") for line in Path("log.csv").read_text().splitlines()]
    kept = [i for i, name in enumerate(rows[0]) if not name.startswith("ctrl.")]
    Path("locked.csv").write_text("\n".join(",".join(row[i] for i in kept) for row in rows))
    held = "".join(f"  {winch.name}: hold\n" for winch in robot.winches)
    Path("locked.yaml").write_text(f"units: {{points: m}}\ncommands:\n{held}")
    (episode,) = read_recording("locked.csv", robot).episodes
    assert np.array_equal(episode.trajectory.controls, hold[0])
