"""A robot behind ROS is driven by rosbridge like any other."""

import socket
import time
from collections.abc import Iterator

import numpy as np
import pytest

from flywheel.control import EpisodeOrder, RandomControls
from flywheel.control.drive import drive
from flywheel.dynamics.plant import Reckoning
from flywheel.errors import LinkError
from flywheel.records import Provenance
from flywheel.robot_link import RobotLink, StandIn, StandInConfig
from flywheel.robot_link.opening import open_link
from flywheel.robot_link.ros import RosLink
from flywheel.robots import Robot
from tests.unit.robot_link.rosbridge import RosBridge

pytestmark = pytest.mark.slow
PERIOD = 0.05  # slow enough for two processes on a busy machine [s]


@pytest.fixture
def bridge(prism3: Robot) -> Iterator[RosBridge]:
    made = RosBridge(
        StandIn(prism3, StandInConfig(winch_measured=True), PERIOD), PERIOD, hides=(1,)
    )
    yield made
    made.stop()


def test_a_robot_behind_ros_is_driven_and_its_log_is_whole(prism3, bridge):
    link = open_link(
        f"ros://127.0.0.1:{bridge.port}", prism3, PERIOD, arguments={"period": str(PERIOD)}
    )
    assert isinstance(link, RobotLink) and link.info.real_time
    about = Provenance(robot=prism3.digest, source="recording", dataset="recording")
    done = drive(
        link,
        prism3,
        RandomControls(prism3, PERIOD),
        lambda points: None,
        EpisodeOrder("ros", about, seconds=1.0, seed=1),
        reckoning=Reckoning(prism3, PERIOD),
    )
    link.close()
    seen = done.episode.trajectory.observations
    assert done.ended == "time" and done.episode.trajectory.steps == 20
    assert bridge.resets == 1 and len(bridge.commands) >= 10
    assert np.isnan(seen.points[:, 1]).all(), "what is not seen stays so"
    assert np.isfinite(seen.points[:, 0]).all(axis=-1).sum() >= 10
    assert np.isfinite(seen.winch).all(axis=-1).sum() >= 10
    until = time.monotonic() + 5
    while np.any(bridge.commands[-1]) and time.monotonic() < until:
        time.sleep(0.01)
    assert not np.any(bridge.commands[-1]), "it was told to hold still"
    limit = prism3.control_high[0]
    assert np.abs(bridge.commands).max() <= limit + 1e-12


def test_a_bridge_that_goes_is_a_lost_robot(prism3: Robot, bridge: RosBridge) -> None:
    link = RosLink(prism3, port=bridge.port, period=PERIOD)
    link.reset()
    link.observe()
    with pytest.raises(LinkError, match="takes 6 finite commands"):
        link.send(np.full(6, np.nan), 1.0)
    bridge.stop()
    with pytest.raises(LinkError, match="is lost|measured nothing"):
        for _ in range(100):
            link.observe()
    with pytest.raises(LinkError, match="is lost"):
        link.send(np.zeros(6), 1.0)
    link.close()


def test_no_bridge_is_said_at_once(prism3: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flywheel.robot_link.ros.CONNECTING", 0.5)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with pytest.raises(LinkError, match=f"No rosbridge answers at 127.0.0.1:{port}"):
        RosLink(prism3, port=port)
