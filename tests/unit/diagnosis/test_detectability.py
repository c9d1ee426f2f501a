"""What is kept of a promise around other starts."""

from __future__ import annotations

import numpy as np
import pytest

from flywheel.diagnosis.checks import detectability as promise
from flywheel.diagnosis.checks.detectability import LEAST, common_share, kept
from flywheel.diagnosis.fitting.baseline import fitted
from flywheel.diagnosis.fitting.plant_fit import StartFitter
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.step import Step
from flywheel.diagnosis.selection.stepwise import Selection
from flywheel.effects import EFFECTS
from flywheel.robots import Robot
from tests import draws

NAMES = ("winch_gain", "slope", "contact_softness", "payload")


@pytest.fixture(scope="module")
def step(robot: Robot, fitter: StartFitter) -> Step:
    library = candidates(robot, {name: EFFECTS[name] for name in NAMES})
    return Selection(fitter, library, 25.0).look(fitted(fitter, rounds=2))


def test_what_others_have_in_common_is_a_share() -> None:
    rng = np.random.default_rng(seed := draws.seed())
    for sizes in (1, 2):
        here = np.linalg.qr(rng.normal(size=(50, 2 * sizes)))[0]
        here, across = 3.0 * here[:, :sizes], here[:, sizes:]
        assert common_share(here, here) == pytest.approx(1.0), seed
        assert common_share(here, 2.0 * here) == 1.0, seed
        assert common_share(here, 0.5 * here) == pytest.approx(0.25), seed
        turn = rng.uniform(0.2, 1.3)
        turned = np.cos(turn) * here + 3.0 * np.sin(turn) * across
        assert common_share(here, turned) == pytest.approx(np.cos(turn) ** 2), seed
        assert common_share(here, across) == LEAST, seed
        assert common_share(0.0 * here, 0.0 * here) == LEAST, seed


def test_nothing_smaller_is_shown_than_around_the_fitted_starts(
    fitter: StartFitter, step: Step, seed: int
) -> None:
    found = kept(fitter, step, np.random.default_rng(seed))
    assert [f.candidate for f in found] == [s.candidate for s in step.scores]
    for before, after in zip(step.scores, found, strict=True):
        assert after.smallest >= before.smallest, (seed, before.candidate.label)
        assert (after.score, after.sizes) == (before.score, before.sizes)
    gain = next(i for i, s in enumerate(step.scores) if s.candidate.label == "winch_gain")
    assert found[gain].smallest < 1.5 * step.scores[gain].smallest, (
        seed
    )  # commands act anywhere alike


def test_where_starts_are_known_exactly_all_of_it_is_kept(
    fitter: StartFitter, step: Step, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(promise, "ELSEWHERE", 0.0)
    found = kept(fitter, step, np.random.default_rng(seed))
    np.testing.assert_allclose(
        [f.smallest for f in found], [s.smallest for s in step.scores], rtol=1e-6
    )
