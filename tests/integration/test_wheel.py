"""The wheel works alone: installed into an environment of its own, outside the checkout."""

import os
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

from flywheel.dynamics.gnn.shipped import shipped_networks

pytestmark = [pytest.mark.nightly, pytest.mark.slow]
ROOT = Path(__file__).parents[2]


def call(*command: str | Path, folder: Path) -> str:
    """What a command prints, with nothing of the checkout on its path."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from the checkout."""
    folder = tmp_path_factory.mktemp("wheel")
    pip = (sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation")
    call(*pip, "--wheel-dir", folder, ROOT, folder=folder)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def environment(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment with the wheel; what it depends on is this environment's."""
    folder = tmp_path_factory.mktemp("alone")
    call(sys.executable, "-m", "venv", "--without-pip", folder / "venv", folder=folder)
    python = folder / "venv" / "bin" / "python"
    pip = (sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-index")
    call(*pip, "--no-deps", wheel, folder=folder)
    # A path alone: the .pth files in it, such as that of an editable flywheel, are not read.
    site = call(
        python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", folder=folder
    )
    others = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
    (Path(site.strip()) / "dependencies.pth").write_text("\n".join(sorted(others)) + "\n")
    return folder


def test_the_wheel_holds_the_package_its_configurations_and_its_networks(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.split("/")[0] for name in names if ".dist-info/" not in name} == {"flywheel"}
    shipped = {name for name in names if name.startswith("flywheel/configs/")}
    here = {file.relative_to(ROOT).as_posix() for file in (ROOT / "configs").rglob("*.yaml")}
    assert shipped == {f"flywheel/{name}" for name in here}
    for path in shipped_networks().values():
        for file in (path, path.with_suffix(".json"), path.with_suffix(".yaml")):
            assert file.relative_to(ROOT).as_posix() in names


@pytest.mark.ray
def test_the_smoke_configuration_runs_by_its_name(environment: Path) -> None:
    flywheel = environment / "venv" / "bin" / "flywheel"
    where = call(
        environment / "venv" / "bin" / "python",
        "-c",
        "import flywheel; print(flywheel.__file__)",
        folder=environment,
    )
    assert Path(where.strip()).is_relative_to(environment)
    listed = call(flywheel, "list", "configs", folder=environment)
    assert "paper/prism3" in listed and "smoke" in listed
    small = (
        "iterations=0",
        "evaluate.oracle=false",
        "evaluate.floor=false",
        "evaluate.video=false",
        "evaluate.unseen=[]",
        "evaluate.tasks=1",
        "task.seconds=1",
        "collect.random_seconds=2",
        "training.initial.steps=6",
        "mppi.samples=4",
        "workers.sim=1",
        "workers.trainers=1",
    )
    printed = call(flywheel, "run", "smoke", *small, folder=environment)
    assert "i0000-mppi" in printed
    assert (environment / "runs" / "smoke" / "result.json").exists()
    call(flywheel, "config", "copy", "paper/prism3", "own.yaml", folder=environment)
    assert "extends: [prism3, paper/training]" in (environment / "own.yaml").read_text()
