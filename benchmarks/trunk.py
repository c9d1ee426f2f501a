"""A real trunk: three discs that six motors bend, as predicted by a network and by simpler models.

    git clone https://github.com/StanfordASL/trunk-stack CHECKOUT
    python -m benchmarks.trunk CHECKOUT/stack/main/data/trajectories/dynamic/servo_motor_archive FOLDER
    python -m benchmarks.tables              makes the table of docs/results/trunk.md
    python -m benchmarks.trunk ARCHIVE FOLDER --logs        writes trunk.xml, and three logs for a diagnosis

The log (MIT licence) has the angles that the motors were told and those that they had, and the centres of
three discs, at 100 Hz for 150 s. The MJCF is crude: a disc is a mass at its centre, the backbone three
springs that pull, and each motor winds one straight cable to a disc and pays out its antagonist. Masses and
stiffness are guesses; where cables end, and how far a motor moves its disc, is fitted to the first minutes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.command import parser_of
from benchmarks.rows import RESULTS, grouped, write_rows
from flywheel.data import SplitSource, TrajectoryStore, WindowCache
from flywheel.data.recordings import write_recording
from flywheel.dynamics.baselines.named import BASELINES
from flywheel.dynamics.baselines.weights import FITTED
from flywheel.dynamics.gnn import LearnedDynamics, NetworkConfig, load_weights
from flywheel.dynamics.plant import Plant, RestartedPlant
from flywheel.dynamics.protocol import Dynamics
from flywheel.evaluation import score
from flywheel.evaluation.pasts import past_at
from flywheel.outputs import write_output
from flywheel.records import RECORDING, Episode, Floats, Observation, Provenance, Split, Trajectory
from flywheel.reports.pictures import as_file
from flywheel.robots import GRAVITY, Robot, read_robot
from flywheel.training import Trainer, TrainingConfig
from flywheel.training.baselines import fit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TRUNK_CSV = RESULTS / "trunk.csv"
TIP = Path(__file__).parents[1] / "docs" / "results" / "trunk" / "tip.svg"
DT = 0.01  # of the log [s]
MOVED = (1, 2, 0, 2, 0, 1)  # disc that each motor moves alone: it and those below follow
LIMITS = np.radians([50, 80, 30, 80, 30, 50])  # of the motors' angles
RING = 0.05  # radius of the cables' upper ends [m]
MASS, STIFFNESS, DAMPING = 0.1, 200.0, 2.0  # of a disc [kg], of a cable [N/m, N s/m]
SPINE, SPINE_DAMPING = 2000.0, 5.0  # of the backbone's springs [N/m, N s/m]
PULLED = 0.01  # by which cables are stretched at rest [m]
LAG = 0.15  # of the motors [s]
LEARNED, TESTED = range(50, 12_000), range(12_050, 15_000)  # rows of the log
DAYS, DAY = {"monday": 2000, "tuesday": 6000, "friday": 12_500}, 301  # logs of the diagnosis [rows]
LONG = {"learned": 1000, "tested": 700}  # of an episode [rows]
VALIDATED = (3, 8)  # episodes of the learned rows that only decide which step is kept
SPLITS: tuple[Split, ...] = ("train", "validation")
HORIZONS = (0.5, 1.0, 2.0)  # [s]
STARTS = 50  # in each tested episode
BEGUN, SHOWN = 50, 6.0  # of the prediction in the figure [rows, s]
HISTORY, NOISE = 40, 0.003  # of a network: commands shown [rows], added to the past in training [L]


@dataclass(frozen=True)
class TrunkRow:
    """Errors of one model.

    Attributes:
      model: its name.
      seed: of its training.
      steps: of its training, 0 without one.
      cpu: of its training or fit [s].
      half, one, two: RMSE of the discs' centres over 0.5, 1 and 2 s [mm].
    """

    model: str
    seed: int
    steps: int
    cpu: float
    half: float
    one: float
    two: float


@dataclass(frozen=True)
class TrunkLog:
    """Motion of the trunk.

    Attributes:
      told: (S, 6) commanded angles, each from one row of `had` to the next [rad].
      had: (S + 1, 6) measured angles [rad].
      discs: (S + 1, 3, 3) centres of the discs, z up [m].
      rest: (3, 3) those without a command [m].
    """

    told: Floats
    had: Floats
    discs: Floats
    rest: Floats

    @classmethod
    def read(cls, archive: Path) -> TrunkLog:
        """The longest log, without a load."""

        def table(name: str) -> Floats:
            found = np.loadtxt(archive / f"{name}.csv", delimiter=",", skiprows=1)[:, 1:]
            return np.asarray(found, dtype=np.float64)

        def upright(columns: Floats) -> Floats:
            x, y, z = np.moveaxis(columns.reshape(-1, 3, 3), 2, 0)
            return np.stack([x, -z, y], axis=2)

        seen, still = table("observations_controlled_1"), table("observations_zeros_0g")
        told = np.radians(table("control_inputs_controlled_1"))
        rest = upright(still[:, :9]).mean(axis=0)
        return cls(told, np.radians(seen[:, 9:]), upright(seen[:, :9]), rest)

    def pulls(self) -> Floats:
        """(6, 2) horizontal motion of each motor's disc per angle [m/rad], by regression."""
        rows = slice(LEARNED.start, LEARNED.stop)
        shown = np.c_[self.had[rows], np.ones(len(LEARNED))]
        found = np.linalg.lstsq(shown, self.discs[rows].reshape(len(shown), -1), rcond=None)[0]
        return np.asarray(found[:6].reshape(6, 3, 3)[range(6), MOVED, :2])


