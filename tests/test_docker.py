"""The containers' scripts work without containers, and the compose file says what it should."""

import os
import re
import shutil
import socket
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
DOCKER = ROOT / "docker"
SCRIPTS = sorted(DOCKER.glob("*.sh"))
BIN = Path(sys.executable).parent


@pytest.fixture(scope="module")
def compose() -> dict:
    return yaml.safe_load((DOCKER / "compose.yaml").read_text())


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


def environment(**more: str) -> dict[str, str]:
    return {**os.environ, "PATH": f"{BIN}{os.pathsep}{os.environ['PATH']}", **more}


@pytest.mark.parametrize("script", [*SCRIPTS, ROOT / ".ci" / "run"], ids=lambda p: p.name)
def test_a_script_is_valid_and_can_be_started(script: Path) -> None:
    assert os.access(script, os.X_OK)
    assert script.read_text().startswith("#!/usr/bin/env bash\n")
    assert "set -euo pipefail" in script.read_text()
    subprocess.run(["bash", "-n", script], check=True)
    if shutil.which("shellcheck"):
        subprocess.run(["shellcheck", script], check=True)


def test_docker_compose_accepts_the_file() -> None:
    docker = shutil.which("docker")
    command = [docker, "compose"] if docker else []
    if not docker or subprocess.run([*command, "version"], capture_output=True).returncode:
        pytest.skip("docker compose is not installed")
    done = subprocess.run(
        [*command, "-f", DOCKER / "compose.yaml", "config", "-q"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def test_every_service_runs_a_script_that_is_there(compose: dict) -> None:
    named = re.findall(r"docker/[\w-]+\.sh", (DOCKER / "compose.yaml").read_text())
    assert {ROOT / name for name in named} == set(SCRIPTS)


def test_every_service_that_stays_is_watched_and_every_wait_is_for_a_watched_one(compose):
    services = compose["services"]
    watched = {name for name, service in services.items() if "healthcheck" in service}
    assert watched == services.keys() - {"driver"}
    for service in services.values():
        for name, condition in service.get("depends_on", {}).items():
            assert name in watched
            assert condition == {"condition": "service_healthy"}


def test_volumes_and_files_that_services_use_are_declared(compose: dict) -> None:
    for service in compose["services"].values():
        for volume in service.get("volumes", []):
            assert volume.split(":")[0] in compose["volumes"]
        for config in service.get("configs", []):
            assert config["source"] in compose["configs"]


def test_nothing_is_published_beyond_this_machine(compose: dict) -> None:
    for service in compose["services"].values():
        for port in service.get("ports", []):
            assert port.startswith("127.0.0.1:")


def test_each_target_of_the_image_that_compose_may_build_is_there() -> None:
    text = (DOCKER / "Dockerfile").read_text()
    assert re.findall(r"^FROM \S+ AS (\w+)$", text, flags=re.MULTILINE) == ["base", "cpu", "cuda"]
    pinned = re.search(r"^torch==(\S+)$", (ROOT / "constraints.txt").read_text(), re.MULTILINE)
    assert pinned is not None
    assert set(re.findall(r'TORCH="torch==([\d.]+)', text)) == {pinned[1]}
    for copied in re.findall(r"^COPY (.+) \S+$", text, flags=re.MULTILINE):
        assert all((ROOT / name).exists() for name in copied.split())


def test_the_image_has_what_the_package_is_built_from() -> None:
    text = (DOCKER / "Dockerfile").read_text()
    copied = {
        name for line in re.findall(r"^COPY (.+) \S+$", text, re.MULTILINE) for name in line.split()
    }
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    about = {"pyproject.toml", project["project"]["readme"], *project["project"]["license-files"]}
    assert {*wheel["packages"], *wheel["force-include"], *about} <= copied


def test_the_driver_says_what_it_wants() -> None:
    done = subprocess.run([DOCKER / "driver.sh"], capture_output=True, text=True)
    assert done.returncode == 2
    assert "usage" in done.stderr


def test_the_driver_joins_the_cluster_and_resumes_in_the_shared_folder(tmp_path: Path) -> None:
    for name in ("ray", "flywheel"):
        fake = tmp_path / name
        fake.write_text(f'#!/usr/bin/env bash\necho {name} "$@"\n')
        fake.chmod(0o755)
    settings = {"RAY_HEAD": "head:1", "RUNS": "shared", "STORE": "s3://bucket"}
    settings |= {"MLFLOW_TRACKING_URI": "http://mlflow:5000"}
    done = subprocess.run(
        [DOCKER / "driver.sh", "configs/prism3.yaml", "seed=1"],
        env={**os.environ, **settings, "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.splitlines() == [
        "ray start --address=head:1 --num-cpus=0 --disable-usage-stats",
        "flywheel run configs/prism3.yaml --address auto --folder shared/prism3 --resume "
        "store=s3://bucket/prism3 tracking.uri=http://mlflow:5000 seed=1",
    ]


def test_mlflow_listens_to_the_network_only_where_it_is_told_to(compose, tmp_path):
    fake = tmp_path / "mlflow"
    fake.write_text('#!/usr/bin/env bash\necho "$@"\n')
    fake.chmod(0o755)

    def host(**settings: str) -> str:
        path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
        folder = {"MLFLOW_FOLDER": str(tmp_path / "folder")}
        done = subprocess.run(
            [DOCKER / "mlflow-server.sh"],
            env={**os.environ, "PATH": path, **folder, **settings},
            capture_output=True,
            text=True,
            check=True,
        )
        return re.findall(r"--host (\S+)", done.stdout)[0]

    assert host() == "127.0.0.1"
    inside = compose["services"]["mlflow"]["environment"]["MLFLOW_HOST"]
    assert host(MLFLOW_HOST=inside) == "0.0.0.0"


@pytest.fixture
def started(tmp_path: Path) -> Iterator[list[subprocess.Popen]]:
    """Processes to be ended, with their children, after the test."""
    running: list[subprocess.Popen] = []
    yield running
    for process in running:
        process.terminate()
    for process in running:
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def until_alive(script: str, settings: dict[str, str], seconds: float) -> bool:
    limit = time.monotonic() + seconds
    while time.monotonic() < limit:
        done = subprocess.run([DOCKER / script], env=environment(**settings), capture_output=True)
        if done.returncode == 0:
            return True
        time.sleep(0.5)
    return False


@pytest.mark.nightly
@pytest.mark.ray
@pytest.mark.slow
def test_ray_head_and_a_worker_start_and_are_seen_to_be_alive(started: list) -> None:
    port = free_port()
    settings = {"RAY_PORT": str(port), "RAY_CPUS": "1", "RAY_HEAD": f"127.0.0.1:{port}"}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    started.append(subprocess.Popen([DOCKER / "ray-head.sh"], env=environment(**settings), **quiet))
    assert until_alive("ray-alive.sh", settings, 60)
    started.append(
        subprocess.Popen([DOCKER / "ray-worker.sh"], env=environment(**settings), **quiet)
    )
    look = f"""
import ray, time
ray.init(address="127.0.0.1:{port}", logging_level="ERROR")
limit = time.monotonic() + 40
while ray.cluster_resources().get("CPU", 0) < 2 and time.monotonic() < limit:
    time.sleep(0.2)
print(ray.cluster_resources()["CPU"])
"""
    done = subprocess.run(
        [sys.executable, "-c", look], env=environment(), capture_output=True, text=True, timeout=90
    )
    assert done.stdout.strip().endswith("2.0"), done.stderr


@pytest.mark.nightly
@pytest.mark.slow
def test_the_mlflow_server_starts_is_seen_to_be_alive_and_refuses_other_names(started, tmp_path):
    port = free_port()
    settings = {"MLFLOW_PORT": str(port), "MLFLOW_FOLDER": str(tmp_path / "mlflow")}
    started.append(
        subprocess.Popen(
            [DOCKER / "mlflow-server.sh"],
            env=environment(**settings),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
    )
    assert until_alive("mlflow-alive.sh", settings, 90)
    assert (tmp_path / "mlflow" / "mlflow.db").exists()
    url = f"http://127.0.0.1:{port}/api/2.0/mlflow/experiments/search?max_results=1"
    assert status(url, f"mlflow:{port}") == 200
    assert status(url, f"evil.example:{port}") == 403


def status(url: str, host: str) -> int:
    code = (
        "import sys, urllib.request as u, urllib.error as e\n"
        "r = u.Request(sys.argv[1], headers={'Host': sys.argv[2]})\n"
        "try: print(u.urlopen(r, timeout=20).status)\n"
        "except e.HTTPError as error: print(error.code)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, url, host], capture_output=True, text=True, check=True
    )
    return int(done.stdout)
