"""What no effect of the library explains: where it acts, and a learned law in its place."""

from dataclasses import replace

import numpy as np
import pytest

from flywheel.diagnosis import Limits, Verdict, diagnose
from flywheel.diagnosis.checks import discrepancy
from flywheel.diagnosis.checks.discrepancy import learned_law, resemblances
from flywheel.diagnosis.checks.localisation import localise
from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.fitting.model import fitted, fitter_of
from flywheel.diagnosis.fitting.plant_fit import PlantFitter
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.search import Search
from flywheel.diagnosis.settings import (
    FitStoppingSettings,
    FittingSettings,
)
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS, Cables, Parameter, TensionEffect, Term
from flywheel.effects.effect import Memory, Values
from flywheel.options import DiagnosisOptions
from flywheel.records import Floats, Observation, Trajectory
from flywheel.reports.diagnosis_page import diagnosis_page, sentence
from flywheel.robots import Robot
from tests.unit.diagnosis.conftest import QUICK, recorded

ROBOT = "platform4"

RECORDINGS = 2  # initial states make up for what is missing, in some more than in others
FEW = {name: EFFECTS[name] for name in ("winch_gain", "slope")}


class Ratchet(TensionEffect):
    """Cables that pull harder while they get longer, which the library does not have."""

    name = "ratchet"
    sizes = (Parameter("share", "-", lambda s: 1.0),)
    equation = "dT = s T (1 + tanh(V / v0)) / 2"
    source = "made up"
    shown_by = "strokes to and fro"

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        return values["share"] * cables.elastic * (1.0 + cables.direction) / 2.0, memory


HIDDEN = (Term(Ratchet(), None, (0.3,)),)


@pytest.mark.slow
def test_a_learned_law_comes_near_the_true_one(robot: Robot, seed: int) -> None:
    learned_falls, true_falls = [], []
    for each in range(seed, seed + RECORDINGS):
        log = recorded(robot, HIDDEN, each)
        fitter = fitter_of(Windows.cut(robot, [log], seconds=0.4), Plant(robot))
        fit = fitted(fitter)
        model = Search(fitter, candidates(robot, FEW)).score_all(fit)
        learned = learned_law(fitter, model, each)
        true = fitter.fit(fitter.at(fit.local, fit.initial.winch, HIDDEN))
        learned_falls.append(fit.cost - learned.cost)
        true_falls.append(fit.cost - true.cost)
        likest = resemblances(fitter, learned, model.test)
        shares = [resemblance.share for resemblance in likest]
        assert shares == sorted(shares, reverse=True), each
        assert all(0.0 <= share <= 1.0 + 1e-9 for share in shares), each
    assert sum(learned_falls) > 0.5 * sum(true_falls), (seed, learned_falls, true_falls)


@pytest.mark.slow
def test_a_law_is_trained_only_while_that_explains_something(robot, seed, monkeypatch):
    log = recorded(robot, HIDDEN, seed)
    fitter = fitter_of(Windows.cut(robot, [log], seconds=0.4), Plant(robot))
    model = Search(fitter, candidates(robot, FEW)).score_all(fitted(fitter))
    rounds: list[int] = []
    fit = PlantFitter.fit
    monkeypatch.setattr(PlantFitter, "fit", lambda *a, **k: rounds.append(1) or fit(*a, **k))
    trained: dict[float, tuple[int, Fit]] = {}
    for worth in (0.0, 0.01, 10.0):
        rounds.clear()
        stopping = FitStoppingSettings(min_relative_gain=worth)
        asking = PlantFitter(fitter.simulator, fitter.first, FittingSettings(stopping=stopping))
        learned = learned_law(asking, model, seed)
        trained[worth] = len(rounds) - discrepancy.BEGINNINGS, learned
    for worth, most in ((10.0, discrepancy.PATIENCE), (0.0, discrepancy.ROUNDS)):
        number, ended = trained[worth]
        assert number == most or (number < most and ended.converged), (seed, worth, number)
    assert trained[10.0][0] <= trained[0.01][0] <= trained[0.0][0]
    assert trained[0.0][1].cost <= trained[0.01][1].cost <= trained[10.0][1].cost


@pytest.mark.slow
def test_the_page_and_the_json_say_so(robot: Robot, seed: int) -> None:
    never = replace(QUICK, limits=Limits(max_residual_variance=0.0))  # nothing is ever enough
    logs = [recorded(robot, (), seed + i) for i in range(2)]
    found = diagnose(Plant(robot), logs[:1], logs[1:], FEW, never, DiagnosisOptions(0.4, seed=seed))
    assert found.verdict in (Verdict.OUTSIDE_LIBRARY, Verdict.PARTIAL), seed
    summary, law = found.summary(), found.discrepancy
    assert law is not None and law.held_out is not None
    assert {each.effect for each in law.resembles} <= set(FEW), (
        "laws of no library have no say here"
    )
    assert law.errors.augmented <= 1.01 * law.errors.baseline, seed  # there is nothing to learn
    assert summary["discrepancy_model"]["error"]["unit"] == "m"
    assert {"recording", "from", "to", "cable", "point", "unit"} == set(summary["unexplained"])
    assert "A law of the cables, fitted to the recordings" in diagnosis_page(found, {})
    assert "none of the library" in sentence(found) or "something else" in sentence(found)


def test_a_marker_that_jumps_is_placed_in_time_and_on_the_robot(robot: Robot, seed: int) -> None:
    log = recorded(robot, (), seed)
    point, begin, end = seed % len(robot.points), 0.52, 0.68
    time = log.dt * np.arange(log.steps + 1)
    moved = log.observations.points.copy()
    moved[(time >= begin) & (time <= end), point] += 0.02 * robot.length
    jumped = Trajectory(Observation(moved, log.observations.winch), log.controls, log.dt)
    fitter = fitter_of(Windows.cut(robot, [jumped], seconds=0.4), Plant(robot))
    places = candidates(robot, {"marker_offset": EFFECTS["marker_offset"]})
    where = localise(fitter, Search(fitter, places).score_all(fitted(fitter)).test)
    assert where.point == robot.points[point].name, seed
    # The initial state of the window makes up for part of the jump: not all of its time need stand out.
    shared = min(end, where.end) - max(begin, where.begin)
    assert shared > 0.5 * (where.end - where.begin), (seed, where)
    assert shared > 0.25 * (end - begin), (seed, where)
