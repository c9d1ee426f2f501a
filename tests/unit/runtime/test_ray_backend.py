"""Ray's errors as the pool knows them."""

import pytest
import ray
from ray import exceptions

from flywheel.errors import ModelError
from flywheel.runtime.pool.jobs import JobFailed, WorkerDied
from flywheel.runtime.pool.ray_backend import RayBackend


def failing(error: Exception):
    def get(ticket: object, timeout: float) -> None:
        raise error

    return get


@pytest.mark.parametrize(
    "error",
    [
        exceptions.RayActorError(),
        exceptions.WorkerCrashedError(),
        exceptions.NodeDiedError("gone"),
        exceptions.OutOfMemoryError("full"),
        exceptions.GetTimeoutError("late"),
        exceptions.ActorUnschedulableError("worker startup repeatedly failed"),
        exceptions.RuntimeEnvSetupError("no environment"),
    ],
)
def test_whatever_ray_says_of_a_worker_it_is_replaced(error, monkeypatch):
    monkeypatch.setattr(ray, "get", failing(error))
    with pytest.raises(WorkerDied):
        RayBackend().result("ticket")


@pytest.mark.parametrize(
    ("cause", "kind"), [(ModelError("it diverged"), ModelError), (ValueError("odd"), JobFailed)]
)
def test_an_error_of_a_job_is_no_death(cause, kind, monkeypatch):
    error = exceptions.RayTaskError("work", "traceback", cause)
    monkeypatch.setattr(ray, "get", failing(error))
    with pytest.raises(kind, match=str(cause)):
        RayBackend().result("ticket")
