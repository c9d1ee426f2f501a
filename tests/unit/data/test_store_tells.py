"""What a store says of damage: which episodes, what is wrong, and of nothing twice."""

from pathlib import Path

import pytest

from flywheel.data import TrajectoryStore
from flywheel.errors import DataError


def largest_file(root: Path, segment: str) -> Path:
    """One that a segment cannot do without."""
    files = (path for path in (root / "segments" / segment).rglob("*") if path.is_file())
    return max(files, key=lambda path: path.stat().st_size)


@pytest.fixture
def store(tmp_path, make_episode) -> TrajectoryStore:
    """Two segments in a snapshot, and a third one."""
    store = TrajectoryStore(tmp_path)
    for i, name in enumerate(("one", "two", "three")):
        store.commit(name, [make_episode(f"{name}-{part}", seed=10 * i + part) for part in (0, 1)])
    store.seal("s", ["one", "two"])
    return store


@pytest.mark.parametrize("segment", ["one", "three"])
def test_damage_is_told_once_whether_a_snapshot_lists_the_segment_or_not(store, tmp_path, segment):
    file = largest_file(tmp_path, segment)
    file.write_bytes(file.read_bytes()[:-1])
    (damage,) = store.verify()
    assert (damage.segment, damage.episodes) == (segment, (f"{segment}-0", f"{segment}-1"))
    assert file.name in damage.what


def test_a_snapshot_is_verified_without_what_it_does_not_list(store, tmp_path) -> None:
    sealed = store.snapshot("s")
    other = largest_file(tmp_path, "three")
    other.write_bytes(b"")
    assert store.verify(sealed) == ()
    mine = largest_file(tmp_path, "two")
    mine.write_bytes(b"")
    assert [damage.segment for damage in store.verify(sealed)] == ["two"]


@pytest.mark.parametrize("segment", ["one", "three"])
def test_a_file_that_cannot_be_read_is_damage_like_any_other(store, tmp_path, segment) -> None:
    file = largest_file(tmp_path, segment)
    file.unlink()
    file.symlink_to(tmp_path / "nowhere")
    (damage,) = store.verify()
    assert damage.segment == segment and "cannot be read" in damage.what
    assert damage.episodes == ((f"{segment}-0", f"{segment}-1") if segment == "one" else ())
    with pytest.raises(DataError, match="cannot be read"):
        store.read(f"{segment}-0")
    for name in ("one", "two", "three"):
        if name != segment:
            assert store.read(f"{name}-1").id == f"{name}-1"


def test_every_refusal_of_a_damaged_segment_names_its_episodes_and_what_is_wrong(
    store, tmp_path, make_episode
) -> None:
    file = largest_file(tmp_path, "one")
    file.write_bytes(b"")
    told = rf"{file.name} was altered\. Episodes: one-0, one-1"
    with pytest.raises(DataError, match=told):
        store.read_segment("one")
    with pytest.raises(DataError, match=f"undamaged segments only.*{told}"):
        store.seal("t", ["one", "two"])
    with pytest.raises(DataError, match=f"set it aside first.*{told}"):
        store.commit("one", [make_episode(f"one-{part}", seed=part) for part in (0, 1)])


def test_a_snapshot_that_is_gone_is_named(store, tmp_path) -> None:
    sealed = store.snapshot("s")
    next((tmp_path / "snapshots").iterdir()).unlink()
    (damage,) = store.verify(sealed)
    assert damage.segment == "snapshot s" and "no snapshot 's'" in damage.what
    assert damage.episodes == ()


def test_another_snapshot_of_the_same_name_is_not_taken_for_it(store, tmp_path) -> None:
    sealed = store.snapshot("s")
    next((tmp_path / "snapshots").iterdir()).unlink()
    other = store.seal("s", ["three"])
    (damage,) = store.verify(sealed)
    assert damage.segment == "snapshot s"
    assert sealed.digest[:12] in damage.what and other.digest[:12] in damage.what
    assert store.verify(other) == ()


