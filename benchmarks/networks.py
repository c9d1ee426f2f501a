"""The shipped networks: trains one, measures it, writes it with its card into the package.

    python -m benchmarks.networks prism3 FOLDER      an hour of one core; goes on where it was

The training is a run of `configs/networks/ROBOT.yaml`. The errors are of episodes with random controls that
no training has seen: on the plant of the MJCF, on those of the training, and on others that are drawn alike.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import yaml
from scipy.stats import qmc

from benchmarks.command import parser_of
from flywheel.cli.runs.opening import OpenRun, open_run
from flywheel.dynamics import Persistence
from flywheel.dynamics.gnn import LearnedDynamics, load_weights, weights_digest
from flywheel.dynamics.gnn.shipped import (
    FOLDER,
    MJCF,
    NETWORK,
    ModelCard,
    PredictionError,
    shipped_networks,
)
from flywheel.dynamics.plant import PlantParameters, RestartedPlant
from flywheel.dynamics.protocol import Dynamics
from flywheel.evaluation import ErrorTable, score
from flywheel.records import Episode, Floats
from flywheel.robots import load_robot
from flywheel.runtime.config.parts import DataSet
from flywheel.runtime.config.run_config import RunConfig, load_config
from flywheel.runtime.loop import run
from flywheel.runtime.pool.progress import console_progress
from flywheel.runtime.run.folder import name_of
from flywheel.runtime.run.provenance import code_version
from flywheel.runtime.workers.episode_plan import EpisodePlan
from flywheel.runtime.workers.episode_recorder import EpisodeRecorder

CONFIGS = Path(__file__).parents[1] / "configs" / "networks"
TRAINED, OTHERS = "of the training", "others around it"
DRAWN, OTHER_DRAWN = 0, 1  # seeds of the plants of the training, and of the others
PLANTS = 8
EPISODES, SECONDS, STARTS, HORIZON = 12, 15.0, 10, 2.0
# Of the episodes that are measured; no run derives them but by chance in 2^32.
FIRST_SEED = 10_000_000
# How far plants around the MJCF lie from it, at most: a factor, or one over it.
SPREAD = {
    "friction": 1.5,
    "contact_stiffness": 3.0,
    "cable_stiffness": 1.15,
    "cable_damping": 2.0,
    "winch_speed": 1.1,
    "mass": 1.1,
}


def drawn_plants(count: int, seed: int) -> tuple[PlantParameters, ...]:
    """Plants around the MJCF: a Latin hypercube on the logarithms of their factors."""
    rng = np.random.default_rng(seed)
    cube = qmc.LatinHypercube(len(SPREAD), rng=rng, optimization="random-cd").random(count)
    factors = np.exp((2 * cube - 1) * np.log(list(SPREAD.values()))).round(2)
    return tuple(PlantParameters(**dict(zip(SPREAD, row, strict=True))) for row in factors.tolist())


class Measurement:
    """Measures a network of one robot.

    Args:
      config: of the run that made it.
      episodes: for each plant.
    """

    def __init__(self, config: RunConfig, episodes: int = EPISODES) -> None:
        self.robot, self.episodes, self._config = load_robot(config.model), episodes, config
        self.groups: dict[str, tuple[PlantParameters, ...]] = {
            MJCF: (PlantParameters(),),
            TRAINED: tuple(data.plant for data in config.datasets[1:]),
            OTHERS: drawn_plants(PLANTS, OTHER_DRAWN),
        }

    def errors(self, weights: Path, plants: str, floors: bool = True) -> list[PredictionError]:
        """The errors of a network, and of the baselines, on one group of plants.

        Args:
          weights: of the network.
          plants: name of the group.
          floors: measure also the baselines.
        """
        network = LearnedDynamics(self.robot, load_weights(weights, self.robot))
        tables: dict[str, ErrorTable] = {}
        for number, plant in enumerate(self.groups[plants]):
            recorder = self._recorder(plant)
            # The network knows the plants of its training by their number.
            index = number + 1 if plants == TRAINED else 0
            episodes = self._recorded(recorder, plants, number)
            models = {NETWORK: network, **(self._floors(recorder) if floors else {})}
            for name, model in models.items():
                own = index if name == NETWORK else 0
                found = self._scored(recorder, model, episodes, own)
                tables[name] = tables[name] + found if name in tables else found
        return [
            PredictionError(
                plants=plants,
                model=name,
                e_pos=round(table.e_pos_rmse, 3),
                e_rot=round(table.e_rot, 3),
            )
            for name, table in tables.items()
        ]

    def _recorder(self, plant: PlantParameters) -> EpisodeRecorder:
        datasets = (DataSet(name="measured", plant=plant),)
        return EpisodeRecorder(self._config.model_copy(update={"datasets": datasets}), self.robot)

    def _recorded(self, recorder: EpisodeRecorder, group: str, plant: int) -> list[Episode]:
        first = FIRST_SEED + 1000 * (1 + list(self.groups).index(group)) + 100 * plant
        plans = (
            EpisodePlan(f"measured-{seed}", "random", 0, "test", SECONDS, seed)
            for seed in range(first, first + self.episodes)
        )
        return [recorder.record(plan, None, "") for plan in plans]

    def _floors(self, recorder: EpisodeRecorder) -> Mapping[str, Dynamics]:
        """Baselines of a network."""
        plant, window = recorder.plant(0), self._config.evaluate.floor_window
        given = self._recorder(PlantParameters()).plant(0)
        return {
            "the MJCF restarted": RestartedPlant(given, window, roll="relaxed"),
            "the very plant restarted": RestartedPlant(plant, window, roll="relaxed"),
            "the very plant, rods' roll random": RestartedPlant(plant, window, roll="random"),
            "nothing moves": Persistence(self.robot, plant.dt),
        }

    def _scored(
        self, recorder: EpisodeRecorder, model: Dynamics, episodes: Sequence[Episode], index: int
    ) -> ErrorTable:
        return score(
            model,
            episodes,
            horizon_seconds=HORIZON,
            starts_per_episode=STARTS,
            seed=0,
            truth=partial(_truth, recorder),
            datasets={"measured": index},
        )


def _truth(recorder: EpisodeRecorder, episode: Episode) -> Floats:
    """The points without noise."""
    states = episode.trajectory.states
    assert states is not None, "a simulated episode has states"
    return recorder.plant(0).observe(states).points


def card(opened: OpenRun, weights: Path) -> ModelCard:
    """The card of a run's champion."""
    config, champion = opened.config, opened.champion()
    measured, training = Measurement(config), config.training
    steps = training.initial.steps + champion.iteration * training.fine_tuning.steps
    episodes = opened.store.snapshot(name_of(champion.iteration, "mppi")).episodes
    seconds = sum(each.steps * config.network.dt for each in episodes if each.split == "train")
    return ModelCard(
        robot=config.model,
        digest=weights_digest(load_weights(weights, measured.robot)),
        configuration=f"networks/{config.model}.yaml",
        seed=config.seed,
        code=code_version(),
        plants=len(config.datasets),
        minutes=round(seconds / 60, 1),
        steps=steps,
        noise=config.measurement.noise,
        horizon=HORIZON,
        episodes=EPISODES,
        seconds=SECONDS,
        starts=STARTS,
        errors=tuple(
            error for group in measured.groups for error in measured.errors(weights, group)
        ),
    )


