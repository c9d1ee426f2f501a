"""Workers on a Ray cluster. This is the only module that imports ray.

A worker is a plain class. Here it becomes an actor with a second thread that reports progress while
a job runs. Ray's own restarts and retries are off: the pool counts and reports them instead.

A local cluster has its own temporary folder with a short path, which is removed afterwards.
"""

from __future__ import annotations

import contextlib
import logging
import os
import re
import socket
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Self

# Before `import ray`: no re-creation of the environment on every worker under `uv run`, no usage
# reports, no warning about accelerators, no handler that has SIGTERM abort the driver while it connects.
os.environ.setdefault("RAY_ENABLE_UV_RUN_RUNTIME_ENV", "0")
os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
os.environ.setdefault("RAY_DISABLE_FAILURE_SIGNAL_HANDLER", "1")

import ray
from ray import exceptions

from flywheel.errors import ConfigError, FlywheelError, RunError
from flywheel.faults import fault_of
from flywheel.outputs import check_folder
from flywheel.runtime.pool.caretaker import MARK, Caretaker, remove
from flywheel.runtime.pool.jobs import Answer, Beat, Group, Job, JobFailed, WorkerDied
from flywheel.runtime.pool.lock import hold

LOG = logging.getLogger(__name__)
STARTS = 3  # attempts to start a local cluster; on a busy machine the first may take too long
OBJECT_STORE_BYTES = 200_000_000  # shared memory of a local cluster
REACHED_SECONDS = 5.0  # longest wait for an answer of a cluster [s]
FOLDER_PREFIX = "flywheel-ray-"
FOLDER_LOCK = "driver.lock"
# A Unix socket's path has at most 107 bytes; Ray adds "/session_<date>_<time>_<pid>/sockets/plasma_store".
LONGEST_FOLDER = 42  # bytes of the folder's path
YOUNG_FOLDER = 60.0  # age up to which another driver may still be making its folder [s]


class Cluster:
    """A connection to Ray for as long as a `with` block lasts.

    A Ray that is already initialised in this process is used unchanged and left running.

    Args:
      address: of an existing cluster ("host:6379", "auto"), or None to start one here.
      cores: of the local cluster.
    """

    def __init__(self, address: str | None = None, cores: int = 2) -> None:
        self._address, self._cores = address, cores
        self._own = ExitStack()  # resources opened by this block

    def __enter__(self) -> Self:
        if not ray.is_initialized():
            with ExitStack() as own, _translated(self._address):
                self._connect(own)
                self._own = own.pop_all()
        return self

    def __exit__(self, *error: object) -> None:
        self._own.close()

    def _connect(self, own: ExitStack) -> None:
        _log_death_messages()
        quiet = {"log_to_driver": False, "logging_level": "ERROR"}
        if self._address is not None:
            check_reachable(self._address)
            own.callback(ray.shutdown)
            ray.init(address=self._address, **quiet)
            return
        # A cluster on the loopback of this machine needs no token, and none is left in HOME.
        os.environ.setdefault("RAY_AUTH_MODE", "disabled")
        folder = own.enter_context(ray_folder())
        own.callback(ray.shutdown)
        for attempt in range(STARTS):
            try:
                with marking(folder), _loopback_only():
                    self._start_local(folder, quiet)
                return
            except Exception as error:  # Ray's own words for a start that took over 30 s
                ray.shutdown()
                if "timed out during startup" not in str(error) or attempt == STARTS - 1:
                    raise

    def _start_local(self, folder: Path, quiet: dict[str, Any]) -> None:
        ray.init(
            address="local",  # never one that happens to run on this machine
            _temp_dir=str(folder),
            num_cpus=self._cores,
            num_gpus=0,
            object_store_memory=OBJECT_STORE_BYTES,
            include_dashboard=False,
            **quiet,
        )

    @property
    def cpus(self) -> int:
        """The cores of the whole cluster."""
        return int(ray.cluster_resources().get("CPU", 1))

    def check_fits(self, groups: Iterable[Group]) -> None:
        """Reject groups that book more than the cluster has; Ray would wait for ever without a message.

        Raises:
          ConfigError: the cluster is too small.
        """
        check_fits(groups, ray.cluster_resources())


@contextmanager
def _translated(address: str | None) -> Any:
    """Turn Ray's connection errors into a RunError with one line of advice."""
    try:
        yield
    except FlywheelError:
        raise
    except OSError as error:
        if address is None and fault_of(error):  # e.g. a full disk
            raise
        raise _no_connection(error, address) from error
    except Exception as error:  # Ray raises almost anything, down to bare Exceptions
        raise _no_connection(error, address) from error


