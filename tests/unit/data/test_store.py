import dataclasses
import errno
import os
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from flywheel.data import SplitSource, TrajectoryStore, WindowCache
from flywheel.data.zarr_files import decode
from flywheel.errors import DataError, RunError
from flywheel.records import Episode, Observation, Trajectory
from tests import draws
from tests.damage import flip


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
    return next((root / "segments" / segment).glob(f"*.zarr/{array}/c.*"))


@pytest.mark.parametrize("recording", [False, True])
def test_episodes_come_back_to_the_bit(tmp_path, make_episode, recording):
    stored = [make_episode(f"e{i}", steps=3 + 700 * i, recording=recording) for i in range(3)]
    TrajectoryStore(tmp_path).commit("several", stored)
    store = TrajectoryStore(tmp_path)
    for episode in stored:
        back = store.read(episode.id)
        assert same(episode, back)
        np.testing.assert_array_equal(
            back.telemetry["plan_seconds"], episode.telemetry["plan_seconds"]
        )


def test_arrays_that_do_not_read_back_are_not_stored(tmp_path, make_episode, monkeypatch):
    def other(files):
        arrays, attributes = decode(files)
        return {name: values + (name == "controls") for name, values in arrays.items()}, attributes

    monkeypatch.setattr("flywheel.data.zarr_files.decode", other)
    with pytest.raises(DataError, match="array controls differs when read back"):
        TrajectoryStore(tmp_path).commit("one", [make_episode("e0")])
    assert TrajectoryStore(tmp_path).committed() == {}


def test_committing_the_same_again_changes_nothing_and_other_content_is_refused(
    tmp_path, make_episode
):
    store = TrajectoryStore(tmp_path)
    first = store.commit("e", [make_episode("e", seed=1)])
    assert store.commit("e", [make_episode("e", seed=1, timing=9.0)]) == first
    with pytest.raises(DataError, match=first.sha256[:12]):
        store.commit("e", [make_episode("e", seed=2)])
    assert same(TrajectoryStore(tmp_path).read("e"), make_episode("e", seed=1))


def test_digests_do_not_depend_on_telemetry_or_place(tmp_path, make_episode):
    receipts = [
        TrajectoryStore(tmp_path / str(t)).commit("e", [make_episode("e", seed=3, timing=t)])
        for t in (0.1, 0.7)
    ]
    assert receipts[0] == receipts[1]


def test_plans_come_back(tmp_path, make_episode):
    store, rng = TrajectoryStore(tmp_path), np.random.default_rng(draws.seed())
    begins, paths = np.arange(3) * 0.5, rng.normal(size=(3, 4, 5, 2)).round(3)
    seen = {"plan_begins": begins, "plan_paths": paths}
    store.commit("e", [dataclasses.replace(make_episode("e"), telemetry=seen)])
    plans = TrajectoryStore(tmp_path).read("e").plans
    assert plans.at(-0.1) is None
    for at, number in ((0.0, 0), (0.49, 0), (0.5, 1), (9.0, 2)):
        np.testing.assert_array_equal(plans.at(at), paths[number])


@pytest.mark.slow
def test_a_flipped_bit_anywhere_is_found_and_the_episode_named(tmp_path, make_episode):
    store = TrajectoryStore(tmp_path)
    for name in ("good", "bad"):
        store.commit(name, [make_episode(name)])
    store.seal("s", ["good", "bad"])
    rng = np.random.default_rng(draws.seed())
    files = [p for p in tmp_path.glob("s*/**/*") if p.is_file() and "good" not in p.parts]
    assert len(files) > 10
    for path in files:
        sound, place = path.read_bytes(), int(rng.integers(path.stat().st_size))
        flip(path, place)
        damages = TrajectoryStore(tmp_path).verify()
        assert damages, (path, place)
        assert all(d.segment in ("bad", "snapshot s") for d in damages)
        if path.parent.name != "snapshots":  # whose flipped byte may lie in the id itself
            assert {d.episodes for d in damages} == {("bad",)}, (path, place)
        if path.parent.name != "snapshots" and path.name != "telemetry.json":
            with pytest.raises(DataError, match="bad"):
                TrajectoryStore(tmp_path).read("bad")
        assert same(TrajectoryStore(tmp_path).read("good"), store.read("good"))
        path.write_bytes(sound)
    assert store.verify() == ()


def test_a_damaged_manifest_is_refused_and_names_its_episodes(tmp_path, make_episode):
    store = TrajectoryStore(tmp_path)
    store.commit("e", [make_episode("e0"), make_episode("e1")])
    sealed = store.seal("s", ["e"])
    path = tmp_path / "snapshots/s.json"
    path.write_text(path.read_text().replace('"train"', '"test"', 1))
    with pytest.raises(DataError, match="altered"):
        store.snapshot("s")
    for found in (store.verify(), store.verify(sealed)):
        assert found[0].episodes == ("e0", "e1")


