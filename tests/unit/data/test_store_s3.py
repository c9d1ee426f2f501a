"""The store on an S3-compatible service: a local server on a free port."""

import threading

import numpy as np
import pytest

from flywheel.data import SplitSource, TrajectoryStore, WindowCache, s3
from flywheel.errors import DataError

pytestmark = pytest.mark.slow

s3fs = pytest.importorskip("s3fs")


def in_turns(calls):
    """Call all at the same moment; their results or errors."""
    results = [None] * len(calls)
    gate = threading.Barrier(len(calls))

    def one(i):
        gate.wait()
        try:
            results[i] = calls[i]()
        except DataError as error:
            results[i] = error

    threads = [threading.Thread(target=one, args=(i,)) for i in range(len(calls))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return results


def test_a_store_on_s3_answers_as_one_on_disk(bucket, tmp_path, make_episode, prism3):
    store, local = TrajectoryStore(bucket), TrajectoryStore(tmp_path / "local")
    for one in (store, local):
        for i in range(2):
            one.commit(f"e{i}", [make_episode(f"e{i}", seed=i)])
    assert store.committed() == local.committed()
    sealed = store.seal("s", ["e0", "e1"])
    assert sealed == local.seal("s", ["e0", "e1"])
    assert TrajectoryStore(bucket).snapshots() == ["s"]
    back = TrajectoryStore(bucket).read("e1")
    expected = local.read("e1")
    for name in ("points", "winch"):
        got, wanted = (getattr(e.trajectory.observations, name) for e in (back, expected))
        assert got.tobytes() == wanted.tobytes()
    np.testing.assert_array_equal(back.telemetry["plan_seconds"], [0.1, 0.1])
    cache = WindowCache.build(SplitSource(store, sealed, "train", prism3), tmp_path / "cache")
    assert len(cache.starts(40)) == 2
    assert store.verify() == ()


def test_the_address_of_the_service_can_be_given(bucket, service, make_episode, monkeypatch):
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:1")
    store = TrajectoryStore(bucket, {"endpoint_url": service})
    store.commit("e", [make_episode("e")])
    assert list(store.committed()) == ["e"]


def test_what_is_there_on_s3_is_not_replaced(bucket, make_episode):
    store = TrajectoryStore(bucket)
    first = store.commit("e", [make_episode("e", seed=1)])
    assert store.commit("e", [make_episode("e", seed=1)]) == first
    with pytest.raises(DataError, match=first.sha256[:12]):
        TrajectoryStore(bucket).commit("e", [make_episode("e", seed=2)])
    store.commit("f", [make_episode("f")])
    store.seal("s", ["e"])
    with pytest.raises(DataError, match="sealed"):
        TrajectoryStore(bucket).seal("s", ["f"])
    with pytest.raises(DataError, match="no segment 'g'"):
        store.episodes("g")
    assert TrajectoryStore(bucket).verify() == ()


def test_of_several_sealers_at_once_one_wins_and_the_others_are_told(bucket, make_episode):
    stores = [TrajectoryStore(bucket) for _ in range(4)]
    for i, store in enumerate(stores):
        store.commit(f"e{i}", [make_episode(f"e{i}")])
    found = in_turns([lambda s=s, i=i: s.seal("s", [f"e{i}"]) for i, s in enumerate(stores)])
    (winner,) = [one for one in found if not isinstance(one, DataError)]
    assert all(winner.digest[:12] in str(one) for one in found if isinstance(one, DataError))
    assert TrajectoryStore(bucket).snapshot("s") == winner


def test_of_several_writers_of_one_name_one_wins_and_its_data_are_whole(bucket, make_episode):
    stores = [TrajectoryStore(bucket) for _ in range(4)]
    episodes = [make_episode("e", seed=i) for i in range(4)]
    found = in_turns(
        [lambda s=s, e=e: s.commit("e", [e]) for s, e in zip(stores, episodes, strict=True)]
    )
    (winner,) = [i for i, one in enumerate(found) if not isinstance(one, DataError)]
    assert TrajectoryStore(bucket).verify() == ()
    back = TrajectoryStore(bucket).read("e").trajectory
    expected = episodes[winner].trajectory
    assert back.controls.tobytes() == expected.controls.tobytes()


def test_an_upload_that_was_cut_off_is_not_visible_and_swept_when_old(
    bucket, make_episode, monkeypatch
):
    store = TrajectoryStore(bucket)
    store.commit("whole", [make_episode("whole")])

    def died(*args: object) -> bool:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(s3.S3Place, "put_new", died)
        with pytest.raises(KeyboardInterrupt):
            store.commit("cut", [make_episode("cut")])
    files = s3fs.S3FileSystem(use_listings_cache=False)
    assert files.find(f"{bucket}/segments/cut")
    assert list(TrajectoryStore(bucket).committed()) == ["whole"]
    assert store.verify() == ()
    assert store.sweep() == 0  # its writer may be slow
    monkeypatch.setattr(s3, "ABANDONED_SECONDS", -5.0)
    assert store.sweep() == 1
    assert not files.find(f"{bucket}/segments/cut")
    store.commit("cut", [make_episode("cut")])
    assert list(store.committed()) == ["cut", "whole"]


@pytest.mark.parametrize(
    "how",
    ["flipped", *(pytest.param(h, marks=pytest.mark.nightly) for h in ("deleted", "receipt"))],
)
def test_damage_on_s3_is_found_and_named(bucket, make_episode, how):
    store = TrajectoryStore(bucket)
    store.commit("e", [make_episode("e")])
    store.seal("s", ["e"])
    files = s3fs.S3FileSystem(use_listings_cache=False)
    wanted = "receipt.json" if how == "receipt" else "/points/c."
    (name,) = [n for n in files.find(f"{bucket}/segments/e") if wanted in n]
    if how == "flipped":
        content = bytearray(files.cat_file(name))
        content[50] ^= 1
        files.pipe_file(name, bytes(content))
    else:
        files.rm_file(name)
    (damage,) = TrajectoryStore(bucket).verify()
    assert damage.episodes == ("e",)
    with pytest.raises(DataError, match="e"):
        TrajectoryStore(bucket).read("e")
    store.quarantine("e")
    assert TrajectoryStore(bucket).committed() == {}
    assert len(store.quarantined()) == 1
    store.commit("e", [make_episode("e")])


def test_what_is_exchanged_foreign_or_set_aside_on_s3_is_known(bucket, make_episode):
    store, other = TrajectoryStore(bucket), TrajectoryStore(f"{bucket}-other")
    for one in (store, other):
        one.commit("e", [make_episode("e", seed=1)])
        one.seal("one", ["e"])
        one.seal("two", ["e"], parent="one")
    files = s3fs.S3FileSystem(use_listings_cache=False)
    first, second = (f"{bucket}/snapshots/{name}.json" for name in ("one", "two"))
    texts = files.cat_file(first), files.cat_file(second)
    files.pipe_file(first, texts[1])
    files.pipe_file(second, texts[0])
    kinds = {(d.kind, d.path) for d in TrajectoryStore(bucket).verify()}
    assert kinds == {("foreign", "snapshots/one.json"), ("foreign", "snapshots/two.json")}
    files.pipe_file(first, files.cat_file(f"{bucket}-other/snapshots/one.json"))
    files.pipe_file(second, texts[1])
    (damage,) = TrajectoryStore(bucket).verify()
    assert (damage.kind, damage.path) == ("foreign", "snapshots/one.json")
    store.quarantine_snapshot("one")
    assert store.snapshots() == ["two"]
    assert [name.startswith("snapshot-one.json.") for name in store.quarantined()] == [True]
    with pytest.raises(DataError, match="no snapshot 'one'"):
        store.quarantine_snapshot("one")


def test_a_bucket_that_is_not_there_is_said_at_once(bucket):
    with pytest.raises(DataError, match=r"'not-there' .* AWS_ENDPOINT_URL"):
        TrajectoryStore("s3://not-there/run")
