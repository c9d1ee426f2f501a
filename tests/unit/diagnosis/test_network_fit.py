"""A model other than the plant under test: here one that has errors of its own, as networks do."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from flywheel.diagnosis import Verdict, diagnose
from flywheel.diagnosis.checks.adequacy import adequacy, own_errors
from flywheel.diagnosis.fitting.model import fitted, fitter_of
from flywheel.diagnosis.fitting.network_fit import NetworkFitter
from flywheel.diagnosis.fitting.plant_fit import PlantFitter
from flywheel.diagnosis.fitting.subject import Subject
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.proposals import screened
from flywheel.diagnosis.selection.search import Search
from flywheel.diagnosis.settings import Limits
from flywheel.dynamics.plant import Plant, Reckoning, RestartedPlant
from flywheel.effects import EFFECTS, Term
from flywheel.errors import ModelError
from flywheel.options import DiagnosisOptions
from flywheel.records import Floats, Past, Rollout, Trajectory
from flywheel.robots import Robot, load_robot
from tests import draws
from tests.unit.diagnosis.conftest import recorded

ROBOT = "platform4"

FEW = {name: EFFECTS[name] for name in ("winch_gain", "cable_damping", "air_drag")}
LENGTH = 0.4  # of the windows [s]


@dataclass(frozen=True)
class Drifting:
    """A plant restarted from what is seen, whose predictions then drift away from it: by how much, and
    which way, depends on where the robot is."""

    restarted: RestartedPlant
    drift: float

    @property
    def robot(self) -> Robot:
        return self.restarted.robot

    @property
    def dt(self) -> float:
        return self.restarted.dt

    @property
    def history(self) -> int:
        return self.restarted.history

    def rollout(self, past: Past, controls: Floats) -> Rollout:
        made = self.restarted.rollout(past, controls)
        time = self.dt * np.arange(made.points.shape[1])
        way = np.sin(5.0 * made.points[:, :1])  # (B, 1, P, 3)
        off = self.drift * self.robot.length * time[:, None, None] * way
        return Rollout(made.points + off, made.winch)


@pytest.fixture(scope="module")
def model(robot: Robot) -> Subject:
    plant = RestartedPlant(Plant(robot), window=10, degree=2, roll="relaxed")
    return Subject("drifting", Drifting(plant, 0.05))


def gain(share: float) -> Term:
    return Term(EFFECTS["winch_gain"], None, (share,))


def world_of(robot: Robot, trajectory: Trajectory) -> PlantFitter:
    return fitter_of(Windows.cut(robot, [trajectory], LENGTH), Plant(robot))


@pytest.fixture(scope="module")
def fitter(robot: Robot, trajectory: Trajectory, model: Subject) -> NetworkFitter:
    world = world_of(robot, trajectory)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("flywheel.diagnosis.fitting.network_fit.DRAWS", 48)
        return NetworkFitter(world, fitted(world), (), model, np.random.default_rng(draws.seed()))


def test_its_own_errors_are_far_above_the_noise_and_are_not_taken_for_an_effect(
    robot: Robot, fitter: NetworkFitter, seed: int
) -> None:
    fit = fitter.first_estimate()
    assert fitter.rms(fit) > 3 * fitter.windows.sigma, seed
    scored = Search(fitter, candidates(robot, FEW)).score_all(fit)
    own = own_errors(fitter, scored.test)
    assert own is not None
    assert scored.test.noise < 1.5 * max(1.0, own.noise), seed
    assert scored.scores[0].score < max(25.0, 2 * own.score), seed
    left, outstanding = adequacy(fitter, fit, scored.test, scored.by_value), Limits().outstanding
    assert left.loudest < max(outstanding, own.loudest), seed
    assert own.loudest > outstanding, seed  # far louder in one window than noise ever is


def test_only_what_comes_after_its_past_is_explained(fitter: NetworkFitter) -> None:
    history = RestartedPlant(Plant(fitter.windows.robot), window=10).history
    assert np.isnan(fitter.windows.measured[:, : history + 1]).all()
    assert np.isfinite(fitter.windows.measured[:, history + 1 :]).all()


def test_a_model_is_told_the_winches_of_the_plant_that_it_was_trained_on(
    robot, trajectory, model, monkeypatch
):
    monkeypatch.setattr("flywheel.diagnosis.fitting.network_fit.DRAWS", 8)
    world = world_of(robot, trajectory)
    seen: list[Floats] = []

    class Told(Drifting):
        def rollout(self, past: Past, controls: Floats) -> Rollout:
            seen.append(past.winch[0])
            return super().rollout(past, controls)

    told = Told(model.dynamics.restarted, 0.05)
    rng = np.random.default_rng(draws.seed())
    for terms in ((), (gain(0.5),)):
        subject = replace(model, dynamics=told, terms=terms)
        seen.clear()
        NetworkFitter(world, fitted(world), (), subject, rng)
        first = seen[0]
        known = Reckoning(robot, trajectory.dt, terms).known(trajectory)[: len(first)]
        assert np.allclose(first, known, atol=1e-9)


def test_what_an_effect_changes_vanishes_with_the_effect(fitter: NetworkFitter) -> None:
    fit = fitter.first_estimate()
    same, tiny, small = fitter.predictions(fit, [(), (gain(1e-6),), (gain(0.02),)])
    assert np.array_equal(same, fit.points)
    # In about one drawn recording of seventy, a contact or a restart's roll falls the other way in a
    # window and from there on, however small the effect: hence most points, not all.
    by_tiny, by_small = (np.median(np.abs(each - fit.points)) for each in (tiny, small))
    assert 0.0 < by_tiny < 1e-3 * by_small


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.3])
def test_what_is_hidden_is_found_and_what_is_not_is_not(robot, model, seed, share):
    hidden = (gain(share),) if share else ()
    logs = [recorded(robot, hidden, seed + i) for i in range(2)]
    found = diagnose(
        Plant(robot), logs, (), FEW, options=DiagnosisOptions(LENGTH, seed=seed), model=model
    )
    assert found.model == "drifting"
    if not share:
        assert found.verdict in (Verdict.NOISE_ONLY, Verdict.DATA_INSUFFICIENT), seed
        return
    # Two of six draws named a little damping beside it, which is wrong: an open weakness (docs/results).
    assert len(found.answers[0]) <= 2, seed
    (named,) = (each for each in found.answers[0] if each.effect == "winch_gain")
    assert named.values[0].value == pytest.approx(share, rel=0.1), seed
    assert found.ranking[0].candidate.effect.name == "winch_gain", seed
    assert found.errors.augmented < found.errors.baseline, seed


def test_a_network_is_not_screened(robot, fitter, monkeypatch):
    search = Search(fitter, candidates(robot, FEW))
    scored = search.score_all(fitter.first_estimate())
    scores = tuple(replace(score, statistic=1.0) for score in scored.scores)
    fit = replace(scored.fit, cost=10.0 * fitter.freedom)
    monkeypatch.setattr(NetworkFitter, "predictions", None)  # nothing is simulated
    assert screened(search, replace(scored, fit=fit, scores=scores), ()) == []


def test_a_model_that_does_not_fit_is_refused(robot, trajectory, model):
    with pytest.raises(ModelError, match="looks back 10 steps"):
        diagnose(
            Plant(robot), [trajectory], library=FEW, options=DiagnosisOptions(0.1), model=model
        )
    other = Subject("other", RestartedPlant(Plant(load_robot("prism3"))))
    with pytest.raises(ModelError, match="The model other is for robot"):
        diagnose(Plant(robot), [trajectory], library=FEW, model=other)
