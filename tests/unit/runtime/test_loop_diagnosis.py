"""A run finds out what its plant lacks, adds it, and learns anew from what the better plant says."""

import importlib
import math
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import ValidationError

from flywheel.data.recordings import read_recording, store_recording
from flywheel.diagnosis import diagnose
from flywheel.effects import WrittenTerm
from flywheel.options import ImportOptions
from flywheel.results import DiagnosisNote
from flywheel.robots import load_robot
from flywheel.runtime.config.parts import DiagnoseConfig
from flywheel.runtime.config.run_config import RunConfig
from flywheel.runtime.pool.jobs import PoolReport
from flywheel.runtime.stages.outcomes import Iteration
from flywheel.runtime.workers import sim_worker
from flywheel.runtime.workers.stored_episodes import effects_of
from flywheel.truth_simulator import hidden_effect
from flywheel.truth_simulator.recording import record
from tests.unit.diagnosis.conftest import QUICK
from tests.unit.runtime.tiny_run import TINY, Bench

stage = importlib.import_module("flywheel.runtime.stages.diagnose")
FEW = ["winch_gain", "slope"]
LEAST = {"evaluate": {**TINY["evaluate"], "floor": False}}


@pytest.fixture(autouse=True)
def quick(monkeypatch) -> None:
    """Searches without robots whose numbers are all off."""
    monkeypatch.setattr(sim_worker, "diagnose", partial(diagnose, settings=QUICK))


def stored_logs(folder, store, *names: str) -> list[str]:
    """Two recordings of a robot with hidden effects: one to learn from, one for tests."""
    robot = load_robot("prism3")
    effects = [
        hidden_effect(name).typical(robot, np.random.default_rng(0)).scaled(2.0) for name in names
    ]
    found = []
    for seed, split in ((5, "train"), (6, "test")):
        made = record(robot, effects, seconds=0.8, seed=seed)
        path, _ = made.write(folder, f"log-{seed}", robot)
        found.append(
            store_recording(store, read_recording(path, robot, ImportOptions(split=split)))[0]
        )
    return found


def bench(folder, *effects: str) -> tuple[Bench, list[str]]:
    names = stored_logs(folder / "logs", Bench(folder).store, *effects)
    collect = {**TINY["collect"], "recordings": names}
    return Bench(folder, collect=collect, diagnose={"on": True, "effects": FEW}, **LEAST), names


@pytest.mark.nightly
@pytest.mark.slow
def test_what_is_missing_is_added_and_data_are_simulated_anew(tmp_path, monkeypatch):
    run, names = bench(tmp_path, "winch_gain")
    compared = []

    def spied(note, before, *off):
        compared.append(off)
        return unless_worse(note, before, *off)

    unless_worse = stage.unless_worse
    monkeypatch.setattr(stage, "unless_worse", spied)
    result = run.turn()
    ((before, after),) = compared
    assert 0.0 < after < before, "predictions of what was held out, from measured starts"
    note = result.iterations[1].diagnosis
    assert result.iterations[0].diagnosis is None
    assert note.adopted and [e.effect for e in note.effects] == ["winch_gain"]
    assert note.effects[0].parameters["share"] == pytest.approx(0.2, abs=0.05)
    assert note.augmented < note.baseline and note.held_out_augmented < note.held_out_baseline
    assert (tmp_path / note.page).read_text().startswith("<!doctype html>")
    assert any("the plant now has winch_gain" in line for line in run.said)

    first, second = (run.store.snapshot(f"i000{i}-mppi").episodes for i in (0, 1))
    simulated = [e.id for e in second if e.source == "sim"]
    assert not set(simulated) & {e.id for e in first}
    assert set(names) <= {e.id for e in second}
    assert all(name.startswith("i0001-") for name in simulated)
    assert {effects_of(run.store.read(name)) for name in simulated} == {note.effects}
    assert {effects_of(run.store.read(e.id)) for e in first} == {()}
    judged = result.iterations[1].test.by_episode
    assert judged and all(effects_of(run.store.read(name)) == note.effects for name in judged)
    assert effects_of(run.store.read("oracle-0000")) == note.effects

    models = [i.model for i in result.iterations]
    (tmp_path / "iterations" / "i0001-mppi.json").unlink()
    (tmp_path / "result.json").unlink()
    again = run.turn(resume=True)
    assert "i0001-diagnose" not in run.backend.done, "an answer that is there is not sought again"
    assert [i.model for i in again.iterations] == models


