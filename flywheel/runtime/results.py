"""What an iteration and a run produced: the records that the loop writes and reports read."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, Self, TypeVar

from pydantic import Field, ValidationError

from flywheel.effects import WrittenTerm
from flywheel.errors import DataError
from flywheel.files import MB, read_bytes
from flywheel.outputs import write_output
from flywheel.runtime.measures import (
    DiagnosisNote,
    ErrorNumbers,
    Errors,
    GateDecision,
    LeadTimes,
    Navigation,
    Overlay,
    PathInside,
    ResultRecord,
    Success,
    TrainingPoint,
    Walk,
)
from flywheel.runtime.run.identity import read_begun
from flywheel.seals import Seal, Unsound, check_seal, sealed, unsealed
from flywheel.validation import first_problem

Arm = Literal["mppi", "control"]
RESULT_FILE, RESULT = "result.json", "result"
LARGEST_RESULT = 200 * MB  # [bytes]; one of ten iterations has some 5 MB
NOTHING: Mapping[str, str] = MappingProxyType({})


class IterationResult(ResultRecord):
    """One turn of the flywheel in one arm.

    Attributes:
      iteration: 0 is gaits, random controls and drops.
      arm: "mppi", or "control" (as many episodes and optimiser steps, but random controls).
      snapshot, parent_snapshot: digests of the data the model was trained on, and of the former.
      model: digest of the weights.
      validation, test: errors; None where not run. Tests are simulated episodes.
      recordings: errors on the recordings that are kept for tests, the same ones in every iteration;
        None where there are none.
      navigation: closed-loop evaluation with this model; None where not run.
      episodes, steps: of training data in the snapshot, in all.
      new_episodes, new_steps: collected by this iteration.
      restarts, quarantined, invalid: workers restarted, tasks set aside, episodes thrown away.
      seconds: wall time per stage ("collect", "snapshot", "train", "evaluate", "decide") [s].
      cpu_seconds: that the workers' processes spent on it, of all arms: in the result of "mppi" [s].
      diagnosis: what the plant was found to lack before this iteration; None where nobody asked.
      video: path relative to the run folder, or "".
    """

    iteration: int
    arm: Arm = "mppi"
    snapshot: str
    parent_snapshot: str = ""
    model: str
    validation: Errors | None = None
    test: Errors | None = None
    recordings: Errors | None = None
    navigation: Navigation | None = None
    episodes: int = 0
    steps: int = 0
    new_episodes: int = 0
    new_steps: int = 0
    restarts: int = 0
    quarantined: int = 0
    invalid: int = 0
    seconds: dict[str, float] = Field(default_factory=dict)
    cpu_seconds: float = 0.0
    curve: tuple[TrainingPoint, ...] = ()
    gate: GateDecision | None = None
    overlay: Overlay | None = None
    diagnosis: DiagnosisNote | None = None
    video: PathInside = ""


class PooledTest(ResultRecord):
    """Errors of one iteration's model on the test episodes of *all* iterations."""

    arm: Arm
    iteration: int
    model: str
    errors: Errors


class UnseenCourse(ResultRecord):
    """Closed-loop episodes on a course that no model was trained on.

    Attributes:
      course: its name.
      navigation: of the last champion.
      oracle: of MPPI on the plant itself; None where not run.
      video: path relative to the run folder, or "".
    """

    course: str
    navigation: Navigation
    oracle: Navigation | None = None
    video: PathInside = ""


