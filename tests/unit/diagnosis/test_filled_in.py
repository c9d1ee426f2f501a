"""What was filled in holds the model, and says nothing of how far it is off."""

from dataclasses import replace

import numpy as np
import pytest

from flywheel.control import RandomControls
from flywheel.diagnosis.checks.held_out import beyond_noise
from flywheel.diagnosis.checks.localisation import localise
from flywheel.diagnosis.checks.model_discrepancy import model_discrepancy
from flywheel.diagnosis.fitting.model import fitted, fitter_of
from flywheel.diagnosis.fitting.network_fit import NetworkFitter
from flywheel.diagnosis.fitting.plant_fit import PlantFitter
from flywheel.diagnosis.fitting.projection import Projection
from flywheel.diagnosis.fitting.subject import Subject
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.scores import score_test
from flywheel.dynamics.plant import Plant, RestartedPlant
from flywheel.effects import EFFECTS
from flywheel.records import Floats, Observation, Past, Rollout, Trajectory
from flywheel.robots import load_robot
from tests import draws

SIGMA = 0.002
DRAWS = 300


@pytest.fixture(scope="module")
def planar() -> PlantFitter:
    """Fits windows of a platform of which nobody measured one coordinate."""
    robot, rng = load_robot("platform4"), np.random.default_rng(draws.seed())
    plant = Plant(robot)
    start = plant.settle(1.0)
    controls = RandomControls(robot, 0.01).sequence(plant.winch(start)[0], 100, 1)
    points = plant.simulate(start, controls[None]).observations.points[0]
    points = points + rng.normal(0, SIGMA, points.shape)
    points[..., 1] = points[0, :, 1]
    blind = np.full((len(points), len(robot.winches)), np.nan)
    log = Trajectory(Observation(points, blind), controls, 0.01)
    return fitter_of(Windows.cut(robot, [log], 0.25, sigma=SIGMA), plant)


def test_noise_alone_leaves_as_much_as_there_are_degrees_of_freedom(planar: PlantFitter) -> None:
    """The local parameters that what was filled in holds take nothing from the rest."""
    windows, rng = planar.windows, np.random.default_rng(0)
    jacobian = planar.jacobian(planar.first_estimate())
    noise = windows.noisy.reshape(len(windows), -1, 1) * rng.normal(
        size=(*jacobian.by_local.shape[:2], DRAWS)
    )
    left = Projection.of(planar, jacobian, None, np.ones(len(windows))).without_local(noise)
    assert (left**2).sum() / DRAWS == pytest.approx(planar.freedom, rel=3e-3)
    assert planar.freedom > windows.noisy.sum() - planar.first_estimate().local.size + 1


def test_what_only_filled_in_coordinates_are_off_counts_nowhere(planar: PlantFitter) -> None:
    windows, fit = planar.windows, planar.first_estimate()
    assert windows.filled[..., 1].all() and not windows.filled[..., ::2].any()
    robot = windows.robot
    gains = candidates(robot, {"winch_gain": EFFECTS["winch_gain"]})
    test = score_test(planar, fit, gains)
    off = np.where(windows.noisy, 0.0, 50.0).reshape(fit.residual.shape)
    aside = replace(fit, residual=fit.residual + off)
    assert planar.mean_squares(aside) == pytest.approx(planar.mean_squares(fit))
    assert model_discrepancy(planar, aside) == model_discrepancy(planar, fit)
    left = test.left.reshape(len(windows), -1)
    swung = np.pad(off, ((0, 0), (0, left.shape[1] - off.shape[1])))
    swung[:, : 3 * len(robot.points) * windows.steps // 2] = 0.0  # off later, if that counted
    before = localise(planar, test).summary()
    assert localise(planar, replace(test, left=(left + swung).ravel())).summary() == before


def test_noise_is_taken_off_for_what_has_any(planar: PlantFitter) -> None:
    squares = beyond_noise(planar, np.zeros(len(planar.windows)))
    assert squares == pytest.approx(planar.taken - planar.windows.noisy_in_each)


def roughness(points: Floats) -> Floats:
    """(3,) of tracks (..., time, point, 3): near 3 of noise by 1, near 0 of motion."""
    return np.nanmedian(np.abs(np.diff(points, n=3, axis=-3)).reshape(-1, 3), axis=0)


def test_errors_that_a_network_is_tried_on_have_no_noise_where_a_log_has_none(planar):
    pasts: list[Floats] = []

    class Remembering(RestartedPlant):
        def rollout(self, past: Past, controls: Floats) -> Rollout:
            pasts.append(past.observations.points)
            return super().rollout(past, controls)

    plant = Remembering(Plant(planar.windows.robot), window=10, degree=2, roll="relaxed")
    subject, rng = Subject("restarted", plant), np.random.default_rng(0)
    network = NetworkFitter(planar, fitted(planar), (), subject, rng)
    shape = network.windows.measured.shape
    own = np.moveaxis(network.own_errors.reshape(*shape, -1), -1, 0)
    ahead = own[:, :, plant.history + 1 :]
    for x, y, z in (roughness(pasts[-1] / SIGMA), roughness(ahead)):
        assert y < 0.1 and min(x, z) > 2.0
