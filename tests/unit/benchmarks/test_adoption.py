"""The whole loop with a network, as small as it gets."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks import adoption
from benchmarks.adoption import NOISY, AdoptionStudy, Bench, line, row_of, study, wanted
from flywheel.diagnosis import Diagnosis
from flywheel.effects import EFFECTS
from flywheel.runtime.config.run_config import load_config
from flywheel.runtime.config.shipped import config_file
from flywheel.runtime.pool.progress import Quiet

TINY = (
    *NOISY,
    "collect.random_seconds=1.2",
    "training.initial.steps=10",
    "training.fine_tuning.steps=4",
    "network.warmup_chunks=1",
)


@pytest.mark.nightly
@pytest.mark.slow
def test_a_network_is_trained_diagnosed_and_trained_on(tmp_path, monkeypatch):
    monkeypatch.setattr(adoption, "FURTHER", 1)
    monkeypatch.setattr(adoption, "SECONDS", 1.2)
    ((seed, case),) = wanted(["winch_gain"], [0])
    short = replace(
        case,
        fit=(replace(case.fit[0], seconds=0.6),),
        held_out=replace(case.held_out, seconds=0.6),
    )
    library = {"winch_gain": EFFECTS["winch_gain"]}
    ask = adoption.diagnose
    found: list[Diagnosis] = []

    def diagnosed_once(*data: object, **more: Any) -> Diagnosis:
        if not found:
            more["options"] = replace(more["options"], window=0.4)
            found.append(ask(*data, library=library, **more))
        return found[0]

    monkeypatch.setattr(adoption, "diagnose", diagnosed_once)
    config = load_config(config_file("smoke"), [*TINY, f"seed={seed}"])
    bench = Bench(config, tmp_path, Quiet())
    result = study(bench, short)
    assert np.isfinite(
        [result.before, result.after, result.ceiling, *result.shorter, *result.rotation]
    ).all()
    assert result.truth[0].effect == "winch_gain"
    assert bool(result.adopted) != bool(result.problem)
    assert result.before != result.ceiling
    assert f"| s{seed} |" in line(row_of(result))
    trained = {path.name for path in tmp_path.glob("network-*")}
    assert {f"network-plain-s{seed}", f"network-{case.name}-true"} <= trained
    again = study(bench, short)  # nothing is recorded or trained again
    assert again == result


def test_the_share_of_a_gap_is_one_where_the_answer_is_as_good_as_the_truth() -> None:
    kept = AdoptionStudy(
        name="x.s0",
        truth=(),
        verdict="EFFECT",
        adopted=("winch_gain",),
        problem="",
        before=5.0,
        after=3.0,
        ceiling=1.0,
        shorter=(4.0, 2.5, 0.5),
        rotation=(3.0, 2.0, 1.0),
    )
    assert kept.closed == pytest.approx(0.5)
    assert "| 50% |" in line(row_of(kept))
    no_gap = kept.model_copy(update={"ceiling": 5.0})
    assert np.isnan(no_gap.closed)
    assert "| no gap |" in line(row_of(no_gap))
