"""What follows from what is left and from how sure values are."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from flywheel.diagnosis.checks.adequacy import Adequacy, OwnErrors, astray, mostly
from flywheel.diagnosis.checks.held_out import Errors
from flywheel.diagnosis.checks.held_out_gain import Gain
from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.results.verdict import (
    Facts,
    Found,
    Verdict,
    beyond,
    carries_over,
    found,
    verdict_of,
)
from flywheel.diagnosis.selection.misspecification import Misspecification
from flywheel.diagnosis.settings import Limits
from flywheel.effects import EFFECTS, Scales, Term
from flywheel.robots import Robot
from tests import draws


def known(
    robot: Robot, effect: str, values: tuple[float, ...], deviation: float, step: float
) -> Found:
    term = Term(EFFECTS[effect], EFFECTS[effect].places(robot)[0], values)
    size = np.ones(len(values))
    return found(term, deviation * size, step * size, robot)


def test_the_time_steps_share_is_taken_off_the_robots_value_only(robot: Robot) -> None:
    (value,) = known(robot, "winch_gain", (0.2,), 0.01, 0.05).values
    assert value.in_plant == 0.2
    assert value.value == pytest.approx(0.15)
    assert (value.low, value.high) == pytest.approx((0.15 - 0.0196, 0.15 + 0.0196))


def test_what_cannot_be_negative_has_no_negative_value_or_bound(robot: Robot) -> None:
    (value,) = known(robot, "cable_friction", (10.0,), 20.0, 30.0).values
    assert (value.value, value.low) == (0.0, 0.0)
    assert value.high == pytest.approx(39.2)


@pytest.mark.parametrize(
    ("effect", "values", "deviation", "shown"),
    [
        ("winch_gain", (0.2,), 0.05, True),
        ("winch_gain", (-0.2,), 0.05, True),
        ("winch_gain", (0.2,), 0.2, False),
        ("cable_friction", (10.0,), 6.0, False),
        ("marker_offset", (0.001, 0.02, 0.001), 0.002, True),  # one component is enough
        ("marker_offset", (0.001, 0.002, 0.001), 0.002, False),
    ],
)
def test_an_effect_is_shown_where_an_interval_leaves_out_zero(
    robot: Robot, effect: str, values: tuple[float, ...], deviation: float, shown: bool
) -> None:
    assert known(robot, effect, values, deviation, 0.0).shown == shown


@pytest.mark.parametrize(
    ("effect", "sizes", "names"),
    [
        ("winch_gain", (5.0,), ["share"]),
        ("winch_gain", (-5.0,), ["share"]),
        ("winch_gain", (4.9,), []),
        ("cable_friction", (20.0,), ["force"]),
        ("cable_friction", (0.0,), []),  # absent, not stopped
        ("marker_offset", (-20.0, 1.0, 20.0), ["x", "z"]),
    ],
)
def test_a_value_that_a_bound_stopped_is_named(robot, effect, sizes, names):
    scales, parameters = Scales.of(robot), EFFECTS[effect].sizes
    values = tuple(s * p.typical(scales) for s, p in zip(sizes, parameters, strict=True))
    assert [value.name for value in known(robot, effect, values, 0.01, 0.0).at_bound] == names


def test_a_shape_alone_shows_nothing(robot: Robot) -> None:
    """The time constant of a creep of no size is sure of itself for no reason."""
    creep = EFFECTS["creep"]
    term = Term(creep, None, (0.01, 0.3))
    assert not found(term, np.array([0.02, 0.001]), np.zeros(2), robot).shown


def test_what_a_model_does_wrong_by_itself_is_not_taken_for_more() -> None:
    limits, rng = Limits(), np.random.default_rng(draws.seed())
    own = OwnErrors(*rng.uniform((25.0, 1.1, 0.1, 6.0), (100.0, 2.0, 0.5, 60.0)))
    wider = beyond(limits, own)
    # A few draws seldom show the worst of them: scores somewhat above theirs are no evidence either.
    assert wider.threshold > 1.2 * own.score
    assert wider.max_residual_variance > own.noise
    assert wider.correlated > own.correlation
    assert wider.outstanding >= own.loudest


def test_a_model_that_does_nothing_wrong_is_asked_what_a_plant_is() -> None:
    rng = np.random.default_rng(draws.seed())
    quiet = OwnErrors(*rng.uniform((0.0, 0.5, -0.1, 0.0), (10.0, 1.0, 0.0, 6.0)))
    assert beyond(Limits(), quiet) == Limits()


def test_what_is_explained_carries_over_to_held_out_recordings_or_does_not() -> None:
    limits = Limits(max_held_out_variance=1.21)
    assert carries_over(limits, None)
    assert carries_over(limits, Errors(noise=1.0, baseline=5.0, augmented=1.09))
    assert not carries_over(limits, Errors(noise=1.0, baseline=5.0, augmented=1.11))


QUIET = Adequacy(1.0, 0.0, loudest=0.0, correlation=0.0, inconstancy=0.0, beyond_noise=0.0)
LOUD, LESS = (
    Adequacy(noise, 0.0, loudest=50.0, correlation=0.5, inconstancy=0.0, beyond_noise=1.0)
    for noise in (10.0, 4.6)
)
# Of a log whose noise is that of a sensor, and was filtered out.
SMOOTH = Adequacy(0.01, 0.0, loudest=0.0, correlation=0.9, inconstancy=0.0, beyond_noise=0.0)
SHOWN, UNSURE = (cast(Found, SimpleNamespace(shown=shown)) for shown in (True, False))
NOTHING = Facts(Limits(), (), LOUD, QUIET)
FOUND = replace(NOTHING, answer=(SHOWN,))
CLEAR, UNCLEAR, LITTLE = (
    Gain(share, share, share, clear, 9, 0)
    for share, clear in ((0.2, True), (0.2, False), (0.05, True))
)
WORSE = Errors(noise=1.0, baseline=5.0, augmented=2.0)
OTHER_LAW = Misspecification("law", score=100.0, share=0.5)
IMITATED = replace(OTHER_LAW, instead="law", gain=100.0)
TOLERANT = Limits(tolerance=2.0)


@pytest.mark.parametrize(
    ("facts", "changes", "verdict"),
    [
        (NOTHING, {}, "NOISE_ONLY"),
        (NOTHING, {"after": SMOOTH}, "NOISE_ONLY"),
        (NOTHING, {"after": replace(SMOOTH, noise=0.5)}, "OUTSIDE_LIBRARY"),
        (NOTHING, {"blind": True}, "DATA_INSUFFICIENT"),
        (NOTHING, {"after": LESS}, "OUTSIDE_LIBRARY"),
        (NOTHING, {"after": LESS, "limits": TOLERANT}, "NOISE_ONLY"),
        (NOTHING, {"law": OTHER_LAW}, "OUTSIDE_LIBRARY"),
        (NOTHING, {"discrepancy": True}, "OUTSIDE_LIBRARY"),  # which counts as noise, and is left
        (NOTHING, {"discrepancy": True, "after": LESS, "limits": TOLERANT}, "NOISE_ONLY"),
        (NOTHING, {"as_built": True}, "NOISE_ONLY"),
        (NOTHING, {"as_built": True, "held_out": WORSE}, "OUTSIDE_LIBRARY"),
        (NOTHING, {"held_out": WORSE}, "NOISE_ONLY"),
        (FOUND, {}, "EFFECT"),
        (FOUND, {"ambiguous": True}, "AMBIGUOUS"),
        (FOUND, {"discrepancy": True}, "PARTIAL"),
        (FOUND, {"answer": (SHOWN, UNSURE)}, "OUTSIDE_LIBRARY"),
        (FOUND, {"after": replace(QUIET, inconstancy=2.0)}, "OUTSIDE_LIBRARY"),
        (FOUND, {"after": LESS}, "PARTIAL"),  # .6 of what was beyond noise is explained
        (FOUND, {"after": LESS, "ambiguous": True}, "PARTIAL"),
        (FOUND, {"after": LESS, "limits": Limits(most=0.7)}, "OUTSIDE_LIBRARY"),
        (FOUND, {"law": OTHER_LAW}, "PARTIAL"),
        (FOUND, {"law": IMITATED}, "OUTSIDE_LIBRARY"),
        (FOUND, {"law": IMITATED, "gain": CLEAR}, "PARTIAL"),
        (FOUND, {"law": IMITATED, "gain": UNCLEAR}, "OUTSIDE_LIBRARY"),
        (FOUND, {"law": IMITATED, "gain": LITTLE}, "OUTSIDE_LIBRARY"),
        (FOUND, {"answer": (UNSURE,), "gain": CLEAR}, "PARTIAL"),
        (FOUND, {"converged": False}, "NOT_CONVERGED"),
        (NOTHING, {"converged": False}, "NOT_CONVERGED"),
    ],
)
def test_a_verdict_follows_from_the_facts(
    facts: Facts, changes: dict[str, Any], verdict: str
) -> None:
    assert verdict_of(replace(facts, **changes)) is Verdict(verdict)


@pytest.mark.parametrize(
    ("facts", "changes", "verdict"),
    [
        (NOTHING, {"after": LESS}, "NOT_CONVERGED"),
        (NOTHING, {}, "NOT_CONVERGED"),  # a small effect may hide in noise
        (NOTHING, {"blind": True}, "DATA_INSUFFICIENT"),
        (FOUND, {"answer": (UNSURE,)}, "NOT_CONVERGED"),
        (FOUND, {"after": LESS}, "PARTIAL"),
        (FOUND, {}, "EFFECT"),
    ],
)
def test_a_search_that_was_stopped_does_not_know_what_is_missing(
    facts: Facts, changes: dict[str, Any], verdict: str
) -> None:
    """Something that nothing explains so far is not outside the library for that."""
    assert verdict_of(replace(facts, unfinished=True, **changes)) is Verdict(verdict)


def test_a_window_has_not_converged_where_it_is_far_above_what_it_began_with() -> None:
    fitter = cast(Fitter, SimpleNamespace(mean_squares=lambda fit: np.array([1.0, 9.0, 9.0, 9.0])))
    unfitted = np.array([0.1, 2.0, 3.0, np.nan])
    where = astray(fitter, cast(Fit, None), unfitted)
    assert where.tolist() == [False, True, False, False]
    assert mostly(~where) and not mostly(where)
