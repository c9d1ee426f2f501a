"""Tensions, lengths and winch positions beside the points: predicted, and weighted by their own noise."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flywheel.control import RandomControls
from flywheel.diagnosis.comparison import Subject, compare
from flywheel.diagnosis.fitting.model import ModelUnderTest, fitter_of
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.dynamics import Persistence
from flywheel.dynamics.plant import AugmentedPlant, Motion, Plant, with_effects
from flywheel.effects import EFFECTS, NAMED, Term, Terms
from flywheel.errors import DataError
from flywheel.options import ComparisonOptions
from flywheel.records import Floats, MeasuredChannel, Observation, Trajectory
from flywheel.reports.comparison_page import channel_rows, write_comparison
from flywheel.robots import Robot
from flywheel.rotations import rotate
from flywheel.truth_simulator import HIDDEN, TruthSimulator
from flywheel.truth_simulator.scripts import script
from tests import draws
from tests.unit.comparison.conftest import plant_of

ROBOT, DT = "platform4", 0.01
NOISE = {"tension": 0.2, "length": 2e-4, "winch": 1e-4}
LATE, LATE_BY = 0.035, ("sensor_latency", "command_delay")  # [s]


def channels_of(robot: Robot) -> list[tuple[str, str]]:
    cables = [cable.name for cable in robot.cables]
    return [(kind, name) for kind in ("tension", "length") for name in cables] + [
        ("winch", robot.winches[1].name)
    ]


def moved(robot: Robot, terms: Terms, reach: float = 1.0, steps: int = 80) -> tuple[Motion, Floats]:
    """A motion with channels, and its commands."""
    augmented = AugmentedPlant(Plant(robot), channels_of(robot))
    start = augmented.plant.settle(1.0)
    at = augmented.plant.winch(start)[0]
    told = at + reach * (RandomControls(robot, DT).sequence(at, steps, draws.seed() % 2**31) - at)
    return augmented.simulate(start, augmented.commands(told[None], [terms]), [terms]), told


def measured(
    robot: Robot, terms: Terms, told_noise: bool = True, reach: float = 1.0, noise: float = 1e-3
) -> Trajectory:
    """The same, as a robot's sensors see it."""
    (motion, told), rng = moved(robot, terms, reach), np.random.default_rng(draws.seed())
    points = motion.points[0] + rng.normal(0, noise, motion.points[0].shape)
    winch = Plant(robot).winch(motion.states)[0]
    channels = tuple(
        MeasuredChannel(
            kind,
            name,
            values + rng.normal(0, NOISE[kind], len(values)),
            NOISE[kind] if told_noise else None,
        )
        for (kind, name), values in zip(channels_of(robot), motion.channels[0].T, strict=True)
    )
    return Trajectory(Observation(points, winch), told, DT, channels=channels)


def cables_of(robot: Robot, motion: Motion) -> tuple[Floats, Floats]:
    """(T + 1, C) lengths of the cables and their rates, by poses and velocities."""
    states = motion.states[0]
    poses, speeds = states.qpos.reshape(-1, 1, 7)[:, 0], states.qvel.reshape(-1, 1, 6)[:, 0]
    lengths, rates = [], []
    for cable in robot.cables:
        (a, va), (b, vb) = (
            (end.offset, np.zeros(3))
            if end.body < 0
            else (
                poses[:, :3] + rotate(poses[:, 3:], end.offset),
                speeds[:, :3] + rotate(poses[:, 3:], np.cross(speeds[:, 3:], end.offset)),
            )
            for end in cable.ends
        )
        apart = b - a
        lengths.append(np.linalg.norm(apart, axis=1))
        rates.append((apart * (vb - va)).sum(axis=1) / lengths[-1])
    return np.stack(lengths, axis=1), np.stack(rates, axis=1)


@pytest.mark.parametrize(
    ("name", "size"), [("", 0.0), ("cable_stiffness", 0.2), ("stiffening", 50.0)]
)
def test_a_plant_predicts_lengths_tensions_and_winch_positions(
    robot: Robot, name: str, size: float
):
    terms = (Term((EFFECTS | NAMED)[name], None, (size,)),) if name else ()
    motion, _ = moved(robot, terms)
    lengths, rates = cables_of(robot, motion)
    tension, length, winch = np.split(motion.channels[0], [4, 8], axis=1)
    np.testing.assert_allclose(length, lengths, atol=1e-9)
    act = motion.states.act[0]
    np.testing.assert_array_equal(winch[:, 0], act[:, robot.winches[1].activation])
    for i, cable in enumerate(robot.cables):
        rest = act[:, robot.winches[cable.winch].activation]
        spring = cable.stiffness * (lengths[:, i] - rest)
        if name == "cable_stiffness":
            spring *= 1.0 + size
        if name == "stiffening":
            taut = np.maximum(spring, 0.0)
            spring += size * taut * (taut / cable.stiffness / rest) ** 2
        pull = np.maximum(spring + cable.damping * rates[:, i], 0.0)
        np.testing.assert_allclose(tension[:, i], pull, atol=1e-6 * pull.max())


