"""Configurations that come with flywheel: known by name from any folder, and copied to be changed."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from flywheel.cli.main import app
from flywheel.cli.runs.run import run_name
from flywheel.errors import UnknownNameError
from flywheel.runtime.config.run_config import load_config
from flywheel.runtime.config.shipped import config_file, copied_text, shipped_configs

ROOT = Path(__file__).parents[3]
NAMES = tuple(shipped_configs())


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def ask(*words: str, code: int = 0) -> str:
    done = CliRunner().invoke(app, words)
    assert done.exit_code == code, done.output
    return done.output


def test_every_file_has_a_name() -> None:
    files = {file.relative_to(ROOT / "configs") for file in (ROOT / "configs").rglob("*.yaml")}
    assert set(NAMES) == {file.with_suffix("").as_posix() for file in files}
    assert {"prism3", "smoke", "paper/s_course"} <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_a_copy_means_the_same_wherever_it_lies(name: str, elsewhere: Path) -> None:
    copy = elsewhere / "own.yaml"
    copy.write_text(copied_text(name))
    assert load_config(copy) == load_config(config_file(name))
    assert ".yaml" not in "".join(
        line for line in copy.read_text().split("\n") if "extends:" in line
    )


def test_names_are_listed_with_a_line_each() -> None:
    printed = ask("list", "configs")
    for name in NAMES:
        assert name in printed
    assert "for tests, and to see that" in printed


def test_files_of_ones_own_are_listed_beside_them(elsewhere: Path) -> None:
    (elsewhere / "configs").mkdir()
    (elsewhere / "configs" / "mine.yaml").write_text("# Mine.\nextends: smoke\n")
    assert "configs/mine.yaml" in ask("list", "configs")


@pytest.mark.parametrize(
    "words", ["run prism4", "navigate prism4 --model oracle", "config copy prism4"]
)
def test_an_unknown_name_is_bad_input_and_the_nearest_is_said(words: str) -> None:
    assert "Did you mean 'prism3'?" in ask(*words.split(), code=2)


def test_a_copy_is_put_where_it_is_wanted_and_never_over_a_file(elsewhere: Path) -> None:
    ask("config", "copy", "paper/training")
    (elsewhere / "there").mkdir()
    ask("config", "copy", "smoke", "there")
    ask("config", "copy", "smoke", "new/own.yaml")
    for file in ("training.yaml", "there/smoke.yaml", "new/own.yaml"):
        assert (elsewhere / file).exists()
    (elsewhere / "training.yaml").write_text("kept")
    assert "not overwritten" in ask("config", "copy", "paper/training", code=2)
    assert (elsewhere / "training.yaml").read_text() == "kept"


def test_what_ends_in_yaml_is_a_file() -> None:
    assert config_file("nothing/prism3.yaml") == Path("nothing/prism3.yaml")
    with pytest.raises(UnknownNameError):
        config_file("nothing/prism3")


def test_runs_of_names_in_folders_do_not_share_one() -> None:
    names = ("configs/prism3.yaml", "prism3", "paper/prism3")
    assert [run_name(name) for name in names] == ["prism3", "prism3", "paper-prism3"]
