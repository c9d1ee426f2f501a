"""Winches of a locked robot are where its cables say, if that is not the keyframe."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from flywheel.data.recordings import read_recording
from flywheel.dynamics.plant import Plant
from flywheel.robots import load_robot, read_robot
from tests.unit.robots.test_structures import PLATFORM, made


@pytest.mark.parametrize(("kind", "lower"), [("rate", 0.0), ("rate", 0.2), ("position", 0.2)])
def test_a_platform_that_hangs_lower_has_longer_cables(
    kind: str, lower: float, tmp_path: Path
) -> None:
    robot = read_robot(made(PLATFORM, tmp_path, winch_kind=kind).xml)
    plant = Plant(robot)
    start = plant.rest()
    start = replace(start, act=start.act + lower)
    told = np.tile(robot.holding(plant.winch(start)), (1, 250, 1))
    points = plant.simulate(start, told).observations.points[0, 150:]
    columns = {p.name: points[:, i] for i, p in enumerate(robot.points)}
    np.savez(tmp_path / "log.npz", t=0.01 * np.arange(len(points)), **columns)
    how = {
        "markers": {name: name for name in columns},
        "units": {"points": "m"},
        "commands": {winch.name: "hold" for winch in robot.winches},
    }
    (tmp_path / "log.yaml").write_text(yaml.safe_dump(how))
    read = read_recording(tmp_path / "log.npz", robot)
    track = read.episodes[0].trajectory
    if not lower:
        assert np.isnan(track.observations.winch).all() and read.report.findings == ()
        return
    there = np.broadcast_to(plant.winch(start), track.observations.winch.shape)
    np.testing.assert_allclose(track.observations.winch, there, atol=1.5e-3)  # pulled by 5 N less
    assert (track.controls == robot.holding(track.observations.winch[0])).all()
    (note,) = (finding.words for finding in read.report.findings)
    assert all(f"{winch.name} at 1.78" in note for winch in robot.winches)


def test_a_winch_on_hold_whose_cable_changes_is_named(tmp_path: Path) -> None:
    robot = load_robot("platform4")
    plant, rng = Plant(robot), np.random.default_rng(0)
    start = plant.settle(1.0)
    still = robot.holding(plant.winch(start))
    told = np.repeat(np.tile(still, (8, 1)), 50, axis=0)
    told[:, 2] += np.repeat(rng.uniform(-0.12, 0.12, 8), 50)
    points = plant.simulate(start, told[None]).observations.points[0]
    points += rng.normal(0, 3e-4, points.shape)
    columns = {p.name: points[:-1, i] for i, p in enumerate(robot.points)}
    np.savez(tmp_path / "log.npz", t=0.01 * np.arange(len(told)), told=told[:, 2], **columns)
    names = [winch.name for winch in robot.winches]
    for rear, wanted in (({"from": "told", "unit": "m"}, []), ("hold", [f"ctrl.{names[2]}"])):
        commands = {names[0]: "hold", names[1]: "hold", names[2]: rear}
        how = {"markers": {name: name for name in columns}, "commands": commands}
        (tmp_path / "log.yaml").write_text(yaml.safe_dump(how))
        found = read_recording(tmp_path / "log.npz", robot).report.findings
        assert [f.subject for f in found if "though the map says hold" in f.words] == wanted
