import dataclasses
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import torch

from flywheel.data import WindowCache
from flywheel.dynamics.gnn import (
    ChunkNetwork,
    NetworkConfig,
    Simulator,
    load_weights,
    weights_digest,
)
from flywheel.errors import ConfigError, DataError, ModelError
from flywheel.robots import Robot, read_robot
from flywheel.training import Schedule, Stage, Trainer
from flywheel.training.checkpoint import read_checkpoint
from flywheel.training.objective import Objective
from flywheel.training.validation import (
    Validation,
    ValidationErrors,
    clearly_worse,
    selection_error,
)
from tests import draws
from tests.unit.robots.test_refusals import GOOD


class Killed(Exception):
    """Stands for the end of the process."""


def _kill_at(step: int):
    def on_progress(progress):
        if progress.point.step >= step:
            raise Killed

    return on_progress


@pytest.fixture
def trainer(robot, train, validation, network_config, make_config, tmp_path):
    def make(folder="run", config=None, **kwargs) -> Trainer:
        settings = {"train": train, "validation": validation} | kwargs
        return Trainer(
            config or make_config(),
            network_config,
            robot,
            settings["train"],
            settings["validation"],
            tmp_path / folder,
            settings.get("initial_weights"),
        )

    return make


@pytest.mark.slow
def test_a_training_that_was_killed_ends_with_the_same_weights(trainer, tmp_path):
    seed = draws.seed()
    whole = trainer("whole").run()
    for at in np.random.default_rng(seed).choice(np.arange(1, 12), 2, replace=False):
        with pytest.raises(Killed):
            trainer(f"killed{at}").run(_kill_at(at))
        resumed = trainer(f"killed{at}").run()
        assert resumed.digest == whole.digest, f"killed at step {at}, seed {seed}"
        assert resumed.curve == whole.curve
    assert trainer("whole").run().digest == whole.digest  # once more: nothing is left to do


def test_another_seed_gives_other_weights(trainer, make_config):
    digests = {trainer(f"{s}", make_config(steps=3, seed=s)).run().digest for s in (0, 1)}
    assert len(digests) == 2


def test_the_best_weights_are_kept_and_not_the_last(trainer, robot, make_config, monkeypatch):
    errors = iter([5.0, 2.0, 3.0])
    monkeypatch.setattr("flywheel.training.trainer.selection_error", lambda table: next(errors))
    digests = {}
    original = Trainer._validate

    def validate(self, state, point):
        original(self, state, point)
        digests[state.step] = weights_digest(state.served)

    monkeypatch.setattr(Trainer, "_validate", validate)
    result = trainer().run()
    assert (result.best_step, result.best_error) == (10, 2.0)
    assert result.digest == digests[10] == weights_digest(load_weights(result.weights, robot))


def test_the_weights_that_are_kept_are_a_running_mean(trainer, robot, make_config, monkeypatch):
    means, decay = [], 0.7
    original = Trainer._train_step

    def step(self, state, pool):
        losses = original(self, state, pool)
        now = {name: w.detach().double().clone() for name, w in state.network.named_parameters()}
        before = means[-1] if means else now
        means.append({n: decay * before[n] + (1 - decay) * w for n, w in now.items()})
        return losses

    monkeypatch.setattr(Trainer, "_train_step", step)
    result = trainer(config=make_config(steps=6, averaging=decay)).run()
    kept = dict(load_weights(result.weights, robot).named_parameters())
    wanted = means[result.best_step - 1]
    for name, weight in wanted.items():
        assert torch.allclose(kept[name].double(), weight, rtol=1e-4, atol=1e-6), name


@pytest.mark.slow
def test_training_stops_when_the_last_stage_no_longer_improves(trainer, make_config, monkeypatch):
    error = iter(range(1000))
    monkeypatch.setattr(
        "flywheel.training.trainer.selection_error", lambda table: float(next(error))
    )
    config = make_config(steps=40, validate_every=2, patience=3)
    result = trainer(config=config).run()
    assert result.steps == 20 + 2 * 3
    assert result.best_step == 2
    assert trainer(config=config).run().digest == result.digest


