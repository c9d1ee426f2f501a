"""Models by name: the plant, an adopted plant, a model of a run, a file of weights."""

from __future__ import annotations

from pathlib import Path

from flywheel.cli.plants import adopted_file, open_plant
from flywheel.cli.runs import open_run
from flywheel.diagnosis.comparison import Subject
from flywheel.dynamics.plant import RestartedPlant
from flywheel.effects import Scales
from flywheel.errors import ConfigError
from flywheel.robots import Robot
from flywheel.runtime.workers.model_weights import Weights
from flywheel.runtime.workers.trained import TrainedModel

PLANT = "plant"
PAST = 0.36  # that a restarted plant looks back, to see speeds through noise [sqrt(L / g)]
ALLOWED = (
    f"{PLANT!r}, the folder of an adopted plant, a run's folder (its champion), RUN:NAME (another of "
    "its models), or a file of weights; each may have LABEL= in front"
)


def open_model(spec: str, robot: Robot, robot_name: str, dt: float, threads: int) -> Subject:
    """The model that `[LABEL=]SPEC` means.

    Args:
      spec: see `ALLOWED`.
      robot: that is to be predicted.
      robot_name: as it was given.
      dt: control step of plants [s].
      threads: of the model.

    Raises:
      ConfigError, DataError, ModelError, UnknownNameError: there is none, or it does not fit.
    """
    label, _, what = spec.rpartition("=")
    name = label or what
    if what == PLANT:
        return _plant(name, robot_name, dt, threads)
    if adopted_file(what) is not None:
        return _plant(name, what, dt, threads)
    return open_trained(spec, robot).subject(robot, threads)


def open_trained(spec: str, robot: Robot) -> TrainedModel:
    """The trained model that `[LABEL=]SPEC` means.

    Args:
      spec: see `ALLOWED`, plants left out.
      robot: that is to be predicted.

    Raises:
      ConfigError, DataError, ModelError, UnknownNameError: there is none, or it does not fit.
    """
    label, _, what = spec.rpartition("=")
    name, path = label or what, Path(what)
    if what == PLANT or adopted_file(what) is not None:
        raise ConfigError(
            f"{what} is a plant, which is tested by --robot alone; a trained model is wanted here."
        )
    if (path / "config.yaml").exists():
        return _of_run(name, path, "")
    if path.is_file():
        return TrainedModel(name, Weights.read(path, robot))
    run, _, model = what.rpartition(":")
    if run:
        return _of_run(name, Path(run), model)
    raise ConfigError(f"There is no model {what!r}. A model is {ALLOWED}.")


def _plant(name: str, robot_name: str, dt: float, threads: int) -> Subject:
    """MuJoCo, started from what is seen of the past."""
    plant = open_plant(robot_name, dt, threads)
    window = max(2, round(PAST * Scales.of(plant.robot).time / dt))
    dynamics = RestartedPlant(plant, window=window, degree=2, roll="relaxed")
    return Subject(name, dynamics, terms=plant.terms)


def _of_run(name: str, folder: Path, model: str) -> TrainedModel:
    run = open_run(folder)
    iteration = run.iteration(model) if model else run.champion()
    # A run that learned from recordings has a data set of their own; no other knows that input.
    dataset = run.config.dataset_numbers()["recording"] if run.config.collect.recordings else 0
    effects = run.result.effects_before(iteration.iteration + 1)
    return TrainedModel(name, run.weights(iteration), dataset, effects)