@dataclass(frozen=True)
class Trunk:
    """Geometry of the robot.

    Attributes:
      rest: (3, 3) centres of the discs at rest [m].
      pulls: (6, 2) horizontal motion of each motor's disc per angle [m/rad].
    """

    rest: Floats
    pulls: Floats

    @property
    def top(self) -> Floats:
        """(3,) upper end of the backbone [m]."""
        return self.rest[0] * [1, 1, 0]

    @property
    def ends(self) -> Floats:
        """(6, 2, 3) upper ends of each motor's cable and of its antagonist [m]."""
        towards = self.pulls / np.linalg.norm(self.pulls, axis=1, keepdims=True)
        out = RING * np.pad(towards, [(0, 0), (0, 1)])
        return np.stack([self.top + out, self.top - out], axis=1)

    @property
    def lengths(self) -> Floats:
        """(6, 2) of the cables at rest [m]."""
        return np.asarray(np.linalg.norm(self.rest[list(MOVED)][:, None] - self.ends, axis=2))

    @property
    def drums(self) -> Floats:
        """(6,) length of cable that a motor winds per angle [m/rad]."""
        return np.linalg.norm(self.pulls, axis=1) * RING / self.lengths[:, 0]

    def positions(self, angles: Floats) -> Floats:
        """(..., 6) rest lengths of the motors' cables at angles (..., 6) [m]."""
        return np.asarray(self.lengths[:, 0] - PULLED - self.drums * angles)

    def mjcf(self) -> str:
        """The MJCF of the trunk."""
        bodies, spine, sites, cables, winches, pairs, seen = [], [], [], [], [], [], []
        above, upper = ["top", "c1", "c2"], [self.top, *self.rest[:2]]
        for k, (here, over) in enumerate(zip(self.rest, upper, strict=True)):
            bodies.append(
                f'<body name="disc_{k + 1}" pos="{_numbers(here)}"><freejoint name="disc_{k + 1}"/>'
                f'<geom type="sphere" size="0.02" mass="{MASS}" contype="0" conaffinity="0"/>'
                f'<site name="c{k + 1}"/></body>'
            )
            rest = np.linalg.norm(here - over) - (3 - k) * MASS * GRAVITY / SPINE
            spine.append(
                f'<spatial name="spine_{k + 1}" stiffness="{SPINE}" damping="{SPINE_DAMPING}" '
                f'springlength="0 {rest:.17g}"><site site="{above[k]}"/><site site="c{k + 1}"/></spatial>'
            )
            seen.append(f'<framepos name="p{k + 1}" objtype="site" objname="c{k + 1}"/>')
        motor = (
            f'dyntype="filterexact" dynprm="{LAG}" gainprm="{STIFFNESS}" biastype="affine" '
            f'biasprm="0 -{STIFFNESS} -{DAMPING}" forcerange="-100 0"'
        )
        for k, disc in enumerate(MOVED):
            for side, end, length in zip("ab", self.ends[k], self.lengths[k], strict=True):
                name, rest, way = f"{k + 1}{side}", length - PULLED, self.drums[k] * LIMITS[k]
                sites.append(f'<site name="w{name}" pos="{_numbers(end)}"/>')
                cables.append(
                    f'<spatial name="cable_{name}"><site site="w{name}"/><site site="c{disc + 1}"/></spatial>'
                )
                winches.append(
                    f'<general name="motor_{name}" tendon="cable_{name}" {motor} '
                    f'ctrlrange="{rest - way:.17g} {rest + way:.17g}"/>'
                )
            pairs.append(
                f'<tuple name="motor_{k + 1}"><element objtype="actuator" objname="motor_{k + 1}a" prm="1"/>'
                f'<element objtype="actuator" objname="motor_{k + 1}b" prm="-1"/></tuple>'
            )
            seen.append(
                f'<user name="angle_{k + 1}" objtype="actuator" objname="motor_{k + 1}a" dim="1"/>'
            )
        act = _numbers((self.lengths - PULLED).ravel())
        begin = " ".join(f"{_numbers(here)} 1 0 0 0" for here in self.rest)
        parts = [
            '<mujoco model="trunk"><option timestep="0.005" integrator="implicitfast"/><worldbody>',
            f'<site name="top" pos="{_numbers(self.top)}"/>',
            *(*sites, *bodies, "</worldbody><tendon>", *spine, *cables, "</tendon><actuator>"),
            *(*winches, "</actuator><custom>", *pairs, "</custom><sensor>", *seen, "</sensor>"),
            f'<keyframe><key name="start" qpos="{begin}" act="{act}" ctrl="{act}"/></keyframe></mujoco>',
        ]
        return "\n".join(parts) + "\n"

    def episodes(self, log: TrunkLog, robot: Robot, rows: range, length: int) -> list[Episode]:
        """Parts of a log of at most a length [rows], each with its split."""
        found = []
        for number, first in enumerate(range(rows.start, rows.stop - length // 2, length)):
            last = min(first + length, rows.stop - 1)
            seen = Observation(
                log.discs[first : last + 1], self.positions(log.had[first : last + 1])
            )
            track = Trajectory(seen, self.positions(log.told[first:last]), DT)
            learned: Split = "validation" if number in VALIDATED else "train"
            split = learned if first in LEARNED else "test"
            made = Provenance(robot.digest, source="recording", dataset=RECORDING)
            found.append(Episode(f"rows-{first}-{last}", track, made, split))
        return found


def _numbers(values: Floats) -> str:
    return " ".join(f"{value:.17g}" for value in values)


def errors(model: Dynamics, tested: Sequence[Episode]) -> tuple[float, float, float]:
    """RMSE of the discs' centres over each horizon [mm]."""
    scored = (
        score(model, tested, horizon_seconds=seconds, starts_per_episode=STARTS, seed=0)
        for seconds in HORIZONS
    )
    half, one, two = (10.0 * model.robot.length * each.e_pos_rmse for each in scored)
    return half, one, two


def trained(
    robot: Robot, learned: Sequence[Episode], folder: Path, steps: int, seed: int
) -> Dynamics:
    """A network that learned from episodes.

    It is shown the last 0.4 s of commands, as motors are 0.22 s late, and no loads: the masses are guesses.
    The noise that is added to what it is shown keeps its own small errors from growing.
    """
    store = TrajectoryStore(str(folder / "store"))
    store.commit("log", learned)
    snapshot = store.seal("log", ["log"])
    train, validation = (
        WindowCache.build(SplitSource(store, snapshot, split, robot), folder / "cache")
        for split in SPLITS
    )
    usual = TrainingConfig(seed=seed, noise=NOISE)
    schedule = usual.initial.model_copy(update={"steps": steps})
    config = usual.model_copy(update={"initial": schedule})
    shape = NetworkConfig.lean(control_history=HISTORY, winch="learned", load_features=False)
    place = folder / f"network-{steps}-{seed}"
    weights = Trainer(config, shape, robot, train, validation, place).run().weights
    return LearnedDynamics(robot, load_weights(weights, robot))


def table(rows: Sequence[TrunkRow]) -> list[str]:
    """Lines of Markdown: a row for each model, with all its seeds."""
    lines = ["| model | training [CPU s] | 0.5 s | 1 s | 2 s |", "|---" * 5 + "|"]
    for (model,), seeds in grouped(rows, "model").items():
        cells = (
            ", ".join(f"{getattr(row, name):.1f}" for row in seeds)
            for name in ("cpu", "half", "one", "two")
        )
        lines.append(f"| {model} | {' | '.join(cells)} |")
    return lines


def figure(models: Mapping[str, Dynamics], tested: Episode) -> Figure:
    """The tip in one prediction: its path from above, measured and predicted, and its errors."""
    from matplotlib.figure import Figure

    from flywheel.reports import style

    track, steps = tested.trajectory, round(SHOWN / DT)
    drawn = Figure(figsize=(7.4, 3.2))
    above, later = drawn.subplots(1, 2)
    tip = 1e3 * track.observations.points[BEGUN : BEGUN + steps + 1, -1]
    above.plot(*tip[:, :2].T, color=style.INK, label="measured")
    for (name, model), colour in zip(models.items(), (style.MPPI, style.ORACLE), strict=False):
        winch = model.robot.winches_of(tested)
        past = past_at(tested, model.robot, BEGUN, model.history, winch)
        found = model.rollout(past, track.controls[None, BEGUN : BEGUN + steps])
        way = 1e3 * found.points[0, :, -1]
        above.plot(*way[:, :2].T, color=colour, label=name)
        later.plot(DT * np.arange(steps + 1), np.linalg.norm(way - tip, axis=1), color=colour)
    above.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    later.set(xlabel="time [s]", ylabel="error of the tip [mm]")
    drawn.legend(*above.get_legend_handles_labels(), loc="outside upper left", ncols=3)
    return drawn


def main() -> None:
    """Write the robot, train, fit and measure the models, and write the CSV and the figure."""
    parser = parser_of(__file__, __doc__)
    parser.add_argument("archive", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--logs", action="store_true")
    parser.add_argument("--steps", type=int, default=700)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    given = parser.parse_args()
    log = TrunkLog.read(given.archive)
    trunk = Trunk(log.rest, log.pulls())
    write_output(given.folder / "trunk.xml", trunk.mjcf())
    robot = read_robot(trunk.mjcf())
    if given.logs:
        for day, first in DAYS.items():
            (part,) = trunk.episodes(log, robot, range(first, first + DAY), DAY)
            write_recording(part, given.folder / f"{day}.csv", robot)
        return
    learned = trunk.episodes(log, robot, LEARNED, LONG["learned"])
    tested = trunk.episodes(log, robot, TESTED, LONG["tested"])
    rows, models = [], {}

    def measured(name: str, make: Callable[[], Dynamics], seed: int = 0, steps: int = 0) -> None:
        begun = time.process_time()
        model = make()
        row = TrunkRow(name, seed, steps, time.process_time() - begun, *errors(model, tested))
        print(row, flush=True)
        rows.append(row)
        models[name] = model

    def linear() -> Dynamics:
        kind = FITTED["arx"]
        return fit(kind(robot, DT, kind.Config()), [each.trajectory for each in learned]).model

    measured("persistence", lambda: BASELINES["persistence"](robot, DT, 1))
    measured("mjcf_restarted", lambda: RestartedPlant(Plant(robot, DT), 1))
    measured("arx", linear)
    for seed in given.seeds:
        train = partial(trained, robot, learned, given.folder, given.steps, seed)
        measured("network", train, seed, given.steps)
    write_rows(TRUNK_CSV, rows)
    shown = {name: models[name] for name in ("network", "arx")}
    picture = as_file(lambda: figure(shown, tested[0]))
    assert picture is not None
    write_output(TIP, picture)


if __name__ == "__main__":
    main()
