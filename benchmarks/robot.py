"""The whole mission on a robot that differs from its model: errors and drives of each model.

    python -m benchmarks.robot FOLDER                  three seeds: a run each, and 24 drives of five planners
    python -m benchmarks.robot FOLDER --sets cogging   the same with another robot
    python -m benchmarks.robot FOLDER --sets nothing --seeds 0 1 2 3 4 5 6 7 8 9   only collects and diagnoses

A study is a run of `configs/prism3_robot.yaml`, and then drives to new goals, the same ones for
each planner: MPPI on the unchanged MJCF, on the plant with the identified effects, on the last
network, on the last residual model, and on a plant with the true effects in the library's form. The
first and the last of these are independent of the run, and drive once for all seeds. Existing
results are reused. `python -m benchmarks.tables collect robot FOLDER` imports the results.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from benchmarks.command import parser_of
from flywheel.cli.driving.driver import PLANT, RESIDUAL, RobotDriver
from flywheel.cli.driving.drives import DriveLine, append_drive, read_drives
from flywheel.cli.runs.opening import OpenRun, open_run
from flywheel.demo.assessment import library_values
from flywheel.effects import AdoptedPlant, WrittenTerm
from flywheel.registry import lookup
from flywheel.robot_link import StandInConfig
from flywheel.robot_link.opening import SIMULATED
from flywheel.runtime.config.run_config import RunConfig, load_config
from flywheel.runtime.config.shipped import config_file
from flywheel.runtime.loop import run
from flywheel.runtime.pool.progress import Progress, Stage, console_progress
from flywheel.truth_simulator.written import hidden_effects

CONFIG = "prism3_robot"
SETS = {
    "library": ("torque_speed:2", "cable_friction:2", "payload:2"),
    "cogging": ("cogging",),
    "rod_flex": ("rod_flex:2",),
    "nothing": (),
}
COLLECT_ONLY = (  # for a set without hidden effects: whether something is found that is not there
    "robot.planners=[plant]",
    "robot.drives=2",
    "residual.on=false",
    "training.initial.steps=20",
    "training.fine_tuning.steps=20",
    "evaluate.tasks=0",
    "evaluate.video=false",
    "collect.mppi=1",
)
GIVEN, KNOWS, NETWORK = "given", "knows", "network"
UNTAUGHT = (GIVEN, KNOWS)  # have nothing from a run: with each seed they drive the same
DRIVES, FIRST_SEED = 24, 1000
FIRST_SECOND = 1.0  # lead time of the nearer errors [s]


@dataclass(frozen=True)
class PieceOfStage:
    """A stage that is one piece of a longer one.

    Attributes:
      whole: the longer one.
      before: amount of it done at the beginning of the piece.
    """

    whole: Stage
    before: float

    def update(self, done: float, note: str = "") -> None:
        """Report that `done` of the piece is done."""
        self.whole.update(self.before + done, note)


@dataclass(frozen=True)
class ErrorRow:
    """The errors of one model on all of the robot's held-out recordings.

    Attributes:
      set, seed: of the study.
      model: its name, as in `RobotScore`, or "noise".
      iteration: of the model.
      minutes: recorded on the robot before.
      e_pos, e_rot: RMSE of the centres of mass [% of the length], and mean angle [deg], over 2 s.
      e_pos_1s: RMSE at a lead time of 1 s [% of the length].
      found: effects of the model, beyond its MJCF.
    """

    set: str
    seed: int
    model: str
    iteration: int
    minutes: float
    e_pos: float
    e_rot: float
    e_pos_1s: float
    found: str


@dataclass(frozen=True)
class DriveRow:
    """The drives of one planner.

    Attributes:
      set, seed: of the study.
      planner: name of its model, with the iteration for drives in the run itself.
      drives, reached: their number, and the number that reached the goal.
      median: time to the goal of those that did [s].
      limit: time limit of a drive [s].
    """

    set: str
    seed: int
    planner: str
    drives: int
    reached: int
    median: float
    limit: float


@dataclass(frozen=True)
class Study:
    """One robot, one seed.

    Attributes:
      folder: of all studies.
      set: name of the hidden effects.
      seed: of the run.
      drives: for each planner.
      overrides: of the run's configuration.
    """

    folder: Path
    set: str
    seed: int
    drives: int = DRIVES
    overrides: tuple[str, ...] = ()

    @property
    def hidden(self) -> tuple[str, ...]:
        """Hidden effects of the stand-in."""
        return lookup(SETS, self.set, "set of hidden effects")

    @property
    def path(self) -> Path:
        """The run's folder."""
        return self.folder / f"{self.set}-s{self.seed}"

    @property
    def collects_only(self) -> bool:
        """True if nothing is hidden: the run collects and diagnoses, and nothing is driven after it."""
        return not self.hidden

    def config(self) -> RunConfig:
        """Of the run."""
        written = ", ".join(f'"{each}"' for each in self.hidden)
        only = COLLECT_ONLY if self.collects_only else ()
        changes = [f"seed={self.seed}", f"robot.hidden=[{written}]", *only, *self.overrides]
        return load_config(config_file(CONFIG), changes)

    def do(self, progress: Progress) -> None:
        """Do all missing parts."""
        run(self.config(), self.path, resume=True, progress=progress)
        if self.collects_only:
            return
        for planner in self.planners:
            self._drive(planner, progress)

    @property
    def planners(self) -> dict[str, tuple[str, tuple[str, ...]]]:
        """Name of a planner -> its model, and overrides with its known effects."""
        return {
            GIVEN: (PLANT, ("effects=[]",)),
            PLANT: (PLANT, ()),
            NETWORK: (str(self.opened.config.iterations), ()),
            RESIDUAL: (RESIDUAL, ()),
            **({KNOWS: (PLANT, (f"effects={self._known()}",))} if self._written() else {}),
        }

    @cached_property
    def opened(self) -> OpenRun:
        """The run, once it is finished."""
        return open_run(self.path)

    def file(self, planner: str) -> Path:
        """Its drives."""
        of = self.set if planner in UNTAUGHT else self.path.name
        return self.folder / f"{of}-{planner}.jsonl"

    def _drive(self, planner: str, progress: Progress) -> None:
        file = self.file(planner)
        seeds = range(FIRST_SEED, FIRST_SEED + self.drives)
        if not (left := sorted(set(seeds) - {drive.seed for drive in read_drives(file)})):
            return
        model, overrides = self.planners[planner]
        stand_in = StandInConfig(hidden=self.hidden)
        driver = RobotDriver(self.path, overrides, model, SIMULATED, stand_in, {})
        try:
            with progress.stage(f"{self.path.name}: {planner} drives", float(len(left))) as stage:
                for done, seed in enumerate(left):
                    begun = time.process_time()
                    shown, log = PieceOfStage(stage, float(done)), file.with_suffix(".transcript")
                    driven = driver.drive(seed, shown, log)
                    append_drive(file, driver.line(seed, driven, begun))
                    stage.update(done + 1.0)
        finally:
            driver.link.close()

    def _written(self) -> tuple[WrittenTerm, ...]:
        """The hidden effects in the library's form; empty for those outside the library."""
        robot = self.opened.robot
        truths = [effect.truth(robot) for effect in hidden_effects(self.hidden, robot)]
        library = self.opened.config.library()
        if any(truth.name not in library for truth in truths):
            return ()
        return tuple(
            WrittenTerm(effect=t.name, location=t.place, parameters=library_values(t))
            for t in truths
        )

    def _known(self) -> Path:
        """A plant with the hidden effects, as an adopted one."""
        robot, parent = self.opened.robot, self.folder / f"{self.path.name}-known"
        plant = AdoptedPlant(
            robot=robot.name, digest=robot.digest, version=1, effects=self._written()
        )
        there = parent / plant.label
        return (there if there.exists() else plant.write(parent, robot).parent).absolute()

    def errors(self) -> Iterator[ErrorRow]:
        """The errors of all models."""
        result = self.opened.result
        for score in result.on_robot:
            leads, short = score.errors.by_lead_time, score.errors.short
            at = np.interp(FIRST_SECOND, leads.seconds, leads.e_pos_rmse) if leads else math.nan
            known = () if score.model == GIVEN else result.effects_before(score.iteration + 1)
            yield ErrorRow(
                set=self.set,
                seed=self.seed,
                model=score.model,
                iteration=score.iteration,
                minutes=score.minutes,
                e_pos=short.e_pos_rmse,
                e_rot=short.e_rot,
                e_pos_1s=float(at),
                found=", ".join(effect.label for effect in known),
            )
        if (noise := result.robot_noise) is not None:
            yield ErrorRow(
                set=self.set,
                seed=self.seed,
                model="noise",
                iteration=0,
                minutes=0.0,
                e_pos=noise.e_pos_rmse,
                e_rot=noise.e_rot,
                e_pos_1s=noise.e_pos_rmse,
                found="",
            )

    def driven(self) -> Iterator[DriveRow]:
        """The drives of all planners: those in the run, and those after it."""
        for result in self.opened.result.of_arm("mppi"):
            for planner, each in ({} if result.robot is None else result.robot.drives).items():
                yield DriveRow(
                    set=self.set,
                    seed=self.seed,
                    planner=f"{planner}, iteration {result.iteration}",
                    drives=each.success.total,
                    reached=each.success.reached,
                    median=each.median_seconds,
                    limit=each.seconds_allowed,
                )
        for planner in (GIVEN, PLANT, NETWORK, RESIDUAL, KNOWS):
            if drives := read_drives(self.file(planner)):
                yield self._driven(planner, drives)

    def _driven(self, planner: str, drives: Sequence[DriveLine]) -> DriveRow:
        times = [drive.walk.seconds for drive in drives if drive.walk.reached]
        return DriveRow(
            set=self.set,
            seed=self.seed,
            planner=planner,
            drives=len(drives),
            reached=len(times),
            median=float(np.median(times)) if times else math.nan,
            limit=drives[0].seconds_allowed,
        )


