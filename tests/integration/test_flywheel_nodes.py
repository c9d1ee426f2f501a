"""A node of a two-node cluster is lost; what it was doing is done on the other."""

import os
import subprocess
import sys

import pytest

from tests.chaos.killing import ROOT


@pytest.mark.nightly
@pytest.mark.ray
@pytest.mark.slow
def test_jobs_of_a_lost_node_are_done_on_the_one_that_is_left():
    done = subprocess.run(
        [sys.executable, "-m", "tests.integration.two_nodes"],
        cwd=ROOT,
        env={**os.environ, "RAY_AUTH_MODE": "disabled"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-3000:]
    assert "same=True" in done.stdout
