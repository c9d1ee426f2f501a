"""Two cables on one motor: one reels in what the other pays out."""

import re

import numpy as np
import pytest
import torch

from flywheel.data.recordings import read_recording, write_recording
from flywheel.diagnosis.comparison import Subject, compare
from flywheel.dynamics.gnn import NetworkConfig
from flywheel.dynamics.gnn.graph import RobotGraph
from flywheel.dynamics.plant import Plant
from flywheel.dynamics.plant.roll import rest_lengths
from flywheel.effects import EFFECTS
from flywheel.errors import RobotError
from flywheel.options import ComparisonOptions
from flywheel.records import Episode, Observation, Provenance, Trajectory
from flywheel.robots import Robot, read_robot
from flywheel.truth_simulator import TruthSimulator
from tests.antagonists import POSITION, antagonists

NOISE = 2e-4  # [m]


@pytest.mark.parametrize(
    ("robot", "told"), [(antagonists(), 0.1), (antagonists(POSITION, "ctrl"), 1.8)]
)
def test_one_cable_reels_in_what_the_other_pays_out(robot: Robot, told: float):
    (pair,) = robot.winches
    assert pair.ratios == (1.0, -1.0) and pair.rest_range == (1.4, 2.0)
    plant = Plant(robot)
    after = plant.simulate(plant.settle(1.0), np.full((1, 100, 1), told)).states[:, -1]
    assert after.act[0] == pytest.approx([1.8, 1.5], abs=1e-6)
    assert plant.activation(plant.winch(after)) == pytest.approx(after.act)
    lengths = dict(
        zip([c.name for c in robot.cables], rest_lengths(robot, plant.winch(after))[0], strict=True)
    )
    assert (lengths["l"], lengths["r"]) == pytest.approx((1.8, 1.5), abs=1e-6)


def test_ranges_that_are_no_mirror_of_each_other_are_refused():
    text = antagonists().xml.replace('actrange="1.3 1.9"', 'actrange="1.3 2"')
    with pytest.raises(RobotError, match=re.escape("(-0.1 m), times -1 (the ratio of their prm)")):
        read_robot(text)


def test_a_log_has_one_column_for_both_and_its_model_is_noise_only(tmp_path):
    robot, rng = antagonists(), np.random.default_rng(0)
    plant, told = Plant(robot), np.repeat(rng.uniform(-0.1, 0.1, (8, 1)), 25, axis=0)
    points = plant.simulate(plant.settle(4.0), told[None]).observations.points[0]
    seen = Observation(points + rng.normal(0, NOISE, points.shape), np.full((201, 1), np.nan))
    episode = Episode("e", Trajectory(seen, told, 0.01), Provenance(robot.digest), "train")
    write_recording(episode, tmp_path / "log.csv", robot)
    (back,) = read_recording(tmp_path / "log.csv", robot).episodes
    found = compare(
        [Subject.of_plant("plant", plant)], [back.trajectory], ComparisonOptions(draws=40)
    )
    assert found.models[0].outcome == "NOISE_ONLY"


def test_a_networks_cables_have_the_rest_lengths_of_the_plants():
    robot = antagonists()
    graph = RobotGraph(robot, NetworkConfig.lean())
    winch, cable = np.array([[1.45], [1.9]]), graph.relations["cable"].origin // 2
    found = graph.rest_lengths(torch.from_numpy(winch.T).float())
    np.testing.assert_allclose(found.T, rest_lengths(robot, winch)[:, cable], atol=1e-6)


def test_the_truth_simulator_and_effects_of_load_have_no_antagonists():
    with pytest.raises(RobotError, match="it has antagonists on one winch"):
        TruthSimulator(antagonists(), [])
    with pytest.raises(
        RobotError, match="torque_speed has no meaning on pair, whose winches drive"
    ):
        EFFECTS["torque_speed"].require_place(antagonists())
    assert EFFECTS["winch_gain"].places(antagonists()) == (None,)
