"""The tuned numbers of a diagnosis: what each is measured in, and why it is what it is.

Lengths, times and speeds "in natural units" are in multiples of the robot's length L, of sqrt(L / g), and of
sqrt(L g), so that one number suits robots of every size. Squares and costs are in variances of the
measurement noise [sigma^2].
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from inspect import getdoc
from math import inf
from typing import Any, TypeVar

from flywheel.errors import ConfigError
from flywheel.quantities import Bounds
from flywheel.registry import lookup
from flywheel.smoothing import MotionPrior

S = TypeVar("S")
NUMBER = Bounds(0, 1e6, above=True)  # what a setting can be set to
COUNT = Bounds(1, 1000)  # the same where it is a whole number


@dataclass(frozen=True)
class WindowSettings:
    """How recordings are cut into windows.

    Attributes:
      seconds: length of a window, in natural units. Longer ones forget their initial states, shorter ones
        tell little beside them.
      remnant: share of that length below which what a recording holds gives no window if others do.
      least_measured: share of its samples that a window needs.
    """

    seconds: float = 1.8
    remnant: float = 0.5
    least_measured: float = 0.3


@dataclass(frozen=True)
class InitialStateSettings:
    """How the first estimates of the initial states are smoothed, and how far they may be off.

    Attributes:
      reach: of the samples to either side of a window's begin that are used, in natural units.
      motion: what is usual, which matters where a window begins beside a gap.
      place_prior, speed_prior: standard deviations of the estimates, in natural units.
      winch_prior: of where the winches were when a recording began, in lengths of the robot.
    """

    reach: float = 1.0
    motion: MotionPrior = MotionPrior()
    place_prior: float = 0.1
    speed_prior: float = 0.5
    winch_prior: float = 0.003


@dataclass(frozen=True)
class JacobianSettings:
    """Finite differences.

    Attributes:
      state_step: of precise differences of an initial state, in natural units.
      rough_steps: of rough ones, in turn: contacts make every one of them blind somewhere.
      winch_step: of a winch's offset, in lengths of the robot.
      parameter_step: of a value of an effect, in typical sizes: a secant, not a derivative, since friction
        and play have none at zero.
      believed: standard deviations of what is known of a value that it may be off.
    """

    state_step: float = 2e-3
    rough_steps: tuple[float, ...] = (2e-3, 8e-3, 5e-4)
    winch_step: float = 1e-3
    parameter_step: float = 0.25
    believed: float = 3.0


@dataclass(frozen=True)
class LeastSquaresSettings:
    """Levenberg-Marquardt.

    Attributes:
      shared_damping: of the shared parameters' step, tried one after the other; infinite for no step.
      least_damping, first_damping, most_damping: of a window's own step.
      max_damping_with_new_jacobian: of a window's own step.
      damping_multipliers: times the damping that suited a window's last step, all of which are tried.
      steps: taken with one Jacobian.
      reuse_sensitivities_from: number of shared parameters from which they are many: their sensitivities,
        too, are kept for all these steps, since simulating them costs the most then, and of the dampings the
        best is taken.
      prediction_error_tolerance: error of a window's predicted change, relative to the change, above which
        its Jacobian is stale.
      negligible_prediction_error: square of such an error that never matters [sigma^2].
    """

    shared_damping: tuple[float, ...] = (0.0, 0.1, 1.0, 10.0, 100.0, inf)
    least_damping: float = 1e-4
    first_damping: float = 0.1
    most_damping: float = 1e4
    max_damping_with_new_jacobian: float = 1.0
    damping_multipliers: tuple[float, ...] = (0.1, 1.0, 10.0)
    steps: int = 3
    reuse_sensitivities_from: int = 12
    prediction_error_tolerance: float = 0.3
    negligible_prediction_error: float = 0.3


@dataclass(frozen=True)
class FitStoppingSettings:
    """When a fit stops. `SelectionSettings` has the limits of the search.

    Attributes:
      converged_share, converged_fall: fall of the cost in a step below which it has converged, relative and
        absolute [sigma^2]: far below what tells models apart.
      wrong: times the noise above which a model is wrong, and not just badly fitted.
      min_relative_gain: of what such a model leaves above that, what a round must explain to be followed by
        another.
      rounds: of a fit, at most.
      max_rounds_to_target: further rounds like the last one after which a fit must have reached its target.
    """

    converged_share: float = 0.001
    converged_fall: float = 2.0
    wrong: float = 1.1
    min_relative_gain: float = 0.05
    rounds: int = 10
    max_rounds_to_target: float = 2.0


@dataclass(frozen=True)
class RefinementSettings:
    """Time steps shorter than the plant's own.

    Attributes:
      tolerated: root mean square of what half the time step changes in a window above which it is halved
        [sigma]. More tells in the fit, and contacts in coarse steps make cliffs in its cost.
      tolerated_by_nothing: the same before nothing is said to be there: a small effect may hide behind it.
      finest: times shorter, at most: quarters are seldom better, and take twice as long.
    """

    tolerated: float = 0.3
    tolerated_by_nothing: float = 0.05
    finest: int = 2


@dataclass(frozen=True)
class MultistartSettings:
    """Other initial states for windows that are stuck in a local minimum.

    Attributes:
      stuck: mean square of a window, over the usual one, from which it may be stuck.
      rotations: random ones of the bodies about axes that no point shows, tried for each such window.
      rotation_sigma: their standard deviation [rad].
      damping: of a step in the search, all of which are tried.
      rounds: of the search.
      rounds_before_elimination: after which only the `finalists` of each window go on.
      finalists: initial states of each window that go on after the elimination.
      eased: of what makes a window loud, what must go with another state if its state is to blame.
      before, after: rounds of a fit before windows are begun elsewhere, and after.
      going: share of the cost that the last round must take away for a fit to go on: stiff cables make it so
        rough that it is far from its end after the usual rounds.
      longest: further rounds of such a fit at most.
    """

    stuck: float = 1.3
    rotations: int = 4
    rotation_sigma: float = 0.4
    damping: tuple[float, ...] = (1e-4, 1e-2, 0.1, 1.0, 10.0)
    rounds: int = 6
    rounds_before_elimination: int = 2
    finalists: int = 2
    eased: float = 0.2
    before: int = 2
    after: int = 4
    going: float = 0.1
    longest: int = 20


@dataclass(frozen=True)
class NuisanceSettings:
    """Numbers of the MJCF that are known only so well.

    Attributes:
      beside: standard deviations from what was said, or found, where a fit begins, too.
      finalists: beginnings that are fitted for more than a round.
      far_off: times the noise above which no other beginnings are sought: they are not what is wrong.
      rounds: further ones for every beginning beside what was found.
      repeats: times that a fit begins beside what was found, at most.
      worth: fall of the cost that this must bring to be repeated [sigma^2].
      shakes: times that a fit of a robot as built begins beside what was found.
      shake: standard deviation of these moves, in those of what is known of the numbers: as little as takes a
        fit off the edges that contacts make in its cost.
      most_by_shaking: fall of the cost that such moves may bring [sigma^2]: 100 to 170 were seen, and a fit
        that is farther from its target is not moved.
      max_rounds_to_target: further rounds like the last one, within which a fit of a robot as built must have
        reached its target; hardly one brings more than the one before it.
    """

    beside: tuple[float, ...] = (-1.0, 1.0)
    finalists: int = 2
    far_off: float = 2.0
    rounds: int = 2
    repeats: int = 4
    worth: float = 4.0
    shakes: int = 3
    shake: float = 0.1
    most_by_shaking: float = 500.0
    max_rounds_to_target: float = 10.0


@dataclass(frozen=True)
class AsBuiltSettings:
    """How far the numbers of a robot are from those of its MJCF: standard deviations, part by part.

    They are those of a robot that somebody has measured with a ruler, scales and a protractor; a better one
    has a share of them (`SelectionSettings.as_built_shares`). Where all of them together explain what is
    left, no single effect is named for it.

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
class NetworkSettings:
    """The own errors of a trained model.

    Attributes:
      draws: of initial states nearby; half make the covariance, half test it.
      place, speed: standard deviations of these states, in natural units.
      quantile: of its own errors that a network's residual must exceed.
      passes: the search is repeated from the plant with what was found, so many times at most: where that
        plant starts depends on what it lacks.
    """

    draws: int = 96
    place: float = 0.01
    speed: float = 0.03
    quantile: float = 0.95
    passes: int = 2


