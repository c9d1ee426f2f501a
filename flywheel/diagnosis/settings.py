"""The settings of a diagnosis, each with its unit and its reason.

Lengths, times and speeds "in natural units" are in multiples of the robot's length L, of sqrt(L / g), and of
sqrt(L g), so that one number suits robots of every size. Squares and costs are in variances of the
measurement noise [sigma^2].
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import reduce
from typing import Any, TypeVar

from flywheel.errors import ConfigError
from flywheel.options import said_of
from flywheel.quantities import Bounds
from flywheel.registry import lookup
from flywheel.smoothing import MotionPrior

S = TypeVar("S")
NUMBER = Bounds(0, 1e6, above=True)  # what a setting can be set to
COUNT = Bounds(1, 1000)  # the same where it is a whole number


@dataclass(frozen=True)
class WindowSettings:
    """Cutting of recordings into windows.

    Attributes:
      seconds: length of a window, in natural units. Longer ones forget their initial states, shorter ones
        contain little information besides them.
      remnant: fraction of that length below which a recording gives no window if others do.
      least_measured: share of its samples that a window needs; a tracker of 20 Hz has a fifth of 100 Hz.
      noise: standard deviation of each coordinate's noise [m]; 0 to estimate it from the recordings. Logs
        that were filtered have lost it, and would be fitted to the last digit.
      least_noise: estimated noise, in lengths of the robot, below which recordings seem to be filtered:
        motion capture in a small volume has five times as much.
    """

    seconds: float = 1.8
    remnant: float = 0.5
    least_measured: float = 0.1
    noise: float = 0.0
    least_noise: float = 2e-6


@dataclass(frozen=True)
class InitialStateSettings:
    """Smoothing of the first estimates of the initial states, and their uncertainty.

    Attributes:
      reach: of the samples to either side of a window's start, in natural units.
      motion: prior of the motion, which matters for a window next to a gap; its speed is also the standard
        deviation of the estimated velocities.
      place_prior: standard deviation of the estimated poses, in natural units.
      winch_prior: of the winch positions at the start of a recording, in lengths of the robot.
    """

    reach: float = 1.0
    motion: MotionPrior = MotionPrior()
    place_prior: float = 0.1
    winch_prior: float = 0.003


@dataclass(frozen=True)
class FitStoppingSettings:
    """Stopping rules of a fit. `SelectionSettings` has the limits of the search.

    Attributes:
      converged_share, converged_fall: decrease of the cost in a step below which it has converged, relative
        and absolute [sigma^2]: far below the differences between models.
      wrong: residual/noise ratio above which a model, or a window, is wrong, and not just badly fitted.
      min_relative_gain: fraction of such a model's excess that a round must explain to be followed by
        another.
      rounds: of a fit, at most.
      max_rounds_to_target: further rounds like the last one after which a fit must have reached its target;
        all `rounds` for one of a robot as built, whose rounds rarely gain more than the previous one, and
        of a law of no library: if that is abandoned too early, an effect is named wrongly.
      slight_fall: decrease of the cost that decides no comparison [sigma^2].
    """

    converged_share: float = 0.001
    converged_fall: float = 2.0
    wrong: float = 1.1
    min_relative_gain: float = 0.05
    rounds: int = 10
    max_rounds_to_target: float = 2.0
    slight_fall: float = 5.0


@dataclass(frozen=True)
class RefinementSettings:
    """Time steps shorter than the plant's own.

    Attributes:
      tolerated: root mean square change of a window by half the time step above which it is halved [sigma].
        More is visible in the fit, and contacts in coarse steps make discontinuities in its cost.
      tolerated_by_nothing: the same before the answer that nothing is missing: a small effect may hide
        behind it.
    """

    tolerated: float = 0.3
    tolerated_by_nothing: float = 0.05


@dataclass(frozen=True)
class AsBuiltSettings:
    """Standard deviations of a robot's numbers from its MJCF, part by part.

    They are those of a robot measured with a ruler, scales and a protractor; a better one has a
    fraction of them (`SelectionSettings.as_built_shares`). If all of them together explain the
    residual, no single effect is named for it.

    Attributes:
      stiffness, damping: of each cable [-].
      cable_length: of each cable that is not the first of its winch, in lengths of the robot.
      cable_end: of each attachment and anchor, along each axis, in lengths of the robot.
      drum: radius of each winch's drum [-].
      mass, inertia: of each body [-].
      centre_of_mass: of each body, along each axis, in lengths of the robot.
      marker: of each tracked point on its body, along each axis, in lengths of the robot.
      friction, softness: of all contacts [-].
    """

    stiffness: float = 0.08
    damping: float = 0.3
    cable_length: float = 0.004
    cable_end: float = 0.004
    drum: float = 0.025
    mass: float = 0.04
    inertia: float = 0.1
    centre_of_mass: float = 0.004
    marker: float = 0.002
    friction: float = 0.2
    softness: float = 0.4


@dataclass(frozen=True)
class FittingSettings:
    """Settings of one fit.

    Attributes:
      believed: largest allowed deviation from a prior, in standard deviations.
      discrepancy: residual/noise ratio above which a model discrepancy is added, a second scale of error:
        below it, noise dominates; and ratio of successive estimates above which they are not stable.
    """

    believed: float = 3.0
    discrepancy: float = 1.5
    initial_states: InitialStateSettings = InitialStateSettings()
    stopping: FitStoppingSettings = FitStoppingSettings()
    refinement: RefinementSettings = RefinementSettings()
    as_built: AsBuiltSettings = AsBuiltSettings()


@dataclass(frozen=True)
class SelectionSettings:
    """The stepwise search.

    Attributes:
      shortlist: candidates that are fitted in each forward step.
      share: of what something must explain, that it must promise to be worth a fit: of the best candidate's
        LM statistic; of the error at the first estimates of the initial states, if no score promises as much
        of a fit's residual; of the threshold, in time steps shorter than a fit needs; and of what effects
        alone explain less than a robot as built.
      per_family: places of one effect on the short list; number of other laws and of effects at one part
        beside it.
      more: ratio to the explanation by the best candidate, from which two of them, another law, an effect at
        one part alone, or all numbers of a robot as built, are tried.
      max_effects: in one answer; a search has twice as many steps.
      least_share: fraction of an answer's residual beyond noise that another effect must promise to explain,
        and a first one in place of a robot as built; twice as much for the last allowed effect, without
        which the answer is incomplete anyway.
      by_chance: fraction of a fit's residual beyond noise that other initial states may explain as well.
      as_built_shares: prior scales tried for a robot as built [-]; the most likely one is used.
      rival: fraction of an effect's LM statistic from which another is tried in its place.
    """

    shortlist: int = 4
    share: float = 0.5
    per_family: int = 2
    more: float = 1.2
    max_effects: int = 3
    least_share: float = 0.2
    by_chance: float = 0.1
    as_built_shares: tuple[float, ...] = (0.125, 0.25, 0.5, 1.0)
    rival: float = 0.8


@dataclass(frozen=True)
class Limits:
    """Limits of visibility, and of noise.

    Attributes:
      threshold: score from which an effect counts as visible.
      equally_good: difference of two criteria (BIC) below which models are not distinguished.
      max_residual_variance: of the residual, above which it is more than noise, with exactly known noise.
      max_held_out_variance: of the residual on held-out recordings, above which numbers of a robot as built
        explain only the fitted recordings.
      least_share: of an error beyond noise that is worth a name: the initial model's on windows that were
        not fitted, removed by effects of the answer; what another law and an answer explain, by that law.
      most: share of the initial model's error beyond noise, above which the answer explains most of it: on
        fitted recordings an answer with a residual is `PARTIAL`, and on held-out ones its effects are adopted
        unnamed; a number of the MJCF that explains as much may be far off.
      tolerance: RMS model error that you accept; the search stops below it [m]; 0 to accept none.
      sure: standard deviations of the noise's own error, in addition to that.
      correlated: covariance of a residual from sample to sample, likewise, in variances of the noise; its
        correlation where the residual is more than noise.
      outstanding: largest excess of one window, in standard deviations of noise.
      margin: factor on a model's own errors in a few draws, which are seldom the worst of them.
    """

    threshold: float = 25.0
    equally_good: float = 10.0
    max_residual_variance: float = 1.05
    max_held_out_variance: float = 1.25
    least_share: float = 0.1
    most: float = 0.5
    tolerance: float = 0.0
    sure: float = 2.0
    correlated: float = 0.05
    outstanding: float = 6.0
    margin: float = 1.5


@dataclass(frozen=True)
class Settings:
    """All settings of a diagnosis."""

    windows: WindowSettings = WindowSettings()
    fitting: FittingSettings = FittingSettings()
    selection: SelectionSettings = SelectionSettings()
    limits: Limits = Limits()


def numbers(settings: Any, prefix: str = "") -> dict[str, float]:
    """All single numbers of settings, by their paths: "selection.shortlist"."""
    found: dict[str, float] = {}
    for field in fields(settings):
        value, path = getattr(settings, field.name), f"{prefix}{field.name}"
        if is_dataclass(value):
            found |= numbers(value, f"{path}.")
        elif isinstance(value, int | float):
            found[path] = value
    return found


def described(path: str) -> str:
    """The description of a setting, from the docstring of its record."""
    *records, name = path.split(".")
    return said_of(name, type(reduce(getattr, records, Settings())))


def unusual(settings: Settings) -> dict[str, float]:
    """The changed numbers, by their paths."""
    usual = numbers(Settings())
    return {path: value for path, value in numbers(settings).items() if value != usual[path]}


def changed(settings: S, changes: Mapping[str, float]) -> S:
    """Settings with other numbers.

    Args:
      settings: `Settings`, or a part of them.
      changes: path -> number.

    Raises:
      UnknownNameError: no such path.
      ConfigError: a number outside the setting's bounds.
    """
    known = numbers(settings)
    for path, number in changes.items():
        default = lookup(known, path, "setting")
        bounds, whole = (COUNT, "whole ") if isinstance(default, int) else (NUMBER, "")
        if number not in bounds or (whole and number != int(number)):
            raise ConfigError(f"{path} must be a {whole}number {bounds}; got {number:g}.")
        settings = _with(settings, path.split("."), type(default)(number))
    return settings


def _with(settings: Any, path: list[str], number: float) -> Any:
    name, *rest = path
    value = _with(getattr(settings, name), rest, number) if rest else number
    return replace(settings, **{name: value})
