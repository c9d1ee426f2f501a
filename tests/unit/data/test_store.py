import dataclasses
import errno
import shutil
from pathlib import Path

import numpy as np
import pytest

from flywheel.data import TrajectoryStore
from flywheel.data import store as store_module
from flywheel.errors import DataError, RunError
from flywheel.records import Episode, Observation, Trajectory


def same(one: Episode, other: Episode) -> bool:
    a, b = one.trajectory, other.trajectory
    pairs = [
        (a.observations.points, b.observations.points),
        (a.observations.winch, b.observations.winch),
        (a.controls, b.controls),
    ]
    if a.states is not None and b.states is not None:
        pairs += [(getattr(a.states, n), getattr(b.states, n)) for n in ("qpos", "qvel", "act")]
    return (
        (a.states is None) == (b.states is None)
        and all(x.tobytes() == y.tobytes() and x.dtype == y.dtype for x, y in pairs)
        and (one.id, one.provenance, one.split, one.outcome)
        == (other.id, other.provenance, other.split, other.outcome)
    )


def array_file(root: Path, segment: str, array: str = "points") -> Path:
    found = (root / "segments" / segment).glob(f"*.zarr/{array}/c/**/*")
    return next(path for path in found if path.is_file())


def flip(path: Path, place: int) -> None:
    content = bytearray(path.read_bytes())
    content[place % len(content)] ^= 1 << (place % 8)
    path.write_bytes(content)


@pytest.mark.parametrize("recording", [False, True])
def test_episodes_come_back_to_the_bit(tmp_path, make_episode, recording):
    stored = [make_episode(f"e{i}", steps=3 + 700 * i, recording=recording) for i in range(3)]
    TrajectoryStore(tmp_path).commit("several", stored)
    store = TrajectoryStore(tmp_path)
    for episode in stored:
        back = store.read(episode.id)
        assert same(episode, back)
        np.testing.assert_array_equal(back.timing["plan_seconds"], episode.timing["plan_seconds"])


def test_committing_the_same_again_changes_nothing_and_other_content_is_refused(
    tmp_path, make_episode
):
    store = TrajectoryStore(tmp_path)
    first = store.commit("e", [make_episode("e", seed=1)])
    assert store.commit("e", [make_episode("e", seed=1, timing=9.0)]) == first
    with pytest.raises(DataError, match=first.sha256[:12]):
        store.commit("e", [make_episode("e", seed=2)])
    assert same(TrajectoryStore(tmp_path).read("e"), make_episode("e", seed=1))


def test_digests_do_not_depend_on_timing_or_place(tmp_path, make_episode):
    receipts = [
        TrajectoryStore(tmp_path / str(t)).commit("e", [make_episode("e", seed=3, timing=t)])
        for t in (0.1, 0.7)
    ]
    assert receipts[0] == receipts[1]


def test_a_flipped_bit_anywhere_is_found_and_the_episode_named(tmp_path, make_episode):
    store = TrajectoryStore(tmp_path / "store")
    for name in ("good", "bad"):
        store.commit(name, [make_episode(name)])
    store.seal("s", ["good", "bad"])
    rng = np.random.default_rng()
    hashed = [
        p
        for p in (tmp_path / "store").rglob("*")
        if p.is_file() and p.name != "timing.json" and "good" not in p.parts
    ]
    assert len(hashed) > 10
    for path in hashed:
        place = int(rng.integers(path.stat().st_size))
        broken = tmp_path / "broken"
        shutil.copytree(tmp_path / "store", broken)
        flip(broken / path.relative_to(tmp_path / "store"), place)
        damages = TrajectoryStore(broken).verify()
        assert damages, (path, place)
        assert all(d.segment in ("bad", "snapshot s") for d in damages)
        if path.suffix != ".json" or path.name == "zarr.json":
            assert damages[0].episodes == ("bad",), (path, place)
            with pytest.raises(DataError, match="bad"):
                TrajectoryStore(broken).read("bad")
        assert same(TrajectoryStore(broken).read("good"), store.read("good"))
        shutil.rmtree(broken)


def test_a_damaged_receipt_is_named_after_the_snapshot_that_lists_it(tmp_path, make_episode):
    store = TrajectoryStore(tmp_path)
    store.commit("e", [make_episode("e")])
    snapshot = store.seal("s", ["e"])
    (tmp_path / "segments/e/receipt.json").write_text("{}")
    (damage,) = TrajectoryStore(tmp_path).verify(snapshot)
    assert damage.episodes == ("e",)


