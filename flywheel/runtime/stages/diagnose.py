"""Diagnose: which effects the plant lacks to explain the recordings, before episodes are collected."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from flywheel.diagnosis import Diagnosis, Verdict
from flywheel.diagnosis.adoption import adoptable
from flywheel.diagnosis.results.answer import Answer
from flywheel.errors import DataError
from flywheel.reports.diagnosis_page import diagnosis_page
from flywheel.runtime.pool.jobs import Job
from flywheel.runtime.results import DiagnosisNote
from flywheel.runtime.run.context import Run
from flywheel.runtime.stages.outcomes import Tally
from flywheel.runtime.workers.episode_plan import Effects

EXPECTED_SECONDS = 60.0  # of one diagnosis; for the remaining time that is shown


def diagnose(run: Run, iteration: int, tally: Tally) -> DiagnosisNote | None:
    """Diagnose the plant and write down the answer.

    Returns:
      The answer; None if the diagnosis took several workers down and was set aside.
    """
    if (done := run.folder.diagnosis(iteration)) is not None:
        return done
    before = run.effects(iteration - 1)
    fit = _used(run, run.recordings("train", iteration))
    held_out = _used(run, run.recordings("test", iteration))
    arguments = (before, fit, held_out)
    job = Job(f"i{iteration:04d}-diagnose", "sim", "diagnose", arguments, size=EXPECTED_SECONDS)
    report = tally.add(run.do([job], f"{iteration}: diagnose"))
    if job.id not in report.results:
        return None
    found: Diagnosis = report.results[job.id]
    about = {"recordings": ", ".join(fit), "held out": ", ".join(held_out) or "none"}
    page = diagnosis_page(found, about)
    return run.folder.keep_diagnosis(iteration, _note(found, before), page)


def _used(run: Run, recordings: list[str]) -> list[str]:
    """The recordings that a diagnosis uses: all, or some that are spread over all (`episode_seconds`)."""
    config = run.config.diagnose
    if config.episode_seconds is None:
        return recordings
    count = min(len(recordings), math.ceil(config.seconds / config.episode_seconds))
    return [recordings[i * len(recordings) // count] for i in range(count)]


def _note(found: Diagnosis, before: Effects) -> DiagnosisNote:
    """A diagnosis as it is kept with the run."""
    answer, held_out = found.summary(), found.held_out
    after, reason = _next_effects(answer, before)
    return DiagnosisNote(
        verdict=found.verdict,
        effects=after,
        adopted=after != before,
        reason=reason,
        noise=found.errors.noise,
        baseline=found.errors.baseline,
        augmented=found.errors.augmented,
        held_out_baseline=None if held_out is None else held_out.baseline,
        held_out_augmented=None if held_out is None else held_out.augmented,
        answer=answer,
    )


def _next_effects(answer: Mapping[str, Any], before: Effects) -> tuple[Effects, str]:
    """The plant's effects from here on, and the reason for them."""
    try:
        after = adoptable(answer)
    except DataError as error:
        return before, str(error)
    labels, said = ", ".join(effect.label for effect in after), Answer.of(answer)
    share = "" if said.held_out is None else f"{said.held_out.explained:.0%} of what was held out, "
    unexplained = said.verdict in (Verdict.OUTSIDE_LIBRARY, Verdict.PARTIAL)
    beside = f" ({share}something else is left)" if unexplained else ""
    return after, f"{said.verdict}: the plant now has {labels}{beside}."