def _no_connection(error: Exception, address: str | None) -> RunError:
    first = next(iter(str(error).strip().splitlines()), type(error).__name__)
    if address is None:
        return RunError(f"No Ray could be started here: {first}")
    token = "auth" in f"{type(error).__name__} {error}".lower()
    advice = (
        "It requires a token: set RAY_AUTH_MODE=token and RAY_AUTH_TOKEN (or ~/.ray/auth_token) "
        "as on its head node."
        if token
        else "Is it running, is the address host:port as seen from here, and the Ray version "
        f"the same ({ray.__version__})?"
    )
    return RunError(f"No connection to the Ray cluster at {address}: {first} {advice}")


def _log_death_messages() -> None:
    """Log what Ray would print on stdout about every dead worker, whatever `log_to_driver` says."""
    from ray._private import worker  # no public switch; without this attribute nothing changes

    if hasattr(worker, "print_to_stdstream"):
        worker.print_to_stdstream = lambda data, ignore_prefix: LOG.info(
            "%s: %s", data.get("pid"), " ".join(map(str, data.get("lines", ())))
        )


@contextmanager
def _loopback_only() -> Iterator[None]:
    """Make Ray listen on this machine only: everyone with access to its ports can run programs.

    Ray's switch for this is named after Windows and macOS. It is read when Ray is imported, so it
    is set both in this process and in the environment of its child processes.
    """
    from ray._private import (
        ray_constants,
    )  # no public switch; without this attribute nothing changes

    before = getattr(ray_constants, "ENABLE_RAY_CLUSTER", True)
    ray_constants.ENABLE_RAY_CLUSTER = False
    os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"
    try:
        yield
    finally:
        ray_constants.ENABLE_RAY_CLUSTER = before
        del os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"]


class _Actor:
    """The actor that holds a plain worker."""

    def __init__(self, factory: type, arguments: tuple[Any, ...]) -> None:
        self._worker = factory(*arguments)

    def ready(self) -> Answer:
        return Answer()

    def work(self, job: str, method: str, *arguments: Any) -> Answer:
        _name_thread(job)
        begun = _cpu_seconds()
        try:
            value = getattr(self._worker, method)(*arguments)
            return Answer(value, _cpu_seconds() - begun)
        finally:
            _name_thread("idle")

    def beat(self) -> Beat | None:
        return getattr(self._worker, "beat", None)


def _cpu_seconds() -> float:
    """Used by this process and by those that it started and that have ended."""
    return sum(os.times()[:4])


def _name_thread(name: str) -> None:
    """Name this thread after its job, for `top -H` and /proc; Ray resets its own process titles."""
    with contextlib.suppress(OSError):
        Path(f"/proc/self/task/{threading.get_native_id()}/comm").write_text(name[:15])


class RayBackend:
    """Workers as Ray actors (`jobs.Backend`)."""

    def __init__(self) -> None:
        self._beats: dict[Any, tuple[Any, Beat | None]] = {}

    def start(self, group: Group) -> Any:
        """Start an actor without waiting; it lives until it is killed or the driver ends."""
        threads = str(group.threads)
        names = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "FLYWHEEL_THREADS")
        actor = ray.remote(
            num_cpus=group.cpus,
            num_gpus=group.gpus,
            memory=1,  # [bytes]; actors that book nothing are placed at random, several on one node
            scheduling_strategy="SPREAD",
            max_restarts=0,
            max_task_retries=0,
            concurrency_groups={"status": 1},
            runtime_env={"env_vars": dict.fromkeys(names, threads)},
        )(_Actor)
        return actor.remote(group.factory, group.arguments)

    def ready(self, worker: Any) -> Any:
        """A ticket that is finished when the actor has started."""
        return worker.ready.remote()

    def submit(self, worker: Any, job: Job) -> Any:
        """Send the job to the actor; returns its ticket."""
        self._beats.pop(worker, None)
        return worker.work.remote(job.id, job.method, *job.arguments)

    def wait(self, tickets: Sequence[Any], seconds: float) -> list[Any]:
        """The tickets that are finished."""
        if not tickets:
            return []
        done, _ = ray.wait(list(tickets), num_returns=1, timeout=seconds)
        if done:  # others may have finished in the same moment
            done, _ = ray.wait(list(tickets), num_returns=len(tickets), timeout=0)
        return done

    def result(self, ticket: Any) -> Answer:
        """The answer of a finished ticket."""
        try:
            answer: Answer = ray.get(ticket, timeout=60)
            return answer
        except exceptions.RayTaskError as error:
            cause = error.cause or error
            if isinstance(cause, FlywheelError):
                raise cause from None
            raise JobFailed(f"{type(cause).__name__}: {cause}", str(error)) from cause
        except (
            exceptions.RayError
        ) as error:  # dead, lost with its node, or never started on a busy machine
            raise WorkerDied(_death_message(error)) from None

    def beat(self, worker: Any) -> Beat | None:
        """The last known sign of progress; asks for the next one without waiting."""
        question, known = self._beats.get(worker, (None, None))
        if question is not None:
            if not ray.wait([question], timeout=0)[0]:
                return known
            try:
                known = ray.get(question, timeout=1)
            except exceptions.RayError:
                return known  # its death is noticed where its job is waited for
        asked = worker.beat.options(concurrency_group="status").remote()
        self._beats[worker] = (asked, known)
        return known

    def kill(self, worker: Any) -> None:
        """End the actor at once."""
        self._beats.pop(worker, None)
        ray.kill(worker, no_restart=True)

    def share(self, value: Any) -> Any:
        """Put a value in the object store; the workers of a node share one copy, read-only."""
        return ray.put(value)