@pytest.mark.slow
def test_a_loss_that_is_not_a_number_names_the_step_and_keeps_the_checkpoint(
    trainer, tmp_path, monkeypatch
):
    original = Objective.backward

    def poisoned(self, network, step, pool):
        losses = original(self, network, step, pool)
        return dataclasses.replace(losses, total=losses.total * (torch.nan if step == 7 else 1.0))

    monkeypatch.setattr(Objective, "backward", poisoned)
    with pytest.raises(ModelError, match="step 8: the loss is nan"):
        trainer().run()
    monkeypatch.undo()
    assert read_checkpoint(tmp_path / "run", trainer()._key).step == 6
    assert trainer().run().digest == trainer("whole").run().digest


def test_a_folder_with_another_training_is_refused(trainer, make_config):
    trainer(config=make_config(steps=2)).run()
    with pytest.raises(ConfigError, match="another configuration"):
        trainer(config=make_config(steps=3)).run()


def test_a_training_that_knew_other_winches_is_another_training(trainer, make_config, train):
    trainer(config=make_config(steps=2)).run()
    with pytest.raises(ConfigError, match="another configuration"):
        trainer(config=make_config(steps=2), train=dataclasses.replace(train, belief="a")).run()


def test_episodes_that_are_too_short_are_refused(trainer, train, validation):
    short = type(train)(
        train.points[:, :9], train.controls[:, :8], train.winch[:, :9], train.dataset
    )
    with pytest.raises(DataError, match="training episode"):
        trainer(train=short)
    with pytest.raises(DataError, match="validation episode"):
        trainer(validation=short)


@pytest.mark.slow
def test_fine_tuning_goes_on_from_the_weights_it_is_given(trainer, robot, make_config):
    first = trainer("first", make_config(steps=40)).run()
    still = Schedule(
        steps=1, stages=(Stage(chunks=1, share=1),), learning_rate=1e-12, warmup_steps=0
    )
    config = make_config(steps=40, fine_tuning=still)
    after = trainer("after", config, initial_weights=first.weights).run()
    assert after.best_error == pytest.approx(first.best_error, rel=1e-4)
    assert after.steps == 1


@pytest.mark.slow
def test_fine_tuning_that_only_does_harm_gives_the_initial_weights_back(trainer, make_config):
    first = trainer("first", make_config(steps=40)).run()
    wild = Schedule(steps=5, stages=(Stage(chunks=1, share=1),), learning_rate=3.0, warmup_steps=0)
    after = trainer(
        "after", make_config(steps=40, fine_tuning=wild), initial_weights=first.weights
    ).run()
    assert after.best_step == 0
    assert after.digest == first.digest


@pytest.mark.slow
def test_fine_tuning_is_kept_unless_it_is_clearly_worse(trainer, make_config, monkeypatch):
    first = trainer("first", make_config(steps=40)).run()
    wild = Schedule(steps=5, stages=(Stage(chunks=1, share=1),), learning_rate=0.1, warmup_steps=0)
    config = make_config(steps=40, fine_tuning=wild)
    asked = []
    monkeypatch.setattr(
        "flywheel.training.trainer.clearly_worse",
        lambda after, before: asked.append((selection_error(after), selection_error(before))),
    )
    after = trainer("after", config, initial_weights=first.weights).run()
    assert asked == [(after.best_error, pytest.approx(first.best_error, rel=1e-4))]
    assert after.best_step == 5
    assert after.digest != first.digest


def test_worse_by_chance_is_not_clearly_worse():
    rng = np.random.default_rng(draws.seed())
    before = rng.uniform(5.0, 10.0, 128)
    more = rng.normal(0.0, 1.0, 128)
    more -= more.mean()
    error = more.std() / np.sqrt(128)

    def errors(by_window):
        return ValidationErrors(None, by_window)

    assert not clearly_worse(errors(before + more + 1.9 * error), errors(before))
    assert clearly_worse(errors(before + more + 2.1 * error), errors(before))
    assert not clearly_worse(errors(before + more - 5.0 * error), errors(before))
    assert not clearly_worse(errors(before), errors(before))
    assert clearly_worse(errors(np.full(128, np.inf)), errors(before))
    assert not clearly_worse(errors(before), errors(np.full(128, np.inf)))


def test_weights_of_another_network_are_refused(
    trainer, robot, train, validation, network_config, make_config, tmp_path
):
    first = trainer("first", make_config(steps=2)).run()
    other = network_config.model_copy(update={"width": 8})
    with pytest.raises(ConfigError, match="another network"):
        Trainer(make_config(), other, robot, train, validation, tmp_path / "o", first.weights).run()