@pytest.mark.parametrize("name", ["segments/e/receipt.json", "snapshots/s.json"])
def test_a_byte_that_changes_no_meaning_is_found_too(tmp_path, make_episode, name):
    store = TrajectoryStore(tmp_path)
    store.commit("e", [make_episode("e")])
    store.seal("s", ["e"])
    path = tmp_path / name
    path.write_text(path.read_text().replace("\n", " ", 1))
    (damage,) = store.verify()
    assert damage.episodes == ("e",)


def test_a_segment_that_is_not_the_one_a_snapshot_lists_is_found(tmp_path, make_episode, prism3):
    store = TrajectoryStore(tmp_path / "store")
    store.commit("e", [make_episode("e", seed=1)])
    sealed = store.seal("s", ["e"])
    store.quarantine("e")
    (missing,) = store.verify()
    assert (missing.episodes, missing.what) == (("e",), "the segment is missing")
    store.commit("e", [make_episode("e", seed=2)])  # sound in itself
    for found in (store.verify(), store.verify(sealed)):
        assert [d.episodes for d in found] == [("e",)]
        assert sealed.sha256[0][:12] in found[0].what
    with pytest.raises(DataError, match="lists it"):
        WindowCache.build(SplitSource(store, sealed, "train", prism3), tmp_path / "cache")
    with pytest.raises(DataError, match="undamaged"):
        store.seal("t", ["e"], parent="s")


def test_what_was_found_under_another_name_is_not_taken_for_it(tmp_path, make_episode):
    store = TrajectoryStore(tmp_path)
    store.commit("e", [make_episode("e")])
    shutil.copytree(tmp_path / "segments/e", tmp_path / "segments/f")
    (damage,) = store.verify()
    assert damage.segment == "f"
    assert "that of e" in damage.what


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
        path.with_name("c.1.0").write_bytes(b"x")
    (damage,) = store.verify()
    assert damage.episodes == ("e",)
    with pytest.raises(DataError, match="e: "):
        store.read("e")
    with pytest.raises(DataError, match="undamaged"):
        store.seal("s", ["e"])


def test_a_quarantined_segment_is_kept_aside_and_can_be_collected_again(tmp_path, make_episode):
    store = TrajectoryStore(tmp_path)
    store.commit("e", [make_episode("e", seed=1)])
    flip(array_file(tmp_path, "e"), 100)
    elsewhere = TrajectoryStore(tmp_path)
    assert list(elsewhere.committed()) == ["e"]
    with pytest.raises(DataError, match="set it aside first"):
        store.commit("e", [make_episode("e", seed=1)])
    (tmp_path / "segments/e/receipt.json").write_text("{}")
    with pytest.raises(DataError, match="set it aside first"):
        store.commit("e", [make_episode("e", seed=1)])
    store.quarantine("e")
    assert [name.split(".")[0] for name in store.quarantined()] == ["e"]
    assert store.committed() == elsewhere.committed() == {}
    with pytest.raises(DataError, match="no segment 'e'"):
        store.quarantine("e")
    store.commit("e", [make_episode("e", seed=2)])
    assert same(elsewhere.read("e"), make_episode("e", seed=2))
    assert store.verify() == ()


@pytest.fixture
def small_disk(tmp_path):
    """A file system of one megabyte."""
    mounted = tmp_path / "disk"
    mounted.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(mounted)]
    if os.getuid() != 0 or subprocess.run(mount, capture_output=True).returncode != 0:
        pytest.skip("mounting a file system takes root")
    yield mounted
    subprocess.run(["umount", str(mounted)], check=True)


def test_a_disk_that_fills_up_says_so_and_harms_nothing(small_disk, make_episode):
    store = TrajectoryStore(small_disk)
    kept = {}
    with pytest.raises(RunError, match=r"full: segment e\d+ was not stored"):
        for i in range(100):
            kept[f"e{i}"] = make_episode(f"e{i}", steps=400)
            store.commit(f"e{i}", [kept[f"e{i}"]])
    unlucky = kept.popitem()[0]
    again = TrajectoryStore(small_disk)
    assert len(kept) > 1
    assert set(again.committed()) == set(kept)
    assert again.verify() == ()
    assert all(same(again.read(name), episode) for name, episode in kept.items())
    assert list((small_disk / "tmp").iterdir()) == []
    (small_disk / "filler").write_bytes(b"x" * (shutil.disk_usage(small_disk).free))
    with pytest.raises(RunError, match="was not sealed"):
        again.seal("s", sorted(kept))
    (small_disk / "filler").unlink()
    assert again.seal("s", sorted(kept)).segments == tuple(sorted(kept))
    assert unlucky not in again.committed()


