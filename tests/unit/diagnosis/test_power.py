"""What `power` promises before an experiment is what `diagnose` says after it."""

import json
from pathlib import Path

import numpy as np
import pytest

from flywheel.diagnosis import diagnose
from flywheel.diagnosis.experiments.information import simulate_scripts
from flywheel.diagnosis.experiments.power import Power, power
from flywheel.diagnosis.fitting.model import fitted, fitter_of
from flywheel.diagnosis.fitting.windows import ChannelNoise, Windows
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.search import Search
from flywheel.diagnosis.settings import Settings, changed
from flywheel.dynamics.plant import Plant, with_effects
from flywheel.effects import EFFECTS, NAMED, Effect
from flywheel.options import PowerOptions
from flywheel.records import MeasuredChannel, Observation, Trajectory
from flywheel.reports.experiment_page import power_sentence, write_power
from flywheel.robots import Robot
from flywheel.truth_simulator.recording import record

ROBOT = "platform4"

FEW = (
    "cable_friction",
    "capstan",
    "winch_gain",
    "command_delay",
    "sensor_latency",
    "payload",
    "slope",
)


@pytest.fixture(scope="module")
def library() -> dict[str, Effect]:
    return {name: EFFECTS[name] for name in FEW}


@pytest.fixture(scope="module")
def hidden(robot: Robot, seed: int) -> Trajectory:
    """Of a robot that lacks nothing, by another simulator."""
    return record(robot, (), seconds=1.6, seed=seed).trajectory


@pytest.fixture(scope="module")
def found(robot: Robot, hidden: Trajectory, library: dict[str, Effect]) -> Power:
    return power(Plant(robot), hidden.controls, 0.003 * robot.length, library)


@pytest.mark.slow
def test_smallest_sizes_are_those_of_recordings_made_afterwards(robot, library, seed):
    plant, noise = Plant(robot), 0.003 * robot.length
    log = record(robot, (), seconds=1.6, seed=seed).trajectory
    ranking = diagnose(plant, [log], library=library).ranking
    said = {score.candidate.label: score.smallest for score in ranking}
    prospects = power(plant, log.controls, noise, library).prospects
    ratios = [p.smallest / said[p.candidate.label] for p in prospects]
    close = np.abs(np.log(ratios)) < np.log(1.25)
    assert close.mean() > 0.6, (seed, ratios)
    assert np.median(ratios) == pytest.approx(1.0, abs=0.15), (seed, ratios)


def test_commands_that_move_nothing_show_no_effect_of_winches(robot, library, found):
    still = np.zeros((80, len(robot.winches)))
    few = {name: library[name] for name in ("winch_gain", "command_delay")}
    moving = {p.candidate.label: p for p in found.prospects}
    for prospect in power(Plant(robot), still, 0.003 * robot.length, few).prospects:
        assert not prospect.visible
        assert prospect.smallest == np.inf
        assert prospect.summary()["smallest"] is None
        assert moving[prospect.candidate.label].visible


@pytest.mark.parametrize(("times", "seen"), [(2.5, True), (0.25, False)])
def test_an_effect_above_the_smallest_size_is_seen_and_one_far_below_is_not(
    robot: Robot, hidden: Trajectory, times: float, seen: bool, seed: int
) -> None:
    gain = {"winch_gain": EFFECTS["winch_gain"]}
    noise, controls = 0.001 * robot.length, hidden.controls[:80]
    (before,) = power(Plant(robot), controls, noise, gain).prospects
    term = before.candidate.term((times * before.smallest,))
    truth = simulate_scripts(with_effects(Plant(robot), (term,)), controls[None]).points[0]
    measured = truth + np.random.default_rng(seed).normal(0, noise, truth.shape)
    log = Trajectory(Observation(measured, hidden.observations.winch[:81]), controls, hidden.dt)
    fitter = fitter_of(Windows.cut(robot, [log], sigma=noise), Plant(robot))
    search = Search(fitter, candidates(robot, gain))
    (after,) = search.score_all(fitted(fitter)).scores
    assert (after.score >= search.threshold) == seen, (seed, after.score)


def test_twins_are_taken_for_each_other_and_nobody_else_is(found: Power, seed: int) -> None:
    by_name = {p.candidate.label: p for p in found.prospects}
    for name, other in (("command_delay", "sensor_latency"), ("sensor_latency", "command_delay")):
        twin = by_name[name]
        assert other in [candidate.label for candidate in twin.taken_for], seed
        assert twin.separation < 0.01
        assert twin.likeness > 0.999
    assert not by_name["winch_gain"].taken_for, seed


def test_encoders_tell_late_points_from_late_commands(robot, hidden, library):
    """A winch that hears commands late is elsewhere when its encoder is read."""
    few = {name: library[name] for name in ("command_delay", "sensor_latency")}
    plant, noise, controls = Plant(robot), 0.003 * robot.length, hidden.controls[:80]
    encoders = [ChannelNoise(("winch", winch.name), 1e-4) for winch in robot.winches]
    found = power(plant, controls, noise, few, channels=encoders)
    assert found.by_points is not None
    delay, late = (
        next(p for p in found.prospects if p.candidate.label == name)
        for name in ("command_delay", "sensor_latency")
    )
    assert all(p.taken_for for p in found.by_points.prospects)
    assert not delay.taken_for and not late.taken_for
    (bare,) = {round(p.smallest, 9) for p in found.by_points.prospects}
    assert late.smallest < bare  # they tell where winches begin
    # A position that is late by d is off by d times its rate, but for the mean: where it began is unknown.
    winch = plant.winch(simulate_scripts(plant, controls[None]).states)[0]
    rates = np.diff(winch, axis=0, prepend=winch[:1]) / plant.dt
    size = delay.candidate.typical[0] * np.linalg.norm(rates - rates.mean(axis=0)) / 1e-4
    assert delay.smallest == pytest.approx((5.0 + 1.645) / size, rel=0.25)  # and points tell some


