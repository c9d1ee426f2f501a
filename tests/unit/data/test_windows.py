import dataclasses
import errno
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchmarks.speed.store import store_benchmark
from flywheel.data import SplitSource, TrajectoryStore, WindowCache, assign_split, cache_files
from flywheel.dynamics.plant import Plant
from flywheel.errors import DataError, RunError
from flywheel.records import Split
from flywheel.robots import load_robot
from tests import draws
from tests.damage import flip


def filled(folder, make_episode, lengths, **kwargs):
    store = TrajectoryStore(folder / "store")
    names = [f"e{i}" for i in range(len(lengths))]
    episodes = [make_episode(n, steps=t, **kwargs) for n, t in zip(names, lengths, strict=True)]
    for episode in episodes:
        store.commit(episode.id, [episode])
    return store, store.seal("s", names), episodes


def test_windows_are_slices_of_one_episode(tmp_path, make_episode, prism3):
    lengths = [int(n) for n in np.random.default_rng(draws.seed()).integers(5, 60, 6)]
    store, snapshot, episodes = filled(tmp_path, make_episode, lengths)
    cache = WindowCache.build(SplitSource(store, snapshot, "train", prism3), tmp_path / "cache")
    starts = cache.starts(7)
    assert len(starts) == sum(max(0, n - 7 + 1) for n in lengths), lengths
    batch = cache.gather(starts, 7)
    expected = [
        (e.trajectory.observations.points[t : t + 8], e.trajectory.controls[t : t + 7])
        for e in episodes
        for t in range(e.trajectory.steps - 7 + 1)
    ]
    np.testing.assert_array_equal(batch.points, np.float32([p for p, _ in expected]))
    np.testing.assert_array_equal(batch.controls, np.float32([u for _, u in expected]))


def test_winches_are_dead_reckoned_and_their_truth_is_the_plants(tmp_path, make_episode, prism3):
    store, snapshot, (episode,) = filled(tmp_path, make_episode, [30])
    cache = WindowCache.build(SplitSource(store, snapshot, "train", prism3), tmp_path / "cache")
    batch = cache.gather(cache.starts(30), 30)
    np.testing.assert_array_equal(batch.winch_truth[0], np.float32(episode.trajectory.states.act))
    start = prism3.winch_of(prism3.keyframe)
    reckoned = prism3.dead_reckon(start, episode.trajectory.controls, 0.01)
    np.testing.assert_array_equal(batch.winch[0], np.float32(reckoned))


def test_targets_are_where_the_plants_points_were(tmp_path, make_episode, prism3):
    store, snapshot, (episode,) = filled(tmp_path, make_episode, [30])
    cache = WindowCache.build(SplitSource(store, snapshot, "train", prism3), tmp_path / "cache")
    batch, track = cache.gather(cache.starts(30), 30), episode.trajectory
    np.testing.assert_array_equal(batch.points[0], np.float32(track.observations.points))
    np.testing.assert_array_equal(batch.points_truth[0], np.float32(prism3.points_of(track.states)))


def test_targets_of_a_recording_are_its_points_with_half_the_noise(tmp_path, make_episode, prism3):
    plant, rng = Plant(prism3), np.random.default_rng(draws.seed())
    told = np.zeros((1, 200, len(prism3.winches)))
    truth = plant.simulate(plant.rest(), told).observations.points[0]
    noisy = truth + rng.normal(0, 0.003 * prism3.length, truth.shape)
    noisy[50:53, 1] = np.nan
    episode = make_episode("e0", steps=200, recording=True)
    seen = dataclasses.replace(episode.trajectory.observations, points=noisy)
    track = dataclasses.replace(episode.trajectory, observations=seen)
    store = TrajectoryStore(tmp_path / "store")
    store.commit("e0", [dataclasses.replace(episode, trajectory=track)])
    source = SplitSource(store, store.seal("s", ["e0"]), "train", prism3)
    cache = WindowCache.build(source, tmp_path / "cache")
    targets = cache.gather(cache.starts(200), 200).points_truth[0]
    known = np.isfinite(noisy)
    np.testing.assert_array_equal(np.isfinite(targets), known)
    assert np.abs(targets - truth)[known].mean() < 0.5 * np.abs(noisy - truth)[known].mean()


def test_a_recording_has_no_truth_of_unmeasured_winches(tmp_path, make_episode, prism3):
    store, snapshot, _ = filled(tmp_path, make_episode, [30], recording=True)
    cache = WindowCache.build(SplitSource(store, snapshot, "train", prism3), tmp_path / "cache")
    batch = cache.gather(cache.starts(10), 10)
    assert np.isnan(batch.winch_truth).all()
    assert np.isfinite(batch.winch).all()


