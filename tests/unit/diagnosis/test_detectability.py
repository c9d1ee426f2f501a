"""What is still detectable around other initial states."""

import numpy as np
import pytest

from flywheel.diagnosis.checks.detectability import LEAST, common_share, detectable
from flywheel.diagnosis.fitting.model import fitted
from flywheel.diagnosis.fitting.plant_fit import PlantFitter
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.scores import ScoredModel
from flywheel.diagnosis.selection.search import Search
from flywheel.effects import EFFECTS
from flywheel.robots import Robot
from tests import draws

pytestmark = pytest.mark.slow

NAMES = ("winch_gain", "slope", "contact_softness", "payload", "creep")  # which has shapes


@pytest.fixture(scope="module")
def model(robot: Robot, fitter: PlantFitter) -> ScoredModel:
    library = candidates(robot, {name: EFFECTS[name] for name in NAMES})
    return Search(fitter, library).score_all(fitted(fitter, rounds=2))


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


def test_nothing_smaller_is_shown_than_around_the_fitted_initial_states(fitter, model, seed):
    found = detectable(fitter, model, np.random.default_rng(seed))
    assert [f.candidate for f in found] == [s.candidate for s in model.scores]
    for before, after in zip(model.scores, found, strict=True):
        assert after.smallest >= before.smallest, (seed, before.candidate.label)
        assert (after.score, after.sizes) == (before.score, before.sizes)
    gain = next(i for i, s in enumerate(model.scores) if s.candidate.label == "winch_gain")
    # Commands act anywhere alike.
    assert found[gain].smallest < 1.5 * model.scores[gain].smallest, seed


def test_where_initial_states_are_known_exactly_all_of_it_is_detectable(
    fitter, model, seed, monkeypatch
):
    monkeypatch.setattr("flywheel.diagnosis.checks.detectability.SHIFT", 0.0)
    found = detectable(fitter, model, np.random.default_rng(seed))
    np.testing.assert_allclose(
        [f.smallest for f in found], [s.smallest for s in model.scores], rtol=1e-6
    )
