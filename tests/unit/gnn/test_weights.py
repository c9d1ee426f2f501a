"""Weights on disk: to the bit, named by their content, refused where they do not belong."""

import io
import json
import os
import time
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch

from flywheel.dynamics.gnn import (
    ChunkNetwork,
    NetworkConfig,
    load_weights,
    save_weights,
    weights_digest,
)
from flywheel.dynamics.gnn.weights import network_from_arrays, read_about, wanted_arrays
from flywheel.dynamics.weight_files import arrays_of
from flywheel.errors import ModelError
from tests.damage import flip

CONFIG = NetworkConfig.lean(width=8, rounds=1)


@pytest.fixture
def saved(robots, make_network, seed, tmp_path):
    network = make_network(robots["prism3"], CONFIG, seed)
    path = tmp_path / "weights.npz"
    return network, path, save_weights(network, path, snapshot="abc")


def test_weights_come_back_to_the_bit(robots, saved):
    network, path, digest = saved
    loaded = load_weights(path, robots["prism3"])
    assert loaded.config == network.config
    for name, value in network.state_dict().items():
        assert torch.equal(loaded.state_dict()[name], value), name
    assert weights_digest(loaded) == digest == weights_digest(network)


def test_the_digest_tells_content_and_not_time(saved, tmp_path):
    network, _, digest = saved
    assert save_weights(network, tmp_path / "later.npz") == digest
    with torch.no_grad():
        bias = network.node_decoder.linears[0].bias
        bias[0] = torch.nextafter(bias[0], bias[0] + 1)
    assert weights_digest(network) != digest


def test_the_side_file_says_what_the_weights_are(robots, saved):
    network, path, digest = saved
    about = read_about(path)
    assert about["robot"] == robots["prism3"].digest
    assert (about["snapshot"], about["digest"]) == ("abc", digest)
    assert NetworkConfig.model_validate(about["config"]) == network.config
    mean = about["normalisation"]["normalisers.cable.mean"]
    np.testing.assert_allclose(mean, network.normalisers["cable"].mean, rtol=1e-6)


def test_weights_of_another_robot_are_refused(robots, saved):
    with pytest.raises(ModelError, match="trained for another robot"):
        load_weights(saved[1], robots["icosa6"])


def test_missing_weights_are_refused(robots, saved, tmp_path):
    with pytest.raises(ModelError, match="no weights"):
        load_weights(tmp_path / "nowhere.npz", robots["prism3"])
    saved[1].unlink()
    with pytest.raises(ModelError, match="no weights"):
        load_weights(saved[1], robots["prism3"])


def test_a_flipped_byte_anywhere_is_found(robots, saved, seed):
    path, rng = saved[1], np.random.default_rng(seed)
    whole = path.read_bytes()
    with np.load(path) as file:
        array = file["node_decoder.linears.0.weight"].tobytes()
    place = whole.index(array) + int(rng.integers(len(array)))
    flip(path, place)
    with pytest.raises(ModelError, match="damaged"):
        load_weights(path, robots["prism3"])
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ModelError, match="damaged"):
        load_weights(path, robots["prism3"])


def test_a_side_file_of_other_weights_is_found(robots, saved):
    side = saved[1].with_suffix(".json")
    about = json.loads(side.read_text())
    side.write_text(json.dumps(about | {"digest": "0" * 64}))
    with pytest.raises(ModelError, match="damaged"):
        load_weights(saved[1], robots["prism3"])
    side.write_text("{}")
    with pytest.raises(ModelError, match="does not describe weights"):
        load_weights(saved[1], robots["prism3"])


def test_weights_travel_as_arrays(robots, saved):
    network = saved[0]
    again = network_from_arrays(robots["prism3"], network.config, arrays_of(network))
    assert weights_digest(again) == saved[2]
    wide = NetworkConfig.lean(width=16, rounds=1)
    with pytest.raises(ModelError, match="do not fit"):
        network_from_arrays(robots["prism3"], wide, arrays_of(network))


def test_reading_weights_draws_no_random_number(robots, saved):
    torch.manual_seed(3)
    load_weights(saved[1], robots["prism3"])
    after = torch.rand(1)
    torch.manual_seed(3)
    assert torch.equal(after, torch.rand(1))


def test_the_papers_network_is_as_large_as_the_papers(robots):
    """25.3 million weights without the LSTM, with features a little different from ours."""
    network = ChunkNetwork(robots["prism3"], NetworkConfig.paper(recurrent=False))
    assert network.parameter_count == pytest.approx(25.3e6, rel=0.1)


def zeros(path: Path, wanted: dict[str, np.ndarray]) -> None:
    with path.open("wb") as file:
        file.truncate(3_000_000_000)


def claims(shape: tuple[int, ...], kind: str = "<f4"):
    """An archive whose first array's header claims another shape or type."""

    def write(path: Path, wanted: dict[str, np.ndarray]) -> None:
        with zipfile.ZipFile(path, "w") as archive:
            for number, (name, array) in enumerate(wanted.items()):
                member = io.BytesIO()
                np.save(member, array)
                if not number:
                    member = io.BytesIO()
                    header = {"descr": kind, "fortran_order": False, "shape": shape}
                    np.lib.format.write_array_header_1_0(member, header)
                archive.writestr(f"{name}.npy", member.getvalue())

    return write


def pickled(path: Path, wanted: dict[str, np.ndarray]) -> None:
    first = next(iter(wanted))
    np.savez(path, **wanted | {first: np.array([{"a": 1}], object)})


