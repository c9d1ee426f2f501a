"""Time steps of the shipped robots: motions and tables."""

import math

import numpy as np
import pytest

from benchmarks.steps import (
    CONTROLS,
    FEW,
    POSSIBLE,
    RestRow,
    StepRow,
    motions_table,
    others_table,
    rest_table,
)
from flywheel.dynamics.plant import Plant
from flywheel.robots import load_robot

MOVED = [(robot, kind) for robot, kinds in POSSIBLE.items() for kind in kinds if kind != "gaits"]


@pytest.mark.parametrize(("robot", "kind"), MOVED)
def test_motions_last_two_seconds_and_differ(robot: str, kind: str) -> None:
    motions = CONTROLS[kind](Plant(load_robot(robot)), 3)
    assert motions.start.qpos.shape[0] == 3
    assert motions.controls.shape == (3, 200, len(load_robot(robot).winches))
    assert np.ptp(motions.start.qpos, axis=0).max() > 0.01


def step_row(controls: str, integrator: str, step: float, median: float) -> StepRow:
    return StepRow(
        "prism3", "the MJCF's", controls, integrator, step, median, 2 * median, 0.5, 99.6
    )


def test_the_tables_have_a_row_for_each_step_and_a_column_for_each_of_a_few() -> None:
    rows = [step_row("random", name, 1e3 * step, 4.0) for name, step in FEW]
    rows += [step_row("held", name, 1e3 * step, math.nan) for name, step in FEW]
    table = motions_table(rows)
    assert len(table) == 2 + len(FEW)
    assert table[2] == "| Euler | 10 | 4, 8; 0.5; 100 |"  # longest first
    others = others_table(rows)
    assert others[0].count("|") == others[1].count("|") == others[2].count("|") == 4 + len(FEW)
    assert others[2] == "| prism3 | the MJCF's | random |" + " 4 |" * len(FEW)
    assert others[3].count("diverged") == len(FEW)
    rest = rest_table(
        [RestRow("prism3", "the MJCF's", name, 1e3 * step, 0.1, 2.0) for name, step in FEW]
    )
    assert rest[2] == "| prism3 | the MJCF's |" + " 0.1, 2 |" * len(FEW)