@dataclass(frozen=True)
class ModelDiscrepancySettings:
    """What no model explains, as a scale of error beside noise.

    Attributes:
      least: times the noise that the best model is off, from which that is counted in, too: below it, noise
        is what disturbs.
      passes: of the search with an estimate of it, at most.
      stands: times by which the next estimate may differ from one that stands.
    """

    least: float = 1.5
    passes: int = 2
    stands: float = 1.5


@dataclass(frozen=True)
class FittingSettings:
    """Everything about one fit."""

    initial_states: InitialStateSettings = InitialStateSettings()
    jacobian: JacobianSettings = JacobianSettings()
    least_squares: LeastSquaresSettings = LeastSquaresSettings()
    stopping: FitStoppingSettings = FitStoppingSettings()
    refinement: RefinementSettings = RefinementSettings()
    multistart: MultistartSettings = MultistartSettings()
    nuisance: NuisanceSettings = NuisanceSettings()
    as_built: AsBuiltSettings = AsBuiltSettings()
    network: NetworkSettings = NetworkSettings()
    discrepancy: ModelDiscrepancySettings = ModelDiscrepancySettings()


@dataclass(frozen=True)
class ScoreSettings:
    """The score test.

    Attributes:
      large: change that a typical size makes in some window, above which a part of it is tried, too
        [sigma]: where a robot rolls, it soon rolls elsewhere.
      part: of a typical size that is tried then.
    """

    large: float = 1.0
    part: float = 0.1


