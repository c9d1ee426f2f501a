"""One driver per run."""

import os
import signal
import subprocess
import sys

import pytest

from flywheel.errors import ConfigError
from flywheel.runtime.pool.lock import hold

HOLDER = """
import sys, time
from pathlib import Path
from flywheel.runtime.pool.lock import hold
with hold(Path(sys.argv[1]), "x"):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def other_process(tmp_path):
    command = [sys.executable, "-c", HOLDER, str(tmp_path / "run.lock")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_a_second_holder_is_refused_with_the_pid_and_host_of_the_first(tmp_path, other_process):
    with pytest.raises(ConfigError, match=rf"The run is in use by process {other_process.pid} on "):
        with hold(tmp_path / "run.lock", "The run"):
            pass


def test_a_lock_does_not_outlive_a_killed_holder(tmp_path, other_process):
    os.kill(other_process.pid, signal.SIGKILL)
    other_process.wait()
    with hold(tmp_path / "run.lock", "The run"):
        pass


def test_waiting_for_a_holder_that_goes_succeeds(tmp_path, other_process):
    other_process.kill()
    with hold(tmp_path / "run.lock", "The run", wait_seconds=10):
        pass


def test_a_lock_can_be_taken_again_after_it_was_given_back(tmp_path):
    for _ in range(2):
        with hold(tmp_path / "run.lock", "The run"):
            pass
