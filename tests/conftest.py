"""What every test relies on: one thread each, no usage reports, drawing only where it can be."""

import contextlib
import ctypes.util
import os
import secrets
import shlex
import signal
import subprocess
import sys
import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

# Before anything imports torch, mujoco or ray; worker processes inherit it.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MUJOCO_GL", "egl")
os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")

import pytest
from hypothesis import settings
from typer.testing import CliRunner
from xdist.scheduler import LoadScopeScheduling

from tests import draws
from tests.readme_commands import the_two_commands

ROOT = Path(__file__).parents[1]
BIN = Path(sys.executable).parent
STARTING_RAY = ("tests/integration/", "tests/test_readme.py", "tests/test_docker.py")
NO_EGL = "libEGL is not installed: apt-get install libegl1 libegl-mesa0 libgl1-mesa-dri"


# The same examples and draws every time; others with --draws.
settings.register_profile("fixed", derandomize=True, deadline=None)
settings.register_profile("fresh", deadline=None)


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--draws`: which random inputs the tests get."""
    parser.addoption(
        "--draws", default="0", help='what tests draw depends on this number; "fresh" for a new one'
    )


def pytest_configure(config: pytest.Config) -> None:
    """Choose what is drawn, before any test is imported.

    Processes of the suite share what one of them has compiled, also where Python is not to keep it.
    """
    if hasattr(config, "workerinput"):
        sys.dont_write_bytecode = False
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    if config.option.draws == "fresh":
        config.option.draws = str(secrets.randbits(32))  # xdist hands it to its processes
    draws.choose(int(config.option.draws))
    settings.load_profile("fixed" if config.option.draws == "0" else "fresh")


def pytest_report_header(config: pytest.Config) -> str:
    """Say what brings the same draws back."""
    return f"draws: {config.option.draws}"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests that start a Ray first, quick files last; skip tests that draw where nothing can.

    A slow file at the end would have one process work while the others are done.
    """
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: (not starts_ray(item.nodeid), item.path not in slow))
    if ctypes.util.find_library("EGL"):
        return
    for item in items:
        if item.get_closest_marker("renders"):
            item.add_marker(pytest.mark.skip(reason=NO_EGL))


def starts_ray(nodeid: str) -> bool:
    """Whether a test starts a Ray, which takes both cores."""
    return nodeid.startswith(STARTING_RAY)


class OneProcessForRay(LoadScopeScheduling):
    """Gives one process all tests that start a Ray; more Rays at a time would wait for each other.

    The others go by file, so that what a file sets up is set up once; pages of the docs one by one.
    """

    def _split_scope(self, nodeid: str) -> str:
        file = nodeid.partition("::")[0]
        if starts_ray(nodeid):
            return "ray"
        return nodeid if file == "tests/test_docs.py" else file


def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> LoadScopeScheduling:
    """How tests are shared out to the processes."""
    return OneProcessForRay(config, log)


@pytest.fixture(scope="session", autouse=True)
def default_signals() -> None:
    """Children begin with the defaults of the signals, however pytest was started.

    A script's `&` ignores Ctrl-C and nohup the end of a terminal; children inherit what is ignored, but no
    handlers. So pytest itself outlives its terminal where it should, and its children do not.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for each in (signal.SIGQUIT, signal.SIGTERM):
        signal.signal(each, signal.SIG_DFL)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, lambda number, frame: None)


@pytest.fixture(scope="session")
def robot() -> object:
    """Three bars and nine cables: the robot of most tests. Some folders and files have another."""
    from flywheel.robots import load_robot

    return load_robot("prism3")


@dataclass(frozen=True)
class Stranger:
    """Someone who has only read the README, in a folder of their own.

    Attributes:
      folder: where they stand.
    """

    folder: Path

    def run(self, command: str, seconds: float = 300, code: int = 0) -> tuple[str, str]:
        """Run a command of the README at smoke size; its two outputs, if it ends with the code."""
        small = f"{BIN}/{command.removeprefix('.venv/bin/')}".replace("prism3", "smoke")
        done = subprocess.run(
            shlex.split(small), cwd=self.folder, capture_output=True, text=True, timeout=seconds
        )
        assert done.returncode == code, f"{small}\n{done.stdout}\n{done.stderr}"
        return done.stdout, done.stderr

    def ask(self, command: str, code: int = 0) -> tuple[str, str]:
        """The same inside this process, which has imported everything already."""
        from flywheel.cli.main import app

        with contextlib.chdir(self.folder):
            done = CliRunner().invoke(app, shlex.split(command.replace("prism3", "smoke"))[1:])
        assert done.exit_code == code, f"{command}\n{done.output}\n{done.exception!r}"
        return done.stdout, done.stderr


@pytest.fixture(scope="session")
def stranger(tmp_path_factory: pytest.TempPathFactory) -> Stranger:
    """A folder with the configurations and nothing else."""
    folder = tmp_path_factory.mktemp("stranger")
    (folder / "configs").symlink_to(ROOT / "configs")
    return Stranger(folder)


@pytest.fixture(scope="session")
def first_run(stranger: Stranger) -> tuple[str, str]:
    """What the README's first command prints, without the installation, at smoke size."""
    return stranger.run(the_two_commands()[0].split("&&")[-1].strip(), 900)


@pytest.fixture(scope="session")
def plain_run(stranger: Stranger) -> tuple[str, str]:
    """What the README's run without a robot prints, at smoke size."""
    return stranger.run("flywheel run configs/prism3.yaml", 900)


@pytest.fixture(scope="module")
def service() -> Iterator[str]:
    """Address of an S3-compatible service of our own, on a free port."""
    moto = pytest.importorskip("moto.server")
    server = moto.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    yield f"http://{host}:{port}"
    server.stop()


@pytest.fixture
def bucket(service: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Place in a new bucket of that service, which is that of this process and its children."""
    s3fs = pytest.importorskip("s3fs")
    monkeypatch.setenv("AWS_ENDPOINT_URL", service)
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "test")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "test")
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    s3fs.S3FileSystem.clear_instance_cache()
    name = f"episodes-{uuid.uuid4().hex}"
    s3fs.S3FileSystem().mkdir(name)
    yield f"s3://{name}/run"
    s3fs.S3FileSystem.clear_instance_cache()