def test_a_cache_is_built_once_and_knows_its_data_sets(tmp_path, make_episode, prism3):
    store = TrajectoryStore(tmp_path / "store")
    for name, dataset in [("a", "soft"), ("b", "hard")]:
        store.commit(name, [make_episode(name, dataset=dataset)])
    snapshot = store.seal("s", ["a", "b"], datasets=["hard", "soft"])
    first = WindowCache.build(SplitSource(store, snapshot, "train", prism3), tmp_path / "cache")
    again = WindowCache.build(SplitSource(store, snapshot, "train", prism3), tmp_path / "cache")
    assert first.datasets == ("hard", "soft")
    np.testing.assert_array_equal(first.gather(first.starts(40), 40).dataset, [1, 0])
    np.testing.assert_array_equal(first.points, again.points)
    assert [len(list((tmp_path / "cache").glob(g))) for g in ("*-train*", "tmp/*")] == [1, 0]


def test_an_empty_split_and_another_robot_are_errors(tmp_path, make_episode, prism3):
    store, snapshot, _ = filled(tmp_path, make_episode, [20])
    with pytest.raises(DataError, match="no test episode"):
        WindowCache.build(SplitSource(store, snapshot, "test", prism3), tmp_path / "cache")
    with pytest.raises(DataError, match="platform4"):
        WindowCache.build(
            SplitSource(store, snapshot, "train", load_robot("platform4")), tmp_path / "cache"
        )