def found_studies(folder: Path) -> list[Study]:
    """The studies whose runs are finished."""
    names = [path.name.rpartition("-s") for path in sorted(folder.iterdir()) if path.is_dir()]
    studies = [Study(folder, name, int(seed)) for name, _, seed in names if seed.isdigit()]
    return [study for study in studies if study.opened.result.finished]


def errors_table(rows: Sequence[ErrorRow], of_set: str) -> list[str]:
    """Lines of Markdown: a row for each model after each iteration, a column for each seed."""
    mine = [row for row in rows if row.set == of_set]
    seeds = sorted({row.seed for row in mine})
    head = " | ".join(f"seed {seed}" for seed in seeds)
    lines = [f"| model | after iteration | minutes | {head} | found (seed {seeds[0]}) |"]
    lines.append("|---|---|---|" + "---|" * (len(seeds) + 1))
    keys = dict.fromkeys((row.model, row.iteration) for row in mine)
    for model, iteration in sorted(keys, key=lambda key: (key[0] == "noise", key[1])):
        of = {row.seed: row for row in mine if (row.model, row.iteration) == (model, iteration)}
        cells = [f"{of[s].e_pos:.2f} % / {of[s].e_rot:.1f} deg" if s in of else "" for s in seeds]
        first = of[min(of)]
        after = "" if model in (GIVEN, "noise") else str(iteration)
        lines.append(
            f"| {model} | {after} | {first.minutes:.1f} | {' | '.join(cells)} | {first.found} |"
        )
    return lines