def test_a_plant_is_diagnosed_as_it_was_an_iteration_before_and_the_answer_is_kept(monkeypatch):
    (slope,) = before = (WrittenTerm(effect="slope", location="", parameters={}),)
    found = SimpleNamespace(
        verdict="UNKNOWN",
        summary=dict,
        errors=SimpleNamespace(noise=1.0, baseline=3.0, augmented=2.0),
        held_out=SimpleNamespace(baseline=5.0, augmented=4.0),
    )
    asked = []

    def do(jobs, title):
        asked.extend(jobs)
        return PoolReport({jobs[0].id: found})

    kept = SimpleNamespace(diagnosis={2: None}.get, keep_diagnosis=lambda *given: given)
    run = SimpleNamespace(
        folder=kept,
        effects={1: before}.__getitem__,
        recordings=lambda split, iteration: [f"{split}-{iteration}-{i}" for i in range(4)],
        config=SimpleNamespace(diagnose=DiagnoseConfig(seconds=2.0, episode_seconds=1.0)),
        do=do,
    )
    monkeypatch.setattr(stage, "diagnosis_page", lambda found, about: str(about))
    iteration, note, page = stage.diagnose(run, Iteration(2))
    used = [[f"{split}-2-{i}" for i in (0, 2)] for split in ("train", "test")]
    assert [(job.method, job.arguments) for job in asked] == [("diagnose", (before, *used))]
    assert iteration == 2 and note.effects == (slope,) and not note.adopted
    assert (note.noise, note.baseline, note.augmented) == (1.0, 3.0, 2.0)
    assert (note.held_out_baseline, note.held_out_augmented) == (5.0, 4.0)
    assert "train-2-0, train-2-2" in page and "test-2-0, test-2-2" in page


def test_what_makes_predictions_worse_is_not_adopted():
    """With fitted starts an effect gains that only imitates what is missing; the plant stays as it was."""
    gain, slope = (
        WrittenTerm(effect=name, location="", parameters={}) for name in ("winch_gain", "slope")
    )
    adopting = DiagnosisNote(
        verdict="EFFECT", effects=(slope,), adopted=True, noise=1.0, baseline=2.0, augmented=1.0
    )
    note = stage.unless_worse(adopting, (gain,), 4.0, 5.0)
    assert (note.verdict, note.adopted, note.effects) == ("EFFECT", False, (gain,))
    assert "error on held-out recordings is 4.00 %; with slope it would be 5.00 %" in note.reason


@pytest.mark.parametrize(
    ("before", "after", "adopted"),
    [(4.0, 4.0, True), (4.0, 3.0, True), (math.nan, 5.0, True), (4.0, math.nan, False)],
)
def test_what_predicts_as_well_or_where_the_old_plant_cannot_is_adopted(before, after, adopted):
    note = DiagnosisNote(verdict="EFFECT", adopted=True, noise=1.0, baseline=2.0, augmented=1.0)
    assert stage.unless_worse(note, (), before, after).adopted is adopted


@pytest.mark.nightly
@pytest.mark.slow
def test_a_plant_that_explains_the_recordings_stays(tmp_path):
    run, _ = bench(tmp_path)
    result = run.turn()
    note = result.iterations[1].diagnosis
    assert (note.verdict, note.adopted, note.effects) == ("NOISE_ONLY", False, ())
    first, second = (run.store.snapshot(f"i000{i}-mppi").episodes for i in (0, 1))
    assert {e.id for e in first} <= {e.id for e in second}


def test_a_diagnosis_without_recordings_is_refused():
    with pytest.raises(ValidationError, match="diagnose.on needs recordings"):
        RunConfig.model_validate({"diagnose": {"on": True}})
    with pytest.raises(ValidationError, match="no effect 'slop'.*Did you mean 'slope'"):
        RunConfig.model_validate({"diagnose": {"effects": ["slop"]}})
