"""One turn of the flywheel."""

from __future__ import annotations

from flywheel.runtime.measures import ErrorNumbers
from flywheel.runtime.results import IterationResult
from flywheel.runtime.run.context import Run
from flywheel.runtime.run.provenance import keep
from flywheel.runtime.stages import Tally, collect, decide, diagnose, evaluate, snapshot, train
from flywheel.runtime.stages.video import filmed
from flywheel.runtime.tracking.publish import publish_iteration_start


def run_iteration(run: Run, iteration: int) -> list[str]:
    """Turn the flywheel once, in every arm that has not done so yet.

    Returns:
      Sentences about what went wrong on the way.
    """
    arms = [arm for arm in run.arms(iteration) if run.folder.finished(iteration, arm) is None]
    if not arms:
        return []
    tally = Tally()
    if run.tracker is not None:
        for arm in arms:
            publish_iteration_start(run.tracker, iteration, arm)
    if run.config.diagnose.on and iteration:
        with tally.timed("diagnose"):
            diagnose(run, iteration, tally)
    with tally.timed("collect"):
        collected = collect(run, iteration, arms, tally)
    with tally.timed("snapshot"):
        snapshots = snapshot(run, iteration, collected)
    with tally.timed("train"):
        trained = train(run, iteration, snapshots, tally)
    with tally.timed("evaluate"):
        evaluated = evaluate(run, iteration, snapshots, trained, tally)
    for result in decide(run, iteration, collected, snapshots, trained, evaluated, tally):
        keep(run, filmed(run, result))
        run.progress.say(summary(result))
    return tally.problems


def summary(result: IterationResult) -> str:
    """One line for people."""
    words = [f"iteration {result.iteration}"]
    if result.arm != "mppi":
        words[0] += f" ({result.arm} arm)"
    words.append(f"{result.episodes} episodes")
    if result.test is not None:
        words.append(f"test {_errors(result.test.short)}")
    if result.recordings is not None:
        words.append(f"recordings {_errors(result.recordings.short)}")
    if result.diagnosis is not None:
        words.append(f"diagnosis: {result.diagnosis.reason}")
    if result.navigation is not None:
        success = result.navigation.success
        words.append(f"{success.reached} of {success.total} goals reached")
    if result.gate is not None:
        words.append(result.gate.reason)
    return "; ".join(words)


def _errors(numbers: ErrorNumbers) -> str:
    rotation = "" if numbers.turnless else f", e_rot {numbers.e_rot:.2f} deg"
    return f"e_pos {numbers.e_pos_rmse:.2f} %{rotation}"
