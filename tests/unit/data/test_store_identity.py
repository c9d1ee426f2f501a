"""What is sealed in a store knows its own name and whose it is; looking at it never ends in an error."""

import json
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flywheel.data import TrajectoryStore
from flywheel.data.zarr_files import decode, encode
from flywheel.errors import DataError
from flywheel.seals import Seal, sealed, unsealed


@pytest.fixture
def filled(tmp_path, make_episode) -> Path:
    """A store of two segments and two snapshots, the second grown from the first."""
    return fill(tmp_path / "store", make_episode)


def fill(root: Path, make_episode: Callable[..., Any]) -> Path:
    store = TrajectoryStore(root)
    for i in range(2):
        store.commit(f"e{i}", [make_episode(f"e{i}", seed=i)])
    store.seal("one", ["e0"])
    store.seal("two", ["e0", "e1"], parent="one")
    return root


def found(root: Path) -> list[tuple[str, str]]:
    """Kind and place of all that is wrong; whatever it is, it is told again in the same words."""
    damages = TrajectoryStore(root).verify()
    assert damages == TrajectoryStore(root).verify()
    return sorted((damage.kind, damage.path) for damage in damages)


def test_snapshots_of_the_same_episodes_have_one_digest_wherever_they_are(tmp_path, make_episode):
    one, two = (TrajectoryStore(fill(tmp_path / n, make_episode)).snapshot("two") for n in "ab")
    assert one == two
    assert one.owner != two.owner
    assert (one.parent_name, one.parent) == (
        "one",
        TrajectoryStore(tmp_path / "a").snapshot("one").digest,
    )


def test_what_has_lost_its_seal_was_altered(filled):
    for part in ("snapshots/two.json", "segments/e1/receipt.json", "segments/e0/telemetry.json"):
        values = json.loads((filled / part).read_text())
        del values["seal"]
        (filled / part).write_text(json.dumps(values, indent=1))
    places = ["segments/e0", "segments/e1", "snapshots/two.json"]
    assert found(filled) == [("altered", place) for place in places]
    for read in (lambda s: s.snapshot("two"), lambda s: s.read("e1")):
        with pytest.raises(DataError, match="has no seal"):
            read(TrajectoryStore(filled))
    assert TrajectoryStore(filled).read("e0").id == "e0"  # its data do not suffer


def test_what_was_copied_in_from_another_store_is_foreign(tmp_path, filled, make_episode):
    other = fill(tmp_path / "other", make_episode)
    for part in ("snapshots/one.json", "segments/e1"):
        (shutil.rmtree if part == "segments/e1" else os.unlink)(filled / part)
        (shutil.copytree if part == "segments/e1" else shutil.copy)(other / part, filled / part)
    assert found(filled) == [("foreign", "segments/e1"), ("foreign", "snapshots/one.json")]
    for read in (lambda s: s.snapshot("one"), lambda s: s.read("e1"), lambda s: s.episodes("e1")):
        with pytest.raises(DataError, match="is of another store"):
            read(TrajectoryStore(filled))
    assert TrajectoryStore(filled).unreadable() == ["e1"]


def test_a_store_whose_identity_is_lost_is_known_by_what_lies_in_it(filled, make_episode):
    before = TrajectoryStore(filled).snapshot("two")
    (filled / "store.json").unlink()
    assert found(filled) == [("missing", "store.json")]
    store = TrajectoryStore(filled)
    assert store.snapshot("two").owner == before.owner
    store.commit("e2", [make_episode("e2")])
    assert found(filled) == []
    assert TrajectoryStore(filled).committed()["e2"].owner == before.owner


def test_a_lost_identity_is_not_guessed_where_what_lies_there_is_of_two_stores(
    tmp_path, filled, make_episode
):
    other = fill(tmp_path / "other", make_episode)
    shutil.rmtree(filled / "segments/e1")
    shutil.copytree(other / "segments/e1", filled / "segments/e1")
    (filled / "store.json").unlink()
    assert ("missing", "store.json") in found(filled)
    with pytest.raises(DataError, match="belong to the stores .* and "):
        TrajectoryStore(filled).commit("e2", [make_episode("e2")])


@pytest.mark.parametrize("content", [b"", b"[]", b"{}", b"\xff", b"[" * 10_000])
def test_a_damaged_identity_is_told_and_hinders_no_reading(filled, make_episode, content):
    (filled / "store.json").write_bytes(content)
    assert found(filled) == [("altered", "store.json")]
    assert TrajectoryStore(filled).read("e1").id == "e1"
    with pytest.raises(DataError, match=r"store\.json"):
        TrajectoryStore(filled).commit("e2", [make_episode("e2")])


@pytest.mark.parametrize("place", ["segments", "snapshots"])
def test_a_file_in_the_place_of_a_folder_is_told(filled, place):
    shutil.rmtree(filled / place)
    (filled / place).write_text("x")
    assert ("altered", place) in found(filled)


