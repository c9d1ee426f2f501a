"""The comparison: from models and recordings to a test of their errors against noise."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from flywheel.diagnosis.comparison.bins import Bins
from flywheel.diagnosis.comparison.bootstrap import bootstrap_null, mean_by_lead
from flywheel.diagnosis.comparison.channel_errors import channel_errors
from flywheel.diagnosis.comparison.first_lengths import with_first_lengths
from flywheel.diagnosis.comparison.fitted_starts import fitted_starts
from flywheel.diagnosis.comparison.forecast_windows import ForecastWindows
from flywheel.diagnosis.comparison.regions import Region, regions, span_noise, spans
from flywheel.diagnosis.comparison.result import LEVEL, Comparison, Judgement
from flywheel.diagnosis.fitting.subject import Subject
from flywheel.diagnosis.settings import Settings
from flywheel.dynamics import Persistence, RestartedPlant
from flywheel.dynamics.plant import Plant
from flywheel.errors import DataError, ModelError
from flywheel.evaluation import ExactSum
from flywheel.options import ComparisonOptions
from flywheel.records import Floats, Trajectory

FEWEST_DRAWS = 2 * round(1 / LEVEL)  # with fewer, nothing could be more than noise


def compare(
    models: Sequence[Subject],
    recordings: Sequence[Trajectory],
    options: ComparisonOptions = ComparisonOptions(),
    names: Sequence[str] = (),
    settings: Settings = Settings(),
) -> Comparison:
    """Compare models with recordings.

    Args:
      models: of one robot; the verdict is that of the last.
      recordings: unbatched, of the models' control step.
      options: see there.
      names: of the recordings.
      settings: of fitted starts, as in a diagnosis.

    Raises:
      DataError: recordings cannot be used.
      ModelError: models do not fit them or each other, or have no finite prediction.
    """
    begun, draws, seed = time.perf_counter(), options.draws, options.seed
    if draws < FEWEST_DRAWS:
        raise DataError(f"It takes {FEWEST_DRAWS} draws to tell noise from more, got {draws}.")
    _check(models, recordings)
    robot = models[0].dynamics.robot
    history = max(subject.dynamics.history for subject in models)
    windows = ForecastWindows.cut(robot, recordings, options.horizon, history, names)
    windows = with_first_lengths(windows, Plant(robot, windows.dt), settings)
    nothing = Subject("nothing moves", Persistence(robot, windows.dt, windows.lead))
    still = _squares(windows, predicted(nothing, windows)[0])
    where = regions(windows)
    fit_seed = seed if options.fit_starts else None
    streams = np.random.default_rng(seed).spawn(len(models))
    return Comparison(
        windows=windows,
        models=tuple(
            judged(subject, windows, where, draws, rng, fit_seed, settings)
            for subject, rng in zip(models, streams, strict=True)
        ),
        persistence=mean_by_lead(still),
        draws=draws,
        seed=seed,
        seconds=time.perf_counter() - begun,
    )


def judged(
    subject: Subject,
    windows: ForecastWindows,
    where: Sequence[Region],
    draws: int,
    rng: np.random.Generator,
    fit_seed: int | None,
    settings: Settings = Settings(),
) -> Judgement:
    """One model; `fit_seed` is of the search for fitted starts, None to leave that out.

    A plant starts with fitted first lengths of its winches, any other model with those of the MJCF.
    """
    dynamics, fitted = subject.dynamics, None
    if isinstance(dynamics, RestartedPlant) and dynamics.plant.terms:
        windows = with_first_lengths(windows, dynamics.plant, settings)
    points, winch = predicted(subject, windows)
    squares = _squares(windows, points)
    null = bootstrap_null(subject, windows, points, draws, rng)
    sums = ExactSum.of(squares, axis=1).over(2)
    spread = _span_squares(windows, points)
    if fit_seed is not None and isinstance(dynamics, RestartedPlant):
        fitted = fitted_starts(dynamics.plant, windows, squares, fit_seed, settings)
    return Judgement(
        name=subject.name,
        points=points,
        winch=winch,
        by_lead=mean_by_lead(squares),
        band=null.band,
        squares=sums,
        cables=ExactSum.of(spread.ravel()),
        bins=_bins(windows, where, sums, squares, spread),
        noise_rms=null.rms,
        excess=null.excess,
        probability=null.probability,
        fitted=fitted,
        channels=channel_errors(subject, windows, rng),
    )


def predicted(subject: Subject, windows: ForecastWindows) -> tuple[Floats, Floats]:
    """Points (K, steps + 1, P, 3) and winch positions (K, steps + 1, W) [m], from measured pasts."""
    model = subject.dynamics
    try:
        found = model.rollout(windows.past(subject), windows.controls())
    except ModelError as error:
        raise ModelError(f"{subject.name}: {error}") from error
    return found.points, found.winch


def _squares(windows: ForecastWindows, points: Floats) -> Floats:
    """(K, steps, P, 3) squared errors in noise variances; NaN for missing measurements."""
    return np.asarray(((windows.measured - points[:, 1:]) / windows.sigma) ** 2)


def _span_squares(windows: ForecastWindows, points: Floats) -> Floats:
    """(K, steps, C) the same of the distances between the ends of cables."""
    robot = windows.robot
    off = spans(robot, windows.measured) - spans(robot, points[:, 1:])
    return np.asarray((off / (windows.sigma * span_noise(robot))) ** 2)


def _bins(
    windows: ForecastWindows,
    where: Sequence[Region],
    sums: ExactSum,
    squares: Floats,
    spread: Floats,
) -> tuple[Bins, ...]:
    robot = windows.robot
    found = [
        Bins("points", "end cap", tuple(p.name for p in robot.points), sums.over(0)),
        Bins("points", "window", windows.labels, sums.over(1)),
        Bins("cables", "cable", tuple(c.name for c in robot.cables), ExactSum.of(spread).over(0)),
    ]
    for region in where:
        if region.of == "points":
            found.append(
                Bins.sort("points", region.by, region.labels, squares, region.place[..., None])
            )
        else:
            found.append(Bins.sort("cables", region.by, region.labels, spread, region.place))
    return tuple(found)


def _check(models: Sequence[Subject], recordings: Sequence[Trajectory]) -> None:
    if not models:
        raise ModelError("There is no model to compare.")
    names = [subject.name for subject in models]
    if len(set(names)) < len(names):
        raise ModelError(f"Models need different names, got {', '.join(names)}.")
    first = models[0].dynamics
    for subject in models:
        dynamics = subject.dynamics
        if dynamics.robot.digest != first.robot.digest:
            raise ModelError(
                f"{subject.name} predicts {dynamics.robot.name} ({dynamics.robot.digest[:12]}), "
                f"{models[0].name} predicts {first.robot.name} ({first.robot.digest[:12]})."
            )
        for t in recordings:
            if abs(t.dt - dynamics.dt) > 1e-9:
                raise ModelError(
                    f"{subject.name} predicts at {dynamics.dt:g} s, a recording has {t.dt:g} s."
                )