def _death_message(error: BaseException) -> str:
    """The relevant line of Ray's message about a dead actor."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    if lines and "creation task" in lines[0]:
        return f"it could not be made: {lines[-1][:300]}"
    text = " ".join(lines)
    detail = re.search(r"exit detail: ([^.]*)", text)
    return f"{type(error).__name__}: {detail.group(1) if detail else text[:200]}"


def check_fits(groups: Iterable[Group], there: dict[str, float]) -> None:
    """Reject groups that book more than the resources `there`, e.g. {"CPU": 2.0}.

    Raises:
      ConfigError: too little of a resource; the message contains a table.
    """
    groups = list(groups)
    rows = [
        (
            group.name,
            str(group.count),
            f"{group.cpus * group.count:g}",
            f"{group.gpus * group.count:g}",
        )
        for group in groups
    ]
    cpus = sum(group.cpus * group.count for group in groups)
    gpus = sum(group.gpus * group.count for group in groups)
    has = (there.get("CPU", 0.0), there.get("GPU", 0.0))
    if cpus <= has[0] and gpus <= has[1]:
        return
    rows += [("wanted", "", f"{cpus:g}", f"{gpus:g}"), ("there", "", f"{has[0]:g}", f"{has[1]:g}")]
    table = "\n".join(
        f"  {a:<10}{b:>8}{c:>8}{d:>8}"
        for a, b, c, d in [("workers", "count", "CPUs", "GPUs"), *rows]
    )
    raise ConfigError(
        "The cluster is too small for the workers that the configuration "
        f"requests:\n{table}\nRequest fewer (workers.sim=...), or give the cluster more."
    )


def check_reachable(address: str) -> None:
    """Check that an address has a listener; Ray itself would try for minutes.

    Raises:
      ConfigError: the address has another form.
      ConnectionError: there is no listener.
    """
    if address in ("auto", "local"):
        return
    host, _, port = address.rpartition(":")
    if "//" in address or not host or not port.isdigit():
        raise ConfigError(
            f"The address of a cluster is host:port (of its head, usually port 6379) or auto, got "
            f"{address!r}. From outside the cluster, use `ray job submit`."
        )
    try:
        socket.create_connection((host, int(port)), timeout=REACHED_SECONDS).close()
    except OSError as error:
        raise ConnectionError(f"{error}.") from None


@contextmanager
def ray_folder() -> Iterator[Path]:
    """A temporary folder for Ray while the block runs.

    A `Caretaker` removes it even if this process is killed. Folders that killed drivers left
    behind are removed first.

    Raises:
      RunError: no temporary folder has a short enough path, or none can be written.
    """
    place = _place()
    sweep(place)
    folder = Path(tempfile.mkdtemp(prefix=FOLDER_PREFIX, dir=place))
    with Caretaker(folder), hold(folder / FOLDER_LOCK, f"The folder {folder}"):
        yield folder


@contextmanager
def marking(folder: Path) -> Iterator[None]:
    """Mark the processes that are started in the block as belonging to the folder."""
    os.environ[MARK] = str(folder)
    try:
        yield
    finally:
        del os.environ[MARK]


def sweep(place: Path) -> None:
    """Remove the folders of drivers that have ended, and end the processes that belong to them."""
    for folder in place.glob(f"{FOLDER_PREFIX}*"):
        with contextlib.suppress(OSError, ConfigError):  # of another user; gone meanwhile; in use
            about = folder.lstat()
            young = time.time() - about.st_mtime < YOUNG_FOLDER
            if about.st_uid != os.getuid() or young or not (folder / FOLDER_LOCK).is_file():
                continue
            with hold(folder / FOLDER_LOCK, f"The folder {folder}"):
                remove(folder, grace=0.0)


def _place() -> Path:
    """The place for temporary folders: RAY_TMPDIR, Python's own, or the system's."""
    named = [os.environ.get("RAY_TMPDIR"), tempfile.gettempdir(), Path(os.sep, "tmp")]
    refused = []
    for place in dict.fromkeys(Path(name).absolute() for name in named if name):
        try:
            if len(os.fsencode(place / f"{FOLDER_PREFIX}12345678")) > LONGEST_FOLDER:
                raise ConfigError(f"The path {place} is too long for Ray's sockets.")
            check_folder(place, "temporary folder of Ray")
            return place
        except FlywheelError as error:
            refused.append(str(error))
    raise RunError(f"Ray finds no temporary folder; set RAY_TMPDIR to one. {' '.join(refused)}")
