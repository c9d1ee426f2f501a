"""Diagnose: what the plant lacks to explain the recordings of the robot, before data are collected."""

from __future__ import annotations

from flywheel.runtime.pool.jobs import Job
from flywheel.runtime.results import DiagnosisNote
from flywheel.runtime.run.context import Run
from flywheel.runtime.stages.outcomes import Tally

SIZE = 60.0  # roughly how many seconds it takes


def diagnose(run: Run, iteration: int, tally: Tally) -> DiagnosisNote | None:
    """Ask, and keep the answer; None where the worker that was asked did not survive it."""
    if (there := run.folder.diagnosis(iteration)) is not None:
        return there
    arguments = (run.effects(iteration - 1), run.logs("train"), run.logs("test"))
    job = Job(f"i{iteration:04d}-diagnose", "sim", "diagnose", arguments, size=SIZE)
    report = tally.add(run.do([job], f"{iteration}: diagnose"))
    if job.id not in report.results:
        return None
    note, page = report.results[job.id]
    return run.folder.keep_diagnosis(iteration, note, page)
