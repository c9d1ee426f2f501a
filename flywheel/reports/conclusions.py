"""Results of a run, in sentences derived from its numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, NamedTuple

from flywheel.results import ErrorNumbers, IterationResult, RunResult, Success

Answer = Literal["yes", "no", "open"]
GOAL_ROTATION = 1.1  # of the floor's error
GOAL_POSITION = 2.5  # of the floor's error
GOAL_SUCCESS = 0.8  # of the oracle's rate
LEAST_CHANGE = 0.02  # of an error; anything less counts as no difference


@dataclass(frozen=True)
class Conclusion:
    """One question about a run.

    Attributes:
      answer: "open" if the numbers do not decide, or are missing.
      text: one or two sentences with the numbers.
    """

    answer: Answer
    text: str


class _Pair(NamedTuple):
    """One error of two models.

    Attributes:
      name: of the error, in a word.
      error: the same in full.
      unit: of it.
      goal: allowed ratio to the floor's.
      first, second: its values.
    """

    name: str
    error: str
    unit: str
    goal: float
    first: float
    second: float

    @property
    def ratio(self) -> float:
        return _ratio(self.first, self.second)


def headline(run: RunResult) -> str:
    """The trend of error and success, in one sentence or two."""
    results = run.of_arm("mppi")
    if on_robot := _robot_conclusions(run):
        return " ".join(each.text for each in on_robot)
    if len(results) < 2:
        state = "No iteration has ended yet" if not results else "Only iteration 0 has ended"
        return f"{state}: there is nothing to compare."
    error, success = _error_conclusion(run, results), _success_conclusion(results)
    start = f"From iteration {results[0].iteration} to {results[-1].iteration}"
    tail = "." if run.finished else " (so far: the run has not ended)."
    falls = {
        "yes": "the prediction error fell",
        "no": "the prediction error did not fall",
        "open": "it is undecided whether the prediction error fell",
    }[error.answer]
    rises = {
        "yes": "success rose",
        "no": "success did not rise",
        "open": "it is undecided whether success rose",
    }[success.answer]
    joint = "and" if error.answer == success.answer else "but"
    return f"{start}, {falls} {joint} {rises}{tail}"


def conclusions(run: RunResult) -> list[Conclusion]:
    """The questions that a run can answer by now, most important first."""
    results = run.of_arm("mppi")
    if len(results) < 2:
        return []
    found = [_error_conclusion(run, results)]
    on_robot = _robot_conclusions(run)
    if not on_robot or results[-1].navigation is not None:  # a robot may be driven by plants alone
        found.append(_success_conclusion(results))
    found[:0] = on_robot
    if "control" in run.arms:
        found.append(_control_conclusion(run, results[-1]))
    if run.floor is not None and (errors := run.test_errors(results[-1])) is not None:
        found.append(_floor_conclusion(errors.short, run.floor.short))
        if run.informed_floor is not None:
            found.append(_informed_conclusion(errors.short, run.informed_floor.short))
    if run.oracle is not None and results[-1].navigation is not None:
        found.append(_oracle_conclusion(results[-1].navigation.success, run.oracle.success))
    return found


def rate(success: Success) -> str:
    """A success rate with its counts and interval."""
    if not success.total:
        return "no episodes"
    low, high = success.interval
    return f"{success.reached}/{success.total} ({success.rate:.0%}, {low:.0%} to {high:.0%})"


def _robot_conclusions(run: RunResult) -> list[Conclusion]:
    """Progress of the plant and of the network on the robot; none for a run without one."""
    plant = _plant_conclusion(run)
    found = [] if plant is None else [plant, _network_conclusion(run)]
    return [each for each in found if each is not None]


def _plant_conclusion(run: RunResult) -> Conclusion | None:
    """Progress of the plant on the robot; None for a run without one."""
    given = list(run.robot_errors("given").values())
    plant = run.robot_errors("plant")
    if not given or not plant:
        return None
    before, after = given[-1].short.e_pos_rmse, plant[max(plant)].short.e_pos_rmse
    known = {effect.label for effect in run.effects_before(0)}
    added = [e.label for e in run.effects_before(max(plant) + 1) if e.label not in known]
    noise = "" if run.robot_noise is None else f" (noise {run.robot_noise.e_pos_rmse:.2f} %)"
    if not added:
        text = (
            f"The error of the MJCF on the robot is {before:.2f} %{noise}, and no effect was "
            "added to it."
        )
        return Conclusion("open", text)
    change = f"from {before:.2f} to {after:.2f} %{noise}, with {', '.join(added)} added."
    if _lower(after, before):
        return Conclusion("yes", f"The error of the MJCF on the robot fell {change}")
    return Conclusion("no", f"The error of the MJCF on the robot did not fall: {change}")


def _network_conclusion(run: RunResult) -> Conclusion | None:
    """Progress of the network on the robot; None for fewer than two iterations of one."""
    errors = [each.short.e_pos_rmse for _, each in sorted(run.robot_errors("network").items())]
    if len(errors) < 2:
        return None
    fell = [_lower(after, before) for before, after in pairwise(errors)]
    answer: Answer = "yes" if all(fell) else "open" if _lower(errors[-1], errors[0]) else "no"
    trend = {
        "yes": "fell in every iteration",
        "open": "fell, but not in every iteration",
        "no": "did not fall",
    }[answer]
    values = ", ".join(f"{error:.2f}" for error in errors)
    return Conclusion(answer, f"The network's error on the robot {trend}: {values} %.")


def _error_conclusion(run: RunResult, results: tuple[IterationResult, ...]) -> Conclusion:
    first, last = run.test_errors(results[0]), run.test_errors(results[-1])
    if first is None or last is None:
        return Conclusion("open", "The models were not scored on test episodes.")
    pairs = _pairs(first.short, last.short)
    if not all(math.isfinite(each.first) and math.isfinite(each.second) for each in pairs):
        return Conclusion("no", "A prediction error on test episodes is not finite.")
    fell = [_lower(each.second, each.first) for each in pairs]
    answer: Answer = "yes" if all(fell) else "open" if any(fell) else "no"
    where = "all test episodes of the run"
    if run.pooled_errors(results[0]) is None or run.pooled_errors(results[-1]) is None:
        where = "the test episodes that each iteration had (not the same ones)"
        answer = "open" if all(fell) else answer
    words = [
        f"{each.name} {each.first:.2f} to {each.second:.2f} {each.unit} "
        f"({_change(each.first, each.second)})"
        for each in pairs
    ]
    return Conclusion(answer, f"Short-horizon errors on {where}: {', '.join(words)}.")


def _success_conclusion(results: tuple[IterationResult, ...]) -> Conclusion:
    if results[0].navigation is None or results[-1].navigation is None:
        return Conclusion(
            "open", "Goal reaching was not evaluated in the first and last iteration."
        )
    first, last = results[0].navigation.success, results[-1].navigation.success
    text = f"Goals reached: {rate(first)} to {rate(last)}."
    if not first.total or not last.total or last.rate <= first.rate:
        return Conclusion("no", text)
    if last.interval[0] <= first.interval[1]:
        return Conclusion("open", f"{text} The intervals overlap.")
    return Conclusion("yes", text)


def _control_conclusion(run: RunResult, last: IterationResult) -> Conclusion:
    control = run.of_arm("control")[-1]
    ours, theirs = run.test_errors(last), run.test_errors(control)
    if control.iteration != last.iteration or ours is None or theirs is None:
        return Conclusion("open", "The control arm has not reached the MPPI arm's iteration.")
    pairs = _pairs(ours.short, theirs.short)
    better = [_lower(each.first, each.second) for each in pairs]
    words = [
        f"{each.name} {each.first:.2f} against {each.second:.2f} {each.unit}" for each in pairs
    ]
    text = f"Against random controls instead of MPPI: {', '.join(words)}"
    if last.navigation is not None and control.navigation is not None:
        mine, other = last.navigation.success, control.navigation.success
        better.append(mine.rate > other.rate)
        text += f", goals reached {rate(mine)} against {rate(other)}"
    answer: Answer = "yes" if all(better) else "open" if any(better) else "no"
    return Conclusion(answer, f"{text}.")


def _floor_conclusion(ours: ErrorNumbers, floor: ErrorNumbers) -> Conclusion:
    pairs = _pairs(ours, floor)
    words = [f"{each.error} {each.ratio:.2f} times" for each in pairs]
    return Conclusion(
        "yes" if all(each.ratio <= each.goal for each in pairs) else "no",
        f"Against the floor: {', '.join(words)} that of the restarted plant (goals: "
        f"{' and '.join(str(each.goal) for each in pairs)}).",
    )


def _informed_conclusion(ours: ErrorNumbers, floor: ErrorNumbers) -> Conclusion:
    """Remaining potential: not a goal, but information that the goals must not hide."""
    pairs = _pairs(ours, floor)
    words = [f"{each.error} {each.ratio:.1f} times" for each in pairs]
    return Conclusion(
        "yes" if all(each.ratio <= 1.0 for each in pairs) else "no",
        "Relative to exact physics that also computes the invisible roll (the informed floor): "
        f"{', '.join(words)} its error.",
    )


def _oracle_conclusion(ours: Success, oracle: Success) -> Conclusion:
    if not oracle.reached:
        return Conclusion("open", f"The oracle reached {rate(oracle)}: it is no reference.")
    share = _ratio(ours.rate, oracle.rate)
    return Conclusion(
        "yes" if share >= GOAL_SUCCESS else "no",
        f"Against the oracle, which reached {rate(oracle)}: {share:.0%} of its rate "
        f"(goal: {GOAL_SUCCESS:.0%}).",
    )


def _pairs(first: ErrorNumbers, second: ErrorNumbers) -> list[_Pair]:
    """Both errors of both; without rotations if orientation is not observable."""
    rotation = _Pair("rotation", "rotation error", "deg", GOAL_ROTATION, first.e_rot, second.e_rot)
    position = _Pair(
        "position",
        "position error (RMSE/L)",
        "% RMSE/L",
        GOAL_POSITION,
        first.e_pos_rmse,
        second.e_pos_rmse,
    )
    return [position] if first.turnless and second.turnless else [rotation, position]


def _lower(error: float, reference: float) -> bool:
    """True if lower by more than an insignificant difference; never if one is NaN."""
    return error < (1 - LEAST_CHANGE) * reference


def _ratio(value: float, reference: float) -> float:
    return value / reference if reference else math.nan


def _change(before: float, after: float) -> str:
    return f"{100 * (after - before) / before:+z.1f}%" if before else "from zero"