def test_a_segment_that_is_not_there_is_missed_by_name(store) -> None:
    for missed in (store.read_segment, store.episodes, store.quarantine):
        with pytest.raises(DataError, match="There is no segment 'four'"):
            missed("four")
    with pytest.raises(DataError, match="There is no segment 'four'"):
        store.seal("t", ["one", "four"])
    with pytest.raises(DataError, match="no snapshot 'none'.*Sealed: s"):
        store.seal("t", ["one"], parent="none")


def test_an_empty_store_says_so(tmp_path) -> None:
    empty = TrajectoryStore(tmp_path / "new")
    assert (empty.committed(), empty.snapshots(), empty.verify(), empty.quarantined()) == (
        {}, [], (), [],
    )  # fmt: skip
    assert empty.sweep() == 0
    with pytest.raises(DataError, match="no snapshot 's'.*Sealed: none"):
        empty.snapshot("s")


@pytest.mark.parametrize("name", ["E", "../e", "", "a/b", ".e", "e e"])
def test_no_kind_of_name_leaves_its_place(tmp_path, make_episode, name) -> None:
    store = TrajectoryStore(tmp_path)
    with pytest.raises(DataError, match="segment's name"):
        store.commit(name, [make_episode("e")])
    with pytest.raises(DataError, match="episode's name"):
        store.commit("e", [make_episode(name)])
    store.commit("e", [make_episode("e")])
    with pytest.raises(DataError, match="snapshot's name"):
        store.seal(name, ["e"])
    assert list(store.committed()) == ["e"] and store.snapshots() == []


def test_what_was_set_aside_and_collected_again_elsewhere_is_known_by_its_new_content(
    store, tmp_path, make_episode
) -> None:
    before = store.committed()["three"]
    store.quarantine("three")
    again = TrajectoryStore(tmp_path).commit("three", [make_episode("other")])
    assert store.committed()["three"] == again != before
    assert store.read("other").id == "other"


def test_what_others_commit_and_what_cannot_be_read_are_told_apart(store, tmp_path, make_episode):
    other = TrajectoryStore(tmp_path)
    other.commit("four", [make_episode("four-0")])
    assert sorted(store.committed()) == ["four", "one", "three", "two"]
    assert store.unreadable() == []
    (tmp_path / "segments/five").mkdir()
    assert store.unreadable() == ["five"]
    assert "five" not in store.committed()
    store.committed().clear()  # is the caller's own
    assert len(store.committed()) == 4


def test_episodes_are_found_in_whichever_segment_holds_them(store) -> None:
    for name in ("one-0", "one-1", "three-1"):
        assert store.read(name).id == name
    assert [summary.id for summary in store.episodes("two")] == ["two-0", "two-1"]
    assert [episode.id for episode in store.read_segment("two")] == ["two-0", "two-1"]


def test_a_snapshot_that_grows_keeps_what_its_parent_has_and_names_it(store, make_episode) -> None:
    parent = store.snapshot("s")
    child = store.seal("t", ["one", "two", "three"], parent="s", datasets=["extra"])
    assert child.parent == parent.digest and not parent.parent
    assert child.datasets == (*parent.datasets, "extra")
    assert child.segments == ("one", "two", "three")
    assert store.snapshot("t") == child


def test_segments_of_the_parent_are_not_read_again_but_new_ones_are(store, tmp_path) -> None:
    """They were sound when it was sealed, and are read when they are used."""
    largest_file(tmp_path, "one").write_bytes(b"")
    grown = store.seal("t", ["one", "two", "three"], parent="s")
    assert [damage.segment for damage in store.verify(grown)] == ["one"]
    largest_file(tmp_path, "three").write_bytes(b"")
    with pytest.raises(DataError, match="undamaged segments only.*three-0"):
        store.seal("u", ["two", "three"], parent="s")