def test_windows_lie_within_episodes_and_can_leave_out_pasts_with_missing_points(
    tmp_path, make_episode, prism3
):
    lengths = [int(n) for n in np.random.default_rng(draws.seed()).integers(3, 90, 5)]
    store, snapshot, _ = filled(tmp_path, make_episode, lengths)
    cache = WindowCache.build(SplitSource(store, snapshot, "train", prism3), tmp_path / "cache")
    np.testing.assert_array_equal(cache.valid, np.isfinite(cache.points).all(-1))
    for length in (0, 4, 50):
        first = np.cumsum([0, *(n + 1 for n in lengths)])
        expected = [first[i] + t for i, n in enumerate(lengths) for t in range(n - length + 1)]
        np.testing.assert_array_equal(cache.starts(length), expected)
        for past in {0, length // 2, length}:
            rows = [cache.valid[s : s + past + 1].any(axis=0).all() for s in expected]
            seen = np.array(expected)[rows] if expected else []
            np.testing.assert_array_equal(cache.starts(length, past), seen)
    with pytest.raises(DataError, match="length >= 0"):
        cache.starts(-1)


def test_a_window_that_leaves_its_episode_is_refused(tmp_path, make_episode, prism3):
    store, snapshot, _ = filled(tmp_path, make_episode, [20, 30])
    cache = WindowCache.build(SplitSource(store, snapshot, "train", prism3), tmp_path / "cache")
    assert cache.gather(np.array([0, 10, 21, 41]), 10).points.shape == (4, 11, 6, 3)
    for start in (-1, 11, 42, 10_000):
        with pytest.raises(DataError, match="leaves its episode"):
            cache.gather(np.array([0, start]), 10)


@pytest.mark.parametrize("how", ["flipped", "truncated", "deleted"])
def test_a_damaged_cache_is_made_again(tmp_path, make_episode, prism3, how):
    store, snapshot, _ = filled(tmp_path, make_episode, [20, 30])
    sound = WindowCache.build(SplitSource(store, snapshot, "train", prism3), tmp_path / "cache")
    expected = sound.gather(sound.starts(5), 5)
    path = next((tmp_path / "cache").glob("*/controls.npy"))
    if how == "flipped":
        flip(path)
    elif how == "truncated":
        path.write_bytes(path.read_bytes()[:-8])
    else:
        path.unlink()
    again = WindowCache.build(SplitSource(store, snapshot, "train", prism3), tmp_path / "cache")
    np.testing.assert_array_equal(again.gather(sound.starts(5), 5).controls, expected.controls)
    assert [len(list((tmp_path / "cache").glob(g))) for g in ("*-train*", "tmp/*")] == [1, 0]


def test_caches_whose_names_were_exchanged_are_made_again(tmp_path, make_episode, prism3):
    """One was dead-reckoned with what is believed of the winches, the other without."""
    store, snapshot, _ = filled(tmp_path, make_episode, [20, 30])

    def build(*known: object) -> WindowCache:
        source = SplitSource(store, snapshot, "train", prism3, *known)
        return WindowCache.build(source, tmp_path / "cache")

    plain = build().winch.copy()
    other = build(lambda episode: prism3.winches_of(episode) + 1.0, "other").winch.copy()
    assert not np.array_equal(plain, other)
    one, two = sorted((tmp_path / "cache").glob("*-train-*"))
    one.rename(tmp_path / "aside")
    two.rename(one)
    (tmp_path / "aside").rename(two)
    np.testing.assert_array_equal(build().winch, plain)


def test_a_damaged_episode_does_not_reach_a_cache(tmp_path, make_episode, prism3):
    store, snapshot, _ = filled(tmp_path, make_episode, [20, 30])
    next((tmp_path / "store/segments/e1").glob("*.zarr/controls/c.*")).unlink()
    with pytest.raises(DataError, match="Episodes: e1"):
        WindowCache.build(SplitSource(store, snapshot, "train", prism3), tmp_path / "cache")
    assert [path.name for path in (tmp_path / "cache").rglob("*")] == ["tmp"]


def test_a_disk_full_while_a_cache_is_made_is_said(tmp_path, make_episode, prism3, monkeypatch):
    store, snapshot, _ = filled(tmp_path, make_episode, [20])

    def full(*args: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(cache_files, "_write_header", full)
    with pytest.raises(RunError, match="cache of snapshot s was not made"):
        WindowCache.build(SplitSource(store, snapshot, "train", prism3), tmp_path / "cache")
    assert [path.name for path in (tmp_path / "cache").rglob("*")] == ["tmp"]


def test_speed_is_measured(tmp_path, prism3):
    speed = store_benchmark(prism3, tmp_path, episodes=2, seconds=3.0, repeats=2)
    assert speed.write_mb_per_s > 0
    assert speed.windows_per_s > 0
    assert speed.ram_windows_per_s > 0


@pytest.mark.slow
@settings(
    deadline=None,
    max_examples=5,
    suppress_health_check=[HealthCheck.function_scoped_fixture],  # it keeps no state
)
@given(seeds=st.sets(st.integers(0, 10**6), min_size=3, max_size=8), cut=st.integers(1, 7))
def test_no_episode_is_ever_in_two_splits(prism3, make_episode, seeds, cut):
    """Data grow from snapshot to snapshot; what was tested on is not trained on later."""
    fractions: dict[Split, float] = {"train": 0.5, "validation": 0.25, "test": 0.25}
    with TemporaryDirectory() as folder:
        store = TrajectoryStore(Path(folder) / "store")
        for seed in seeds:
            split = assign_split(seed, fractions)
            episode = make_episode(f"e{seed}", steps=3, seed=seed, split=split)
            store.commit(episode.id, [episode])
        names = sorted(store.committed())
        first = store.seal("first", names[:cut])
        seen: dict[bytes, str] = {}
        for snapshot in (first, store.seal("second", names, parent="first")):
            for split in {e.split for e in snapshot.episodes}:
                cache = WindowCache.build(
                    SplitSource(store, snapshot, split, prism3), Path(folder) / "cache"
                )
                for window in cache.gather(cache.starts(3), 3).controls:
                    assert seen.setdefault(window.tobytes(), split) == split
                listed = sum(e.split == split for e in snapshot.episodes)
                assert len(cache.lengths) == listed
        assert len(seen) == len(seeds)


@pytest.mark.slow
@given(st.text(max_size=20), st.lists(st.integers(0, 9), min_size=3, max_size=3).filter(any))
def test_a_split_is_fixed_by_its_key_alone(key, weights):
    names = ("train", "validation", "test")
    fractions = {n: w / sum(weights) for n, w in zip(names, weights, strict=True)}
    split = assign_split(key, fractions)
    assert split == assign_split(key, fractions)
    assert fractions[split] > 0


def test_splits_come_in_the_fractions_asked_for():
    fractions = {"train": 0.7, "validation": 0.2, "test": 0.1}
    base = int(np.random.default_rng(draws.seed()).integers(2**40))
    found = [assign_split(base + i, fractions) for i in range(20_000)]
    for name, fraction in fractions.items():
        assert abs(found.count(name) / 20_000 - fraction) < 0.02, base  # six standard deviations
    with pytest.raises(DataError, match="sum to 1"):
        assign_split(1, {"train": 0.7})
