"""The store on an S3-compatible service: a local server on a free port."""

import uuid

import pytest

from flywheel.data import TrajectoryStore, WindowCache
from flywheel.errors import DataError

moto = pytest.importorskip("moto.server")
pytest.importorskip("s3fs")


@pytest.fixture
def bucket(monkeypatch, tmp_path):
    server = moto.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "test")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "test")
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    import s3fs

    s3fs.S3FileSystem.clear_instance_cache()
    name = f"episodes-{uuid.uuid4().hex}"  # the server's buckets outlive it
    s3fs.S3FileSystem().mkdir(name)
    yield f"s3://{name}/run"
    s3fs.S3FileSystem.clear_instance_cache()
    server.stop()


def test_a_store_on_s3_answers_as_one_on_disk(bucket, tmp_path, make_episode, prism3):
    store, local = TrajectoryStore(bucket), TrajectoryStore(tmp_path / "local")
    for one in (store, local):
        for i in range(2):
            one.commit(f"e{i}", [make_episode(f"e{i}", seed=i)])
    assert store.committed() == local.committed()
    sealed = store.seal("s", ["e0", "e1"])
    assert sealed == local.seal("s", ["e0", "e1"])
    assert TrajectoryStore(bucket).snapshots() == ["s"]
    back = TrajectoryStore(bucket).read("e1").trajectory
    expected = local.read("e1").trajectory
    assert back.observations.points.tobytes() == expected.observations.points.tobytes()
    cache = WindowCache.build(store, sealed, "train", tmp_path / "cache", prism3)
    assert len(cache.starts(40)) == 2
    assert store.verify() == ()


def test_what_is_there_on_s3_is_not_replaced(bucket, make_episode):
    store = TrajectoryStore(bucket)
    first = store.commit("e", [make_episode("e", seed=1)])
    assert store.commit("e", [make_episode("e", seed=1)]) == first
    with pytest.raises(DataError, match="committed"):
        TrajectoryStore(bucket).commit("e", [make_episode("e", seed=2)])
    store.commit("f", [make_episode("f")])
    store.seal("s", ["e"])
    with pytest.raises(DataError, match="sealed"):
        TrajectoryStore(bucket).seal("s", ["f"])
    assert TrajectoryStore(bucket).verify() == ()


def test_damage_on_s3_is_found_and_named(bucket, make_episode):
    import s3fs

    store = TrajectoryStore(bucket)
    store.commit("e", [make_episode("e")])
    files = s3fs.S3FileSystem()
    (name,) = [n for n in files.find(f"{bucket}/segments/e") if "/points/c/" in n]
    content = bytearray(files.cat_file(name))
    content[50] ^= 1
    files.pipe_file(name, bytes(content))
    (damage,) = TrajectoryStore(bucket).verify()
    assert damage.episodes == ("e",)
    store.quarantine("e")
    assert TrajectoryStore(bucket).committed() == {}
