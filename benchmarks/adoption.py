"""From a hidden effect to a better network: the whole loop, compared with the true effect in place
of the answer.

    python -m benchmarks.adoption OUT_FOLDER

A network is trained on a plant. Another simulator hides an effect of twice the typical size; the
plant is diagnosed with its recordings, as in a run of the flywheel, the answer is adopted, data are
simulated anew, and the network is trained further. Its improvement on further recordings, relative
to that of training with the true effect, is the share of the gap that is closed. Existing networks,
data and JSON files are reused. `python -m benchmarks.tables collect adoption OUT_FOLDER` imports
the results into benchmarks/results/.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isnan
from pathlib import Path

import numpy as np

from benchmarks.command import parser_of
from benchmarks.diagnosis.case_result import Named
from benchmarks.diagnosis.cases import Case, Plan, cases
from benchmarks.diagnosis.examiner import truth_of
from flywheel.data import SplitSource, TrajectoryStore, WindowCache
from flywheel.diagnosis import Diagnosis, diagnose
from flywheel.diagnosis.adoption import adoptable
from flywheel.diagnosis.fitting.subject import Subject
from flywheel.dynamics.gnn import LearnedDynamics, load_weights
from flywheel.dynamics.plant import Plant
from flywheel.effects import WrittenTerm
from flywheel.errors import DataError
from flywheel.evaluation import score
from flywheel.options import DiagnosisOptions
from flywheel.outputs import write_output
from flywheel.records import Episode, Floats, Provenance
from flywheel.registry import lookup
from flywheel.results import ResultRecord
from flywheel.robots import load_robot
from flywheel.runtime.config.run_config import RunConfig, load_config
from flywheel.runtime.config.shipped import config_file
from flywheel.runtime.pool.progress import Progress, console_progress
from flywheel.runtime.workers.episode_plan import Effects, collection
from flywheel.runtime.workers.episode_recorder import EpisodeRecorder
from flywheel.runtime.workers.stored_episodes import EpisodeWinches
from flywheel.runtime.workers.trainer_worker import SPLITS
from flywheel.training import Trainer, TrainingProgress
from flywheel.truth_simulator.scripts import SCRIPTS

# What a network of this size notices: of most others the change drowns in its own errors.
HIDDEN = ("slope", "weak_cable", "cable_friction")
SIZE = 2.0  # times the typical one
FURTHER = 8  # recordings that the networks are judged by, of four seconds each
SECONDS = 4.0
HORIZONS = (1.0, 0.5)  # of the predictions [s]; the first one counts
STARTS = 20  # per recording
HEADER = (
    "| hidden | seed | verdict | adopted | before | after | told the truth | closed | over 0.5 s |\n"
    "|---|---|---|---|---|---|---|---|---|"
)
NOISY = (
    "training.noise=0.003",
    "measurement.noise=0.003",
    "network.velocity_window=20",
    "network.smooth_present=true",
)


class AdoptionStudy(ResultRecord):
    """One hidden effect, one seed.

    Attributes:
      name: of the case.
      truth: hidden effect.
      verdict: of the diagnosis.
      adopted: labels of the adopted effects.
      problem: reason for no adoption, or "".
      before, after, ceiling: RMSE/L of the centre of mass over the first horizon on further
        recordings, of the initial network, trained further with the answer, and trained further
        with the truth [%].
      shorter: the same three over the second horizon [%].
      rotation: the same three in rotation, over the first horizon [deg].
    """

    name: str
    truth: tuple[Named, ...]
    verdict: str
    adopted: tuple[str, ...]
    problem: str
    before: float
    after: float
    ceiling: float
    shorter: tuple[float, float, float]
    rotation: tuple[float, float, float]

    @property
    def closed(self) -> float:
        """Share of the gap between the initial network and the one trained with the truth.

        Not a number without a gap: the truth made the network no better.
        """
        gap = self.before - self.ceiling
        return (self.before - self.after) / gap if gap > 0 else float("nan")


@dataclass(frozen=True)
class AdoptionRow:
    """A case as a row of a table.

    Attributes:
      name: of the case.
      hidden: hidden effect, in words.
      seed: of the case and of the networks.
      verdict: of the diagnosis.
      adopted: labels of the adopted effects, or the reason for none.
      before, after, ceiling: see `AdoptionStudy` [%].
      closed: share of the gap that is closed; empty without a gap.
      before_shorter, after_shorter, ceiling_shorter: errors over the second horizon [%].
      before_rotation, after_rotation, ceiling_rotation: errors in rotation, over the first horizon
        [deg].
    """

    name: str
    hidden: str
    seed: int
    verdict: str
    adopted: str
    before: float
    after: float
    ceiling: float
    closed: float
    before_shorter: float
    after_shorter: float
    ceiling_shorter: float
    before_rotation: float
    after_rotation: float
    ceiling_rotation: float


@dataclass(frozen=True)
class Bench:
    """Training of networks.

    Attributes:
      config: of data, network and training.
      folder: of all files.
      progress: display for people.
    """

    config: RunConfig
    folder: Path
    progress: Progress

    def network(self, name: str, effects: Effects, initial: Path | None = None) -> Path:
        """Weights of a network trained, or trained further, with data of a plant with effects."""
        store, robot = TrajectoryStore(self.folder / f"store-{name}"), load_robot(self.config.model)
        if "data" not in store.snapshots():
            store.seal("data", self._recorded(name, store, effects), parent=None)
        cache = self.folder / f"cache-{name}"
        snapshot = store.snapshot("data")
        winches = EpisodeWinches(robot, effects)
        train, validation = (
            WindowCache.build(
                SplitSource(store, snapshot, split, robot, winches, winches.effects_digest), cache
            )
            for split in SPLITS
        )
        training = self.config.training.model_copy(update={"seed": self.config.seed})
        place = self.folder / f"network-{name}"
        trainer = Trainer(training, self.config.network, robot, train, validation, place, initial)
        with self.progress.stage(f"{name}: train", 1.0) as stage:

            def shown(now: TrainingProgress) -> None:
                stage.update(now.point.step / now.steps, f"loss {now.point.loss:.3g}")

            return trainer.run(shown).weights

    def subject(self, weights: Path) -> Subject:
        """A network, to be diagnosed or scored."""
        robot = load_robot(self.config.model)
        return Subject("network", LearnedDynamics(robot, load_weights(weights, robot), threads=1))

    def _recorded(self, name: str, store: TrajectoryStore, effects: Effects) -> list[str]:
        """Ids of the episodes of iteration 0 on a plant with effects."""
        recorder = EpisodeRecorder(self.config, load_robot(self.config.model))
        plans, there = collection(self.config, 0, "mppi", effects), store.committed()
        with self.progress.stage(f"{name}: collect", float(len(plans))) as stage:
            for number, plan in enumerate(plans):
                if plan.id not in there:
                    store.commit(plan.id, [recorder.record(plan, None, "")])
                stage.update(number + 1.0)
        return [plan.id for plan in plans]


def study(bench: Bench, case: Case) -> AdoptionStudy:
    """One case, from the first network to the last."""
    robot, seed = load_robot(case.robot), bench.config.seed
    recorded = case.record(robot)
    truth = tuple(truth_of(each) for each in recorded.held_out.effects)
    first = bench.network(f"plain-s{seed}", ())
    found = diagnose(
        Plant(robot, case.measurement.dt),
        [each.trajectory for each in recorded.fit],
        [recorded.held_out.trajectory],
        options=DiagnosisOptions(seed=seed),
    )
    effects, problem = _answer(found)
    true = tuple(_written(each) for each in truth)
    after = bench.network(f"{case.name}-found", effects, first) if effects else first
    ceiling = bench.network(f"{case.name}-true", true, first)
    further, exact = _further(case)
    first_tables, second_tables = (
        [
            score(
                bench.subject(weights).dynamics,
                further,
                horizon_seconds=horizon,
                starts_per_episode=STARTS,
                seed=seed,
                truth=lambda episode: exact[episode.id],
                winches=EpisodeWinches(robot, told),
            )
            for weights, told in ((first, ()), (after, effects), (ceiling, true))
        ]
        for horizon in HORIZONS
    )
    errors = [table.e_pos_rmse for table in first_tables]
    shorter = [table.e_pos_rmse for table in second_tables]
    return AdoptionStudy(
        name=case.name,
        truth=truth,
        verdict=str(found.verdict),
        adopted=tuple(effect.label for effect in effects),
        problem=problem,
        before=errors[0],
        after=errors[1],
        ceiling=errors[2],
        shorter=(shorter[0], shorter[1], shorter[2]),
        rotation=(first_tables[0].e_rot, first_tables[1].e_rot, first_tables[2].e_rot),
    )


def _answer(found: Diagnosis) -> tuple[Effects, str]:
    """The adopted effects; of several equally good answers the first."""
    try:
        return adoptable(found.summary(), None if len(found.answers) == 1 else 1), ""
    except DataError as error:
        return (), str(error)


def _written(truth: Named) -> WrittenTerm:
    return WrittenTerm(effect=truth.effect, location=truth.location, parameters=truth.values)


def _further(case: Case) -> tuple[list[Episode], dict[str, Floats]]:
    """Recordings of the same robot for the evaluation, and the true points."""
    robot, rng = load_robot(case.robot), np.random.default_rng(case.held_out.seed)
    scripts = itertools.islice(itertools.cycle(SCRIPTS), FURTHER)
    plans = tuple(Plan(script, int(rng.integers(2**31)), SECONDS) for script in scripts)
    about = Provenance(robot.digest, source="recording", dataset="recording")
    episodes, exact = [], {}
    for number, made in enumerate(replace(case, fit=plans).record(robot).fit):
        name = f"further-{number}"
        episodes.append(Episode(name, made.trajectory, about, "test"))
        exact[name] = made.true_points
    return episodes, exact


def row_of(result: AdoptionStudy) -> AdoptionRow:
    """The row of a case."""
    truth = "; ".join(
        f"{each.effect} {', '.join(f'{value:.3g}' for value in each.values.values())}"
        for each in result.truth
    )
    return AdoptionRow(
        name=result.name,
        hidden=truth,
        seed=int(result.name.rpartition(".s")[2]),
        verdict=result.verdict,
        adopted=", ".join(result.adopted) or result.problem,
        before=result.before,
        after=result.after,
        ceiling=result.ceiling,
        closed=result.closed,
        before_shorter=result.shorter[0],
        after_shorter=result.shorter[1],
        ceiling_shorter=result.shorter[2],
        before_rotation=result.rotation[0],
        after_rotation=result.rotation[1],
        ceiling_rotation=result.rotation[2],
    )


def line(row: AdoptionRow) -> str:
    """A row of the table in Markdown."""
    closed = "no gap" if isnan(row.closed) else f"{row.closed:.0%}"
    shorter = (row.before_shorter, row.after_shorter, row.ceiling_shorter)
    return (
        f"| {row.hidden} | s{row.seed} | {row.verdict} | {row.adopted} | {row.before:.2f} | "
        f"{row.after:.2f} | {row.ceiling:.2f} | {closed} | {', '.join(f'{e:.2f}' for e in shorter)} |"
    )


def table(rows: Sequence[AdoptionRow]) -> list[str]:
    """Lines of Markdown: the cases with the usual hidden effects, by seed."""
    usual = [row for name in HIDDEN for row in rows if row.hidden.startswith(name)]
    return [HEADER, *map(line, sorted(usual, key=lambda row: row.seed))]


def wanted(hidden: Sequence[str], seeds: Sequence[int]) -> list[tuple[int, Case]]:
    """The cases, each with its seed."""
    found = []
    for seed in seeds:
        known = {
            case.effects[0].name: case
            for case in cases(load_robot("prism3"), ["single"], [SIZE], [seed])
        }
        found += [(seed, lookup(known, name, "hidden effect")) for name in hidden]
    return found


def main() -> None:
    """Study the cases that the folder has no result of yet, and print the table of all."""
    parser = parser_of(__file__, __doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--hidden", nargs="*", default=HIDDEN, help="effects to hide")
    parser.add_argument("--seeds", type=int, nargs="*", default=[0, 1, 2])
    parser.add_argument("--set", nargs="*", default=[], help="key=value of the configuration")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    print(HEADER)
    for seed, case in wanted(given.hidden, given.seeds):
        file = given.folder / f"{case.name}.json"
        if not file.exists():
            overrides = [*NOISY, f"seed={seed}", *given.set]
            config = load_config(config_file("prism3"), overrides)
            result = study(Bench(config, given.folder, console_progress()), case)
            write_output(file, result.model_dump_json(indent=1) + "\n")
        print(line(row_of(AdoptionStudy.model_validate_json(file.read_text()))), flush=True)


if __name__ == "__main__":
    main()
