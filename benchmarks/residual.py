"""Errors of a plant, and of the plant with a correcting network, by minutes on the robot.

    python -m benchmarks.residual OUT_FOLDER

prism3 is its own stand-in in the truth simulator, with hidden effects, noise of 0.3 % of its
length, and unmeasured winches. Episodes of ten seconds correspond to those of a robot. The plant is
the unchanged MJCF. The network learns from the first minutes; all models are evaluated on other
episodes, half of them with kinds of commands absent from the training, against the true points. The
floor is the plant's error on a robot without hidden effects under the same commands and the same
noise.

Recordings and results are kept in the folder: existing ones are reused. `python -m
benchmarks.tables collect residual OUT_FOLDER` imports the results into benchmarks/results/.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.command import parser_of
from flywheel.data import SplitSource, TrajectoryStore, WindowCache
from flywheel.dynamics.gnn import LearnedDynamics, load_weights
from flywheel.dynamics.plant import Plant, RestartedPlant
from flywheel.dynamics.protocol import Dynamics
from flywheel.dynamics.residual import ResidualWeights
from flywheel.evaluation import ErrorTable, past_at
from flywheel.evaluation.intervals import Interval, rmse_ratio_interval
from flywheel.evaluation.pasts import stacked
from flywheel.outputs import write_output
from flywheel.records import Episode, Floats, Observation, Provenance, Split, Trajectory
from flywheel.registry import lookup
from flywheel.results import ResultRecord
from flywheel.robots import Robot, load_robot
from flywheel.runtime.config.run_config import RunConfig, load_config
from flywheel.runtime.config.shipped import config_file
from flywheel.runtime.pool.progress import Progress, console_progress
from flywheel.training import Trainer, TrainingProgress
from flywheel.training.residual import ResidualTraining, train_residual
from flywheel.truth_simulator.measurement import Measurement
from flywheel.truth_simulator.recording import record
from flywheel.truth_simulator.written import hidden_effects

ROBOT, DT, NOISE = "prism3", 0.01, 0.003
SETS = {
    "library": ("torque_speed", "cable_friction", "payload"),
    "cogging": ("cogging",),
    "rod_flex": ("rod_flex:2",),
    "nothing": (),
}
LEARNED = ("random_steps", "slow_sine", "gait")  # kinds of commands to learn from
JUDGED = ("random_steps", "gait", "fast_sine", "pretension")  # and to judge by
SECONDS = 10.0  # of an episode
FURTHER = 12  # episodes to judge by
APART, EARLIEST = 0.5, 1.2  # between presents, and the first one [s]
NO_GAP = 0.02  # above the floor, as a share of it, below which nothing is there to be closed
HORIZONS = (1.0, 2.0)  # of the predictions [s]
NETWORK_NOISE = (  # what suits a network that learns from noisy points
    "training.noise=0.0",
    "network.velocity_window=20",
    "network.smooth_present=true",
)
HEADER = (
    "| hidden | minutes | seed | floor | plant | corrected | network | gap closed | over 1 s | RMSE over the "
    "plant's | "
    "share | training [CPU s] |\n|---|---|---|---|---|---|---|---|---|---|---|---|"
)


class Errors(ResultRecord):
    """Errors of one model on the evaluation episodes; pairs are of the two horizons.

    Attributes:
      mean: of the windows' RMSE / L of the tracked points [%].
      rmse: RMSE / L of the bodies' centres of mass over all windows together [%].
      rotation: [deg].
      squares: mean squared errors of the points of each episode, over the second horizon [m^2].
      other: `mean` on the kinds of commands absent from the training, over the second horizon [%].
    """

    mean: tuple[float, float]
    rmse: tuple[float, float]
    rotation: tuple[float, float]
    squares: tuple[float, ...]
    other: float


class ResidualStudy(ResultRecord):
    """One set of hidden effects, one seed, so many minutes on the robot.

    Attributes:
      hidden: name of the set.
      minutes: on the robot.
      seed: of commands, noise and training.
      floor, plant, corrected: errors.
      network: errors of a network trained on the same recordings alone; None if not requested.
      share: applied fraction of the correction.
      seconds: of one core, for the training of the correction.
      network_seconds: likewise, for that of the network.
    """

    hidden: str
    minutes: float
    seed: int
    floor: Errors
    plant: Errors
    corrected: Errors
    network: Errors | None = None
    share: float
    seconds: float
    network_seconds: float = 0.0


@dataclass(frozen=True)
class ResidualRow:
    """A study as a row of a table; errors are means of the windows' RMSE / L [%].

    Attributes:
      hidden, minutes, seed, share, seconds: as in `ResidualStudy`.
      floor, plant, corrected, network: over the second horizon; empty without a network.
      floor_1s, plant_1s, corrected_1s: over the first one.
      floor_rmse, plant_rmse, corrected_rmse: of centres of mass, over all windows together and the second
        horizon.
      plant_rotation, corrected_rotation: over the second horizon [deg].
      plant_other, corrected_other: on the other kinds of commands.
      ratio, low, high: of the corrected plant's RMSE to the plant's, with its interval over episodes.
    """

    hidden: str
    minutes: float
    seed: int
    floor: float
    plant: float
    corrected: float
    network: float
    floor_1s: float
    plant_1s: float
    corrected_1s: float
    floor_rmse: float
    plant_rmse: float
    corrected_rmse: float
    plant_rotation: float
    corrected_rotation: float
    plant_other: float
    corrected_other: float
    ratio: float
    low: float
    high: float
    share: float
    seconds: float

    @property
    def closed(self) -> float:
        """Share of the plant's error above the floor that is removed, over the second horizon."""
        return closed(self.plant, self.corrected, self.floor)

    @property
    def closed_1s(self) -> float:
        """The same over the first one."""
        return closed(self.plant_1s, self.corrected_1s, self.floor_1s)


