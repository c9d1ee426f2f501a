"""Terrains are stored with the episodes that were recorded on them."""

import dataclasses

import numpy as np

from flywheel.data import SplitSource, TrajectoryStore, WindowCache
from flywheel.data.packing import SCHEMA, pack, unpack
from flywheel.terrain import Box, Terrain, with_boxes
from tests import draws

BESIDE = Box(center=(0.0, 9.0, 1.0), half_size=(9.0, 0.5, 1.0))


def terrain(rng: np.random.Generator) -> Terrain:
    shape = tuple(int(n) for n in rng.integers(2, 9, 2))
    return Terrain(rng.normal(size=shape), float(rng.uniform(0.1, 2.0)), (1.0, float(rng.normal())))


def test_they_come_back_as_they_were(make_episode):
    rng = np.random.default_rng(draws.seed())
    first, second = terrain(rng), terrain(rng)
    wall = Box(center=(1.0, 2.0, 3.0), half_size=(0.1, 0.2, 0.3), quaternion=(0.6, 0.0, 0.8, 0.0))
    walled = with_boxes(second, [wall, BESIDE])
    grounds = [
        first,
        None,
        second,
        first,
        walled,
        with_boxes(None, [wall]),
        with_boxes(first, [wall]),
    ]
    episodes = [
        dataclasses.replace(make_episode(f"e{i}"), terrain=t) for i, t in enumerate(grounds)
    ]
    arrays, attributes = pack(episodes)
    assert len(arrays["terrain_grid"]) == 5  # each once
    assert [episode.terrain for episode in unpack(arrays, attributes)] == grounds


def test_segments_on_the_plane_are_what_they_always_were(make_episode):
    arrays, attributes = pack([make_episode("a")])
    assert attributes["schema"] == SCHEMA and "terrain" not in arrays
    hill = dataclasses.replace(make_episode("b"), terrain=terrain(np.random.default_rng(0)))
    assert "terrain_boxes" not in pack([hill])[0]
    assert unpack(arrays, attributes)[0].terrain is None


def test_windows_know_what_they_stand_on(tmp_path, make_episode, prism3):
    rng = np.random.default_rng(draws.seed())
    grounds = {"a": terrain(rng), "b": None, "c": with_boxes(None, [BESIDE])}
    store = TrajectoryStore(tmp_path / "store")
    for name, ground in grounds.items():
        store.commit(name, [dataclasses.replace(make_episode(name, steps=20), terrain=ground)])
    snapshot = store.seal("s", list(grounds))
    for _ in range(2):  # filled, then opened
        cache = WindowCache.build(SplitSource(store, snapshot, "train", prism3), tmp_path / "cache")
        assert cache.terrains == tuple(grounds.values())
        batch = cache.gather(cache.starts(20), 20)
        assert batch.terrains == tuple(grounds.values())


def test_windows_on_the_plane_have_one_ground_for_all(tmp_path, make_episode, prism3):
    store = TrajectoryStore(tmp_path / "store")
    store.commit("a", [make_episode("a", steps=20)])
    cache = WindowCache.build(
        SplitSource(store, store.seal("s", ["a"]), "train", prism3), tmp_path / "cache"
    )
    assert cache.gather(cache.starts(5), 5).terrains == (None,)
