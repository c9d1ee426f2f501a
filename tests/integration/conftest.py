"""One local Ray for all tests that need one, without a token and without a trace in HOME."""

import os

os.environ.setdefault("RAY_AUTH_MODE", "disabled")
os.environ.setdefault("RAY_worker_niceness", "0")

import pytest

from flywheel.runtime.pool.ray_backend import Cluster
from tests.integration.stunt_workers import by_value


@pytest.fixture(scope="session")
def local_ray():
    by_value()
    with Cluster(cores=2) as cluster:
        yield cluster