@dataclass(frozen=True)
class Recorded:
    """A measured episode, and the true points (T + 1, P, 3) [m]."""

    trajectory: Trajectory
    points: Floats


@dataclass(frozen=True)
class Bench:
    """Storage of recordings and results.

    Attributes:
      folder: of them.
      robot: its own stand-in.
      progress: display for people.
      training: of the correction.
    """

    folder: Path
    robot: Robot
    progress: Progress
    training: ResidualTraining = field(default_factory=ResidualTraining)

    def learned(self, hidden: str, seed: int, minutes: float) -> list[Recorded]:
        """Training episodes; more minutes begin with the same ones."""
        count = max(1, round(60.0 * minutes / SECONDS))
        return self._episodes(hidden, seed, "learned", LEARNED, count)

    def judged(self, hidden: str, seed: int) -> list[Recorded]:
        """Evaluation episodes."""
        return self._episodes(hidden, seed, "judged", JUDGED, FURTHER)

    def _episodes(
        self, hidden: str, seed: int, use: str, scripts: Sequence[str], count: int
    ) -> list[Recorded]:
        found, first = [], 10_000 * (seed + 1) + (5_000 if use == "judged" else 0)
        with self.progress.stage(f"{hidden} s{seed}: record", float(count)) as stage:
            for number, script in enumerate(itertools.islice(itertools.cycle(scripts), count)):
                file = self.folder / f"{hidden}-s{seed}-{use}-{number:03}.npz"
                if not file.exists():
                    self._record(file, hidden, script, first + number)
                with np.load(file) as kept:
                    blind = np.full((len(kept["points"]), len(self.robot.winches)), np.nan)
                    seen = Observation(kept["points"], blind)
                    found.append(Recorded(Trajectory(seen, kept["controls"], DT), kept["truth"]))
                stage.update(number + 1.0)
        return found

    def _record(self, file: Path, hidden: str, script: str, seed: int) -> None:
        effects = hidden_effects(lookup(SETS, hidden, "set of hidden effects"), self.robot)
        made = record(
            self.robot,
            effects,
            script_name=script,
            seconds=SECONDS,
            seed=seed,
            measurement=Measurement(dt=DT, noise=NOISE),
        )
        draft = file.with_suffix(".draft.npz")
        np.savez(draft, controls=made.controls, points=made.points, truth=made.true_points)
        draft.replace(file)

    def errors(self, model: Dynamics, episodes: Sequence[Recorded]) -> Errors:
        """Errors of a model's predictions against the true points."""
        robot, steps = self.robot, [round(seconds / DT) for seconds in HORIZONS]
        tables = [ErrorTable.empty(robot, DT) for _ in steps]
        windows: list[list[Floats]] = [[], []]
        squares, other = [], []
        for number, each in enumerate(episodes):
            points, truth = predicted(model, robot, each, max(steps))
            for i, count in enumerate(steps):
                part = (truth[:, :count], points[:, :count])
                tables[i] = tables[i] + ErrorTable.between(robot, DT, *part)
                off = ((part[1] - part[0]) ** 2).sum(-1).mean((1, 2))
                windows[i].append(100.0 * np.sqrt(off) / robot.length)
            squares.append(float(((points - truth) ** 2).sum(-1).mean()))
            if JUDGED[number % len(JUDGED)] not in LEARNED:
                other.append(windows[-1][-1])
        means = [float(np.concatenate(w).mean()) for w in windows]
        return Errors(
            mean=(means[0], means[1]),
            rmse=(tables[0].e_pos_rmse, tables[1].e_pos_rmse),
            rotation=(tables[0].e_rot, tables[1].e_rot),
            squares=tuple(squares),
            other=float(np.concatenate(other).mean()),
        )