def drives_table(rows: Sequence[DriveRow], of_set: str) -> list[str]:
    """Lines of Markdown: a row for each planner, a column for each seed."""
    mine = [row for row in rows if row.set == of_set]
    seeds = sorted({row.seed for row in mine})
    head = " | ".join(f"seed {seed}" for seed in seeds)
    lines = [f"| MPPI plans on | {head} |", "|---|" + "---|" * len(seeds)]
    for planner in dict.fromkeys(row.planner for row in mine):
        of = {row.seed: row for row in mine if row.planner == planner}
        cells = [_reached(of[seed]) if seed in of else "" for seed in seeds]
        lines.append(f"| {planner} | {' | '.join(cells)} |")
    return lines


def _reached(row: DriveRow) -> str:
    median = "" if math.isnan(row.median) else f", {row.median:.0f} s"
    return f"{row.reached} of {row.drives}{median}"


def main() -> None:
    """Do the missing studies of the folder, and print their tables."""
    parser = parser_of(__file__, __doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--sets", nargs="*", default=["library"], choices=SETS)
    parser.add_argument("--seeds", type=int, nargs="*", default=[0, 1, 2])
    parser.add_argument("--drives", type=int, default=DRIVES, help="for each planner, at the end")
    parser.add_argument("--set", nargs="*", default=[], help="key=value of the run")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    progress = console_progress()
    for seed, of_set in itertools.product(given.seeds, given.sets):
        study = Study(given.folder, of_set, seed, given.drives, tuple(given.set))
        study.do(progress)
    done = found_studies(given.folder)
    errors, drives = ([r for s in done for r in s.errors()], [r for s in done for r in s.driven()])
    for of_set in dict.fromkeys(study.set for study in done):
        print("\n".join(["", of_set, "", *errors_table(errors, of_set)]))
        if driven := [row for row in drives if row.set == of_set]:
            print("\n".join(["", *drives_table(driven, of_set)]))


if __name__ == "__main__":
    main()