def bomb(path: Path, wanted: dict[str, np.ndarray]) -> None:
    """The first array is as it should be, and then goes on for 20 MB, which fold to little."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for number, (name, array) in enumerate(wanted.items()):
            member = io.BytesIO()
            np.save(member, array)
            rest = bytes(20_000_000) if not number else b""
            archive.writestr(f"{name}.npy", member.getvalue() + rest)


def twice(path: Path, wanted: dict[str, np.ndarray]) -> None:
    np.savez(path, **wanted)
    with zipfile.ZipFile(path, "a") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr(f"{next(iter(wanted))}.npy", b"")


def one_more(path: Path, wanted: dict[str, np.ndarray]) -> None:
    np.savez(path, **wanted, another=np.zeros(3))


def one_less(path: Path, wanted: dict[str, np.ndarray]) -> None:
    np.savez(path, **dict(list(wanted.items())[1:]))


def short(path: Path, wanted: dict[str, np.ndarray]) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        for name, array in wanted.items():
            member = io.BytesIO()
            np.save(member, array)
            archive.writestr(f"{name}.npy", member.getvalue()[:-4])


def double(path: Path, wanted: dict[str, np.ndarray]) -> None:
    np.savez(path, **{name: array.astype(float) for name, array in wanted.items()})


def pipe(path: Path, wanted: dict[str, np.ndarray]) -> None:
    path.unlink()
    os.mkfifo(path)


def folder(path: Path, wanted: dict[str, np.ndarray]) -> None:
    path.unlink()
    path.mkdir()


def text(path: Path, wanted: dict[str, np.ndarray]) -> None:
    path.write_text("weights")


FORGED = {  # how, and what is said
    "3 GB of zeros": (zeros, "has 3000 MB; at most"),
    "1e15 rows": (claims((10**15,)), "and should be float32"),
    "a negative size": (claims((-1,)), "and should be float32"),
    "sizes whose product overflows": (claims((2**40, 2**40)), "and should be float32"),
    "another type": (claims((1,), "<c16"), "and should be float32"),
    "pickled objects": (pickled, "is object .* and should be float32"),
    "arrays that unfold": (bomb, "does not have .* bytes"),
    "a name twice": (twice, "not the .* arrays of their network"),
    "one more": (one_more, "not the .* arrays of their network"),
    "one less": (one_less, "not the .* arrays of their network"),
    "too short": (short, "does not have .* bytes"),
    "doubles": (double, "is float64 .* and should be float32|MB; at most"),
    "a pipe": (pipe, "is a pipe"),
    "a folder": (folder, "is a folder"),
    "text": (text, "File is not a zip file"),
}


@pytest.mark.parametrize("name", ["prism3", "platform4", "icosa6"])
@pytest.mark.parametrize("preset", [NetworkConfig.lean, NetworkConfig.paper])
def test_what_a_network_holds_is_known_without_making_it(robots, make_network, seed, preset, name):
    config = preset(width=24)
    wanted = wanted_arrays(robots[name], config)
    arrays = arrays_of(make_network(robots[name], config, seed))
    assert {n: (w.shape, w.dtype, w.nbytes) for n, w in wanted.items()} == {
        n: (a.shape, a.dtype, a.nbytes) for n, a in arrays.items()
    }


@pytest.mark.parametrize("how", FORGED)
def test_arrays_are_looked_at_before_they_are_read(robots, saved, how):
    network, path, _ = saved
    forge, said = FORGED[how]
    forge(path, arrays_of(network))
    tracemalloc.start()
    begun = time.perf_counter()
    try:
        with pytest.raises(ModelError, match=rf"weights\.npz.*{said}"):
            load_weights(path, robots["prism3"])
        assert time.perf_counter() - begun < 2.0
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()


STRANGE = (None, True, 5, 1e400, -1, "x", "x" * 100_000, [], [[]], {}, {"a": {}}, [1] * 100_000)


@pytest.mark.parametrize("field", ["format", "digest", "robot", "config", "(all)", "(gone)"])
def test_a_side_file_of_any_other_types_is_refused(robots, saved, field):
    side = saved[1].with_suffix(".json")
    about = json.loads(side.read_text())
    changed = [value if field == "(all)" else about | {field: value} for value in STRANGE]
    if field == "(gone)":
        kept = ("format", "digest", "robot", "config")
        changed = [{k: v for k, v in about.items() if k != name} for name in kept]
    for values in changed:
        side.write_text(json.dumps(values))
        with pytest.raises(ModelError):
            load_weights(saved[1], robots["prism3"])


@pytest.mark.parametrize("content", [b"", b"{", b"[" * 100_000, b"\xff\xfe", b"1" * 10_000])
def test_a_side_file_that_is_no_json_is_refused(robots, saved, content):
    saved[1].with_suffix(".json").write_bytes(content)
    with pytest.raises(ModelError, match=r"weights\.json"):
        load_weights(saved[1], robots["prism3"])


@pytest.mark.parametrize(
    "change",
    [
        {"width": 10**6},
        {"rounds": 10**6},
        {"mlp_layers": 10**6},
        {"width": 10**30},
        {"width": "wide"},
        {"width": 16},
        {"chunk": 17},
        {"no such": 1},
    ],
    ids=str,
)
def test_a_side_file_that_names_another_network_is_refused_at_once(robots, saved, change):
    side = saved[1].with_suffix(".json")
    about = json.loads(side.read_text())
    side.write_text(json.dumps(about | {"config": about["config"] | change}))
    begun = time.perf_counter()
    with pytest.raises(ModelError, match="damaged"):
        load_weights(saved[1], robots["prism3"])
    assert time.perf_counter() - begun < 2.0
