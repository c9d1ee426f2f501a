"""Training of a plant's correction: it helps on what it has not seen, repeats, and refuses what cannot be."""

import numpy as np
import pytest

from flywheel.dynamics.plant import MeasurementModel, Plant, RestartedPlant, with_effects
from flywheel.dynamics.residual import Lookout, ResidualConfig, ResidualWeights
from flywheel.effects import EFFECTS, Scales, Term
from flywheel.errors import DataError
from flywheel.evaluation import ErrorTable
from flywheel.records import Observation, Past, Trajectory
from flywheel.robots import load_robot
from flywheel.training.residual import ResidualTraining, chosen_share, train_residual, windows_of
from flywheel.training.spans import Span, split

PRISM = load_robot("prism3")
CONFIG = ResidualConfig(width=16, interval=0.2, past=0.4)
QUICK = ResidualTraining(
    horizon=0.7, steps=40, batch=32, validate_every=20, warmup_steps=5, held_out=0.25
)


def plant() -> RestartedPlant:
    return RestartedPlant(Plant(PRISM), window=10, degree=2, roll="relaxed")


def recordings(
    seed: int, count: int, seconds: float = 3.0, gain: float = 3.0, dropout: float = 0.0
) -> list[Trajectory]:
    """Of a robot whose winches are faster than told, with noise, and without states."""
    effect, scales, rng = EFFECTS["winch_gain"], Scales.of(PRISM), np.random.default_rng(seed)
    sizes = tuple(gain * p.typical(scales) for p in effect.parameters)
    robot = with_effects(Plant(PRISM), (Term(effect, effect.places(PRISM)[0], sizes),))
    pieces = round(seconds / 0.3)
    controls = np.repeat(rng.uniform(-0.4, 0.4, (count, pieces, 6)), 30, axis=1)
    truth = robot.simulate(robot.settle(2.0, count), controls)
    measure = MeasurementModel(noise=0.003, dropout=dropout)
    return [
        Trajectory(measure.apply(truth.observations[i], PRISM, rng), controls[i], 0.01)
        for i in range(count)
    ]


def error(model, tracks: list[Trajectory]) -> float:
    """RMSE / L of predictions over 0.7 s from one second on [%]."""
    past = Past(
        Observation(*(np.stack(a) for a in zip(*[
            (t.observations.points[:101], t.observations.winch[:101]) for t in tracks
        ], strict=True))),
        np.stack([t.controls[:100] for t in tracks]),
        np.stack([PRISM.known_winch(t.observations.winch, t.controls, 0.01)[:101] for t in tracks]),
    )  # fmt: skip
    controls = np.stack([t.controls[100:170] for t in tracks])
    truth = np.stack([t.observations.points[101:171] for t in tracks])
    return ErrorTable.between(
        PRISM, 0.01, truth, model.rollout(past, controls).points[:, 1:]
    ).e_pos_rmse


@pytest.mark.slow
def test_trained_on_short_recordings_it_beats_the_plant_on_others():
    longer = QUICK.model_copy(update={"steps": 60, "batch": 16})
    found = train_residual(plant(), recordings(0, 8), CONFIG, longer)
    assert found.model.share > 0.5
    assert found.error < 0.9 * found.plant_error
    others = recordings(1, 16)
    assert error(found.model, others) < 0.9 * error(plant(), others)


@pytest.mark.slow
def test_equal_trainings_give_equal_weights_and_gaps_do_no_harm():
    tracks = recordings(2, 5, dropout=0.1)
    few = QUICK.model_copy(update={"steps": 4})
    first, again = (train_residual(plant(), tracks, CONFIG, few) for _ in range(2))
    assert ResidualWeights.of(first.model).digest == ResidualWeights.of(again.model).digest
    other = train_residual(plant(), tracks, CONFIG, few.model_copy(update={"seed": 1}))
    assert ResidualWeights.of(other.model).digest != ResidualWeights.of(first.model).digest
    assert all(np.isfinite(value) for _, *values in first.curve for value in values)