def test_more_noise_hides_more(robot, hidden, library):
    few = {name: library[name] for name in ("capstan", "winch_gain")}
    quiet, loud = (power(Plant(robot), hidden.controls[:80], s, few) for s in (0.002, 0.02))
    small = {p.candidate.label: p.smallest for p in quiet.prospects}
    for prospect in loud.prospects:
        assert 3 < prospect.smallest / small[prospect.candidate.label] < 12


def test_a_twice_as_large_effect_is_twice_as_far_from_its_rival(robot, hidden, library):
    few = {name: library[name] for name in ("capstan", "cable_friction")}
    once, twice = (
        power(Plant(robot), hidden.controls[:80], 0.01, few, PowerOptions(size))
        for size in (1.0, 2.0)
    )
    for one, two in zip(once.prospects, twice.prospects, strict=True):
        assert two.separation == pytest.approx(2 * one.separation)
        assert two.smallest == one.smallest


def test_the_summary_is_json(found: Power) -> None:
    again = json.loads(json.dumps(found.summary(), allow_nan=False))
    assert [e["effect"] for e in again["effects"]] == [
        p.candidate.effect.name for p in found.prospects
    ]
    assert np.shape(again["likeness"]) == (len(found.prospects),) * 2


def test_promises_are_those_of_a_diagnosis_with_the_same_settings(robot, hidden, library):
    few = {name: library[name] for name in ("capstan", "winch_gain")}
    strict = changed(Settings(), {"limits.threshold": 36.0})
    before, after = (
        power(Plant(robot), hidden.controls[:80], 0.01, few, settings=settings)
        for settings in (Settings(), strict)
    )
    assert (before.enough, after.enough) == (5.0, 6.0)
    assert "settings" not in before.summary()
    assert after.summary()["settings"] == {"limits.threshold": 36.0}
    for one, two in zip(before.prospects, after.prospects, strict=True):
        assert two.smallest / one.smallest == pytest.approx(7.645 / 6.645)
    between = PowerOptions(5.5 / before.prospects[0].strength)
    shown = [
        power(Plant(robot), hidden.controls[:80], 0.01, few, between, settings=settings)
        .prospects[0]
        .shown
        for settings in (Settings(), strict)
    ]
    assert shown == [True, False]


def load_cells(robot: Robot, noise: float) -> list[ChannelNoise]:
    return [ChannelNoise(("tension", cable.name), noise) for cable in robot.cables]


def test_load_cells_show_what_a_recording_with_them_shows(
    robot: Robot, hidden: Trajectory, seed: int, tmp_path: Path
) -> None:
    stiffness = {"cable_stiffness": NAMED["cable_stiffness"]}
    plant, noise, controls = Plant(robot), 0.003 * robot.length, hidden.controls[:80]
    cells = load_cells(robot, 0.2)
    found = power(plant, controls, noise, stiffness, channels=cells)
    assert found.by_points is not None
    (told,), (bare,) = found.prospects, found.by_points.prospects
    assert told.smallest < 0.5 * bare.smallest
    assert bare.smallest == power(plant, controls, noise, stiffness).prospects[0].smallest
    summary = found.summary()
    assert summary["channels"] == [cell.summary() for cell in cells]
    assert summary["by_points_alone"] == [bare.summary()]
    assert "By points alone, without the channels, it would be" in power_sentence(found)
    page = write_power(found, tmp_path / "p.html", {}).read_text()
    shown = f"{bare.smallest:.3g}" if bare.visible else "invisible"
    assert f"<td>{told.smallest:.3g}</td><td>{shown}</td>" in page

    motion, rng = simulate_scripts(plant, controls[None], None, cells), np.random.default_rng(seed)
    points = motion.points[0] + rng.normal(0, noise, motion.points[0].shape)
    tensions = motion.channels[0] + rng.normal(0, 0.2, motion.channels[0].shape)
    channels = tuple(
        MeasuredChannel(*cell.key, values, cell.sigma)
        for cell, values in zip(cells, tensions.T, strict=True)
    )
    seen = Observation(points, plant.winch(motion.states)[0])
    log = Trajectory(seen, controls, hidden.dt, channels=channels)
    fitter = fitter_of(Windows.cut(robot, [log], sigma=noise), plant)
    search = Search(fitter, candidates(robot, stiffness))
    (after,) = search.score_all(fitted(fitter)).scores
    assert told.smallest == pytest.approx(after.smallest, rel=0.3), seed


def test_a_channel_that_is_all_noise_shows_nothing_more(robot, hidden):
    few = {"winch_gain": EFFECTS["winch_gain"]}
    found = power(Plant(robot), hidden.controls[:80], 0.01, few, channels=load_cells(robot, 1e6))
    (told,), (bare,) = found.prospects, found.by_points.prospects
    assert told.smallest == pytest.approx(bare.smallest, rel=1e-3)
