"""What one launches: `python pipelines/NAME.py`."""

import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from flywheel.runtime.config.run_config import RunConfig, load_config
from flywheel.runtime.config.shipped import config_file

PIPELINES = Path(__file__).parents[2] / "pipelines"
LONGEST = 40  # lines: they only launch what stands elsewhere


@pytest.mark.parametrize("file", sorted(PIPELINES.glob("*.py")), ids=lambda path: path.stem)
def test_a_pipeline_is_short_and_says_what_it_takes(file, monkeypatch, capsys):
    assert len(file.read_text().splitlines()) <= LONGEST
    monkeypatch.setattr(sys, "argv", [file.name, "--help"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(file), run_name="__main__")
    assert ended.value.code == 0
    assert "usage" in capsys.readouterr().out.lower()


@pytest.mark.nightly
@pytest.mark.slow
def test_a_pipeline_runs_by_its_path_from_any_folder(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, PIPELINES / "adoption.py", "--help"],
        cwd=tmp_path, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_nothing_of_them_is_a_package() -> None:
    assert not list(PIPELINES.rglob("__init__.py"))


def test_the_loop_runs_a_configuration_by_name_and_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, object] = {}

    def run(config: RunConfig, folder: Path, **more: object) -> None:
        asked.update(config=config, folder=folder, **more)

    monkeypatch.setattr("flywheel.runtime.loop.run", run)
    monkeypatch.setattr(sys, "argv", ["loop.py", "smoke", "seed=7"])
    runpy.run_path(str(PIPELINES / "loop.py"), run_name="__main__")
    assert asked["config"] == load_config(config_file("smoke"), ["seed=7"])
    assert asked["folder"] == Path("runs/smoke")
    assert asked["resume"] is True