@dataclass(frozen=True)
class PairSettings:
    """Two candidates scored together.

    Attributes:
      count: pairs that are fitted.
      more: times what the best candidate explains alone, from which a pair is tried.
      among: candidates, the best ones.
      singular: condition number of two effects that cannot be told apart.
    """

    count: int = 1
    more: float = 1.2
    among: int = 25
    singular: float = 1e6


@dataclass(frozen=True)
class FormSettings:
    """Other forms of an effect that was found.

    Attributes:
      spread: standard deviation of the logarithm of how much larger an effect is at one part than at another:
        most are within a factor of two.
      rivals: further effects that are fitted with a size for each part, where the found one has that; and
        forms that are fitted beside the candidates, at most.
      more: times what the best candidate explains, from which another law, or an effect at one part alone, is
        fitted beside it.
      enough: share of what is left beyond noise that the best candidate promises, from which no effect at one
        part alone is asked about.
      alone: share of the sum over all parts that the largest one must have, for the effect to be tried there
        alone; factors are drawn to one, so that those of the others do not vanish.
    """

    spread: float = 0.5
    rivals: int = 2
    alone: float = 0.4
    more: float = 1.2
    enough: float = 0.9


@dataclass(frozen=True)
class ScreeningSettings:
    """Candidates as seen from the first estimates of the initial states.

    Attributes:
      sizes: that are tried, in typical sizes.
      promised: of what a fit leaves, what some score must promise for nothing else to be tried.
      explained: of what the first estimates leave, what a candidate must explain there.
    """

    sizes: tuple[float, ...] = (-2.0, -1.0, 1.0, 2.0)
    promised: float = 0.5
    explained: float = 0.5