def test_channels_change_nothing_in_a_motion(robot: Robot) -> None:
    terms = (Term(EFFECTS["hysteresis"], None, (2.0, 0.01)),)
    motion, told = moved(robot, terms)
    bare = AugmentedPlant(Plant(robot))
    other = bare.simulate(bare.plant.settle(1.0), bare.commands(told[None], [terms]), [terms])
    for a, b in zip(
        (motion.points, *motion.states.arrays, motion.memory["hysteresis"]),
        (other.points, *other.states.arrays, other.memory["hysteresis"]),
        strict=True,
    ):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("told", [True, False])
def test_each_channel_counts_by_its_own_noise(robot: Robot, told: bool) -> None:
    windows = Windows.cut(robot, [measured(robot, (), told)], seconds=0.4)
    got = {channel.key[0]: channel.sigma for channel in windows.channels}
    assert got == (NOISE if told else pytest.approx(NOISE, rel=0.4))
    points = len(robot.points)
    assert windows.measured.shape[2] == points + 9
    assert windows.noisy[:, :, points:].sum() == 2 * 41 * 9  # one number each
    shifted = windows.measured.copy()
    shifted[:, :, points:, 0] += windows.widened(
        np.zeros((2, 41, points, 3)),
        np.broadcast_to([c.sigma for c in windows.channels], (2, 41, 9)),
    )[:, :, points:, 0]
    off = replace(windows, measured=shifted).residual(windows.measured).reshape(shifted.shape)
    np.testing.assert_allclose(off[:, :, points:, 0], 1.0)
    assert (off[:, :, :points] == 0).all()


def test_a_channel_that_never_changes_needs_a_noise(robot: Robot) -> None:
    track = measured(robot, ())
    stuck = MeasuredChannel("tension", robot.cables[0].name, np.full(81, 3.0))
    with pytest.raises(
        DataError, match=f"of the tension of {robot.cables[0].name}: give its noise"
    ):
        Windows.cut(robot, [replace(track, channels=(stuck,))], seconds=0.4)


def test_tensions_tell_a_stiffness_that_points_hardly_tell(robot: Robot) -> None:
    wanted, effect = 0.03, NAMED["cable_stiffness"]
    track, found = measured(robot, (Term(effect, None, (wanted,)),)), {}
    for name, seen in (("points", replace(track, channels=())), ("all", track)):
        fitter = fitter_of(Windows.cut(robot, [seen], seconds=0.4), Plant(robot))
        free = fitter.free((Term(effect, None, (0.0,)),))
        fit = fitter.fit(fitter.first_estimate((Term(effect, None, (0.0,)),)), free, rounds=6)
        found[name] = fit.terms[0].values[0]
        assert fitter.rms(fit) == pytest.approx(0.001, rel=0.2)
    assert found["all"] == pytest.approx(wanted, abs=0.004)
    assert abs(found["points"] - wanted) > 2 * abs(found["all"] - wanted)


def test_channels_are_on_time_where_points_are_late(robot: Robot) -> None:
    augmented, late = AugmentedPlant(Plant(robot), channels_of(robot)), 3
    start, (_, told) = augmented.plant.settle(1.0), moved(robot, ())

    def motion(*terms: Term) -> tuple[Floats, Floats]:
        commands = augmented.commands(told[None], [terms])
        found = augmented.simulate(start, commands, [terms], steps=len(told))
        assert found.states.qpos.shape[1] == len(found.points[0]) == len(told) + 1
        return found.points[0], found.channels[0]

    _, at_once = motion()
    (points, seen), (same, later) = (
        motion(Term(EFFECTS[name], None, (late * DT,))) for name in LATE_BY
    )
    np.testing.assert_array_equal(points, same)
    np.testing.assert_array_equal(seen[:-late], later[late:])
    np.testing.assert_allclose(seen[:, -1], at_once[:, -1], atol=1e-12)  # the winch, to the end
    assert abs(later[:, -1] - at_once[:, -1]).max() > 1e-3
    _, between = motion(Term(EFFECTS["sensor_latency"], None, ((late - 0.5) * DT,)))
    jump = abs(np.diff(at_once[:, -1])).max()
    assert abs(between[:, -1] - at_once[:, -1]).max() < 0.3 * jump


def of_truth(robot: Robot, name: str, seed: int) -> Trajectory:
    """Points, encoders and load cells of a robot whose points or motors are late, by the other simulator."""
    controls = script("random_steps", robot, 1.6, DT, np.random.default_rng(seed))
    motion = TruthSimulator(robot, [HIDDEN[name](LATE)]).run(controls, DT)
    rng = np.random.default_rng(draws.seed())
    winch = motion.motor + rng.normal(0, NOISE["winch"], motion.motor.shape)
    tension = motion.tension + rng.normal(0, NOISE["tension"], motion.tension.shape)
    parts = (("winch", robot.winches, winch), ("tension", robot.cables, tension))
    channels = [
        MeasuredChannel(kind, part.name, values, NOISE[kind])
        for kind, owners, table in parts
        for part, values in zip(owners, table.T, strict=True)
    ]
    points = motion.seen + rng.normal(0, 1e-3, motion.seen.shape)
    return Trajectory(Observation(points, winch), controls, DT, channels=tuple(channels))


