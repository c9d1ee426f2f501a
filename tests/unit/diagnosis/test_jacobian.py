"""Jacobians by finite differences, precise ones and rough ones."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.fitting.model import fitter_of
from flywheel.diagnosis.fitting.plant_fit import PlantFitter
from flywheel.diagnosis.fitting.simulation import HASTY, WindowSimulator
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.dynamics.plant import Plant, hasty, refined
from flywheel.dynamics.plant.refined import with_steps
from flywheel.robots import Robot


@pytest.fixture(scope="module")
def fitter(robot: Robot, windows: Windows) -> PlantFitter:
    """With a plant that is implicit: hasty steps are others than its own."""
    return fitter_of(windows, with_steps(Plant(robot), "implicitfast", robot.timestep))


@pytest.fixture(scope="module")
def halved(fitter: PlantFitter, seed: int) -> np.ndarray:
    """Windows whose time steps are half as long in `finer`: some, not all."""
    some = np.random.default_rng(seed).permutation(len(fitter.windows)) == 0
    assert some.any() and not some.all()
    return some


@pytest.fixture(scope="module")
def finer(fitter: PlantFitter, halved: np.ndarray) -> PlantFitter:
    return fitter.halved(halved)


def somewhere(fitter: PlantFitter, seed: int) -> Fit:
    """Near the first estimates."""
    begun = fitter.first_estimate()
    local = np.random.default_rng(seed).normal(0.0, 0.01, begun.local.shape)
    return fitter.with_local(begun, local)


def test_rough_ones_are_the_same_whatever_time_steps_windows_have(fitter, finer, seed):
    own, of_finer = (f.rough_jacobian(somewhere(f, seed)) for f in (fitter, finer))
    assert np.array_equal(own.by_local, of_finer.by_local), seed
    assert np.array_equal(own.by_winch, of_finer.by_winch), seed


@pytest.mark.slow
def test_precise_ones_are_those_of_each_windows_time_steps(fitter, finer, halved, seed):
    fit = fitter.first_estimate()
    own, mixed = fitter.jacobian(fit), finer.jacobian(finer.with_terms(fit, ()))
    plant = refined(fitter.simulator.plant, 2)
    short = PlantFitter(WindowSimulator(fitter.windows, plant), fitter.first)
    shorter = short.jacobian(short.with_terms(fit, ()))
    for name in ("by_local", "by_winch"):
        is_own, is_mixed, is_short = (getattr(each, name) for each in (own, mixed, shorter))
        assert np.array_equal(is_mixed[~halved], is_own[~halved]), (name, seed)
        assert np.array_equal(is_mixed[halved], is_short[halved]), (name, seed)
        assert not np.array_equal(is_own[halved], is_short[halved]), (name, seed)


def test_rough_ones_say_which_way_to_go(finer: PlantFitter, seed: int) -> None:
    fit = somewhere(finer, seed)
    after = finer.lm_steps(replace(fit, cache=finer.cached(finer.rough_jacobian(fit))), ())
    noise = finer.freedom
    assert after.cost - noise < 0.3 * (fit.cost - noise), seed


@pytest.mark.parametrize("stray", [True, False])
def test_windows_that_diverge_or_stray_in_hasty_steps_keep_their_own(
    fitter, halved, seed, stray, monkeypatch
):
    fit = somewhere(fitter, seed)
    hasty = fitter.rough_jacobian(fit)
    simulate = type(fitter.simulator)._simulated

    def lost(self, rows, *arguments):
        motion = simulate(self, rows, *arguments)
        gone = (self.fineness[rows] == HASTY) & halved[rows]
        if stray:
            far = 0.1 * fitter.windows.robot.length * gone
            return replace(motion, points=motion.points + far[:, None, None, None])
        return replace(motion, finite=motion.finite & ~gone)

    monkeypatch.setattr(type(fitter.simulator), "_simulated", lost)
    rough = fitter.rough_jacobian(fit)
    monkeypatch.undo()
    own = fitter.jacobian(fit)
    assert np.array_equal(rough.by_local[~halved], hasty.by_local[~halved]), seed
    assert not np.array_equal(rough.by_local[halved], hasty.by_local[halved]), seed
    square = [(x.by_local[halved] ** 2).sum() for x in (rough, own)]
    assert 0.5 < square[0] / square[1] < 2.0, (seed, square)


def test_hasty_steps_are_explicit_and_long_and_a_plant_that_has_them_keeps_them(
    robot: Robot,
) -> None:
    plant = with_steps(Plant(robot), "implicitfast", robot.timestep)
    explicit = hasty(plant)
    assert plant.model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert explicit.model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
    assert explicit.model.opt.timestep == plant.dt > plant.model.opt.timestep
    assert hasty(explicit) is explicit


@pytest.mark.slow
def test_other_initial_states_are_sought_with_differences_in_hasty_steps(finer, seed, monkeypatch):
    begun, members = finer.first_estimate(), np.arange(len(finer.windows))
    tried = begun.local + np.random.default_rng(seed).normal(0.0, 0.02, begun.local.shape)
    simulated = {HASTY: 0, 1: 0, 2: 0}
    simulate = type(finer.simulator)._simulated

    def counted(self, rows, *arguments):
        for times in simulated:
            simulated[times] += int((self.fineness[rows] == times).sum())
        return simulate(self, rows, *arguments)

    monkeypatch.setattr(type(finer.simulator), "_simulated", counted)
    after = finer.searched(begun, members, tried)
    assert after.cost <= begun.cost, seed
    tried_out = simulated[1] + simulated[2]  # and not what says where to
    assert 0 < tried_out < simulated[HASTY] / 3, (seed, simulated)
