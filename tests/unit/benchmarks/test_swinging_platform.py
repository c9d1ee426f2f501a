"""The public log of a swinging platform: where cables leave their pulleys, and the files that are written."""

import json

import numpy as np
import pytest
import yaml
from scipy.io import savemat

from benchmarks import swinging_platform
from benchmarks.swinging_platform import exit_point
from flywheel.data.recordings import read_recording
from flywheel.robots import read_robot
from flywheel.robots.adapt import adapt


def pulley(radius: float, place: tuple[float, ...] = (0.0, 0.0, 0.0)) -> dict:
    axes = np.array([[0, 1, 0], [0, 0, -1], [-1, 0, 0]])
    named = dict(zip(("vers_i", "vers_j", "vers_k"), axes[:, :, None].tolist(), strict=True))
    return named | {"radius": radius, "pos_OD_glob": [[x] for x in place]}


@pytest.mark.parametrize("end", [(-1.0, 0.3, -1.2), (1.5, -0.2, -0.4)])
def test_a_cable_leaves_its_pulley_along_a_tangent(end):
    radius, end = 0.02, np.array(end)
    left = exit_point(pulley(radius), end)
    out = np.array([0.0, end[1], end[2]]) / np.hypot(
        end[1], end[2]
    )  # the swivel's plane holds the end
    beside = left - radius * out
    assert np.linalg.norm(beside) == pytest.approx(radius, rel=1e-12)
    assert beside @ (end - left) == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(exit_point(pulley(1e-9), end), 0.0, atol=3e-9)


def test_what_is_written_is_taken_by_the_commands(tmp_path, monkeypatch):
    runs = tmp_path / "checkout" / swinging_platform.RUNS
    (runs / "data_opt").mkdir(parents=True)
    pose = np.tile([[0.0], [0.0], [-1.0], [0.01], [0.0], [0.0]], 40)
    pose[0] += 0.01 * np.sin(0.3 * np.arange(40)) + 1e-5 * np.random.default_rng(0).normal(size=40)
    for number in swinging_platform.LOGS.values():
        savemat(runs / f"data_opt/44_exp_{number}.mat", {"p": pose})
    savemat(
        runs / "res_opt.mat", {"X_opt": np.array([1, 0.01, 0, 0.2, 0.05, 0.0601, 0.0301, 0, 0, 0])}
    )
    corners = [(x, y) for x in (-1.0, 1.0) for y in (-1.0, 1.0)]
    used = [
        {
            "active": True,
            "pulley": pulley(0.02, (x, y, 0.0)),
            "winch": {"pos_PA_loc": [[0.1 * x], [0.1 * y], [0.3]]},
        }
        for x, y in corners
    ]
    (tmp_path / "geometry.json").write_text(json.dumps({"actuator": [*used, {"active": False}]}))
    words = [tmp_path / "checkout", tmp_path / "geometry.json", tmp_path / "out"]
    monkeypatch.setattr("sys.argv", ["swinging_platform", *map(str, words)])
    swinging_platform.main()
    known = yaml.safe_load((tmp_path / "out" / "authors4.yaml").read_text())
    assert known["com"] == [0.01, 0.0, 0.2]
    assert known["inertia"] == pytest.approx(
        swinging_platform.MASS * np.array([0.01, 0.02, 0.03]), abs=1e-6
    )
    robot = read_robot(adapt(tmp_path / "out" / "swing4.yaml").xml)
    track = read_recording(tmp_path / "out" / "monday.yaml", robot).episodes[0].trajectory
    middle = track.observations.points.mean(axis=1)
    assert middle[:, 0] == pytest.approx(pose[0], abs=1e-3)