def table() -> list[str]:
    """Lines of Markdown about all shipped networks: a row for each model, a column for each group."""
    lines = []
    for name, weights in shipped_networks().items():
        made = ModelCard.read(weights)
        groups = list(dict.fromkeys(error.plants for error in made.errors))
        lines += [f"| {name}: plant | {' | '.join(groups)} |", "|---|" + "---|" * len(groups)]
        for model in dict.fromkeys(error.model for error in made.errors):
            of = {error.plants: error for error in made.errors if error.model == model}
            cells = [f"{of[group].e_pos:.1f} %, {of[group].e_rot:.1f} deg" for group in groups]
            lines.append(f"| {model} | {' | '.join(cells)} |")
        lines.append("")
    return lines[:-1]


def main() -> None:
    """Train, measure, and write."""
    parser = parser_of(__file__, __doc__)
    parser.add_argument("robot", choices=sorted(path.stem for path in CONFIGS.glob("*[0-9].yaml")))
    parser.add_argument("folder", type=Path)
    asked = parser.parse_args()
    config = load_config(CONFIGS / f"{asked.robot}.yaml")
    run(config, asked.folder, resume=True, progress=console_progress())
    opened, weights = open_run(asked.folder), FOLDER / f"{asked.robot}.npz"
    made = opened.folder.weights(opened.champion().iteration, "mppi")
    FOLDER.mkdir(exist_ok=True)
    shutil.copyfile(made, weights)
    shutil.copyfile(made.with_suffix(".json"), weights.with_suffix(".json"))
    text = yaml.safe_dump(card(opened, weights).model_dump(mode="json"), sort_keys=False)
    weights.with_suffix(".yaml").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
