import dataclasses

import numpy as np
import pytest
import torch

from flywheel.errors import ConfigError, DataError
from flywheel.robots import symmetries_of
from flywheel.terrain import Box, Terrain
from flywheel.training.batches import Draw, generator, noisy, relabelled, to_batch, turned
from tests import draws


def test_a_turned_window_keeps_heights_and_distances(train):
    windows = train.gather(train.starts(20)[::7], 20)
    after = turned(windows, np.random.default_rng(draws.seed()))
    np.testing.assert_allclose(after.points[..., 2], windows.points[..., 2])
    for points in (after.points, windows.points):
        assert points.shape == windows.points.shape

    def apart(points):
        return np.linalg.norm(points[..., :, None, :] - points[..., None, :, :], axis=-1)

    np.testing.assert_allclose(apart(after.points), apart(windows.points), atol=1e-12)
    assert np.abs(after.points - windows.points).max() > 0.1
    np.testing.assert_array_equal(after.controls, windows.controls)


def test_parts_of_a_window_are_listed_in_the_order_of_a_symmetry(robot, train):
    windows, found = train.gather(train.starts(20)[::7], 20), symmetries_of(robot)
    which = np.arange(len(windows.points)) % 2 == 0
    after = relabelled(windows, found, which, np.random.default_rng(draws.seed()))
    drawn = set()
    for index in range(len(windows.points)):
        orders = zip(found.points, found.winches, strict=True)
        (kind,) = (
            number
            for number, (points, winches) in enumerate(orders)
            if np.array_equal(after.points[index], windows.points[index][:, points])
            and np.array_equal(after.points_truth[index], windows.points_truth[index][:, points])
            and np.array_equal(after.controls[index], windows.controls[index][:, winches])
            and np.array_equal(after.winch[index], windows.winch[index][:, winches])
            and np.array_equal(after.winch_truth[index], windows.winch_truth[index][:, winches])
        )
        drawn.add((bool(which[index]), kind))
    assert drawn == {(False, 0), *((True, kind) for kind in range(len(found.points)))}


def test_noise_touches_the_past_and_not_what_is_predicted(train):
    windows = train.gather(train.starts(20)[::3], 20)
    after = noisy(windows, 8, 0.01, np.random.default_rng(draws.seed()))
    change = after.points - windows.points
    assert (change[:, 9:] == 0).all()
    assert change[:, :9].std() == pytest.approx(0.01, rel=0.1)


def test_batches_split_at_the_present_and_stand_above_the_origin(train):
    windows = train.gather(train.starts(20)[:5], 20)
    batch = to_batch(windows, 8)
    assert batch.past_points.shape == (5, 9, 6, 3)
    assert batch.points.shape == (5, 14, 6, 3)
    assert batch.controls.shape == (5, 12, 6)
    assert batch.winch.shape == (5, 12, 6)
    torch.testing.assert_close(batch.past_points[:, -2:], batch.points[:, :2], rtol=0, atol=0)
    center = batch.points[:, 1].mean(dim=1)
    torch.testing.assert_close(center[:, :2], torch.zeros(5, 2), atol=1e-6, rtol=0)
    shift = windows.points[:, 9:] - batch.points[:, 2:].numpy()
    np.testing.assert_allclose(shift, shift[:, :1, :1] + 0 * shift, atol=1e-5)
    np.testing.assert_allclose(shift[..., 2], 0.0, atol=1e-5)


def test_batches_of_a_robot_that_cables_hold_in_the_world_stay_where_they_are(train):
    windows = train.gather(train.starts(20)[:5], 20)
    batch = to_batch(windows, 8, tethered=True)
    np.testing.assert_allclose(batch.past_points, windows.points[:, :9], atol=1e-6)
    np.testing.assert_allclose(batch.points[:, 2:], windows.points[:, 9:], atol=1e-6)
    assert (batch.view.shift == 0).all()


def test_a_missing_point_moves_the_origin_but_spoils_nothing_else(train):
    windows = train.gather(train.starts(20)[:5], 20)
    windows.points[0, 8, 2] = np.nan
    batch = to_batch(windows, 8)
    assert torch.isnan(batch.past_points).sum() == 3


def test_the_draw_is_a_pure_function_of_seed_and_step(train):
    draw = Draw(train, 20, 8, {})
    first, again = (draw(generator(3, 17, 0), 64) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, draw(generator(3, 18, 0), 64))
    assert not np.array_equal(first, draw(generator(4, 17, 0), 64))
    assert np.isin(first, train.starts(20)).all()


def test_a_mix_draws_each_data_set_by_its_share(train):
    dataset = np.array([0, 1, 1])
    mixed = type(train)(train.points, train.controls, train.winch, dataset, ("sim", "real"))
    draw = Draw(mixed, 20, 8, {"sim": 0.9, "real": 0.1})
    starts = draw(np.random.default_rng(draws.seed()), 4000)
    share = (mixed.gather(starts, 20).dataset == 1).mean()
    assert share == pytest.approx(0.1, abs=0.03)


def test_a_mix_with_an_unknown_data_set_is_refused(train):
    with pytest.raises(ConfigError, match=r"'real'.*There are: nominal"):
        Draw(train, 20, 8, {"nominal": 0.5, "real": 0.5})


def test_episodes_shorter_than_a_window_are_refused(train):
    with pytest.raises(DataError, match="window of 201 steps"):
        Draw(train, 201, 8, {})


def test_turned_and_shifted_windows_stand_on_the_same_ground(train):
    rng = np.random.default_rng(draws.seed())
    wall = Box(center=(1.0, 0.5, 0.3), half_size=(0.3, 4.0, 0.2), quaternion=(0.6, 0.0, 0.48, 0.64))
    terrain = Terrain(rng.uniform(-0.2, 0.2, (30, 30)), 0.5, (-7.0, -7.5), (wall,))
    windows = train.gather(train.starts(20)[::9], 20)
    windows = dataclasses.replace(windows, terrains=(terrain,) * len(windows.points))
    batch = to_batch(turned(windows, rng), 8)
    places = batch.points[:, :, :, :2].permute(3, 1, 2, 0).flatten(1, 2)  # (2, N, B)
    heights, _ = batch.ground(places)
    expected, _ = terrain.at(windows.points[:, 7:, :, :2])
    expected = np.moveaxis(expected, 0, -1).reshape(heights.shape)
    assert np.quantile(np.abs(heights.numpy() - expected), 0.95) < 1e-4
    points = batch.points.permute(3, 1, 2, 0).flatten(1, 2)
    away = batch.ground.nearest(points, 1)[0][0].numpy()
    beyond = np.moveaxis(wall.beyond(windows.points[:, 7:]), 0, -2).reshape(*away.shape, 3)
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
    assert np.abs(away.clip(0.0) - outside).max() < 1e-4
    piece = batch[2:5]
    assert len(piece.terrains) == 3
    part, _ = piece.ground(places[..., 2:5])
    torch.testing.assert_close(part, heights[..., 2:5])