def predicted(
    model: Dynamics, robot: Robot, episode: Recorded, steps: int
) -> tuple[Floats, Floats]:
    """Predicted and true points (B, steps, P, 3) [m] from presents of one episode."""
    about = Provenance(robot.digest, source="recording", dataset="recording")
    track = episode.trajectory
    known = Episode("judged", track, about, "test")
    winch = robot.known_winch(track.observations.winch, track.controls, DT)
    at = np.arange(round(EARLIEST / DT), track.steps - steps + 1, round(APART / DT))
    past = stacked([past_at(known, robot, int(s), model.history, winch) for s in at])
    controls = np.stack([track.controls[s : s + steps] for s in at])
    truth = np.stack([episode.points[s + 1 : s + steps + 1] for s in at])
    return model.rollout(past, controls).points[:, 1:], truth


def study(
    bench: Bench, hidden: str, seed: int, minutes: float, config: RunConfig | None
) -> ResidualStudy:
    """One set of hidden effects, one seed, one duration; with a network if there is a config of one."""
    learned = [each.trajectory for each in bench.learned(hidden, seed, minutes)]
    judged, plain = bench.judged(hidden, seed), bench.judged("nothing", seed)
    plant = RestartedPlant.from_measurements(Plant(bench.robot, DT))
    name = f"{hidden}-s{seed}-{minutes:g}min"
    begun = time.process_time()
    with bench.progress.stage(f"{name}: correct", 1.0) as stage:
        training = bench.training.model_copy(update={"seed": seed})
        found = train_residual(plant, learned, training=training, say=stage.update)
    seconds = time.process_time() - begun
    ResidualWeights.of(found.model).write(bench.folder / f"{name}.model.npz", found.notes())
    network, network_seconds = None, 0.0
    if config is not None:
        seeded = config.training.model_copy(update={"seed": seed})
        config = config.model_copy(update={"training": seeded})
        weights, network_seconds = network_of(bench, name, learned, config)
        network = bench.errors(weights, judged)
    return ResidualStudy(
        hidden=hidden,
        minutes=minutes,
        seed=seed,
        floor=bench.errors(plant, plain),
        plant=bench.errors(plant, judged),
        corrected=bench.errors(found.model, judged),
        network=network,
        share=found.model.share,
        seconds=seconds,
        network_seconds=network_seconds,
    )


def network_of(
    bench: Bench, name: str, tracks: Sequence[Trajectory], config: RunConfig
) -> tuple[LearnedDynamics, float]:
    """The fully learned network, trained on the same recordings alone, and the seconds of one core."""
    robot, store = bench.robot, TrajectoryStore(bench.folder / f"{name}-store")
    about = Provenance(robot.digest, source="recording", dataset="recording")
    ids, there = [], store.committed()
    for number, track in enumerate(tracks):
        ids.append(f"{name}-{number:03}".lower())
        if ids[-1] not in there:
            split: Split = "validation" if number % 5 == 4 else "train"
            store.commit(ids[-1], [Episode(ids[-1], track, about, split)])
    if "data" not in store.snapshots():
        store.seal("data", ids, parent=None)
    train, validation = (
        WindowCache.build(
            SplitSource(store, store.snapshot("data"), split, robot), bench.folder / f"{name}-cache"
        )
        for split in ("train", "validation")
    )
    folder = bench.folder / f"{name}-network"
    trainer = Trainer(config.training, config.network, robot, train, validation, folder)
    begun = time.process_time()
    with bench.progress.stage(f"{name}: network", 1.0) as stage:

        def shown(now: TrainingProgress) -> None:
            stage.update(now.point.step / now.steps, f"loss {now.point.loss:.3g}")

        weights = trainer.run(shown).weights
    seconds = time.process_time() - begun
    return LearnedDynamics(robot, load_weights(weights, robot)), seconds