@pytest.mark.slow
def test_a_network_overfits_a_tiny_data_set(trainer, train, make_config):
    tiny = type(train)(
        train.points[:1, 100:117],
        train.controls[:1, 100:116],
        train.winch[:1, 100:117],
        train.dataset[:1],
    )
    schedule = Schedule(
        steps=120, stages=(Stage(chunks=1, share=1),), learning_rate=1e-2, warmup_steps=10
    )
    config = make_config(initial=schedule, validate_every=1000)
    curve = trainer(config=config, train=tiny).run().curve
    first = np.mean([point.loss for point in curve[:3]])
    last = np.mean([point.loss for point in curve[-10:]])
    assert last < first / 10, (first, last)


def test_progress_tells_step_rate_losses_and_validation(trainer, make_config):
    seen = []
    trainer(config=make_config(steps=6)).run(seen.append)
    assert [p.point.step for p in seen] == [1, 2, 3, 4, 5, 6]
    assert [p.point.chunks for p in seen] == [1, 1, 1, 2, 2, 2]
    assert [p.point.e_rot is not None for p in seen] == [False] * 4 + [True] * 2
    assert all(p.steps == 6 and p.steps_per_second > 0 for p in seen)
    assert seen[-1].best_error == min(p.point.error for p in seen[4:])


def test_the_number_of_threads_is_put_back_and_changes_no_bit(trainer, make_config):
    before, digests = torch.get_num_threads(), set()
    for threads in (2, 1):
        torch.set_num_threads(threads)
        digests.add(trainer(f"{threads}", make_config(steps=2, processes=2)).run().digest)
        assert torch.get_num_threads() == threads
    torch.set_num_threads(before)
    assert len(digests) == 1


def measured(robot: Robot, cache: WindowCache, config: NetworkConfig) -> Validation:
    """Four short windows of a cache."""
    return Validation(
        robot,
        cache,
        history=config.history,
        chunk=config.chunk,
        dt=0.01,
        seconds=0.2,
        windows=4,
        seed=0,
    )


def test_a_validation_rollout_that_flies_off_is_never_the_best(
    robot, validation, network_config, monkeypatch
):
    measure = measured(robot, validation, network_config)
    simulator, network = Simulator(robot, network_config), ChunkNetwork(robot, network_config)
    original = Simulator.unroll

    def broken(self, *args):
        unrolled = original(self, *args)
        unrolled.points[0, 3:] = torch.nan
        return unrolled

    good = selection_error(measure(simulator, network, "cpu"))
    monkeypatch.setattr(Simulator, "unroll", broken)
    assert selection_error(measure(simulator, network, "cpu")) > 100 * good


def test_weights_for_a_robot_that_shows_no_rotation_are_selected_by_positions(
    cache_of, network_config
):
    robot = read_robot(GOOD)
    assert len(robot.points) == 1
    measure = measured(robot, cache_of(robot, 0, 2, 150), network_config)
    network = ChunkNetwork(robot, network_config)
    errors = measure(Simulator(robot, network_config), network, "cpu")
    assert np.isnan(errors.table.e_rot)
    assert selection_error(errors) > 0 and np.isfinite(selection_error(errors))


@pytest.mark.chaos
@pytest.mark.nightly
@pytest.mark.slow
def test_a_training_process_killed_at_a_random_instant_can_be_resumed(
    trainer, train, validation, network_config, make_config, tmp_path
):
    seed = draws.seed()
    rng = np.random.default_rng(seed)
    config = make_config(steps=30, checkpoint_every=1, processes=2)
    whole = trainer("whole", config).run()
    folder = tmp_path / "killed"
    folder.mkdir()
    train.save(folder / "train.npz")
    validation.save(folder / "validation.npz")
    (folder / "training.json").write_text(config.model_dump_json())
    (folder / "network.json").write_text(network_config.model_dump_json())
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.unit.training.killable", str(folder)],
        stdout=subprocess.PIPE,
        text=True,
    )
    with process, process.stdout:
        process.stdout.readline()
        time.sleep(rng.uniform(0.0, 0.4))
        process.send_signal(signal.SIGKILL)
    resumed = trainer("killed/run", config).run()
    assert resumed.digest == whole.digest, f"seed {seed}"
    assert resumed.curve == whole.curve, f"seed {seed}"
