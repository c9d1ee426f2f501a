"""The study puts sysid and the diagnosis on the same recordings and measures both alike."""

import math
from dataclasses import replace

import pytest
from mujoco import sysid

from benchmarks.diagnosis.cases import Plan, cases
from benchmarks.sysid.identification import Fitted
from benchmarks.sysid.study import CaseStudy, Contender, Setup, study
from benchmarks.sysid.table import line, rows_of
from flywheel.robots import load_robot
from flywheel.truth_simulator.winch_effects import WinchGain
from tests import draws


@pytest.mark.nightly
@pytest.mark.slow
@pytest.mark.skipif(
    not hasattr(sysid, "optimize"), reason="mujoco.sysid lacks packages: mujoco[sysid]"
)
def test_every_contender_is_measured_on_the_same_windows() -> None:
    seed = draws.seed()
    case = replace(
        cases(load_robot("platform4"), ["none"], seeds=[0])[0],
        effects=(WinchGain(0.15),),
        fit=(Plan("random_steps", seed, 0.5),),
        held_out=Plan("random_steps", seed + 1, 0.5),
    )
    result = study(case, {"sysid": Setup(True, 1, "scipy_parallel_fd")}, ["winch_gain"])
    assert result.truth == "winch_gain: share 0.15 -"
    before, fitted, diagnosed = result.contenders
    assert len(fitted.numbers) == 35
    for contender in result.contenders:
        assert 0.7 < contender.fit < 10.0, f"seed {seed}: {contender}"
        assert 0.7 < contender.held_out < 10.0, f"seed {seed}: {contender}"
    assert [number.name for number in diagnosed.numbers] == ["winch_gain.share"], f"seed {seed}"
    assert diagnosed.fit < before.fit, f"seed {seed}"
    assert fitted.seconds > 0
    assert diagnosed.seconds > 0


def test_the_table_shows_what_surely_changed() -> None:
    numbers = (
        Fitted("rod01.mass", "kg", 200.0, 210.0, 190.0, 230.0),
        Fitted("winch_02.gain", "1", 1.0, 1.1, 1.05, 1.15),
        Fitted("winch_13.gain", "1", 1.0, 1.3, -math.inf, math.inf),
    )
    contenders = (
        Contender(name="plant as it was", fit=1.2, held_out=1.5),
        Contender(
            name="sysid",
            fit=1.01,
            held_out=1.1,
            seconds=9.6,
            verdict="Ended. 9 evals",
            numbers=numbers,
        ),
    )
    result = CaseStudy(name="case", truth="gain", noise=0.01, contenders=contenders)
    again = CaseStudy.model_validate_json(result.model_dump_json())
    assert again == result
    assert [line(row) for row in rows_of(again)] == [
        "| gain | plant as it was | 1.200 | 1.500 | 0 |  |",
        "| gain | sysid | 1.010 | 1.100 | 10 | 1 of 3 |",
    ]
