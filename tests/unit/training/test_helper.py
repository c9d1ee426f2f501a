"""Processes that compute parts of a batch: the same bits, whoever computes them."""

from multiprocessing import Pipe

import pytest
import torch

from flywheel.dynamics.gnn import ChunkNetwork, Simulator, fit_normalisation
from flywheel.errors import RunError
from flywheel.runtime.pool.ray_backend import _Actor
from flywheel.training import helper as helping
from flywheel.training.objective import Objective


@pytest.fixture
def objective(robot, train, network_config, make_config):
    config = make_config(processes=2)
    return Objective(config, config.initial, Simulator(robot, network_config), train)


@pytest.fixture
def network(robot, network_config, objective):
    torch.manual_seed(0)
    network = ChunkNetwork(robot, network_config)
    fit_normalisation(Simulator(robot, network_config), network, [objective.measured()])
    return network


@pytest.mark.slow
@pytest.mark.chaos
def test_parts_have_the_same_bits_whoever_computes_them(objective, network):
    def found(*helpers: helping.Helper) -> list[torch.Tensor]:
        losses = objective.backward(network, 7, helpers)
        return [losses.total, *(w.grad for w in network.parameters() if w.grad is not None)]

    def same(one: list[torch.Tensor], other: list[torch.Tensor]) -> bool:
        return all(torch.equal(a, b) for a, b in zip(one, other, strict=True))

    (helper,) = objective.helpers(network)
    with helper:
        assert same(found(helper), found())  # it has not started yet
        assert helper._pipe.poll(120)
        process = helper._process
        with torch.no_grad():  # what it was given at first is out of date
            for weight in network.parameters():
                weight.mul_(1.1)
        assert same(found(helper), found())
        assert helper._ready and process.poll() is None
        process.kill()
        assert same(found(helper), found())
        assert process.returncode == -9 and helper._process.pid != process.pid
        helper._process.kill()
        helper._process.wait()
        with pytest.raises(RunError, match=r"ended while it started, with status -9; training\.p"):
            found(helper)


def test_a_helper_ends_with_the_process_that_it_works_for(network):
    ours, theirs = Pipe()
    asked = []
    ours.send_bytes(helping._packed((network.state_dict(), "work")))
    ours.close()
    helping._serve(theirs, lambda network, *rest: asked.append(rest), network, "rehearsal")
    assert asked == [("rehearsal",)]


@pytest.mark.parametrize("device, processes, count", [("cpu", 1, 0), ("cpu", 3, 2), ("cuda", 3, 0)])
def test_there_is_a_helper_for_each_part_but_one_where_parts_have_cores_of_their_own(
    objective, network, make_config, device, processes, count
):
    objective._config = make_config(device=device, processes=processes)
    assert len(objective.helpers(network)) == count


class Training:
    """A worker with a helper that computes for a third of a second."""

    def train(self) -> None:
        with helping.Helper(print, None) as helper:
            assert helper._pipe.poll(60), "its process has not ended"


def test_the_processor_time_of_a_helper_counts_for_the_job_that_it_helps(monkeypatch):
    busy = "import time\nwhile time.process_time() < 0.3: pass"
    monkeypatch.setattr(helping, "_BEGINNING", busy)
    assert 0.25 < _Actor(Training, ()).work("train", "train").cpu_seconds < 3.0