@pytest.mark.parametrize("how", ["deleted", "truncated", "added"])
def test_files_that_are_gone_cut_or_strange_are_found(tmp_path, make_episode, how):
    store = TrajectoryStore(tmp_path)
    store.commit("e", [make_episode("e", steps=1200)])
    path = array_file(tmp_path, "e", "controls")
    if how == "deleted":
        path.unlink()
    elif how == "truncated":
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    else:
        path.with_name("1").write_bytes(b"x")
    (damage,) = store.verify()
    assert damage.episodes == ("e",)
    with pytest.raises(DataError, match="e: "):
        store.read("e")
    with pytest.raises(DataError, match="sound"):
        store.seal("s", ["e"])


def test_a_quarantined_segment_is_kept_aside_and_can_be_collected_again(tmp_path, make_episode):
    store = TrajectoryStore(tmp_path)
    store.commit("e", [make_episode("e", seed=1)])
    flip(array_file(tmp_path, "e"), 100)
    store.quarantine("e")
    assert store.quarantined() == ["e.0"]
    assert store.committed() == {}
    store.commit("e", [make_episode("e", seed=1)])
    assert store.verify() == ()


def test_a_full_disk_says_so_and_harms_nothing(tmp_path, make_episode, monkeypatch):
    store = TrajectoryStore(tmp_path)
    store.commit("kept", [make_episode("kept")])

    def full(*args: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(store_module, "write_group", full)
    with pytest.raises(RunError, match="full"):
        store.commit("lost", [make_episode("lost")])
    assert list(TrajectoryStore(tmp_path).committed()) == ["kept"]
    assert list((tmp_path / "tmp").iterdir()) == []


def test_a_snapshot_keeps_its_digest_and_its_name(tmp_path, make_episode):
    store = TrajectoryStore(tmp_path)
    for i in range(3):
        store.commit(f"e{i}", [make_episode(f"e{i}", dataset=f"set{i}", seed=i)])
    one = store.seal("one", ["e0"], datasets=["set1"])
    assert store.seal("one", ["e0"], datasets=["set1"]) == one
    with pytest.raises(DataError, match="sealed"):
        store.seal("one", ["e1"])
    two = store.seal("two", ["e0", "e2"], parent="one")
    assert two.datasets == ("set0", "set1", "set2") or two.datasets[:2] == one.datasets
    assert two.parent == one.digest
    assert store.snapshots() == ["one", "two"]
    with pytest.raises(DataError, match="one, two"):
        store.snapshot("three")


def test_what_does_not_belong_together_is_not_sealed(tmp_path, make_episode):
    store = TrajectoryStore(tmp_path)
    mine = make_episode("mine")
    other = dataclasses.replace(
        make_episode("other"), provenance=dataclasses.replace(mine.provenance, robot="f" * 64)
    )
    store.commit("mine", [mine])
    store.commit("other", [other])
    store.commit("again", [mine])
    with pytest.raises(DataError, match="one robot"):
        store.seal("s", ["mine", "other"])
    with pytest.raises(DataError, match="twice: mine"):
        store.seal("s", ["mine", "again"])
    with pytest.raises(DataError, match="nothing"):
        store.seal("s", ["nothing"])
    with pytest.raises(DataError, match="at least one"):
        store.seal("s", [])


def test_what_must_not_be_stored_is_refused_by_name(tmp_path, make_episode):
    store = TrajectoryStore(tmp_path)
    good = make_episode("e")
    states = good.trajectory.states
    broken = dataclasses.replace(states, qvel=np.where(states.qvel > 2, np.nan, states.qvel))
    broken.qvel[3, 0] = np.nan
    with pytest.raises(DataError, match="e: qvel"):
        store.commit("e", [replaced(good, states=broken)])
    endless = Observation(good.trajectory.observations.points.copy(), np.full((41, 6), np.inf))
    with pytest.raises(DataError, match="infinite"):
        store.commit("e", [replaced(good, observations=endless)])
    for name in ("E", "../e", "", "a/b"):
        with pytest.raises(DataError, match="name"):
            store.commit(name, [good])
    assert store.committed() == {}


def replaced(episode: Episode, **changes: object) -> Episode:
    trajectory: Trajectory = dataclasses.replace(episode.trajectory, **changes)  # type: ignore[arg-type]
    return dataclasses.replace(episode, trajectory=trajectory)
