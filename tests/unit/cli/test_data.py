"""`flywheel data`: every fault named with its kind and what to do, and an exit code that says so."""

import os
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from flywheel.cli.main import app
from flywheel.results import RunResult
from flywheel.runtime.config.run_config import RunConfig
from flywheel.runtime.run.folder import RunFolder


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run that has just begun."""
    folder = RunFolder(tmp_path / "run")
    folder.path.mkdir()
    identity = folder.begin(RunConfig(name="mine"), resume=False)
    RunResult(name="mine", key=identity.key).save(folder.path)
    return folder.path


def ask(*words: object, code: int = 0) -> str:
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == code, f"{done.output}\n{done.exception!r}"
    return done.output


def test_a_sound_run_is_said_to_be_sound_and_a_file_of_ones_own_is_noted(run):
    (run / "README.txt").write_text("mine")
    (run / "[red]x").write_text("mine")
    said = ask("data", "verify", run)
    assert "note: README.txt is not the run's." in said
    assert "note: [red]x is not the run's." in said
    assert "all files of the run are as they were committed" in said


@pytest.mark.parametrize("name", ["run.json", "config.yaml", "robot.xml", "result.json"])
@pytest.mark.parametrize("how", ["cut", "emptied", "removed", "made a folder", "made a pipe"])
def test_verify_names_what_is_wrong_and_what_to_do(run, name, how):
    path = run / name
    content = path.read_bytes()
    path.unlink()
    if how == "made a folder":
        path.mkdir()
    elif how == "made a pipe":
        os.mkfifo(path)
    elif how != "removed":
        path.write_bytes(content[:-5] if how == "cut" else b"")
    if (name, how) == ("result.json", "removed"):
        assert "as they were committed" in ask("data", "verify", run)
        return
    said = ask("data", "verify", run, code=1)
    kind = "missing" if how == "removed" else "altered"
    assert f"{kind} {name}: " in said
    assert "1 fault;" in said
    assert "Restore a copy of it" in said or "data rewind" in said
    for command in (["data", "show", run], ["summary", run], ["evaluate", run]):
        done = CliRunner().invoke(app, [str(word) for word in command])
        assert done.exit_code in (0, 1, 2) and "Traceback" not in done.output
        assert done.exception is None or isinstance(done.exception, SystemExit), command


def test_a_folder_that_is_neither_run_nor_store_is_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("x")
    for place in (tmp_path, tmp_path / "gone", tmp_path / "notes.txt"):
        assert "no run and no store" in ask("data", "verify", place, code=2)


def test_the_store_of_a_run_is_looked_at_by_itself_too(run):
    (run / "store/segments/strange").mkdir(parents=True)
    for place, where in ((run, "segments/strange"), (run / "store", "strange")):
        said = ask("data", "verify", place, code=1)
        assert f"foreign {where}: it is no segment" in said
        assert "Nothing that a run does next rests on" in said


def test_the_end_of_a_run_is_gone_back_before_by_its_number(run):
    assert "has the iterations 0 to 2, and 3 for its end" in ask("data", "rewind", run, 9, code=1)
    said = ask("data", "rewind", run, 3)
    assert "set aside: result.json" in said and "continues from iteration 3" in said
    assert not (run / "result.json").exists()
    assert len(list((run / "aside").rglob("result.json"))) == 1


def test_a_run_of_another_name_is_not_taken_for_it(run, tmp_path):
    other = RunFolder(tmp_path / "other")
    other.path.mkdir()
    other.begin(RunConfig(name="other", seed=1), resume=False)
    shutil.copy(run / "result.json", other.path)
    assert "foreign result.json" in ask("data", "verify", other.path, code=1)
    assert "is of another run" in ask("report", other.path, code=2)
