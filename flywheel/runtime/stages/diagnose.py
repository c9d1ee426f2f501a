"""Diagnose: identify effects missing from the plant with the recordings, before episodes are collected."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from flywheel.diagnosis import Diagnosis, Verdict
from flywheel.diagnosis.adoption import adoptable
from flywheel.diagnosis.results.answer import Answer
from flywheel.errors import DataError
from flywheel.reports.diagnosis_page import diagnosis_page
from flywheel.results import DiagnosisNote
from flywheel.runtime.pool.jobs import Job
from flywheel.runtime.run.context import Run
from flywheel.runtime.stages.outcomes import Iteration
from flywheel.runtime.stages.scoring import score_jobs, scored
from flywheel.runtime.workers.episode_plan import Effects
from flywheel.runtime.workers.sim_worker import KnownPlant

EXPECTED_SECONDS = 60.0  # of one diagnosis; for the remaining time that is shown


def diagnose(run: Run, iteration: Iteration) -> DiagnosisNote | None:
    """Diagnose the plant and write the answer.

    Returns:
      The answer; None if the diagnosis killed several workers and was set aside.
    """
    number = iteration.number
    if (done := run.folder.diagnosis(number)) is not None:
        return done
    before = run.effects(number - 1)
    fit = _used(run, run.recordings("train", number))
    held_out = _used(run, run.recordings("test", number))
    arguments = (before, fit, held_out)
    job = Job(f"i{number:04d}-diagnose", "sim", "diagnose", arguments, size=EXPECTED_SECONDS)
    report = iteration.add(run.do([job], f"{number}: diagnose"))
    if job.id not in report.results:
        return None
    found: Diagnosis = report.results[job.id]
    note = _note(found, before)
    if note.adopted:
        note = unless_worse(note, before, *_off(run, iteration, (before, note.effects)))
    about = {"recordings": ", ".join(fit), "held out": ", ".join(held_out) or "none"}
    page = diagnosis_page(found, about)
    return run.folder.keep_diagnosis(number, note, page)


def _off(run: Run, iteration: Iteration, plants: Sequence[Effects]) -> list[float]:
    """Prediction errors of plants on the held-out recordings [% of the length]; NaN without any."""
    number = iteration.number
    episodes = run.recordings("test", number)
    jobs = [
        score_jobs(run, f"i{number:04d}-plant-{i}", KnownPlant(each), episodes, each, full=False)
        for i, each in enumerate(plants)
    ]
    title = f"{number}: predict the held-out recordings"
    report = iteration.add(run.do([job for each in jobs for job in each], title))
    errors = [scored(report, each) for each in jobs]
    return [math.nan if each is None else each.short.e_pos_rmse for each in errors]


def unless_worse(
    note: DiagnosisNote, before: Effects, off_before: float, off_after: float
) -> DiagnosisNote:
    """A diagnosis without adoption if the plant would predict worse with it.

    With fitted starts an effect may gain, and yet make predictions from measurements worse: an
    imitation of the missing effect does.

    Args:
      note: adopts something.
      before: effects of the plant without it.
      off_before, off_after: errors of predictions of held-out recordings without and with it [% of
        the length]; NaN if a plant cannot predict them. If the old one cannot, the new one is
        accepted.
    """
    if math.isnan(off_before) or off_after <= off_before:
        return note
    found = ", ".join(effect.label for effect in note.effects)
    reason = (
        f"{note.verdict}: the plant is unchanged. Its prediction error on held-out recordings is "
        f"{off_before:.2f} %; with {found} it would be {off_after:.2f} %."
    )
    return note.model_copy(update={"effects": before, "adopted": False, "reason": reason})


def _used(run: Run, recordings: list[str]) -> list[str]:
    """The recordings for a diagnosis: all, or some that are spread over all (`episode_seconds`)."""
    config = run.config.diagnose
    if config.episode_seconds is None:
        return recordings
    count = min(len(recordings), math.ceil(config.seconds / config.episode_seconds))
    return [recordings[i * len(recordings) // count] for i in range(count)]


def _note(found: Diagnosis, before: Effects) -> DiagnosisNote:
    """A diagnosis in the form stored with the run."""
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
    share = (
        ""
        if said.held_out is None
        else (f"{said.held_out.explained:.0%} of the held-out error removed, ")
    )
    unexplained = said.verdict in (Verdict.OUTSIDE_LIBRARY, Verdict.PARTIAL)
    beside = f" ({share}something else is left)" if unexplained else ""
    return after, f"{said.verdict}: the plant now has {labels}{beside}."