@dataclass(frozen=True)
class SelectionSettings:
    """The stepwise search.

    Attributes:
      shortlist: candidates that are fitted in each forward step.
      share: of the best candidate's LM statistic that one needs to be fitted.
      per_family: places of one effect on the short list.
      max_forward_steps: of the search.
      max_effects: that are found together.
      least_share: of what an answer leaves beyond noise, that another effect must promise to explain.
      least_share_of_last: the same of the last one that may be added, without which the answer is not the
        whole one anyway.
      by_chance: of what a fit leaves beyond noise, what other initial states may explain as well.
      slight_fall: of the cost in a round, by which no comparison is decided [sigma^2].
      max_rounds_to_target_of_last: `FitStoppingSettings.max_rounds_to_target` where it is about the last
        effect that may be added.
      max_rounds_to_target_of_law: the same of a law of no library: one that is given up too early is an
        effect wrongly named.
      makes_good: share of what a robot as built explains more than the effects found beside it, that one more
        effect must explain in its place.
      usually_off: standard deviations of a number of a robot as built, up to which an effect that changes the
        same is no answer beside another one in the place of these numbers.
      unlikely: probability that numbers of a robot as built, which are right, explain so much; below it
        they are doubted.
      as_built_shares: of the deviations of a robot as built [-]; the one counts with which recordings are the
        most likely, since nobody knows how well a robot was made.
      rival: share of an effect's LM statistic from which another is tried in its place.
      suspect_share: share by which a number of the MJCF is off at most.
      restart_mean_square: of a window, from which its initial state is doubted before anything is said to
        be left [sigma^2].
    """

    shortlist: int = 4
    share: float = 0.5
    per_family: int = 2
    max_forward_steps: int = 6
    max_effects: int = 3
    least_share: float = 0.2
    least_share_of_last: float = 0.4
    by_chance: float = 0.1
    slight_fall: float = 5.0
    max_rounds_to_target_of_last: float = 1.0
    max_rounds_to_target_of_law: float = 40.0
    makes_good: float = 0.5
    usually_off: float = 2.0
    unlikely: float = 1e-3
    as_built_shares: tuple[float, ...] = (0.125, 0.25, 0.5, 1.0)
    rival: float = 0.8
    suspect_share: float = 0.25
    restart_mean_square: float = 1.1
    score: ScoreSettings = ScoreSettings()
    pairs: PairSettings = PairSettings()
    forms: FormSettings = FormSettings()
    screening: ScreeningSettings = ScreeningSettings()


@dataclass(frozen=True)
class DiscrepancySettings:
    """The training of a discrepancy model.

    Attributes:
      beginnings: hidden layers whose outputs are trained for a round, to go on with the best.
      rounds: of the best of them, at most.
      patience: rounds that explain little before it is given up: the next one may explain much.
      step: of a finite difference of an output, in typical sizes.
      shown: effects that it is said to resemble.
    """

    beginnings: int = 2
    rounds: int = 5
    patience: int = 2
    step: float = 0.05
    shown: int = 3


@dataclass(frozen=True)
class CheckSettings:
    """What is asked of an answer.

    Attributes:
      rare: probability of differences between windows, by noise, that count as none.
      least_told: share of what all windows tell of a size, below which one tells nothing of it.
      shift: standard deviations of the initial states by which they are moved, to see what of an effect is
        still detected: a whole one leaves the valley of the cost where there are contacts.
      pieces: of a window, in which what is left is located.
      half: of what the highest piece exceeds noise by, above which pieces beside it belong to it.
      astray: times the mean square of an unfitted start, from which a window's fit has not converged.
      most_astray: share of such windows from which nothing can be said.
    """

    rare: float = 1e-3
    least_told: float = 1e-3
    shift: float = 0.5
    pieces: int = 10
    half: float = 0.5
    astray: float = 4.0
    most_astray: float = 0.5
    discrepancy: DiscrepancySettings = DiscrepancySettings()


