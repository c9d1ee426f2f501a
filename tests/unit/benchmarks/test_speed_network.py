"""What `python -m benchmarks.speed` says about the network."""

import math

import pytest

from benchmarks.speed import network as measured
from flywheel.dynamics.gnn import NetworkConfig
from flywheel.robots import load_robot

SMALL = NetworkConfig.lean(width=8, rounds=1)


def test_the_least_time_of_each_is_kept_and_they_take_turns():
    called = []
    least = measured.least_seconds(
        {
            "quick": lambda: called.append("q"),
            "slow": lambda: [called.append("s"), sum(range(10**5))],
        },
        seconds=0.0,
    )
    assert called[:6] == ["q", "s"] * 3 and len(called) == 12
    assert 0 <= least["quick"] < least["slow"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "measure",
    [
        lambda robot: measured.learned_against_plant(
            robot, lambda: sum(range(1000)), 100, 0.0, threads=2, configs={"small": SMALL}
        ),
        lambda robot: measured.lean_against_paper(robot, 8, 0.0),
        lambda robot: measured.fused_against_plain(robot, SMALL, 0.0),
        lambda robot: measured.blocked_against_unblocked(robot, SMALL, 0.0, candidates=96),
        lambda robot: measured.product_fraction(robot, SMALL, 0.0),
    ],
)
def test_every_measurement_gives_finite_numbers_and_ratios_of_its_own(measure):
    speeds = measure(load_robot("prism3"))
    rates = {speed.of.split(",")[0].split(" [")[0]: speed.rate for speed in speeds}
    assert all(math.isfinite(s.rate) and s.rate > 0 for s in speeds)
    for speed in speeds:
        if speed.against:
            assert speed.ratio == pytest.approx(speed.rate / rates[speed.against])
    assert any(speed.against for speed in speeds)
