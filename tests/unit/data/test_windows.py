import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flywheel.data import TrajectoryStore, WindowCache, assign_split
from flywheel.errors import DataError
from flywheel.robots import load_robot


def filled(folder, make_episode, lengths, **kwargs):
    store = TrajectoryStore(folder / "store")
    names = [f"e{i}" for i in range(len(lengths))]
    episodes = [make_episode(n, steps=t, **kwargs) for n, t in zip(names, lengths, strict=True)]
    for episode in episodes:
        store.commit(episode.id, [episode])
    return store, store.seal("s", names), episodes


def test_windows_are_slices_of_one_episode(tmp_path, make_episode, prism3):
    lengths = [int(n) for n in np.random.default_rng().integers(5, 60, 6)]
    store, snapshot, episodes = filled(tmp_path, make_episode, lengths)
    cache = WindowCache.build(store, snapshot, "train", tmp_path / "cache", prism3)
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
    cache = WindowCache.build(store, snapshot, "train", tmp_path / "cache", prism3)
    batch = cache.gather(cache.starts(30), 30)
    np.testing.assert_array_equal(batch.winch_truth[0], np.float32(episode.trajectory.states.act))
    start = prism3.winch_of(prism3.keyframe)
    reckoned = prism3.dead_reckon(start, episode.trajectory.controls, 0.01)
    np.testing.assert_array_equal(batch.winch[0], np.float32(reckoned))


def test_a_recording_has_no_truth_of_unmeasured_winches(tmp_path, make_episode, prism3):
    store, snapshot, _ = filled(tmp_path, make_episode, [30], recording=True)
    cache = WindowCache.build(store, snapshot, "train", tmp_path / "cache", prism3)
    batch = cache.gather(cache.starts(10), 10)
    assert np.isnan(batch.winch_truth).all()
    assert np.isfinite(batch.winch).all()


def test_a_cache_is_built_once_and_knows_its_data_sets(tmp_path, make_episode, prism3):
    store = TrajectoryStore(tmp_path / "store")
    for name, dataset in [("a", "soft"), ("b", "hard")]:
        store.commit(name, [make_episode(name, dataset=dataset)])
    snapshot = store.seal("s", ["a", "b"], datasets=["hard", "soft"])
    first = WindowCache.build(store, snapshot, "train", tmp_path / "cache", prism3)
    again = WindowCache.build(store, snapshot, "train", tmp_path / "cache", prism3)
    assert first.datasets == ("hard", "soft")
    np.testing.assert_array_equal(first.gather(first.starts(40), 40).dataset, [1, 0])
    np.testing.assert_array_equal(first.points, again.points)
    assert len(list((tmp_path / "cache").iterdir())) == 1


def test_an_empty_split_and_another_robot_are_errors(tmp_path, make_episode, prism3):
    store, snapshot, _ = filled(tmp_path, make_episode, [20])
    with pytest.raises(DataError, match="no test episode"):
        WindowCache.build(store, snapshot, "test", tmp_path / "cache", prism3)
    with pytest.raises(DataError, match="platform4"):
        WindowCache.build(store, snapshot, "train", tmp_path / "cache", load_robot("platform4"))


@given(st.text(max_size=20), st.lists(st.integers(0, 9), min_size=3, max_size=3).filter(any))
def test_a_split_is_fixed_by_its_key_alone(key, weights):
    names = ("train", "validation", "test")
    fractions = {n: w / sum(weights) for n, w in zip(names, weights, strict=True)}
    split = assign_split(key, fractions)
    assert split == assign_split(key, fractions)
    assert fractions[split] > 0


def test_splits_come_in_the_fractions_asked_for():
    fractions = {"train": 0.7, "validation": 0.2, "test": 0.1}
    base = int(np.random.default_rng().integers(2**40))
    found = [assign_split(base + i, fractions) for i in range(20_000)]
    for name, fraction in fractions.items():
        assert abs(found.count(name) / 20_000 - fraction) < 0.02, base  # six standard deviations
    with pytest.raises(DataError, match="sum to 1"):
        assign_split(1, {"train": 0.7})
