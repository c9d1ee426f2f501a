import numpy as np
import pytest
import torch

from flywheel.training import TrainingConfig
from flywheel.training.loss import LossScales, Truth, residual_scales, window_loss

CHUNK, CHUNKS = 3, 4


def _window(seed=None):
    rng = np.random.default_rng(seed)
    shape = (2, CHUNK * CHUNKS, 5, 3)
    positions = torch.tensor(rng.standard_normal(shape))
    velocities = torch.tensor(rng.standard_normal(shape))
    winch = torch.tensor(rng.standard_normal((2, CHUNK * CHUNKS, 2)))
    scales = LossScales(
        torch.tensor([1.0, 2.0, 4.0], dtype=torch.float64),
        torch.tensor([0.1, 0.2, 0.4], dtype=torch.float64),
        torch.tensor(0.5, dtype=torch.float64),
    )
    return positions, velocities, winch, scales


def test_a_perfect_prediction_has_no_loss():
    positions, velocities, winch, scales = _window()
    truth = Truth(positions, velocities, winch)
    losses = window_loss(positions, velocities, winch, truth, scales, TrainingConfig())
    assert losses.total == losses.velocity == losses.position == losses.rest == 0.0


def test_an_error_that_grows_as_the_lead_time_scaling_says_costs_the_same_in_every_chunk():
    positions, velocities, winch, scales = _window()
    truth = Truth(positions, velocities, winch)
    config = TrainingConfig(huber=100.0)
    growth = (1.0 + torch.arange(CHUNKS)).double()
    costs = []
    for chunk in range(CHUNKS):
        rows = slice(CHUNK * chunk, CHUNK * (chunk + 1))
        off_v, off_p, off_w = velocities.clone(), positions.clone(), winch.clone()
        off_v[:, rows] += 3.0 * growth[chunk] * scales.velocity.view(1, -1, 1, 1)
        off_p[:, rows] += 2.0 * growth[chunk] ** 2 * scales.position.view(1, -1, 1, 1)
        off_w[:, rows] += 7.0 * growth[chunk] * scales.winch
        losses = window_loss(off_p, off_v, off_w, truth, scales, config)
        costs.append([losses.velocity.item(), losses.position.item(), losses.rest.item()])
    np.testing.assert_allclose(costs, [[9 / CHUNKS, 4 / CHUNKS, 49 / CHUNKS]] * CHUNKS)


def test_beyond_the_threshold_the_loss_grows_linearly():
    positions, velocities, winch, scales = _window()
    truth = Truth(positions, velocities, winch)
    config = TrainingConfig(huber=5.0, lead_power=0.0)
    unit = scales.velocity.repeat(CHUNKS).view(1, -1, 1, 1)

    def cost(size: float) -> float:
        off = velocities + size * unit
        return window_loss(positions, off, winch, truth, scales, config).velocity.item()

    assert cost(2.0) == pytest.approx(4.0)
    assert cost(5.0) == pytest.approx(25.0)
    assert cost(8.0) == pytest.approx(25.0 + 2 * 5.0 * 3.0)


def test_what_was_not_measured_has_no_weight_and_no_gradient():
    positions, velocities, winch, scales = _window()
    truth_positions = positions.clone()
    truth_positions[:, 3, 1] = torch.nan
    truth = Truth(truth_positions, velocities, torch.full_like(winch, torch.nan))
    config = TrainingConfig(huber=1e9)
    guess = (positions + 0.1).requires_grad_()
    losses = window_loss(guess, velocities, winch + 1.0, truth, scales, config)
    losses.total.backward()
    assert losses.rest == 0.0
    assert torch.isfinite(guess.grad).all()
    assert (guess.grad[:, 3, 1] == 0).all()
    assert (guess.grad[:, 3, 0] != 0).all()


def test_a_prediction_that_is_not_finite_is_never_hidden():
    positions, velocities, winch, scales = _window()
    truth = Truth(positions, velocities, winch)
    broken = positions.clone()
    broken[0, 0, 0, 0] = torch.nan
    losses = window_loss(broken, velocities, winch, truth, scales, TrainingConfig())
    assert not torch.isfinite(losses.total)


def test_weights_multiply_their_parts():
    positions, velocities, winch, scales = _window()
    truth = Truth(positions, velocities, winch)
    config = TrainingConfig(velocity_weight=2.0, position_weight=0.5, rest_weight=3.0)
    losses = window_loss(positions + 0.1, velocities + 0.1, winch + 0.1, truth, scales, config)
    parts = 2.0 * losses.velocity + 0.5 * losses.position + 3.0 * losses.rest
    assert losses.total.item() == pytest.approx(parts.item())


def test_scales_of_a_free_fall_are_what_gravity_says():
    """v[t+i] - v[t] = g i dt; p[t+i] - p[t] - i dt v[t] = g dt^2 i (i + 1) / 2, on one axis of three."""
    dt, steps = 0.01, 4
    time = dt * torch.arange(-1, steps + 1, dtype=torch.float64)
    positions = torch.zeros(3, steps + 2, 2, 3, dtype=torch.float64)
    positions[..., 2] = (-0.5 * 9.81 * time**2).view(1, -1, 1)
    winch = (0.3 * time[1:]).view(1, -1, 1).repeat(3, 1, 2)
    scales = residual_scales(positions, winch, dt)
    i = torch.arange(1, steps + 1, dtype=torch.float64)
    torch.testing.assert_close(scales.velocity, 9.81 * i * dt / 3**0.5)
    torch.testing.assert_close(scales.position, 9.81 * dt**2 * i * (i + 1) / 2 / 3**0.5)
    torch.testing.assert_close(scales.winch, torch.tensor(0.003, dtype=torch.float64))
