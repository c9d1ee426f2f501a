"""A worker that makes the recordings of a case, has them diagnosed, and compares."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.diagnosis.case_result import CaseResult, Named
from benchmarks.diagnosis.cases import UNSURE, Case, Recorded
from flywheel.data.recordings import read_recording
from flywheel.demo.assessment import library_values, smallest_shown
from flywheel.diagnosis import Diagnosis, Found, diagnose
from flywheel.diagnosis.checks.adequacy import Adequacy
from flywheel.diagnosis.settings import AsBuiltSettings, Settings
from flywheel.dynamics.plant import Plant, PlantParameters
from flywheel.effects import Scales
from flywheel.errors import FlywheelError
from flywheel.options import ImportOptions
from flywheel.records import Trajectory
from flywheel.robots import Robot, load_robot
from flywheel.runtime.pool.jobs import Beat
from flywheel.runtime.workers.model_weights import TrainedModel
from flywheel.truth_simulator.built_robot import Spread
from flywheel.truth_simulator.effect import EffectTruth
from flywheel.truth_simulator.recording import HiddenRecording

EXACT = 1e-9  # standard deviation of what is as the MJCF says
AS_EFFECT = {"cable_stiffness": "cable_stiffness", "mass": "body_mass"}  # of what a case is told


class Examiner:
    """Diagnoses cases.

    Args:
      model: tested instead of the plant.
      told: true distribution of the deviations of messy robots; None for the usual settings.
      threads: of the plant.
    """

    def __init__(
        self, model: TrainedModel | None = None, told: Spread | None = None, threads: int = 1
    ) -> None:
        self._model, self._told, self._threads = model, told, threads
        self.beat = Beat()

    def examine(self, case: Case) -> CaseResult:
        """Make the recordings, diagnose them, and return the result. A failure is a result, too."""
        robot = load_robot(case.robot)
        recorded = case.record(robot)
        truth = tuple(truth_of(each) for each in recorded.held_out.effects)
        empty = CaseResult(
            name=case.name,
            group=case.group,
            robot=case.robot,
            model="" if self._model is None else self._model.weights.digest,
            told=self._told is not None,
            scripts=tuple(each.script for each in recorded.fit),
            truth=truth,
            visible=_visible(case, recorded),
        )
        told = PlantParameters(**case.told)
        plant = Plant(robot, case.measurement.dt, told, threads=self._threads)
        try:
            found = diagnose(
                plant,
                [part for each in recorded.fit for part in _imported(each, robot)],
                _imported(recorded.held_out, robot),
                model=None if self._model is None else self._model.subject(robot, self._threads),
                unsure={AS_EFFECT[name]: UNSURE for name in case.told},
                settings=Settings() if self._told is None else knowing(self._told),
            )
        except FlywheelError as error:
            return empty.model_copy(update={"failure": str(error)})
        return filled(empty, found, Scales.of(robot))


def knowing(spread: Spread) -> Settings:
    """Settings with the true distribution of the robots' deviations."""
    as_built = AsBuiltSettings(
        stiffness=spread.stiffness,
        damping=spread.damping,
        cable_length=spread.rest,
        cable_end=spread.ends,
        drum=spread.gain,
        mass=spread.mass,
        friction=spread.friction,
        softness=spread.contact_stiffness,
        inertia=EXACT,  # it goes with the mass
        centre_of_mass=EXACT,
        marker=EXACT,
    )
    usual = Settings()
    return replace(
        usual,
        fitting=replace(usual.fitting, as_built=as_built),
        selection=replace(usual.selection, as_built_shares=(1.0,)),
    )


def _imported(made: HiddenRecording, robot: Robot) -> list[Trajectory]:
    """The parts of a recording as read from its log, e.g. with corrected swaps of markers."""
    with TemporaryDirectory() as folder:
        log, _ = made.write(Path(folder), "log", robot)
        return [
            each.trajectory
            for each in read_recording(log, robot, ImportOptions(dt=made.dt)).episodes
        ]


def filled(case: CaseResult, found: Diagnosis, scales: Scales) -> CaseResult:
    """The case with the diagnosis' answer."""
    held = found.held_out
    assert held is not None
    answers = tuple(tuple(_named(each) for each in answer) for answer in found.answers)
    own = {each.key for answer in answers[:1] for each in answer}
    named = [
        (Named(effect=s.candidate.effect.name, location=s.candidate.location), s)
        for s in found.ranking
    ]
    others = [s.score for n, s in named if n.key not in own]
    return case.model_copy(
        update={
            "verdict": str(found.verdict),
            "answers": answers,
            "runner_up": max(others, default=0.0) / max(found.ranking[0].score, 1e-9),
            "smallest": _smallest(case, found),
            "noise": found.errors.noise,
            "baseline": found.errors.baseline,
            "augmented": found.errors.augmented,
            "held_out_baseline": held.baseline,
            "held_out": held.augmented,
            "left": _left(found.after),
            "left_before": _left(found.before),
            "other_law": found.misspecification.name,
            "other_score": found.misspecification.score,
            "other_share": found.misspecification.share,
            "other_gain": found.misspecification.gain,
            "time_steps": found.time_steps.taken,
            "seconds": found.seconds,
        }
    )


def _left(left: Adequacy) -> tuple[float, ...]:
    return (left.noise, left.correlation, left.inconstancy, left.loudest)


def _smallest(case: CaseResult, found: Diagnosis) -> float:
    """Smallest visible size of the first hidden effect, over its true size."""
    if not case.truth:
        return float("nan")
    first = case.truth[0]
    return smallest_shown(found.ranking, first.effect, first.location, first.values)


def truth_of(effect: EffectTruth) -> Named:
    """The hidden effects, in the parameters of the library."""
    return Named(effect=effect.name, location=effect.place, values=library_values(effect))


def _named(found: Found) -> Named:
    return Named(
        effect=found.effect,
        location=found.location,
        values={v.name: v.value for v in found.values},
        low={v.name: v.low for v in found.values},
        high={v.name: v.high for v in found.values},
    )


def _visible(case: Case, recorded: Recorded) -> float:
    """Change of the measured points by the effects, in the truth simulator, over the noise.

    Noise and gaps depend on seeds alone, so that they are the same without the effects.
    """
    if not case.effects:
        return 0.0
    robot = load_robot(case.robot)
    without = replace(case, effects=()).record(robot)
    sigma = case.measurement.noise * robot.length
    off = [
        np.nanmean((a.points - b.points) ** 2)
        for a, b in zip(recorded.fit, without.fit, strict=True)
    ]
    return float(np.sqrt(np.mean(off)) / sigma)
