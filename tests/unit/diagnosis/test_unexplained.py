"""What no effect of the library explains: where it acts, and a learned law in its place."""

from __future__ import annotations

import numpy as np
import pytest

from flywheel.diagnosis import Diagnosis, Verdict, diagnose
from flywheel.diagnosis.baseline import fitted, fitter_of
from flywheel.diagnosis.candidates import candidates
from flywheel.diagnosis.selection import Selection
from flywheel.diagnosis.whereabouts import whereabouts
from flywheel.diagnosis.windows import Windows
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS, Cables, Parameter, TensionEffect, Term
from flywheel.effects.effect import Memory, Values
from flywheel.records import Floats, Observation, Trajectory
from flywheel.reports.diagnosis_page import diagnosis_page, sentence
from flywheel.robots import Robot
from tests.unit.diagnosis.conftest import recorded

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


@pytest.fixture(scope="module")
def found(robot: Robot, seed: int) -> Diagnosis:
    hidden = (Term(Ratchet(), None, (0.3,)),)
    log = recorded(robot, hidden, seed)
    return diagnose(Plant(robot), [log], (), FEW, window_seconds=0.4, seed=seed)


def test_a_learned_law_explains_more_than_the_library(found: Diagnosis, seed: int) -> None:
    assert found.verdict in (Verdict.OUTSIDE_LIBRARY, Verdict.PARTIAL), seed
    law = found.stand_in
    assert law is not None
    assert law.errors.augmented < law.errors.baseline <= found.errors.baseline, seed
    excess = law.errors.augmented**2 - law.errors.noise**2
    assert excess < 0.5 * (found.errors.baseline**2 - found.errors.noise**2), seed


def test_likeness_is_a_share_and_sorted(found: Diagnosis, seed: int) -> None:
    assert found.stand_in is not None
    shares = [each.share for each in found.stand_in.likeness]
    assert shares == sorted(shares, reverse=True), seed
    assert all(0.0 <= share <= 1.0 + 1e-9 for share in shares), seed


def test_the_page_and_the_json_say_so(found: Diagnosis) -> None:
    summary = found.summary()
    assert summary["stand_in"]["error"]["unit"] == "m"
    assert {"recording", "from", "to", "cable", "point", "unit"} == set(summary["unexplained"])
    page = diagnosis_page(found, {})
    assert "learned" in page
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
    shared = min(end, where.end) - max(begin, where.begin)
    assert shared > 0.5 * max(end - begin, where.end - where.begin), (seed, where)
