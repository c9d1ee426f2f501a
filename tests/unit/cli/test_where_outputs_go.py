"""A place that cannot be written is refused before anything is computed."""

import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from flywheel.cli.main import app

CSV = "log.csv --robot prism3"
COMMANDS = (
    f"diagnose {CSV} --page OUT",
    f"diagnose {CSV} --json OUT",
    f"compare {CSV} --page OUT",
    f"compare {CSV} --json OUT",
    f"compare {CSV} --video OUT",
    f"power {CSV} --page OUT",
    f"power {CSV} --json OUT",
    "design payload capstan --robot prism3 --out OUT",
    "design payload capstan --robot prism3 --page OUT",
    "design payload capstan --robot prism3 --json OUT",
    "navigate config.yaml --model oracle --video OUT",
    "navigate config.yaml --model oracle --no-film --results OUT",
    "navigate config.yaml --model oracle --no-film --picture OUT",
    "navigate config.yaml --model oracle --no-film --logs OUT",
    "demo --page OUT",
    "config copy smoke OUT",
    "recordings import log.csv --robot prism3 --store OUT",
    "run config.yaml --folder OUT",
    "run config.yaml store=OUT",
)


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a file, a log that cannot be read, and a configuration."""
    (tmp_path / "file").write_text("kept")
    (tmp_path / "log.csv").write_text("no log")
    (tmp_path / "config.yaml").write_text("model: prism3\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("place", ["file/out", "n" * 300])
@pytest.mark.parametrize("command", COMMANDS)
def test_a_place_where_nothing_can_be_is_refused_at_once(command, place, here):
    before = sorted(here.rglob("*"))
    done = CliRunner().invoke(app, shlex.split(command.replace("OUT", place)))
    assert done.exit_code == 2, done.output
    assert "cannot be" in done.stderr
    assert {"file/out": "a file stands", "n" * 300: "too long"}[place] in done.stderr
    assert done.stderr.count("\n") == 1
    assert sorted(here.rglob("*")) == before


@pytest.mark.parametrize("command", [c for c in COMMANDS if "log.csv" in c and "import" not in c])
def test_what_is_read_is_not_written_over(command, here):
    done = CliRunner().invoke(app, shlex.split(command.replace("OUT", "./log.csv")))
    assert done.exit_code == 2
    assert "would overwrite log.csv, which is an input" in done.stderr
    assert (here / "log.csv").read_text() == "no log"
