"""The pool on a real Ray, with real processes that are really killed."""

import ctypes
import signal
import threading
import time

import numpy as np
import pytest

from flywheel.errors import ConfigError, RunError
from flywheel.runtime.pool.interrupts import Interrupted, StopRequest
from flywheel.runtime.pool.jobs import Group, Job, JobFailed
from flywheel.runtime.pool.pool import Patience, WorkerPool
from flywheel.runtime.pool.ray_backend import Cluster, RayBackend, check_fits, check_reachable
from tests.integration.stunt_workers import Stunt, at_work

pytestmark = pytest.mark.ray
PATIENCE = Patience(start=120, stall=60, drain=1, tick=0.1)
IMPATIENCE = Patience(start=120, stall=3, drain=1, tick=0.1)


@pytest.fixture
def pool_of(local_ray, tmp_path):
    pools = []

    def made(
        count: int = 2, threads: int = 1, stop=lambda: False, patience: Patience = PATIENCE
    ) -> WorkerPool:
        group = Group("stunt", Stunt, (str(tmp_path),), count, threads=threads)
        pools.append(WorkerPool(RayBackend(), [group], 2, patience, stop))
        return pools[-1]

    yield made
    for pool in pools:
        pool.close()


def drawing(count: int, seconds: float = 0.0) -> list[Job]:
    return [Job(f"draw-{i}", "stunt", "draw", (i, seconds)) for i in range(count)]


def expected(count: int) -> list[float]:
    return [float(np.random.default_rng(i).normal()) for i in range(count)]


def system_handler(number: signal.Signals) -> int:
    """Address of the C function that the system calls for a signal."""
    action = (ctypes.c_void_p * 64)()
    ctypes.CDLL(None).sigaction(number, None, action)
    return action[0]


def test_ray_leaves_sigterm_to_python(local_ray):
    assert callable(signal.getsignal(signal.SIGTERM))
    assert system_handler(signal.SIGTERM) == system_handler(signal.SIGINT)


@pytest.mark.slow
def test_killed_workers_are_replaced_and_their_jobs_give_the_same_numbers(pool_of):
    killed: set[str] = set()  # jobs whose worker was killed; none twice, or it would be set aside

    def kill_now_and_then():
        deadline = time.monotonic() + 60
        while len(killed) < 2 and time.monotonic() < deadline:
            time.sleep(0.3)
            busy = {job: victim for victim, job in at_work("draw-") if job not in killed}
            for job, victim in list(busy.items())[:1]:
                victim.kill()
                killed.add(job)

    killer = threading.Thread(target=kill_now_and_then)
    pool = pool_of()
    killer.start()
    report = pool.run(drawing(6, seconds=0.8))
    killer.join()
    assert [report.results[f"draw-{i}"][0] for i in range(6)] == expected(6)
    assert len(killed) == 2 == report.restarts


@pytest.mark.slow
def test_a_job_that_kills_three_workers_is_set_aside_while_the_rest_goes_on(pool_of):
    bad = Job("bad", "stunt", "die", ("bad", 99))
    unlucky = Job("unlucky", "stunt", "die", ("unlucky", 2))
    report = pool_of().run([bad, unlucky, *drawing(4)])
    assert report.results["unlucky"] == 2, "two deaths are forgiven"
    assert [report.results[f"draw-{i}"][0] for i in range(4)] == expected(4)
    (quarantined,) = report.quarantined
    assert quarantined.id == "bad" and len(quarantined.deaths) == 3
    assert report.restarts == 5


@pytest.mark.slow
def test_hung_workers_are_replaced_and_their_jobs_done_again(pool_of):
    hung = [Job(how, "stunt", how, (how,)) for how in ("stop", "sleep")]
    report = pool_of(patience=IMPATIENCE).run([*hung, *drawing(2)])
    assert (report.results["stop"], report.results["sleep"]) == (1, 1)
    assert report.restarts == 2


@pytest.mark.slow
def test_an_error_in_a_job_reaches_the_driver_with_its_place(pool_of):
    pool = pool_of(count=1)
    with pytest.raises(JobFailed, match="ValueError: a mistake in the job") as caught:
        pool.run([Job("fail", "stunt", "fail")])
    assert "in fail" in caught.value.trace
    assert pool.run(drawing(1)).results["draw-0"][0] == expected(1)[0], "the pool goes on"


@pytest.mark.slow
def test_workers_compute_with_the_threads_of_their_group(pool_of):
    report = pool_of(count=1, threads=2).run([Job("threads", "stunt", "threads")])
    assert report.results["threads"] == ("2", 2)


@pytest.mark.slow
def test_shared_arrays_are_read_by_all_workers_and_written_by_none(pool_of):
    pool = pool_of()
    shared = pool.share(np.arange(1000.0))
    report = pool.run([Job(f"sum{i}", "stunt", "total", (shared,)) for i in range(4)])
    assert set(report.results.values()) == {(499500.0, False)}


@pytest.mark.slow
def test_a_request_to_stop_ends_within_the_time_to_drain(pool_of):
    stop, asked = StopRequest(), []

    def ask_when_busy():
        deadline = time.monotonic() + 60
        while not at_work("draw-") and time.monotonic() < deadline:
            time.sleep(0.1)
        asked.append(time.monotonic())
        stop.ask()

    asking = threading.Thread(target=ask_when_busy)
    asking.start()
    with pytest.raises(Interrupted):
        pool_of(stop=stop).run(drawing(4, seconds=30.0))
    ended = time.monotonic()
    asking.join()
    assert ended - asked[0] < PATIENCE.drain + 10


@pytest.mark.slow
def test_a_cluster_too_small_is_refused_at_once_with_a_table(local_ray):
    groups = [Group("sim", Stunt, count=64), Group("trainer", Stunt, cpus=2, gpus=1)]
    begun = time.monotonic()
    with pytest.raises(ConfigError) as caught:
        local_ray.check_fits(groups)
    assert time.monotonic() - begun < 2
    lines = str(caught.value).splitlines()
    assert lines[2].split() == ["sim", "64", "64", "0"]
    assert lines[-3].split() == ["wanted", "66", "1"]
    assert lines[-2].split() == ["there", "2", "0"]
    assert "workers.sim" in lines[-1]


def test_workers_that_share_cores_fit():
    check_fits([Group("sim", Stunt, count=2), Group("trainer", Stunt, cpus=0)], {"CPU": 2.0})


@pytest.mark.parametrize("address", ["somewhere", "ray://head:10001", "head:port"])
def test_an_address_that_is_none_is_refused(address):
    with pytest.raises(ConfigError, match="host:port"):
        check_reachable(address)


def test_a_cluster_that_is_not_there_is_told_at_once(monkeypatch):
    monkeypatch.setattr("ray.is_initialized", lambda: False)
    with (
        pytest.raises(
            RunError, match=r"No connection to the Ray cluster at 127\.0\.0\.1:1: .*refused"
        ),
        Cluster(address="127.0.0.1:1"),
    ):
        pass
