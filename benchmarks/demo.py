"""Outcomes of `flywheel demo`: over all effects of the library and some seeds, and with nothing hidden.

    python -m benchmarks.demo OUT_FOLDER

Tells one story after the other, each as the command would with `--effect NAME@PLACE:SIZE --seed N`,
and keeps one JSON file per story. Existing stories are not repeated: it can be stopped at any time.
`python -m benchmarks.tables collect demo OUT_FOLDER` imports the results as CSV.
"""

from __future__ import annotations

import math
import os
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.command import parser_of
from benchmarks.seconds import cpu_seconds
from flywheel.demo.assessment import RIGHT, Naming
from flywheel.demo.demonstration import (
    NOTHING,
    DemoConfig,
    Demonstration,
    demonstrate,
    placed_effect,
)
from flywheel.errors import FlywheelError
from flywheel.evaluation.intervals import success_interval
from flywheel.outputs import write_output
from flywheel.registry import lookup
from flywheel.results import ResultRecord
from flywheel.robots import Robot, load_robot
from flywheel.runtime.pool.progress import Progress, console_progress
from flywheel.truth_simulator import HIDDEN

ROBOT = "prism3"
SEEDS = (0, 1, 2)
FAILED = "failed"
HEADER = (
    "| hidden | stories | named | among others | wrong beside | not named | before | after | held out "
    "| CPU s |\n|---|---|---|---|---|---|---|---|---|---|"
)


class DemoResult(ResultRecord):
    """One story.

    Attributes:
      name: "prism3.slope.s0".
      hidden: in the format of `flywheel demo --effect`.
      seed: of the story.
      outcome: in a few words, or "failed".
      sentence: the hidden effect, and the answer; or the error.
      verdict: of the diagnosis.
      answers: labels of its alternatives.
      adopted: labels of the adopted effects.
      noise: of a coordinate, as estimated [m].
      before, after: root mean square error of predictions from the held-out recordings, over the
        noise.
      more_before, more_after: it was more than noise.
      held_out_before, held_out: error with fitted starts on the held-out recordings, over the
        noise.
      seconds: by the clock.
      cpu_seconds: of this process and the stand-in's.
      load: average over a minute at the end, of the whole machine.
    """

    name: str
    hidden: str
    seed: int
    outcome: str
    sentence: str
    verdict: str = ""
    answers: tuple[str, ...] = ()
    adopted: tuple[str, ...] = ()
    noise: float = math.nan
    before: float = math.nan
    after: float = math.nan
    more_before: bool = False
    more_after: bool = False
    held_out_before: float = math.nan
    held_out: float = math.nan
    seconds: float = math.nan
    cpu_seconds: float = math.nan
    load: float = math.nan


@dataclass(frozen=True)
class DemoRow:
    """A story as a row of a table; see `DemoResult`."""

    name: str
    hidden: str
    seed: int
    outcome: str
    verdict: str
    answers: str
    adopted: str
    before: float
    after: float
    more_before: bool
    more_after: bool
    held_out_before: float
    held_out: float
    seconds: float
    cpu_seconds: float
    load: float

    @property
    def effect(self) -> str:
        """Name of the hidden effect."""
        return self.name.split(".")[1]


def tell(
    robot: Robot, effect: str, seed: int, progress: Progress, config: DemoConfig
) -> DemoResult:
    """Tell one story. A failure is a result, too.

    Args:
      robot: of the MJCF.
      effect: name of the hidden effect, or "none".
      seed: of the story, and of the effect's place.
      progress: receives the progress.
      config: size of the demonstration.
    """
    rng = np.random.default_rng(seed)
    hidden = effect if effect == NOTHING else placed_effect(robot, HIDDEN[effect], rng)
    about = {"name": f"{robot.name}.{effect}.s{seed}", "hidden": hidden, "seed": seed}
    begun, spent = time.perf_counter(), cpu_seconds()
    try:
        story = demonstrate(robot, hidden, seed, config, progress)
    except FlywheelError as error:
        return DemoResult.model_validate({**about, "outcome": FAILED, "sentence": str(error)})
    took = {
        "seconds": round(time.perf_counter() - begun, 1),
        "cpu_seconds": round(cpu_seconds() - spent, 1),
        "load": round(os.getloadavg()[0], 2),
    }
    return DemoResult.model_validate({**about, **_numbers(story), **took})


