"""Names on the command line: plants, trained models, effects of the library.

A plant is a shipped robot, an MJCF, or an adopted plant. A model is a plant, a baseline, a model of a
run, or a file of weights: of a network, of a corrected plant, or of a fitted baseline.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from flywheel.cli.options import PlantOptions
from flywheel.cli.runs.opening import open_run
from flywheel.diagnosis.comparison import Subject
from flywheel.dynamics.baselines.named import BASELINES
from flywheel.dynamics.gnn.shipped import SHIPPED, shipped_weights
from flywheel.dynamics.plant import Plant, with_effects
from flywheel.dynamics.plant.law_checks import check_laws
from flywheel.effects import EFFECTS, NAMED, AdoptedPlant, Effect
from flywheel.effects.adopted import PLANT as PLANT_FILE
from flywheel.effects.adopted import plant_file
from flywheel.effects.libraries import with_laws
from flywheel.effects.own import LawFile, check_different
from flywheel.errors import ConfigError
from flywheel.registry import lookup
from flywheel.robots import Robot, load_robot
from flywheel.runtime.workers.model_weights import TrainedModel

PLANT = "plant"
ALLOWED = (
    f"{PLANT!r}, {SHIPPED!r} (the network that comes with Flywheel for the robot), a baseline "
    f"({', '.join(BASELINES)}), the folder of an adopted plant, a run's folder (its champion), RUN:NAME "
    "(another of its models), or a file of weights; each may have LABEL= in front"
)


def adopted_file(name: str) -> Path | None:
    """The file of an adopted plant, if the name is its folder or the file itself."""
    path = Path(name)
    if path.suffix in {".yaml", ".yml"}:
        return plant_file(path)
    with suppress(OSError, ValueError):  # no name that a file can have
        if (path / PLANT_FILE).exists():
            return path / PLANT_FILE
    return None


@dataclass(frozen=True)
class Library:
    """The effects known to a command.

    Attributes:
      files: given law files.
      known: all available effects.
    """

    files: tuple[LawFile, ...] = ()
    known: Mapping[str, Effect] = field(default_factory=lambda: NAMED)

    @classmethod
    def of(cls, paths: Sequence[Path]) -> Self:
        """The library of the package, with the effects of law files, which are run.

        Raises:
          ConfigError: a law file cannot be used, see `with_laws`.
        """
        files = tuple(LawFile.read(path) for path in paths)
        check_different(files)
        return cls(files, with_laws(files))

    @property
    def about(self) -> dict[str, str]:
        """A line about the law files, for the head of a page; none without any."""
        files = ", ".join(str(file.reference) for file in self.files)
        return {"effects from": files} if files else {}

    @property
    def provenance(self) -> dict[str, Any]:
        """The law files, as in the JSON of an answer; empty without any."""
        files = [file.reference.model_dump() for file in self.files]
        return {"effects_from": files} if files else {}

    def asked(self, effects: str = "", robot: Robot | None = None) -> Mapping[str, Effect]:
        """The effects by name ("capstan,creep"); for none all default candidates of a diagnosis.

        Raises:
          UnknownNameError: there is none of that name.
          RobotError: it has no meaning on the robot.
        """
        names = [name.strip() for name in effects.split(",") if name.strip()]
        named = {name: lookup(self.known, name, "effect") for name in names}
        for effect in named.values():
            if robot is not None:
                effect.require_place(robot)
        return named or with_laws(self.files, EFFECTS)

    def check(self, plant: Plant) -> None:
        """Check the contract of effects of law files, on this robot.

        Raises:
          ConfigError: see `check_laws`.
        """
        check_laws(with_laws(self.files, {}).values(), plant)


BUILT_IN = Library()


def open_plant(name: str, dt: float, threads: int = 1, library: Library = BUILT_IN) -> Plant:
    """The plant of a name.

    Args:
      name: of a shipped robot, or path of an MJCF or an adopted plant.
      dt: control step [s]; the plant's steps are those of its MJCF, or the next shorter ones that divide it.
      threads: of the plant.
      library: of its effects; law files in it are tested on the plant's robot.

    Raises:
      RobotError, UnknownNameError, ConfigError: there is none, or it cannot be used.
    """
    path = adopted_file(name)
    if path is None:
        plant = Plant(load_robot(name).stepped(dt), dt, threads=threads)
        library.check(plant)
        return plant
    adopted, robot = AdoptedPlant.read(path)
    plant = Plant(robot.stepped(dt), dt, threads=threads)
    library.check(plant)
    return with_effects(plant, adopted.terms(robot, library.known))


def opened(chosen: PlantOptions) -> tuple[Plant, Library]:
    """The plant of a command, and the library of its effects; raises as `open_plant` and `Library.of`."""
    library = Library.of(chosen.effects_from)
    return open_plant(chosen.robot, chosen.dt, chosen.threads, library), library


def about_plant(plant: Plant) -> dict[str, str]:
    """Lines about a plant, for the head of a page."""
    robot = plant.robot
    return {
        "robot": f"{robot.name} ({robot.digest[:12]})",
        "effects it has": ", ".join(term.label(robot) for term in plant.terms) or "none",
        "control step": f"{plant.dt:g} s, MuJoCo steps of {robot.timestep:g} s",
    }


def open_model(spec: str, plant: Plant, library: Library = BUILT_IN) -> Subject:
    """The model of `[LABEL=]SPEC`.

    Args:
      spec: see `ALLOWED`.
      plant: of the robot to be predicted, whose control step and threads are the model's.
      library: of the effects of other plants.

    Raises:
      ConfigError, DataError, ModelError, UnknownNameError: there is none, or it does not fit.
    """
    label, _, what = spec.rpartition("=")
    name, dt, threads = label or what, plant.dt, plant.threads
    if what == PLANT:
        return Subject.of_plant(name, plant)
    if what in BASELINES:
        return Subject(name, BASELINES[what](plant.robot, dt, threads))
    if adopted_file(what) is not None:
        return Subject.of_plant(name, open_plant(what, dt, threads, library))
    return open_trained(spec, plant.robot).subject(plant.robot, threads)


def open_trained(spec: str, robot: Robot) -> TrainedModel:
    """The trained model of `[LABEL=]SPEC`.

    Args:
      spec: see `ALLOWED`, except plants and baselines by name.
      robot: to be predicted.

    Raises:
      ConfigError, DataError, ModelError, UnknownNameError: there is none, or it does not fit.
    """
    label, _, what = spec.rpartition("=")
    name, path = label or what, Path(what)
    if what == PLANT or adopted_file(what) is not None:
        raise ConfigError(
            f"{what} is a plant, which is tested by --robot alone; a trained model is needed here."
        )
    if what in BASELINES:
        raise ConfigError(f"{what} is not fitted to anything; a trained model is needed here.")
    if what == SHIPPED:
        return TrainedModel.read(name, shipped_weights(robot), robot)
    if (path / "config.yaml").exists():
        return _of_run(name, path, "")
    if path.is_file():
        return TrainedModel.read(name, path, robot)
    run, _, model = what.rpartition(":")
    if run:
        return _of_run(name, Path(run), model)
    raise ConfigError(f"There is no model {what!r}. A model is {ALLOWED}.")


def _of_run(name: str, folder: Path, model: str) -> TrainedModel:
    run = open_run(folder)
    iteration = run.iteration(model) if model else run.champion()
    dataset = run.config.recording_number
    effects = run.result.effects_before(iteration.iteration + 1)
    library = run.config.library() if effects else NAMED  # law files are the run's own copies
    return TrainedModel(name, run.weights(iteration), dataset, effects, library)