def test_a_full_disk_leaves_no_litter(tmp_path, make_episode, monkeypatch):
    store = TrajectoryStore(tmp_path)
    store.commit("kept", [make_episode("kept")])

    def full(*args: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    for name in ("fsync", "link", "mkdir"):
        with monkeypatch.context() as patch:
            patch.setattr(os, name, full)
            with pytest.raises(RunError, match="full"):
                store.commit("lost", [make_episode("lost")])
                store.seal("s", ["kept"])
        assert list((tmp_path / "tmp").iterdir()) == []
        if "lost" in store.committed():
            store.quarantine("lost")
    assert list(TrajectoryStore(tmp_path).committed()) == ["kept"]


def test_only_what_dead_writers_left_is_swept(tmp_path, make_episode):
    store = TrajectoryStore(tmp_path)
    store.commit("e", [make_episode("e")])
    litter = tmp_path / "tmp"
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    host = socket.gethostname()
    mine = f"{host}+{os.getpid()}+b"
    for name in (f"{host}+{dead.pid}+a", mine, "elsewhere+1+c", "elsewhere+1+d"):
        (litter / name).mkdir()
    two_days_ago = time.time() - 2 * 86400
    os.utime(litter / "elsewhere+1+d", (two_days_ago, two_days_ago))
    assert store.sweep() == 2
    left = {path.name for path in litter.iterdir()}
    assert left == {mine, "elsewhere+1+c"}
    assert store.verify() == ()


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
    torn = dataclasses.replace(mine, split="test")
    store.commit("torn", [torn])
    store.seal("parent", ["mine"])
    for parent in (None, "parent"):
        with pytest.raises(DataError, match="stays in one split; mine is in train"):
            store.seal("s", ["mine", "torn"], parent=parent)
    with pytest.raises(DataError, match="stays in one split"):
        store.seal("s", ["torn"], parent="parent")
    store.commit("slow", [replaced(make_episode("slow"), dt=0.02)])
    with pytest.raises(DataError, match=r"one dt; got 0.01 s \(mine\), 0.02 s \(slow\)"):
        store.seal("s", ["mine", "slow"])
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
    nowhere = make_episode("e")
    nowhere.trajectory.controls[7, 2] = np.nan
    with pytest.raises(DataError, match="e: controls"):
        store.commit("e", [nowhere])
    flat = Observation(good.trajectory.observations.points, np.full((3, 6), np.nan))
    with pytest.raises(DataError, match=r"e: winch positions are \(41, 6\)"):
        store.commit("e", [replaced(good, observations=flat)])
    with pytest.raises(DataError, match="e: provenance"):
        origin = dataclasses.replace(good.provenance, plant={"friction": np.nan})
        store.commit("e", [dataclasses.replace(good, provenance=origin)])
    with pytest.raises(DataError, match="split is one of train"):
        store.commit("e", [dataclasses.replace(good, split="dev")])
    good = make_episode("e")
    for name in ("E", "../e", "", "a/b"):
        with pytest.raises(DataError, match="name"):
            store.commit(name, [good])
    assert store.committed() == {}


def test_an_episode_is_not_read_as_another(tmp_path, make_episode):
    store = TrajectoryStore(tmp_path)
    store.commit("a", [make_episode("b", seed=1)])
    store.commit("c", [make_episode("a", seed=2), make_episode("d", seed=3)])
    assert same(store.read("a"), make_episode("a", seed=2))
    assert same(store.read("b"), make_episode("b", seed=1))
    assert [e.id for e in store.episodes("c")] == ["a", "d"]
    with pytest.raises(DataError, match="no episode 'c'"):
        store.read("c")


@pytest.mark.slow
def test_equal_numbers_give_equal_digests_in_any_process(tmp_path, make_episode):
    wide = make_episode("e", seed=5)
    seen = wide.trajectory.observations
    points = seen.points.astype(np.float32)
    narrow = replaced(wide, observations=Observation(points, -seen.winch))  # another NaN
    wide = replaced(wide, observations=Observation(points.astype(float), seen.winch))
    here = TrajectoryStore(tmp_path / "here").commit("e", [wide])
    assert TrajectoryStore(tmp_path / "narrow").commit("e", [narrow]).sha256 == here.sha256
    program = (
        "import sys; from flywheel.data import TrajectoryStore; "
        "e = TrajectoryStore(sys.argv[1]).read('e'); "
        "print(TrajectoryStore(sys.argv[2]).commit('e', [e]).sha256)"
    )
    command = [sys.executable, "-c", program, str(tmp_path / "here"), str(tmp_path / "there")]
    assert subprocess.check_output(command, text=True).strip() == here.sha256


def test_a_url_of_another_kind_is_refused():
    with pytest.raises(DataError, match="s3://bucket/prefix, got 'gs://"):
        TrajectoryStore("gs://bucket")


def replaced(episode: Episode, **changes: object) -> Episode:
    trajectory: Trajectory = dataclasses.replace(episode.trajectory, **changes)  # type: ignore[arg-type]
    return dataclasses.replace(episode, trajectory=trajectory)


def test_a_process_whose_threads_are_slow_to_end_ends_without_a_word():
    slow = (
        "import time; import numpy as np; from zarr.core import sync;"
        "from flywheel.data.zarr_files import encode; encode({'a': np.ones(3)}, {});"
        "sync.loop[0].call_soon_threadsafe(time.sleep, 2)"
    )
    done = subprocess.run([sys.executable, "-c", slow], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