@dataclass(frozen=True)
class Limits:
    """What counts as seen, and what as noise.

    Attributes:
      threshold: score from which an effect counts as seen.
      equally_good: difference of two criteria (BIC) below which data do not tell models apart.
      max_residual_variance: of what is left, above which it is more than noise, were that known exactly.
      max_held_out_variance: of what is left on held-out recordings, above which numbers of a robot as built
        explain only the recordings that they were fitted to.
      least_gain: share of what the model as it was leaves beyond noise, on windows that were not fitted,
        that effects must take away to be named as a part of what is missing.
      partial: the same on the recordings that were fitted, above which an answer beside something else is
        `PARTIAL`: most of the error has a name.
      adopted: share of the held-out error beyond noise, as mean squares, from which effects beside something
        that no effect explains are adopted unnamed.
      tolerance: root mean square beyond noise that a model may be off without anybody wanting to know more
        [m]; 0 to know all.
      sure: standard deviations of the noise's own error on top of that.
      correlated: correlation from sample to sample, likewise.
      inconstant: differences of a size between windows, likewise.
      outstanding: standard deviations of noise by which one window may stand out.
      other: of what an answer and another law explain, what the other one does.
      margin: times a model's own errors in a few draws, which seldom are the worst of them.
    """

    threshold: float = 25.0
    equally_good: float = 10.0
    max_residual_variance: float = 1.05
    max_held_out_variance: float = 1.25
    least_gain: float = 0.1
    partial: float = 0.5
    adopted: float = 0.5
    tolerance: float = 0.0
    sure: float = 2.0
    correlated: float = 0.05
    inconstant: float = 1.0
    outstanding: float = 6.0
    other: float = 0.1
    margin: float = 1.5


@dataclass(frozen=True)
class Settings:
    """All tuned numbers of a diagnosis."""

    windows: WindowSettings = WindowSettings()
    fitting: FittingSettings = FittingSettings()
    selection: SelectionSettings = SelectionSettings()
    checks: CheckSettings = CheckSettings()
    limits: Limits = Limits()


@dataclass(frozen=True)
class Setting:
    """One tuned number.

    Attributes:
      value: of it.
      what: it is, as the docstring of its record says.
    """

    value: float
    what: str


def numbers(settings: Any) -> dict[str, Setting]:
    """All single numbers of settings, by their paths: "selection.shortlist"."""
    return dict(_numbers(settings))


def unusual(settings: Settings) -> dict[str, float]:
    """The numbers that differ from the usual ones, by their paths."""
    usual = numbers(Settings())
    return {
        path: setting.value
        for path, setting in numbers(settings).items()
        if setting.value != usual[path].value
    }


def _numbers(settings: Any, prefix: str = "") -> Iterator[tuple[str, Setting]]:
    for field in fields(settings):
        value, path = getattr(settings, field.name), f"{prefix}{field.name}"
        if is_dataclass(value):
            yield from _numbers(value, f"{path}.")
        elif isinstance(value, int | float):
            yield path, Setting(value, _said_of(field.name, settings))


def _said_of(name: str, record: Any) -> str:
    """What the docstring of a record says of one of its attributes, in one line; "" for nothing."""
    _, _, attributes = (getdoc(type(record)) or "").partition("Attributes:\n")
    for entry in re.split(r"\n(?=  \S)", attributes):
        names, _, text = entry.partition(":")
        if name in names.strip().split(", "):
            return " ".join(text.split())
    return ""


def changed(settings: S, changes: Mapping[str, float]) -> S:
    """Settings with other numbers.

    Args:
      settings: `Settings`, or a part of them.
      changes: path -> number.

    Raises:
      UnknownNameError: no such path.
      ConfigError: a number that a setting cannot be.
    """
    known = numbers(settings)
    for path, number in changes.items():
        default = lookup(known, path, "setting").value
        bounds, whole = (COUNT, "whole ") if isinstance(default, int) else (NUMBER, "")
        if number not in bounds or (whole and number != int(number)):
            raise ConfigError(f"{path} must be a {whole}number {bounds}; got {number:g}.")
        settings = _with(settings, path.split("."), type(default)(number))
    return settings


def _with(settings: Any, path: list[str], number: float) -> Any:
    name, *rest = path
    value = _with(getattr(settings, name), rest, number) if rest else number
    return replace(settings, **{name: value})
