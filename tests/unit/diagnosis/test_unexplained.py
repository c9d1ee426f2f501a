"""What no effect of the library explains: where it acts, and a learned law in its place."""

from __future__ import annotations

import numpy as np

from flywheel.diagnosis import Limits, Verdict, diagnose
from flywheel.diagnosis.checks.discrepancy import BEGINNINGS, PATIENCE, ROUNDS, stand_in
from flywheel.diagnosis.checks.localisation import whereabouts
from flywheel.diagnosis.fitting import stopping as worth_module
from flywheel.diagnosis.fitting.baseline import fitted, fitter_of
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.stepwise import Selection
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS, Cables, Parameter, TensionEffect, Term
from flywheel.effects.effect import Memory, Values
from flywheel.records import Floats, Observation, Trajectory
from flywheel.reports.diagnosis_page import diagnosis_page, sentence
from flywheel.robots import Robot
from tests.unit.diagnosis.conftest import recorded

RECORDINGS = 3  # starts make up for what is missing, in some more than in others
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


def test_a_learned_law_comes_near_the_true_one(robot: Robot, seed: int) -> None:
    learned_falls, true_falls = [], []
    for each in range(seed, seed + RECORDINGS):
        log = recorded(robot, HIDDEN, each)
        fitter = fitter_of(Windows.cut(robot, [log], seconds=0.4), Plant(robot))
        fit = fitted(fitter)
        step = Selection(fitter, candidates(robot, FEW), 25.0).look(fit)
        learned = stand_in(fitter, step, each)
        true = fitter.fit(fitter.at(fit.change, fit.starts.winch, HIDDEN))
        learned_falls.append(fit.cost - learned.fit.cost)
        true_falls.append(fit.cost - true.cost)
        shares = [like.share for like in learned.likeness]
        assert shares == sorted(shares, reverse=True), each
        assert all(0.0 <= share <= 1.0 + 1e-9 for share in shares), each
    assert sum(learned_falls) > 0.5 * sum(true_falls), (seed, learned_falls, true_falls)


def test_a_law_is_trained_only_while_that_explains_something(
    robot: Robot, seed: int, monkeypatch
) -> None:
    log = recorded(robot, HIDDEN, seed)
    fitter = fitter_of(Windows.cut(robot, [log], seconds=0.4), Plant(robot))
    step = Selection(fitter, candidates(robot, FEW), 25.0).look(fitted(fitter))
    rounds: list[int] = []
    fit = fitter.fit
    monkeypatch.setattr(fitter, "fit", lambda *a, **k: rounds.append(1) or fit(*a, **k))
    trained = {}
    for worth in (0.0, 0.01, 10.0):
        rounds.clear()
        monkeypatch.setattr(worth_module, "FRUITLESS", worth)
        learned = stand_in(fitter, step, seed)
        trained[worth] = len(rounds) - BEGINNINGS, learned.fit
    for worth, most in ((10.0, PATIENCE), (0.0, ROUNDS)):
        number, ended = trained[worth]
        assert number == most or (number < most and ended.converged), (seed, worth, number)
    assert trained[10.0][0] <= trained[0.01][0] <= trained[0.0][0]
    assert trained[0.0][1].cost <= trained[0.01][1].cost <= trained[10.0][1].cost


def test_the_page_and_the_json_say_so(robot: Robot, seed: int) -> None:
    never = Limits(loud=0.0)  # nothing is ever enough
    logs = [recorded(robot, (), seed + i) for i in range(2)]
    found = diagnose(Plant(robot), logs[:1], logs[1:], FEW, never, window_seconds=0.4, seed=seed)
    assert found.verdict in (Verdict.OUTSIDE_LIBRARY, Verdict.PARTIAL), seed
    summary, law = found.summary(), found.stand_in
    assert law is not None and law.held_out is not None
    assert {like.effect for like in law.likeness} <= set(FEW), "laws of no library have no say here"
    assert law.errors.augmented <= 1.01 * law.errors.baseline, seed  # there is nothing to learn
    assert summary["stand_in"]["error"]["unit"] == "m"
    assert {"recording", "from", "to", "cable", "point", "unit"} == set(summary["unexplained"])
    assert "learned" in diagnosis_page(found, {})
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
    where = whereabouts(fitter, Selection(fitter, places, 25.0).look(fitted(fitter)).test)
    assert where.point == robot.points[point].name, seed
    # The start of the window makes up for part of the jump: not all of its time need stand out.
    shared = min(end, where.end) - max(begin, where.begin)
    assert shared > 0.5 * (where.end - where.begin), (seed, where)
    assert shared > 0.25 * (end - begin), (seed, where)