@pytest.mark.parametrize("name", ["README.txt", "notes.txt", "e9"])
@pytest.mark.parametrize(
    "make", [Path.touch, Path.mkdir, os.mkfifo], ids=["file", "folder", "pipe"]
)
@pytest.mark.parametrize("place", ["segments", "snapshots"])
def test_what_no_store_writes_is_told(filled, place, make, name):
    make(filled / place / name)
    assert found(filled) == [("foreign", f"{place}/{name}")]
    assert TrajectoryStore(filled).committed().keys() == {"e0", "e1"}


def test_a_snapshot_that_is_gone_is_missed_by_the_one_that_grew_from_it(filled):
    (filled / "snapshots/one.json").unlink()
    assert found(filled) == [("missing", "snapshots/one.json")]
    TrajectoryStore(filled).seal("one", ["e1"])
    assert found(filled) == [("altered", "snapshots/one.json")]


def test_three_names_that_went_round_are_all_told(filled):
    TrajectoryStore(filled).seal("three", ["e1"])
    one, two, three = (filled / f"snapshots/{name}.json" for name in ("one", "two", "three"))
    aside = filled / "aside"
    for source, target in ((one, aside), (two, one), (three, two), (aside, three)):
        source.rename(target)
    assert found(filled) == [("foreign", f"snapshots/{n}.json") for n in ("one", "three", "two")]


def content_of(path: Path) -> dict[str, Any]:
    content, _ = unsealed(path.read_bytes(), "It")
    return content


STRANGE = (None, 5, "x", [], {}, [1], [{}], [None], {"a": 1}, ["../../x"], [["e0"]])


@pytest.mark.parametrize("kind", ["snapshot", "segment"])
def test_a_sealed_text_of_other_types_is_refused_and_told(filled, kind):
    path = filled / ("snapshots/one.json" if kind == "snapshot" else "segments/e0/receipt.json")
    name = "one" if kind == "snapshot" else "e0"
    owner = TrajectoryStore(filled).snapshot("one").owner
    content = content_of(path)
    wrong = [content | {field: value} for field in content for value in STRANGE]
    wrong += [
        {f: v for f, v in content.items() if f != left} for left in content if left != "sizes"
    ]
    wrong += [content | {"unheard of": 1}]
    told = 0
    for values in wrong:
        path.write_bytes(sealed(values, Seal(kind, name, owner)))
        told += bool(TrajectoryStore(filled).verify())
    allowed = {"parent": 1, "robot": 1, "datasets": 2, "sha256": 0, "files": 0, "sizes": 2}
    assert len(wrong) - told <= sum(allowed.values()), "what is of the right type is not refused"


@pytest.mark.parametrize("name", ["../e1", "/etc", "", "e1/../e0", "E", "e\0"])
def test_a_name_in_a_manifest_never_leads_out_of_the_store(filled, name):
    path = filled / "snapshots/one.json"
    content, owner = content_of(path), TrajectoryStore(filled).snapshot("one").owner
    content["segments"][0]["segment"] = name
    path.write_bytes(sealed(content, Seal("snapshot", "one", owner)))
    with pytest.raises(DataError, match="segments.0.segment"):
        TrajectoryStore(filled).snapshot("one")
    for ask in ("snapshot", "read", "read_segment", "episodes"):
        with pytest.raises(DataError):
            getattr(TrajectoryStore(filled), ask)(name)


def test_a_file_that_has_another_size_is_not_read(filled):
    (array,) = filled.glob("segments/e0/*.zarr/points/c.*")
    with array.open("wb") as file:
        file.truncate(10**13)
    begun = time.perf_counter()
    assert found(filled) == [("altered", "segments/e0")]
    with pytest.raises(DataError, match="was altered"):
        TrajectoryStore(filled).read("e0")
    assert time.perf_counter() - begun < 2.0


def test_an_array_that_claims_more_than_is_stored_is_not_made():
    files = encode({"a": np.zeros((5, 3))}, {})
    about = json.loads(files["a/zarr.json"])
    about["shape"] = [10**15, 3]
    files["a/zarr.json"] = json.dumps(about).encode()
    with pytest.raises(DataError, match="claims a shape"):
        decode(files)


def test_a_text_of_a_later_version_says_so():
    text = sealed({"a": 1}, Seal("snapshot", "s", "o")).replace(b'"format": 2', b'"format": 3')
    with pytest.raises(DataError, match="format 3, of a later version"):
        unsealed(text, "It")


def test_no_byte_of_a_sealed_text_can_change():
    text = sealed({"a": [1.5, "b"], "c": {}}, Seal("snapshot", "s", "o", {"p": "q"}))
    assert unsealed(text, "It")[1] == Seal("snapshot", "s", "o", {"p": "q"})
    for place in range(len(text)):
        changed = bytearray(text)
        changed[place] ^= 1
        with pytest.raises(DataError):
            unsealed(bytes(changed), "It")