def closed(plant: float, corrected: float, floor: float) -> float:
    """Share of a gap above the floor that is removed; NaN without a gap."""
    return (plant - corrected) / (plant - floor) if plant - floor > NO_GAP * floor else np.nan


def row_of(found: ResidualStudy) -> ResidualRow:
    """The row of a study."""
    floor, plant, corrected = found.floor, found.plant, found.corrected
    ratio = paired(found)
    return ResidualRow(
        hidden=found.hidden,
        minutes=found.minutes,
        seed=found.seed,
        floor=floor.mean[1],
        plant=plant.mean[1],
        corrected=corrected.mean[1],
        network=np.nan if found.network is None else found.network.mean[1],
        floor_1s=floor.mean[0],
        plant_1s=plant.mean[0],
        corrected_1s=corrected.mean[0],
        floor_rmse=floor.rmse[1],
        plant_rmse=plant.rmse[1],
        corrected_rmse=corrected.rmse[1],
        plant_rotation=plant.rotation[1],
        corrected_rotation=corrected.rotation[1],
        plant_other=plant.other,
        corrected_other=corrected.other,
        ratio=ratio.value,
        low=ratio.low,
        high=ratio.high,
        share=found.share,
        seconds=found.seconds,
    )


def paired(found: ResidualStudy) -> Interval:
    """The corrected plant's RMSE over the plant's, and its interval over episodes."""
    return rmse_ratio_interval(
        np.array(found.corrected.squares), np.array(found.plant.squares), found.seed
    )


def line(row: ResidualRow) -> str:
    """A row of the table in Markdown."""
    gone, gone_1s = (
        "no gap" if np.isnan(share) else f"{share:.0%}" for share in (row.closed, row.closed_1s)
    )
    network = "-" if np.isnan(row.network) else f"{row.network:.2f}"
    return (
        f"| {row.hidden} | {row.minutes:g} | {row.seed} | {row.floor:.2f} | {row.plant:.2f} | "
        f"{row.corrected:.2f} | {network} | {gone} | {gone_1s} | {row.low:.0%} to {row.high:.0%} | "
        f"{row.share:.0%} | {row.seconds:.0f} |"
    )


def table(rows: Sequence[ResidualRow]) -> list[str]:
    """Lines of Markdown."""
    places = list(SETS)
    ordered = sorted(rows, key=lambda row: (places.index(row.hidden), row.seed, row.minutes))
    return [HEADER, *map(line, ordered)]


def main() -> None:
    """Complete the missing studies of the folder, and print the table of all."""
    parser = parser_of(__file__, __doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--hidden", nargs="*", default=list(SETS), choices=SETS)
    parser.add_argument("--minutes", type=float, nargs="*", default=[1.0, 3.0, 10.0, 30.0])
    parser.add_argument("--seeds", type=int, nargs="*", default=[0, 1, 2])
    parser.add_argument("--network", action="store_true", help="train the network beside it; slow")
    parser.add_argument("--set", nargs="*", default=[], help="key=value of the network's run")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    bench = Bench(given.folder, load_robot(ROBOT), console_progress())
    print(HEADER)
    for seed, minutes, hidden in itertools.product(given.seeds, given.minutes, given.hidden):
        file = given.folder / f"{hidden}-s{seed}-{minutes:g}min.json"
        if not file.exists():
            overrides = [*NETWORK_NOISE, *given.set]
            config = load_config(config_file(ROBOT), overrides) if given.network else None
            result = study(bench, hidden, seed, minutes, config)
            write_output(file, result.model_dump_json(indent=1) + "\n")
        print(line(row_of(ResidualStudy.model_validate_json(file.read_text()))), flush=True)


if __name__ == "__main__":
    main()
