"""Ground that is drawn at random."""

import numpy as np
import pytest
from pydantic import ValidationError

from flywheel.robots import TerrainConfig, draw_terrain
from tests import draws

LENGTH = 2.95


@pytest.fixture
def seed() -> int:
    return draws.seed()


def drawn(kind: str, seed: int, **given: object):
    config = TerrainConfig.model_validate({"kinds": (kind,), **given})
    return config, draw_terrain(config, LENGTH, np.random.default_rng(seed))


def test_without_kinds_there_is_the_plane(seed: int) -> None:
    assert draw_terrain(TerrainConfig(), LENGTH, np.random.default_rng(seed)) is None
    assert drawn("flat", seed)[1] is None


@pytest.mark.parametrize("kind", ["slope", "bumps", "steps"])
def test_the_same_seed_draws_the_same_ground_around_the_origin(kind: str, seed: int) -> None:
    config, terrain = drawn(kind, seed)
    assert terrain == drawn(kind, seed)[1] and terrain != drawn(kind, seed + 1)[1]
    assert terrain.size == pytest.approx((config.size * LENGTH,) * 2)
    assert terrain.origin == pytest.approx((-config.size * LENGTH / 2,) * 2)


def test_a_slope_rises_as_much_everywhere(seed: int) -> None:
    config, terrain = drawn("slope", seed)
    rise = np.array(np.gradient(terrain.heights, terrain.cell))
    angle = np.arctan(np.linalg.norm(rise, axis=0))
    assert np.ptp(angle) < 1e-9
    assert config.slope[0] <= angle.mean() <= config.slope[1], seed


def test_bumps_are_as_high_as_asked(seed: int) -> None:
    config, terrain = drawn("bumps", seed)
    half = np.ptp(terrain.heights) / 2 / LENGTH
    assert config.bump_height[0] <= half <= config.bump_height[1], seed
    assert terrain.heights.max() == pytest.approx(-terrain.heights.min())


def test_steps_are_level_between_edges(seed: int) -> None:
    config, terrain = drawn("steps", seed)
    edges = np.abs(np.diff(terrain.heights, axis=0)) / LENGTH
    high = edges[edges > 1e-9]
    assert np.ptp(high) < 1e-9  # all of one height
    assert config.step_height[0] <= high.mean() <= config.step_height[1], seed
    assert (edges < 1e-9).mean() > 0.5


def test_every_kind_is_drawn(seed: int) -> None:
    config, rng = TerrainConfig(kinds=("flat", "slope")), np.random.default_rng(seed)
    flat = [draw_terrain(config, LENGTH, rng) is None for _ in range(60)]
    assert any(flat) and not all(flat)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"slope": (0.2, 0.1)}, "least <= most"),
        ({"bump_length": (0.2, 1.0)}, "too large for bumps"),
        ({"cell": 9.0}, "at most half"),
        ({"kinds": ("hills",)}, "hills"),
    ],
)
def test_what_cannot_be_drawn_is_refused(given: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        TerrainConfig.model_validate(given)
