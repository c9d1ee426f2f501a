"""What names on the command line stand for: plants, trained models, effects of the library.

A plant is a shipped robot, an MJCF, or an adopted plant. A model is a plant, a model of a run, or a file
of weights.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from flywheel.cli.runs import open_run
from flywheel.diagnosis.comparison import Subject
from flywheel.dynamics.plant import Plant, with_effects
from flywheel.effects import EFFECTS, NAMED, AdoptedPlant, Effect
from flywheel.effects.adopted import PLANT as PLANT_FILE
from flywheel.effects.adopted import plant_file
from flywheel.errors import ConfigError
from flywheel.registry import lookup
from flywheel.robots import Robot, load_robot
from flywheel.runtime.workers.model_weights import TrainedModel, Weights

PLANT = "plant"
ALLOWED = (
    f"{PLANT!r}, the folder of an adopted plant, a run's folder (its champion), RUN:NAME (another of "
    "its models), or a file of weights; each may have LABEL= in front"
)


def adopted_file(name: str) -> Path | None:
    """The file of an adopted plant, where the name is its folder or the file itself."""
    path = Path(name)
    if path.suffix in {".yaml", ".yml"}:
        return plant_file(path)
    with suppress(OSError, ValueError):  # no name that a file can have
        if (path / PLANT_FILE).exists():
            return path / PLANT_FILE
    return None


def open_plant(name: str, dt: float, threads: int = 1) -> Plant:
    """The plant that a name means.

    Raises:
      RobotError, UnknownNameError, ConfigError: there is none, or it cannot be used.
    """
    path = adopted_file(name)
    if path is None:
        return Plant(load_robot(name), dt, threads=threads)
    adopted, robot = AdoptedPlant.read(path)
    return with_effects(Plant(robot, dt, threads=threads), adopted.terms(robot, NAMED))


def about_plant(plant: Plant) -> dict[str, str]:
    """Lines about a plant, for the head of a page."""
    robot = plant.robot
    return {
        "robot": f"{robot.name} ({robot.digest[:12]})",
        "effects it has": ", ".join(term.label(robot) for term in plant.terms) or "none",
        "control step": f"{plant.dt:g} s, MuJoCo steps of {robot.timestep:g} s",
    }


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
        return Subject.of_plant(name, open_plant(robot_name, dt, threads))
    if adopted_file(what) is not None:
        return Subject.of_plant(name, open_plant(what, dt, threads))
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


def _of_run(name: str, folder: Path, model: str) -> TrainedModel:
    run = open_run(folder)
    iteration = run.iteration(model) if model else run.champion()
    # A run that learned from recordings has a data set of their own; no other knows that input.
    dataset = run.config.dataset_numbers()["recording"] if run.config.collect.recordings else 0
    effects = run.result.effects_before(iteration.iteration + 1)
    return TrainedModel(name, run.weights(iteration), dataset, effects)


def library_of(effects: str) -> Mapping[str, Effect]:
    """The effects of the library by name ("capstan,creep"); all of them for none."""
    names = [name.strip() for name in effects.split(",") if name.strip()]
    return {name: lookup(NAMED, name, "effect") for name in names} or EFFECTS