class RunResult(ResultRecord):
    """A run so far. The loop saves it after every iteration; reports read it, finished or not.

    Attributes:
      name, key: for people; and the unique key that resume and MLflow find the run by.
      config, config_digest: as resolved and validated; sha256 of it.
      code, versions: of this project; of the engines it stands on.
      robot, robot_digest, length: L is the characteristic length [m].
      iterations: in the order in which they ended, both arms.
      pooled: every model on the pooled test set (filled at the end).
      floor: MuJoCo restarted from the same partial observations, on the pooled test set,
        with the roll of each rod drawn at random.
      informed_floor: the same with the roll computed from the cables, by exact parameters.
      persistence: "nothing moves", on the same set.
      persistence_on_recordings: the same on the recordings that are kept for tests.
      oracle: MPPI on the plant itself; the ceiling of success.
      unseen: the last champion on courses that it never met.
      notes: sentences that the page must show among its limits.
    """

    name: str
    key: str
    config: dict[str, Any] = Field(default_factory=dict)
    config_digest: str = ""
    code: str = ""
    versions: dict[str, str] = Field(default_factory=dict)
    robot: str = ""
    robot_digest: str = ""
    length: float = 1.0
    iterations: tuple[IterationResult, ...] = ()
    pooled: tuple[PooledTest, ...] = ()
    floor: Errors | None = None
    informed_floor: Errors | None = None
    persistence: Errors | None = None
    persistence_on_recordings: Errors | None = None
    oracle: Navigation | None = None
    unseen: tuple[UnseenCourse, ...] = ()
    finished: bool = False
    notes: tuple[str, ...] = ()

    @property
    def arms(self) -> tuple[Arm, ...]:
        """The arms that have an iteration, "mppi" first."""
        present = {i.arm for i in self.iterations}
        return tuple(arm for arm in ("mppi", "control") if arm in present)

    def of_arm(self, arm: Arm) -> tuple[IterationResult, ...]:
        """The arm's iterations in order. Iteration 0 is common to both arms."""
        own = {i.iteration: i for i in self.iterations if i.arm == arm}
        shared = {i.iteration: i for i in self.iterations if i.iteration == 0}
        return tuple(i for _, i in sorted((shared | own).items()))

    def effects_before(self, iteration: int) -> tuple[WrittenTerm, ...]:
        """What the plant had beyond its MJCF before a diagnosis in this iteration."""
        earlier = [t for t in self.of_arm("mppi") if t.iteration < iteration and t.diagnosis]
        if earlier and earlier[-1].diagnosis is not None:
            return earlier[-1].diagnosis.effects
        return tuple(WrittenTerm.model_validate(e) for e in self.config.get("effects", ()))

    def pooled_errors(self, result: IterationResult) -> Errors | None:
        """Of an iteration's model on the pooled test set; None where that was not run."""
        for pooled in self.pooled:
            if (pooled.arm, pooled.iteration) == (result.arm, result.iteration):
                return pooled.errors
        return None

    def test_errors(self, result: IterationResult) -> Errors | None:
        """On the pooled test set if that was run, else on the iteration's own test episodes."""
        return self.pooled_errors(result) or result.test

    def save(self, folder: str | Path, rests_on: Mapping[str, str] = NOTHING) -> Path:
        """Write `<folder>/result.json` in one atomic step, under a seal.

        Args:
          folder: of the run.
          rests_on: see `seals.Seal`.
        """
        return save(self, Path(folder) / RESULT_FILE, Seal(RESULT, RESULT, self.key, rests_on))

    @classmethod
    def load(cls, folder: str | Path) -> Self:
        """Read `<folder>/result.json`.

        Raises:
          DataError: there is none, it was altered, or it is another run's than the folder.
        """
        try:
            return cls.read(folder)[0]
        except Unsound as error:
            if error.kind == "missing":
                raise
            hint = f"`flywheel data verify {folder}` says what can be done."
            raise Unsound(f"{error} {hint}", error.kind, error.instead) from None

    @classmethod
    def read(cls, folder: str | Path) -> tuple[Self, Seal | None]:
        """Result and seal; see `load`."""
        owner = ""
        with suppress(Unsound):  # what run.json has is told by `flywheel data verify`
            owner = read_begun(Path(folder)).owner
        return read(cls, Path(folder) / RESULT_FILE, Seal(RESULT, RESULT, owner))


R = TypeVar("R", bound=ResultRecord)


def save(record: ResultRecord, path: Path, seal: Seal) -> Path:
    """Write any of these records as JSON under a seal, in one atomic and durable step."""
    return write_output(path, sealed(json.loads(record.model_dump_json()), seal))


def read(kind: type[R], path: Path, wanted: Seal) -> tuple[R, Seal | None]:
    """Read a record that `save` wrote, and its seal; none in files of before.

    Args:
      kind: of record.
      path: of the file.
      wanted: what its seal has to name; without an owner, anyone's and none will do.

    Raises:
      DataError: no such file, or its contents are not such a record.
      Unsound: it was altered, or is another's.
    """
    if not os.path.lexists(path):
        message = f"There is no {path.name} in {path.parent}; has the run begun?"
        raise Unsound(message, "missing")
    what = f"The file {path}"
    values, seal = unsealed(read_bytes(path, "file", DataError, LARGEST_RESULT), what)
    if seal is not None:
        check_seal(seal, wanted.kind, wanted.name, what)
    elif wanted.owner:
        raise Unsound(f"{what} has no seal, unlike the other files of its run.", "foreign")
    if seal is not None and wanted.owner not in ("", seal.owner):
        words = f"{what} is of another run ({seal.owner}, this one is {wanted.owner})."
        raise Unsound(words, "foreign")
    try:
        return kind.model_validate(values), seal
    except ValidationError as error:
        raise Unsound(f"{what} is not a {kind.__name__}: {first_problem(error)}.") from None


__all__ = [
    "RESULT_FILE",
    "Arm",
    "DiagnosisNote",
    "ErrorNumbers",
    "Errors",
    "GateDecision",
    "IterationResult",
    "LeadTimes",
    "Navigation",
    "Overlay",
    "PooledTest",
    "ResultRecord",
    "RunResult",
    "Success",
    "TrainingPoint",
    "Walk",
    "read",
    "save",
]
