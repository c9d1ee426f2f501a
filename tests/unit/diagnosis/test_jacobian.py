"""Sensitivities by finite differences."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from flywheel.diagnosis.fitting.jacobian_cache import Held
from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.fitting.plant_fit import StartFitter
from flywheel.diagnosis.fitting.simulation import HASTY, Predictor
from flywheel.dynamics.plant import Plant, hasty, refined
from flywheel.robots import Robot


@pytest.fixture(scope="module")
def halved(fitter: StartFitter, seed: int) -> np.ndarray:
    """Windows whose time steps are half as long in `finer`: some, not all."""
    some = np.random.default_rng(seed).permutation(len(fitter.windows)) == 0
    assert some.any() and not some.all()
    return some


@pytest.fixture(scope="module")
def finer(fitter: StartFitter, halved: np.ndarray) -> StartFitter:
    return fitter.refined(halved)


def somewhere(fitter: StartFitter, seed: int) -> Fit:
    """Near the first estimates."""
    begun = fitter.beginning()
    change = np.random.default_rng(seed).normal(0.0, 0.01, begun.change.shape)
    return fitter.at(change, begun.starts.winch, ())


def test_on_the_way_they_are_the_same_whatever_time_steps_windows_have(
    fitter: StartFitter, finer: StartFitter, seed: int
) -> None:
    own, of_finer = (f.linear(somewhere(f, seed), precise=False) for f in (fitter, finer))
    assert np.array_equal(own.by_start, of_finer.by_start), seed
    assert np.array_equal(own.by_winch, of_finer.by_winch), seed


def test_precise_ones_are_those_of_each_windows_time_steps(
    fitter: StartFitter, finer: StartFitter, halved: np.ndarray, seed: int
) -> None:
    fit = fitter.beginning()
    own, mixed = fitter.linear(fit), finer.linear(finer.under(fit, ()))
    plant = refined(Plant(fitter.windows.robot), 2)
    short = StartFitter(Predictor(fitter.windows, plant), fitter.first)
    shorter = short.linear(short.under(fit, ()))
    for name in ("by_start", "by_winch"):
        is_own, is_mixed, is_short = (getattr(each, name) for each in (own, mixed, shorter))
        assert np.array_equal(is_mixed[~halved], is_own[~halved]), (name, seed)
        assert np.array_equal(is_mixed[halved], is_short[halved]), (name, seed)
        assert not np.array_equal(is_own[halved], is_short[halved]), (name, seed)


def test_rough_ones_say_which_way_to_go(finer: StartFitter, seed: int) -> None:
    fit = somewhere(finer, seed)
    after = finer.refit(replace(fit, held=Held.fresh(finer.linear(fit, precise=False))), ())
    noise = finer.freedom(fit)
    assert after.cost - noise < 0.3 * (fit.cost - noise), seed


def test_windows_that_diverge_in_hasty_steps_keep_their_own(
    fitter: StartFitter, halved: np.ndarray, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    fit, hasty = somewhere(fitter, seed), fitter.linear(somewhere(fitter, seed), precise=False)
    simulate = type(fitter.predictor)._simulated

    def lost(self, rows, *arguments):
        motion = simulate(self, rows, *arguments)
        gone = (self.fineness[rows] == HASTY) & halved[rows]
        return replace(motion, finite=motion.finite & ~gone)

    monkeypatch.setattr(type(fitter.predictor), "_simulated", lost)
    rough = fitter.linear(fit, precise=False)
    monkeypatch.undo()
    own = fitter.linear(fit)
    assert np.array_equal(rough.by_start[~halved], hasty.by_start[~halved]), seed
    assert not np.array_equal(rough.by_start[halved], hasty.by_start[halved]), seed
    square = [(x.by_start[halved] ** 2).sum() for x in (rough, own)]
    assert 0.5 < square[0] / square[1] < 2.0, (seed, square)


def test_hasty_steps_are_explicit_and_a_plant_that_has_them_keeps_them(robot: Robot) -> None:
    plant = Plant(robot)
    explicit = hasty(plant)
    assert plant.model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert explicit.model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
    assert explicit.model.opt.timestep == plant.model.opt.timestep
    assert hasty(explicit) is explicit


def test_other_starts_are_sought_with_differences_in_hasty_steps(
    finer: StartFitter, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, members = finer.beginning(), np.arange(len(finer.windows))
    tried = begun.change + np.random.default_rng(seed).normal(0.0, 0.02, begun.change.shape)
    simulated = {HASTY: 0, 1: 0, 2: 0}
    simulate = type(finer.predictor)._simulated

    def counted(self, rows, *arguments):
        for times in simulated:
            simulated[times] += int((self.fineness[rows] == times).sum())
        return simulate(self, rows, *arguments)

    monkeypatch.setattr(type(finer.predictor), "_simulated", counted)
    after = finer.searched(begun, members, tried)
    assert after.cost <= begun.cost, seed
    tried_out = simulated[1] + simulated[2]  # and not what says where to
    assert 0 < tried_out < simulated[HASTY] / 3, (seed, simulated)
