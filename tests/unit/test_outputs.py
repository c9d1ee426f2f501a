"""Where something is to be written is tried beforehand, and files are whole or not there."""

import errno
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from flywheel import outputs
from flywheel.errors import ConfigError, DataError, RunError
from flywheel.faults import FAULTS, told
from flywheel.outputs import check_folder, check_output, check_outputs, printable, write_output
from tests.full_disk import files_end_at


def refusing(number: int):
    """What opening a file on such a disk does."""

    def refuse(**_: object) -> None:
        raise OSError(number, os.strerror(number), "somewhere/tmp123")

    return refuse


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "file"
    path.write_text("kept")
    return path


def test_a_file_can_be_checked_and_written_in_folders_that_are_not_there_yet(tmp_path):
    path = tmp_path / "a" / "b" / "out.json"
    check_output(path, "JSON")
    assert list(tmp_path.iterdir()) == []
    assert write_output(path, "ü\n").read_bytes() == "ü\n".encode()
    assert [p.name for p in path.parent.iterdir()] == ["out.json"]


def test_a_file_that_is_there_is_left_as_it_is_by_the_check_and_replaced_by_writing(file):
    check_output(file, "page")
    assert file.read_text() == "kept"
    write_output(file, b"new")
    assert file.read_text() == "new"


def test_a_page_may_go_to_a_pipe_or_through_a_link_and_neither_is_replaced(file, tmp_path):
    link, pipe = tmp_path / "link", tmp_path / "pipe"
    link.symlink_to(file)
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    for path in (link, pipe):
        check_output(path, "page")
        write_output(path, "new")
    assert link.is_symlink()
    assert file.read_text() == "new"
    assert pipe.is_fifo()
    assert os.read(reader, 10) == b"new"
    os.close(reader)


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("file/out.json", "a file stands where a folder is needed"),
        ("file/deeper/out.json", "a file stands where a folder is needed"),
        (".", "this is a folder"),
        ("n" * 300, "too long"),
        ("missing/" + "n" * 300 + "/out.json", "too long"),
        ("a/" * 3000 + "out.json", "too long"),
        ("a\0b", "null"),
        (os.devnull + "/out.json", "a file stands where a folder is needed"),
        (f"{os.sep}proc/out.json", "nothing can be stored there"),
    ],
)
def test_a_place_where_no_file_can_be_is_refused_and_named_briefly(tmp_path, file, path, words):
    with pytest.raises(DataError, match=words) as refused:
        check_output(tmp_path / path, "page")
    assert "The page cannot be written" in str(refused.value)
    assert len(str(refused.value)) < 600
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize(
    ("number", "kind", "words"),
    [
        (errno.EROFS, DataError, "read-only"),
        (errno.EACCES, DataError, "no permission"),
        (errno.ENOSPC, RunError, "the disk is full"),
        (errno.EDQUOT, RunError, "quota"),
        (errno.EIO, RunError, "failing"),
    ],
)
def test_a_disk_that_takes_no_file_is_told_with_the_folder(
    tmp_path, monkeypatch, number, kind, words
):
    monkeypatch.setattr(outputs.tempfile, "TemporaryFile", refusing(number))
    for check in (check_output, check_folder):
        with pytest.raises(kind, match=words) as refused:
            check(tmp_path / "new" / "out", "page")
        assert f"{tmp_path}:" in str(refused.value)


def test_a_disk_that_takes_an_empty_file_but_nothing_in_it_is_full(tmp_path):
    with files_end_at(0), pytest.raises(RunError, match="The page cannot be written"):
        check_output(tmp_path / "out", "page")


def test_a_folder_is_refused_where_a_file_is_and_allowed_where_it_can_be_made(tmp_path, file):
    check_folder(tmp_path / "a" / "b", "store")
    check_folder(tmp_path, "store")
    assert list(tmp_path.iterdir()) == [file]
    with pytest.raises(ConfigError, match="The store cannot be used.*file stands"):
        check_folder(file, "store", ConfigError)


def test_no_output_is_written_over_what_is_read_or_over_another(tmp_path, file):
    check_outputs({"page": tmp_path / "a", "JSON": tmp_path / "b", "video": None}, [file])
    check_outputs({"page": os.devnull, "JSON": os.devnull})
    with pytest.raises(DataError, match="which is an input"):
        check_outputs({"page": tmp_path / "new" / ".." / "file"}, [file])
    with pytest.raises(DataError, match="is the page, too"):
        check_outputs({"page": tmp_path / "a", "JSON": tmp_path / "." / "a"})


def test_a_file_that_cannot_be_written_to_its_end_leaves_the_former_one(file):
    with files_end_at(1000), pytest.raises(OSError) as failed:
        write_output(file, bytes(5000))
    assert failed.value.filename == str(file)
    assert file.read_text() == "kept"
    assert list(file.parent.iterdir()) == [file]


def test_two_threads_write_into_one_folder_at_once(tmp_path, monkeypatch):
    both, sync = threading.Barrier(2, timeout=30), os.fsync

    def together(handle):
        sync(handle)
        both.wait()

    monkeypatch.setattr(outputs.os, "fsync", together)
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda name: write_output(tmp_path / name, 1000 * name), "ab"))
    assert [(tmp_path / name).read_text() for name in "ab"] == [1000 * "a", 1000 * "b"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


def test_every_error_of_the_system_is_told_with_its_path_and_what_to_do():
    for number, fault in FAULTS.items():
        text = told(OSError(number, os.strerror(number), "runs/a/result.json"))
        assert text == f"runs/a/result.json: {fault.words}. {fault.advice}"
        assert fault.advice.endswith((".", "?"))
    assert told(OSError(errno.ENOSPC, "")).startswith("The disk is full. ")
    assert told(OSError(errno.EIO, "", b"\xff")).startswith("\udcff: ")
    assert len(told(OSError(errno.ENOENT, "", "x" * 5000))) < 400


def test_text_from_outside_cannot_steer_the_terminal():
    assert printable("a\tb\nc é [red] :smile:") == "a\tb\nc é [red] :smile:"
    assert printable("\x1b[2J\r\a\udcff\u202e") == r"\x1b[2J\r\x07\udcff\u202e"
