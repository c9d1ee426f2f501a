"""The lasting record of an iteration and of the run: results, seals, versions."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from flywheel import __version__
from flywheel.results import RESULT_FILE, IterationResult, RunResult
from flywheel.run_identity import Identity
from flywheel.runtime.run.context import Run
from flywheel.runtime.run.folder import ARMS, POOLED, SEGMENT, SNAPSHOT, name_of
from flywheel.runtime.workers.episode_plan import robot_prefix
from flywheel.seals import file_sha256

ENGINES = ("mujoco", "torch", "ray", "zarr", "mlflow", "numpy")


def keep(run: Run, result: IterationResult) -> None:
    """Write the result of an iteration; with that, it is done."""
    run.folder.finish(result, rests_on(run, result))
    shutil.rmtree(run.folder.cache / name_of(result.iteration, result.arm), ignore_errors=True)


def rests_on(run: Run, result: IterationResult) -> dict[str, str]:
    """Name -> digest of an iteration's other files: snapshot, files, episodes."""
    iteration, arm = result.iteration, result.arm
    others = tuple(f"{name_of(iteration, other)}-" for other in ARMS if other != arm)
    recorded = {n: d for n, d in _recorded(run, iteration).items() if not n.startswith(others)}
    videos = [run.folder.path / result.video] if result.video else []
    snapshot = {f"{SNAPSHOT}{name_of(iteration, arm)}": result.snapshot}
    files = _digests(run, [*run.folder.model_files(iteration, arm), *videos])
    return snapshot | files | {f"{SEGMENT}{name}": digest for name, digest in recorded.items()}


def end_rests_on(run: Run, result: RunResult) -> dict[str, str]:
    """Name -> digest of the other files at the end of a run: episodes and videos."""
    videos = [run.folder.path / each.video for each in result.unseen if each.video]
    pooled = {f"{SNAPSHOT}{POOLED}": run.store.snapshot(POOLED).digest}
    recorded = _recorded(run, -1)
    files = _digests(run, videos)
    return pooled | files | {f"{SEGMENT}{name}": digest for name, digest in recorded.items()}


def _recorded(run: Run, iteration: int) -> dict[str, str]:
    """Segment -> digest of the episodes recorded by an iteration; -1 is the end of the run."""
    return {
        name: receipt.sha256
        for name, receipt in run.store.committed().items()
        if name.startswith(robot_prefix(iteration))
        or any(e.source == "sim" and e.iteration == iteration for e in receipt.summaries)
    }


def _digests(run: Run, paths: Sequence[Path]) -> dict[str, str]:
    root = run.folder.path.absolute()
    return {p.absolute().relative_to(root).as_posix(): file_sha256(p, "file") for p in paths}


def result_so_far(run: Run, identity: Identity, notes: list[str]) -> RunResult:
    """The result of the run without its final part."""
    done = [
        run.folder.finished(iteration, arm)
        for iteration in range(run.config.iterations + 1)
        for arm in run.arms(iteration)
    ]
    before = _before(run)
    return RunResult(
        name=run.config.name,
        key=identity.key,
        config=run.config.model_dump(mode="json"),
        config_digest=identity.config_digest,
        code=code_version(),
        versions=versions(),
        robot=run.robot.name,
        robot_digest=run.robot.digest,
        length=run.robot.length,
        iterations=tuple(each for each in done if each is not None),
        notes=tuple(dict.fromkeys([*before, *notes])),
    )


def _before(run: Run) -> tuple[str, ...]:
    path = run.folder.path
    return RunResult.load(path).notes if (path / RESULT_FILE).exists() else ()


def versions() -> dict[str, str]:
    """The versions of Python and of the engines that this project uses."""
    found = {"python": ".".join(map(str, sys.version_info[:3]))}
    for engine in ENGINES:
        try:
            found[engine] = version(engine)
        except PackageNotFoundError:
            continue
    return found


def code_version() -> str:
    """The version of this project, with the commit if it runs from a git checkout."""
    here = Path(__file__).parent
    command = ["git", "-C", str(here), "describe", "--always", "--dirty", "--abbrev=12"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return __version__
    commit = done.stdout.strip()
    return f"{__version__}+{commit}" if done.returncode == 0 and commit else __version__
