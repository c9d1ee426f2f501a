"""A stand-in shows what its sensors give, and obeys within its limits."""

import numpy as np
import pytest

from flywheel.errors import ConfigError, LinkError, UnknownNameError
from flywheel.records import Floats
from flywheel.robot_link import RobotLink, Sample, StandIn, StandInConfig
from flywheel.robots import Robot
from flywheel.truth_simulator import TruthSimulator
from flywheel.truth_simulator.written import hidden_effects

PERIOD, EXACT = 0.01, StandInConfig(noise=0.0, winch_measured=True)


def driven(stand_in: StandIn, controls: Floats, valid: float = 0.1, seed: int = 0) -> list[Sample]:
    """T + 1 samples, before and after each command (T, W)."""
    stand_in.reset(seed)
    samples = [stand_in.observe()]
    for control in controls:
        stand_in.send(control, samples[-1].time + valid)
        samples.append(stand_in.observe())
    return samples


def hauling(robot: Robot, steps: int = 20) -> Floats:
    return np.full((steps, len(robot.winches)), -0.1)


def test_it_is_a_link(prism3: Robot) -> None:
    assert isinstance(StandIn(prism3, EXACT), RobotLink)


def test_it_does_what_the_truth_simulator_does_to_the_bit(prism3: Robot) -> None:
    hidden, controls = ("torque_speed", "payload:2"), hauling(prism3)
    truth = TruthSimulator(prism3, hidden_effects(hidden, prism3)).run(controls, PERIOD)
    config = StandInConfig(hidden=hidden, noise=0.0, winch_measured=True)
    samples = driven(StandIn(prism3, config), controls)
    np.testing.assert_array_equal([s.points for s in samples], truth.seen)
    np.testing.assert_array_equal([s.winch for s in samples], truth.motor)
    assert [s.time for s in samples] == pytest.approx(PERIOD * np.arange(len(samples)))


def test_the_same_seed_gives_the_same_noise_and_another_one_other_noise(prism3: Robot) -> None:
    stand_in = StandIn(prism3, StandInConfig(noise=0.01, dropout=0.2))
    one, same, other = (driven(stand_in, hauling(prism3, 3), seed=s) for s in (1, 1, 2))
    for a, b in zip(one, same, strict=True):
        np.testing.assert_array_equal(a.points, b.points)
    assert not np.array_equal(one[-1].points, other[-1].points, equal_nan=True)


@pytest.mark.parametrize("told", [True, False])
def test_measurements_come_late_and_say_so_where_they_are_told_to(prism3, told):
    now = driven(StandIn(prism3, EXACT), hauling(prism3))
    config = EXACT.model_copy(update={"latency": 0.03, "latency_told": told})
    stand_in = StandIn(prism3, config)
    late = driven(stand_in, hauling(prism3))
    np.testing.assert_array_equal(late[20].points, now[17].points)
    assert late[20].stamp == pytest.approx(0.17 if told else 0.2)
    assert stand_in.info.latency == (0.03 if told else 0.0)


def test_a_slow_sensor_repeats_its_newest_measurement(prism3: Robot) -> None:
    config = EXACT.model_copy(update={"rate": 50.0})
    samples = driven(StandIn(prism3, config), hauling(prism3, 6))
    assert [s.stamp for s in samples] == pytest.approx([0.0, 0.0, 0.02, 0.02, 0.04, 0.04, 0.06])


def test_the_share_of_missing_points_is_as_configured(prism3: Robot) -> None:
    config = EXACT.model_copy(update={"dropout": 0.3, "burst": 0.03})
    samples = driven(StandIn(prism3, config), hauling(prism3, 150))
    valid = np.array([s.valid for s in samples])
    assert 1 - valid.mean() == pytest.approx(0.3, abs=0.08)
    gone = np.diff(valid.astype(int), axis=0)
    assert (~valid).sum() / (gone < 0).sum() == pytest.approx(3, rel=0.4)  # periods of absence


def test_winches_hold_still_once_the_last_command_is_not_valid_any_more(prism3: Robot) -> None:
    stand_in = StandIn(prism3, EXACT)
    stand_in.reset()
    begin = stand_in.observe().winch
    stand_in.send(np.full(6, -0.1), 0.03)
    moved = np.array([stand_in.observe().winch for _ in range(6)]) - begin
    np.testing.assert_allclose(moved[:, 0], [-0.001, -0.002, -0.003, -0.003, -0.003, -0.003])


def test_no_command_is_valid_for_longer_than_the_dead_man_time(prism3: Robot) -> None:
    stand_in = StandIn(prism3, EXACT.model_copy(update={"dead_man": 0.02}))
    samples = driven(stand_in, hauling(prism3, 1), valid=100.0)
    after = [stand_in.observe().winch[0] for _ in range(4)]
    assert after == pytest.approx([samples[0].winch[0] - 0.002] * 4)


def test_it_stops_when_told_and_cuts_off_what_is_beyond_its_limits(prism3: Robot) -> None:
    stand_in = StandIn(prism3, EXACT)
    fast = driven(stand_in, np.full((2, 6), -1e6))
    low = prism3.control_low[0] * PERIOD
    assert fast[2].winch[0] - fast[0].winch[0] == pytest.approx(2 * low)
    stand_in.stop()
    np.testing.assert_array_equal(stand_in.observe().winch, fast[2].winch)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"hidden": ("torque_sped",)}, "Did you mean 'torque_speed'"),
        ({"hidden": ("weak_cable@nowhere",)}, "nowhere"),
        (
            {"hidden": ("payload:heavy",)},
            "a multiple of the typical size, from 0 to 1000, got 'heavy'",
        ),
        ({"hidden": ("torque_speed@cable_0",)}, "has no place: leave out @cable_0"),
        ({"latency": 0.015}, "must be a multiple of the control period, 0.01 s"),
        ({"rate": 70.0}, "must be the control rate, 100 Hz, or a whole part of it"),
    ],
)
def test_what_cannot_be_is_refused(prism3: Robot, changes: dict[str, object], message: str) -> None:
    with pytest.raises((ConfigError, UnknownNameError), match=message):
        StandIn(prism3, EXACT.model_copy(update=changes))


def test_wrong_commands_are_refused(prism3: Robot) -> None:
    stand_in = StandIn(prism3, EXACT)
    with pytest.raises(LinkError, match="must be reset"):
        stand_in.observe()
    stand_in.reset()
    for wrong in (np.zeros(5), np.full(6, np.nan)):
        with pytest.raises(LinkError, match="takes 6 finite commands"):
            stand_in.send(wrong, 1.0)


def test_effects_are_placed_and_sized_by_their_texts(prism3: Robot) -> None:
    cable, point = prism3.cables[4].name, prism3.points[2].name
    weak, heavy, twice = hidden_effects(
        (f"weak_cable@{cable}", f"payload@{point}", f"payload@{point}:2"), prism3
    )
    assert weak.truth(prism3).place == cable
    assert heavy.truth(prism3).place == twice.truth(prism3).place == point
    assert twice.truth(prism3).values["mass"] == 2 * heavy.truth(prism3).values["mass"]