def test_what_is_missing_has_no_weight():
    (track,) = recordings(3, 1)
    points = track.observations.points.copy()
    points[120:, 4] = np.nan
    seen = Observation(points, track.observations.winch)
    lookout = Lookout(plant(), CONFIG)
    whole, part = (
        windows_of(lookout, [Span(t, 0, t.steps)], 66, QUICK)
        for t in (track, Trajectory(seen, track.controls, track.dt))
    )
    assert whole.weight.min() > 0.0
    assert (part.weight[:, :, 4] == 0.0).any() and (part.weight[:, :, 3] > 0.0).all()
    assert (part.left[part.weight == 0.0] == 0.0).all()


def test_windows_that_the_plant_cannot_predict_are_left_out():
    (track,) = recordings(4, 1)
    lookout, steps = Lookout(plant(), CONFIG), 66
    whole = windows_of(lookout, [Span(track, 0, track.steps)], steps, QUICK)
    points = track.observations.points.copy()
    points[40:81, 2] = (
        np.nan
    )  # longer than the past that is looked at, and not than what is in sight
    seen = Observation(points, track.observations.winch)
    spoilt = Trajectory(seen, track.controls, track.dt)
    part = windows_of(lookout, [Span(spoilt, 0, track.steps)], steps, QUICK)
    assert 0 < len(part) < len(whole)


def test_whole_recordings_are_held_out_if_there_are_enough_and_else_the_ends_of_all():
    tracks = recordings(5, 4)
    learned, judged = split(tracks, 0.25)
    assert [id(p.track) for p in learned] == [id(t) for t in tracks[:3]]
    assert [id(p.track) for p in judged] == [id(tracks[3])]
    assert all((p.begin, p.end) == (0, 300) for p in (*learned, *judged))
    learned, judged = split(tracks[:2], 0.25)
    assert [(p.begin, p.end) for p in learned] == [(0, 225)] * 2
    assert [(p.begin, p.end) for p in judged] == [(225, 300)] * 2
    lookout = Lookout(plant(), CONFIG)
    ends = windows_of(lookout, judged[:1], 55, QUICK)
    winch = PRISM.known_winch(
        tracks[0].observations.winch, tracks[0].controls, 0.01
    )  # the beginning of the recording is still known
    np.testing.assert_allclose(
        PRISM.length * ends.sight.ahead.winch[0, 0].numpy(), winch[225], atol=1e-5
    )


def test_a_correction_that_may_be_luck_is_not_made():
    training = ResidualTraining(spacing=0.2, horizon=2.0, sure=2.0)
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(40, 1))
    better = np.linspace(0.0, 1.0, 21)
    assert chosen_share(1.0 - 0.05 * better + noise * better, training) == 0
    assert chosen_share(1.0 - 0.05 * better + 0.001 * noise * better, training) == 20
    assert chosen_share(np.ones((40, 1)) + 0.05 * better, training) == 0
    alone = 1.0 - 0.05 * better[None]
    assert chosen_share(np.repeat(alone, 2, axis=0), training) == 20
    assert chosen_share(alone, training) == 0, "one window shows no chance"


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (list, "no recording"),
        (lambda: recordings(6, 1, seconds=0.3), "too short"),
        (lambda: [Trajectory(t.observations, t.controls, 0.02) for t in recordings(6, 1)], "steps of"),
        (
            lambda: [
                Trajectory(
                    Observation(t.observations.points[:, :5], t.observations.winch), t.controls, t.dt
                )
                for t in recordings(6, 1)
            ],
            "points, winches",
        ),
    ],
)  # fmt: skip
def test_recordings_that_cannot_be_learned_from_are_refused(make, words):
    with pytest.raises(DataError, match=words):
        train_residual(plant(), make(), CONFIG, QUICK)