@pytest.mark.parametrize("name", LATE_BY)
def test_late_points_are_told_from_late_commands_by_encoders(robot: Robot, name: str) -> None:
    windows = Windows.cut(robot, [of_truth(robot, name, 1)], seconds=0.4)
    costs = {}
    for asked in LATE_BY:
        fitter, term = fitter_of(windows, Plant(robot)), Term(EFFECTS[asked], None, (0.01,))
        fit = fitter.fit(fitter.first_estimate((term,)), fitter.free((term,)), rounds=6)
        costs[asked] = fit.cost
        if asked == name:
            # Steps of 5 ms in the plant, and of 1 ms in the other simulator.
            assert fit.terms[0].values[0] == pytest.approx(LATE, abs=2.5e-3)
    (other,) = set(LATE_BY) - {name}
    assert costs[other] > costs[name] + 1000


def test_compare_knows_that_points_are_late_and_channels_are_not(robot: Robot) -> None:
    track, told = of_truth(robot, "sensor_latency", 2), ComparisonOptions(horizon=0.3, draws=40)
    worst = {}
    for name in LATE_BY:
        plant = with_effects(Plant(robot), (Term(EFFECTS[name], None, (LATE,)),))
        model = compare([Subject.of_plant(name, plant)], [track], told).models[0]
        worst[name] = max(error.rms / error.by_noise for error in model.channels)
    assert worst["sensor_latency"] < 1.5
    assert worst["command_delay"] > 3.0


def test_models_that_predict_only_points_are_tested_without_channels(robot: Robot) -> None:
    under = ModelUnderTest(Plant(robot), plant_of(robot), 0)
    assert under.windows([measured(robot, ())], 0.4).channels == ()
    assert replace(under, model=None).windows([measured(robot, ())], 0.4).channels


def seen_by_encoders(track: Trajectory, robot: Robot) -> Trajectory:
    """The same with the winch of its channel as its encoder measured it."""
    winch = track.observations.winch.copy()
    winch[:, 1] = track.channels[-1].values
    return replace(track, observations=Observation(track.observations.points, winch))


def test_compare_tells_how_other_models_than_plants_predict_winches(robot: Robot) -> None:
    track = seen_by_encoders(measured(robot, ()), robot)
    still = Subject("still", Persistence(robot, DT))
    told = ComparisonOptions(horizon=0.2, draws=40)
    (error,) = compare([still], [track], told).models[0].channels
    assert error.channel.key == ("winch", robot.winches[1].name)
    # Noise of its own, and of the start.
    assert error.by_noise == pytest.approx(2**0.5 * NOISE["winch"], rel=0.15)
    assert error.rms < 3 * error.by_noise
    lagging = replace(track, controls=0.9 * track.controls)
    (error,) = compare([still], [lagging], told).models[0].channels
    assert error.rms > 5 * error.by_noise


def test_compare_tells_the_error_of_each_channel_beside_that_of_noise(
    robot: Robot, tmp_path: Path
) -> None:
    heavier = (Term(NAMED["body_mass"], None, (5.0,)),)
    for terms, low, high in (((), 0.5, 1.5), (heavier, 2.0, 50.0)):
        track = seen_by_encoders(measured(robot, terms, reach=0.02, noise=5e-5), robot)
        found = compare([plant_of(robot)], [track], ComparisonOptions(horizon=0.2, draws=40))
        model = found.models[0]
        errors = model.channels
        assert [error.channel.key for error in errors] == channels_of(robot)
        times = np.array([error.rms / error.by_noise for error in errors])
        assert (low < times[:4]).all() and (times[:4] < high).all()
        assert model.summary(0.001)["channels"][0] == errors[0].summary()
        assert errors[-1].by_noise == pytest.approx(2**0.5 * NOISE["winch"], rel=0.15)
    both = replace(found, models=(replace(model, name="network", channels=errors[-1:]), model))
    first, last = (
        [f"{k * n:.3g}" for n in (e.rms, e.by_noise)]
        for e, k in ((errors[0], 1), (errors[-1], 1e3))
    )
    rows = {row[0]: row[1:] for row in channel_rows(both)}
    assert rows[errors[0].channel.label] == ["N", "0.2", "–", "–", *first]
    assert rows[errors[-1].channel.label] == ["mm", "0.1", *last, *last]
    page = write_comparison(both, tmp_path / "p.html", {}, {}).read_text()
    assert all(f"<td>{'</td><td>'.join((name, *row))}</td>" in page for name, row in rows.items())
    assert page.count('src="data:image/svg+xml') == 5
