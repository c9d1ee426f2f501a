import os
import zipfile
from pathlib import Path

import pytest
import torch

from flywheel.errors import ConfigError, DataError
from flywheel.faults import fault_of
from flywheel.training.checkpoint import CHECKPOINT, Checkpoint, read_checkpoint, write_checkpoint
from tests.damage import flip
from tests.full_disk import files_end_at


def _checkpoint(key: str = "a" * 64) -> Checkpoint:
    weight = torch.nn.Parameter(torch.randn(3, 2))
    optimiser = torch.optim.AdamW([weight], 1e-3)
    weight.sum().backward()
    optimiser.step()
    return Checkpoint(
        key=key,
        step=7,
        weights={"w": weight.detach()},
        optimiser=optimiser.state_dict(),
        averaged={"module.w": torch.randn(3, 2), "n_averaged": torch.tensor(7)},
        best={"w": torch.randn(3, 2)},
        best_error=float("inf"),
        best_step=5,
        stale=2,
        curve=[{"step": 5, "loss": 0.25, "e_rot": None}],
    )


def test_a_checkpoint_comes_back_as_it_was(tmp_path):
    kept = _checkpoint()
    write_checkpoint(kept, tmp_path / "new")
    got = read_checkpoint(tmp_path / "new", kept.key)
    assert torch.equal(got.weights["w"], kept.weights["w"])
    assert torch.equal(got.best["w"], kept.best["w"])
    assert torch.equal(got.averaged["module.w"], kept.averaged["module.w"])
    assert (got.step, got.stale, got.best_step, got.curve) == (7, 2, 5, kept.curve)
    moments = [c.optimiser["state"][0]["exp_avg"] for c in (got, kept)]
    assert torch.equal(*moments)


def test_a_disk_without_room_keeps_the_former_checkpoint_and_is_told_as_such(tmp_path):
    kept, later = _checkpoint(), _checkpoint("b" * 64)
    write_checkpoint(kept, tmp_path)
    with files_end_at(500), pytest.raises(OSError) as failed:
        write_checkpoint(later, tmp_path)
    assert fault_of(failed.value) is not None
    assert read_checkpoint(tmp_path, kept.key) is not None
    assert [p.name for p in tmp_path.iterdir()] == [CHECKPOINT]


def test_a_folder_without_a_checkpoint_has_none(tmp_path):
    assert read_checkpoint(tmp_path, "a" * 64) is None


def test_a_checkpoint_of_another_training_is_refused(tmp_path):
    write_checkpoint(_checkpoint(), tmp_path)
    with pytest.raises(ConfigError, match="another configuration"):
        read_checkpoint(tmp_path, "b" * 64)


@pytest.mark.parametrize("keep", [0, 1, 100, 1000])
def test_a_truncated_checkpoint_is_found(tmp_path, keep):
    path = write_checkpoint(_checkpoint(), tmp_path)
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(DataError, match="damaged"):
        read_checkpoint(tmp_path, "a" * 64)


def test_a_checkpoint_that_would_run_code_is_refused(tmp_path):
    class Evil:
        def __reduce__(self):
            return (eval, ("1 + 1",))

    torch.save({"key": Evil()}, tmp_path / CHECKPOINT)
    with pytest.raises(DataError, match="damaged"):
        read_checkpoint(tmp_path, "a" * 64)


@pytest.mark.parametrize("part", ["data.pkl", "data/0", "data/3", "version"])
def test_a_bit_that_flips_in_a_checkpoint_is_found(tmp_path, part):
    path = write_checkpoint(_checkpoint(), tmp_path)
    with zipfile.ZipFile(path) as archive:
        (name,) = (n for n in archive.namelist() if n.endswith(f"/{part}"))
        content = archive.read(name)
    whole = path.read_bytes()
    place = whole.index(content) + len(content) // 2
    flip(path, place)
    with pytest.raises(DataError, match="damaged"):
        read_checkpoint(tmp_path, "a" * 64)


STRANGE = (None, 5, "x", [], {"w": 1}, [{}], torch.zeros(2))


@pytest.mark.parametrize("field", [*Checkpoint.__annotations__, "(all)", "(gone)"])
def test_a_checkpoint_of_other_types_is_refused(tmp_path, field):
    fields = vars(_checkpoint())
    for value in STRANGE:
        if field in fields and isinstance(value, type(fields[field])):
            continue
        changed = {n: v for n, v in fields.items() if n != "step"} if field == "(gone)" else fields
        torch.save(value if field == "(all)" else changed | {field: value}, tmp_path / CHECKPOINT)
        with pytest.raises(DataError, match="damaged"):
            read_checkpoint(tmp_path, "a" * 64)


@pytest.mark.parametrize("make", [os.mkfifo, Path.mkdir, lambda path: path.symlink_to("nowhere")])
def test_what_is_no_file_is_no_checkpoint(tmp_path, make):
    make(tmp_path / CHECKPOINT)
    with pytest.raises(DataError, match=CHECKPOINT):
        read_checkpoint(tmp_path, "a" * 64)


def test_a_failed_write_leaves_the_last_checkpoint(tmp_path, monkeypatch):
    write_checkpoint(_checkpoint(), tmp_path)
    before = (tmp_path / CHECKPOINT).read_bytes()

    def fail(fields, file):
        file.write(b"half")
        raise OSError("No space left on device")

    monkeypatch.setattr(torch, "save", fail)
    with pytest.raises(OSError, match="No space"):
        write_checkpoint(_checkpoint(), tmp_path)
    assert (tmp_path / CHECKPOINT).read_bytes() == before
