"""The pool against workers that die, hang and never come, without a cluster."""

import numpy as np
import pytest

from flywheel.errors import RunError
from flywheel.runtime.pool.interrupts import Interrupted, StopRequest
from flywheel.runtime.pool.jobs import Group, Job, JobFailed
from flywheel.runtime.pool.pool import DEATHS_ALLOWED, Patience, WorkerPool
from tests import draws
from tests.unit.runtime.fake_backend import CRASH, DIE, HANG, SLOW, FakeBackend

SIM = Group("sim", object, count=2)
TRAINER = Group("trainer", object, count=1, threads=2)


def pool_of(backend: FakeBackend, *groups: Group, cores: int = 2, stop=lambda: False) -> WorkerPool:
    patience = Patience(start=30, stall=10, drain=5, tick=0.5)
    return WorkerPool(backend, groups or (SIM,), cores, patience, stop, backend.clock)


def jobs(*names: str, group: str = "sim") -> list[Job]:
    return [Job(name, group, "work") for name in names]


def test_every_job_is_done_exactly_once_and_reported_in_the_driver():
    seen: list[str] = []
    pool = pool_of(FakeBackend())
    report = pool.run(jobs(*"abcdefg"), on_result=lambda job, result: seen.append(job.id))
    assert sorted(seen) == list("abcdefg") == sorted(report.results)
    assert report.restarts == 0 and not report.quarantined


def test_jobs_are_done_whatever_the_workers_do_as_long_as_no_job_kills_three():
    seed = draws.seed()
    rng = np.random.default_rng(seed)
    names = [f"job{i}" for i in range(20)]
    script = {n: list(rng.choice([DIE, HANG, SLOW], rng.integers(0, 3))) for n in names}
    deaths = sum(fate in (DIE, HANG) for fates in script.values() for fate in fates)
    for fates in script.values():  # a slow attempt succeeds: what is written after it never happens
        if SLOW in fates:
            deaths -= sum(f != SLOW for f in fates[fates.index(SLOW) :])
            del fates[fates.index(SLOW) + 1 :]
    report = pool_of(FakeBackend(script)).run(jobs(*names))
    assert sorted(report.results) == sorted(names), f"seed {seed}"
    assert report.restarts == deaths, f"seed {seed}"


def test_computing_time_is_counted_for_what_is_done_and_not_for_what_died_on_the_way():
    backend = FakeBackend({"a": [DIE]})
    assert pool_of(backend).run(jobs(*"abc")).cpu_seconds == pytest.approx(3 * backend.seconds)


def test_a_hung_worker_is_killed_and_its_job_done_again():
    backend = FakeBackend({"a": [HANG]})
    report = pool_of(backend).run(jobs("a", "b"))
    assert sorted(report.results) == ["a", "b"]
    assert backend.killed and report.restarts == 1
    assert backend.now < 15, "noticed after the 10 s that were allowed"


def test_a_slow_worker_that_shows_progress_is_left_alone():
    report = pool_of(FakeBackend({"a": [SLOW]})).run(jobs("a"))
    assert report.restarts == 0 and list(report.results) == ["a"]


def test_a_job_that_kills_three_workers_is_set_aside_while_the_rest_goes_on():
    backend = FakeBackend({"bad": [DIE] * 10})
    report = pool_of(backend).run(jobs("bad", *"abcdef"))
    assert sorted(report.results) == list("abcdef")
    (quarantined,) = report.quarantined
    assert quarantined.id == "bad" and len(quarantined.deaths) == DEATHS_ALLOWED
    assert "signal 9" in quarantined.deaths[0]
    assert backend.attempts.count("bad") == DEATHS_ALLOWED


def test_an_error_of_the_job_itself_is_not_tried_again():
    backend = FakeBackend({"a": [CRASH]})
    with pytest.raises(JobFailed, match="ValueError: no"):
        pool_of(backend).run(jobs("a"))
    assert backend.attempts == ["a"]


def test_workers_that_never_start_end_the_run_with_a_message():
    backend = FakeBackend(starts=False)
    with pytest.raises(RunError, match="No sim worker has started for 30 s; 1 requested"):
        pool_of(backend).run(jobs("a"))


def test_workers_that_die_while_starting_end_the_run_with_the_reason():
    with pytest.raises(RunError, match="died while starting: killed by signal 9"):
        pool_of(FakeBackend(starts="die")).run(jobs("a"))


def test_a_job_for_unknown_workers_is_refused():
    with pytest.raises(RunError, match="'gpu'"):
        pool_of(FakeBackend()).run(jobs("a", group="gpu"))


def test_no_more_threads_are_busy_than_there_are_cores():
    backend = FakeBackend()
    mixed = [*jobs("t", group="trainer"), *jobs(*"abcd")]
    report = pool_of(backend, SIM, TRAINER).run(mixed)
    assert len(report.results) == 5
    assert backend.most_busy == 2
    assert backend.attempts[0] == "t" and backend.now >= 3, "the trainer had both cores alone"


def test_a_core_is_kept_for_a_job_whose_worker_is_only_starting():
    backend = FakeBackend(start_seconds={"trainer": 3.0})
    slow_to_start = Group("trainer", object, count=1)
    mixed = [*jobs("t", group="trainer"), *jobs(*"abcdef")]
    report = pool_of(backend, SIM, slow_to_start).run(mixed)
    assert len(report.results) == 7
    # One core is used all the time, the other one from the third second on: not by five sims first.
    assert backend.attempts.index("t") <= 4
    assert backend.most_busy == 2 and backend.now == pytest.approx(5.0)


def test_a_request_to_stop_finishes_running_jobs_and_starts_no_new_ones():
    stop = StopRequest()
    backend = FakeBackend()
    done: list[str] = []

    def on_result(job, result):
        done.append(job.id)
        stop.ask()

    with pytest.raises(Interrupted, match="finished work is kept"):
        pool_of(backend, stop=stop).run(jobs(*"abcdef"), on_result)
    assert done == ["a", "b"]


def test_a_request_to_stop_does_not_wait_for_ever():
    backend = FakeBackend({"a": [HANG]})
    asked = iter([False, False, True, True, True])
    with pytest.raises(Interrupted):
        pool_of(backend, stop=lambda: next(asked)).run(jobs("a"))
    assert backend.now <= 7


def test_progress_is_told_the_share_that_is_done():
    shares: list[float] = []

    class Spy:
        def say(self, text):
            pass

        def stage(self, title, total):
            return self

        def __enter__(self):
            return self

        def __exit__(self, *error):
            return None

        def update(self, done, note=""):
            shares.append(done)

    pool_of(FakeBackend({"x": [DIE] * 3})).run(jobs(*"abcx"), progress=Spy())
    assert shares == sorted(shares) and shares[-1] == 4.0