def _numbers(story: Demonstration) -> dict[str, object]:
    found, errors = story.diagnosis, story.diagnosis.held_out
    assert errors is not None, "a demonstration holds recordings out"
    models = story.beside.models
    return {
        "outcome": str(story.assessment.outcome),
        "sentence": story.assessment.sentence,
        "verdict": str(found.verdict),
        "answers": tuple(
            " with ".join(each.label for each in answer) for answer in found.answers if answer
        ),
        "adopted": tuple(each.label for each in story.adopted),
        "noise": errors.noise,
        "before": models[0].rms,
        "after": models[-1].rms,
        "more_before": models[0].outcome == "MORE_THAN_NOISE",
        "more_after": models[-1].outcome == "MORE_THAN_NOISE",
        "held_out_before": errors.baseline / errors.noise,
        "held_out": errors.augmented / errors.noise,
    }


def row_of(result: DemoResult) -> DemoRow:
    """The row of a story."""
    values = result.model_dump(exclude={"sentence", "noise", "answers", "adopted"})
    return DemoRow(
        **values, answers="; or ".join(result.answers), adopted=", ".join(result.adopted)
    )


def table(rows: Sequence[DemoRow]) -> list[str]:
    """Lines of Markdown: a row per hidden effect, one for nothing hidden, and one for all effects."""
    lines = [HEADER]
    for name in (*HIDDEN, NOTHING):
        if mine := [row for row in rows if row.effect == name]:
            lines.append(_line("nothing" if name == NOTHING else name, mine))
    if effects := [row for row in rows if row.effect != NOTHING]:
        lines.append(_line("all effects", effects))
        right = sum(row.outcome in RIGHT for row in effects)
        share = success_interval(right, len(effects), method="exact")
        interval = f"{share.value:.0%} ({100 * share.low:.0f}-{100 * share.high:.0f})"
        lines.append(
            f"| named, alone or among others | {right} of {len(effects)} | {interval} |{' |' * 7}"
        )
    return lines


def _line(what: str, rows: Sequence[DemoRow]) -> str:
    """A row of the table; with nothing hidden, a right answer counts as named."""
    count = Counter(row.outcome for row in rows)
    right = count[Naming.NAMED] + count[Naming.NOTHING]
    wrong = count[Naming.NOT_NAMED] + count[Naming.FALSE_ALARM] + count[FAILED]
    before, after, first, last, cpu = (
        np.nanmedian([getattr(row, name) for row in rows])
        for name in ("before", "after", "held_out_before", "held_out", "cpu_seconds")
    )
    return (
        f"| {what} | {len(rows)} | {right} | {count[Naming.AMONG]} | {count[Naming.BESIDE]} | {wrong} | "
        f"{before:.2f} | {after:.2f} | {first:.2f} to {last:.2f} | {cpu:.0f} |"
    )


def main() -> None:
    """Tell the stories that the folder has no result of yet, and print the table of all."""
    parser = parser_of(__file__, __doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--hidden", nargs="*", default=[*HIDDEN, NOTHING], help="effects, or none")
    parser.add_argument("--seeds", type=int, nargs="*", default=SEEDS)
    parser.add_argument("--threads", type=int, default=DemoConfig().threads)
    given = parser.parse_args()
    robot, config = load_robot(ROBOT), DemoConfig(threads=given.threads)
    for name in given.hidden:
        lookup({**HIDDEN, NOTHING: None}, name, "hidden effect")
    given.folder.mkdir(parents=True, exist_ok=True)
    for seed in given.seeds:
        for effect in given.hidden:
            file = given.folder / f"{robot.name}.{effect}.s{seed}.json"
            if not file.exists():
                result = tell(robot, effect, seed, console_progress(), config)
                write_output(file, result.model_dump_json(indent=1) + "\n")
    texts = [file.read_text(encoding="utf-8") for file in sorted(given.folder.glob("*.json"))]
    rows = [row_of(DemoResult.model_validate_json(text)) for text in texts]
    print("\n".join(table(rows)))


if __name__ == "__main__":
    main()
