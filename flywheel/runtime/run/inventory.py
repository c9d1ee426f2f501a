"""Checks that a run's folder and store are unchanged.

Every file that a later step needs has a seal, or is listed with its digest in the seal of another
file:

    run.json                         config.yaml, robot.xml, copies of law files and of weights to begin with
    iterations/i0001-mppi.json       its snapshot, the episodes it recorded, its model's files, its video
    iterations/i0001-diagnosis.json  its page
    result.json, of a finished run   the episodes and videos of its end
    the store                        see `flywheel.data`
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from flywheel.data import Damage, Snapshot, TrajectoryStore
from flywheel.errors import DataError, FlywheelError, RunError
from flywheel.results import RESULT_FILE, IterationResult, RunResult
from flywheel.run_identity import HOW, RUN_FILE
from flywheel.runtime.config.run_config import RunConfig
from flywheel.runtime.run.folder import ARMS, SEGMENT, SNAPSHOT, UNFINISHED, RunFolder, name_of
from flywheel.runtime.tracking.dashboard import DATABASE
from flywheel.seals import Kind, Seal, Unsound, file_sha256

TOLD = 8  # faults, and episodes of one, that a message names
OURS = re.compile(
    r"config\.yaml|robot\.xml|run\.json|store|cache|models|iterations|videos|figures|aside|result\.json|"
    rf"robot|report\.html|{re.escape(DATABASE)}.*|mlflow-artifacts|published\.txt"
)
_TURN = re.compile(r"i(\d{4,})-(mppi|control)")
_DIAGNOSIS = re.compile(r"i(\d{4,})-diagnosis")


@dataclass(frozen=True)
class Fault:
    """A changed item in a run's folder or store.

    Attributes:
      kind: of the fault.
      where: path in the folder or in the store.
      what: the fault, in words.
      since: the first iteration that needs the file and has to be repeated; one more than the last
        for the end of the run; None if the whole run needs it.
      idle: True if no later step needs it.
    """

    kind: Kind
    where: str
    what: str
    since: int | None = None
    idle: bool = False

    def __str__(self) -> str:
        return f"{self.where}: {self.what.removesuffix('.')}."


class Inventory:
    """Checks everything in a run's folder and its store.

    Args:
      folder: of the run.
      store: of its episodes.
      thorough: hash every file; otherwise only texts, names and small files.
    """

    def __init__(self, folder: RunFolder, store: TrajectoryStore, thorough: bool = True) -> None:
        self.folder, self.store, self.thorough = folder, store, thorough
        self._config: RunConfig | None = None
        self._turns: dict[str, tuple[IterationResult, Seal]] = {}
        self._result: tuple[RunResult, Seal] | None = None
        self._pages: dict[str, tuple[str, int]] = {}
        self._snapshots: dict[str, Snapshot] = {}

    def faults(self) -> list[Fault]:
        """All faults, in the order in which a run writes its files."""
        found = [*self._beginning(), *self._folders()]
        # Without run.json it cannot be told whose the other files are.
        if not any(fault.where == RUN_FILE for fault in found):
            found += [*self._iterations(), *self._end(), *self._missing(), *self._models()]
        self._snapshots = dict(self._sound_snapshots())
        stored = list(self._of_store())
        told = {fault.where for fault in stored}
        found += self._named()
        if "segments" not in told:
            found += [fault for fault in self._compared() if fault.where not in told]
        return found + stored

    def remedy(self, faults: Iterable[Fault]) -> str:
        """A sentence about remedies; "" if the run needs none of the faulty files."""
        resting = [fault for fault in faults if not fault.idle]
        since = [fault.since for fault in resting if fault.since is not None]
        if any(fault.since is None for fault in resting):
            return (
                f"{HOW} With store={self.folder.path / 'store'} that reuses the episodes, if it "
                "has the same configuration."
            )
        if not since:
            return ""
        first = min(since)
        what = "the end of the run" if first == self.end else f"all from iteration {first} on"
        command = f"`flywheel data rewind {self.folder.path} {first}`"
        return (
            f"Put back copies, and names that were exchanged. Or {command} sets {what} aside, and --resume "
            "does it again."
        )

    def strangers(self) -> list[str]:
        """Foreign names in the folder; they do no harm."""
        names = {path.name for path in self.folder.path.iterdir()}
        with suppress(DataError):
            names -= set(self.folder.copies(self.folder.begun()))
        return sorted(n for n in names if not OURS.fullmatch(n) and not UNFINISHED.fullmatch(n))

    @property
    def end(self) -> int:
        """One more than the number of the last iteration."""
        if self._config is not None:
            return self._config.iterations + 1
        return 1 + max(map(_number, self._turns), default=0)

    def _fault(
        self, error: FlywheelError, where: str, since: int | None = None, idle: bool = False
    ) -> Fault:
        kind = error.kind if isinstance(error, Unsound) else "altered"
        what = str(error).replace(f"The file {self.folder.path / where} ", "it ")
        return Fault(kind, where, what, since, idle)

    def _rested_on(self, since: int) -> str:
        return "the end of the run" if since == self.end else f"iteration {since}"

    def _beginning(self) -> Iterator[Fault]:
        try:
            begun = self.folder.begun()
        except DataError as error:
            yield self._fault(error, RUN_FILE)
            return
        faulty = []
        for name in (*self.folder.copies(begun), self.folder.robot_file.name):
            try:
                begun.check(self.folder.path, name)
            except FlywheelError as error:
                faulty.append(self._fault(error, name))
        try:
            self._config = self.folder.config()
        except FlywheelError as error:
            if not faulty or faulty[0].where == self.folder.robot_file.name:
                yield self._fault(error, self.folder.config_file.name)
        yield from faulty

    def _folders(self) -> Iterator[Fault]:
        """Folders that cannot be read, or are files."""
        for part in ("iterations", "models"):
            path = self.folder.path / part
            if os.path.lexists(path) and not (path.is_dir() and os.access(path, os.R_OK | os.X_OK)):
                yield Fault("altered", part, "it is no folder that can be read", 0)

    def _iterations(self) -> Iterator[Fault]:
        """Faults of the files of iterations and diagnoses themselves."""
        for path in _entries(self.folder.path / "iterations"):
            where, name = f"iterations/{path.name}", path.name.removesuffix(".json")
            if path.name == f"{path.stem}.html" and _DIAGNOSIS.fullmatch(path.stem):
                continue  # a page, which the diagnosis names
            if path.suffix != ".json" or not (_TURN.fullmatch(name) or _DIAGNOSIS.fullmatch(name)):
                yield Fault("foreign", where, "it is no file of a run", idle=True)
                continue
            try:
                self._read(name)
            except DataError as error:
                yield self._fault(error, where, min(_number(name), self.end))

    def _read(self, name: str) -> None:
        if (turn := _TURN.fullmatch(name)) is None:
            iteration = _number(name)
            if (diagnosis := self.folder.kept_diagnosis(iteration)) is not None:
                pages = diagnosis[1].rests_on.items()
                self._pages |= {name: (digest, iteration) for name, digest in pages}
            return
        arm = next(arm for arm in ARMS if arm == turn[2])
        if (kept := self.folder.kept(int(turn[1]), arm)) is not None:
            self._turns[name] = kept

    def _end(self) -> Iterator[Fault]:
        if not os.path.lexists(self.folder.path / RESULT_FILE):
            return
        try:
            self._result = RunResult.read(self.folder.path)
        except DataError as error:
            yield self._fault(error, RESULT_FILE, self.end)
            return
        result = self._result[0]
        if result.key != self.folder.begun().identity.key:
            yield Fault("foreign", RESULT_FILE, f"it is of the run {result.key}", self.end)
        for each in result.iterations:
            name = name_of(each.iteration, each.arm)
            if name in self._turns and not _same(self._turns[name][0], each):
                what = f"of {name} it says otherwise than iterations/{name}.json"
                yield Fault("altered", RESULT_FILE, what, self.end)

    def _missing(self) -> Iterator[Fault]:
        """Missing files of iterations that are followed by later ones, or that the result names."""
        told = self._result[0].iterations if self._result else ()
        wanted = {name_of(each.iteration, each.arm): "result.json tells of it" for each in told}
        for name, (result, _) in self._turns.items():
            if result.diagnosis is not None:
                wanted[f"i{result.iteration:04d}-diagnosis"] = f"iterations/{name}.json tells of it"
        arms = ARMS if self._config is None or self._config.control_arm else ARMS[:1]
        for iteration in range(max(map(_number, self._turns), default=0)):
            for arm in arms if iteration else ARMS[:1]:
                wanted.setdefault(name_of(iteration, arm), "a later one is there")
        for name, why in sorted(wanted.items()):
            path = self.folder.path / "iterations" / f"{name}.json"
            if not os.path.lexists(path):
                what = f"it is missing, though {why}"
                yield Fault("missing", f"iterations/{path.name}", what, _number(name))

    def _models(self) -> Iterator[Fault]:
        for path in _entries(self.folder.path / "models"):
            turn = _TURN.fullmatch(path.name)
            if turn is None or int(turn[1]) >= self.end or not path.is_dir():
                what = "it is no model of this run"
                yield Fault("foreign", f"models/{path.name}", what, idle=True)

    def _seals(self) -> Iterator[tuple[str, str, int]]:
        """Name and digest of all entries of a seal, and the iteration of the seal."""
        seals = [(seal, _number(name)) for name, (_, seal) in self._turns.items()]
        seals += [(self._result[1], self.end)] if self._result else []
        for seal, since in seals:
            for name, digest in seal.rests_on.items():
                yield name, digest, since

    def _compared(self) -> Iterator[Fault]:
        """Segments and snapshots that an iteration needs, and that are missing or altered in the store."""
        there = {f"{SEGMENT}{name}": one.sha256 for name, one in self.store.committed().items()}
        there |= {f"{SNAPSHOT}{name}": one.digest for name, one in self._snapshots.items()}
        for name, digest, since in dict.fromkeys(self._seals()):
            if not name.startswith((SEGMENT, SNAPSHOT)) or there.get(name) == digest:
                continue
            where = f"{name}.json" if name.startswith(SNAPSHOT) else name
            if name in there:
                what = f"rests on its digest {digest[:12]}, but it has {there[name][:12]} now"
                yield Fault("altered", where, f"{self._rested_on(since)} {what}", since)
            else:
                what = f"it is missing; {self._rested_on(since)} rests on it"
                yield Fault("missing", where, what, since)

    def _named(self) -> Iterator[Fault]:
        """Faults of the files in the folder that a seal lists."""
        wanted = {n: (d, i) for n, d, i in self._seals() if not n.startswith((SEGMENT, SNAPSHOT))}
        wanted |= self._pages
        for name, (digest, since) in wanted.items():
            idle = "/served/" not in name  # the others are for people, and for doing it again
            if idle and not self.thorough:
                continue
            try:
                there = file_sha256(self.folder.path / name, "file")
            except Unsound as error:
                yield self._fault(error, name, since, idle)
                continue
            if there != digest:
                yield Fault("altered", name, "it was altered", since, idle)

    def _sound_snapshots(self) -> Iterator[tuple[str, Snapshot]]:
        try:
            names = self.store.snapshots()
        except DataError:  # which the store tells
            return
        for name in names:
            try:
                yield name, self.store.snapshot(name)
            except DataError:
                continue

    def _of_store(self) -> Iterator[Fault]:
        listed: dict[str, int] = {}
        for name, one in self._snapshots.items():
            for segment in one.segments:
                since = _number(name) if _TURN.fullmatch(name) else self.end
                listed[segment] = min(since, listed.get(segment, since))
        for name, _, since in self._seals():
            segment = name.removeprefix(SEGMENT)
            listed[segment] = min(since, listed.get(segment, since))
        for damage in self.store.verify(arrays=self.thorough):
            what = damage.what
            if damage.episodes:
                told = damage.episodes if self.thorough else damage.episodes[:TOLD]
                more = " ..." if len(told) < len(damage.episodes) else ""
                what = f"{what.rstrip('.')}. Episodes: {', '.join(told)}{more}"
            yield Fault(damage.kind, damage.path, what, *self._rests(damage, listed))

    def _rests(self, damage: Damage, listed: Mapping[str, int]) -> tuple[int | None, bool]:
        """The first iteration that needs a damaged file, and True if none does."""
        kind, _, name = damage.segment.rpartition(" ")
        if kind == "":
            return listed.get(name), name not in listed
        if kind == "snapshot":
            turn = _TURN.fullmatch(name)
            return min(int(turn[1]), self.end) if turn else self.end, False
        return None, kind == "file" and damage.kind in ("missing", "foreign")


def check_sound(folder: RunFolder, store: TrajectoryStore) -> None:
    """Stop a run whose files were changed; faults in files that are not needed are ignored.

    Raises:
      RunError: the message names the faults, and the remedies.
    """
    look = Inventory(folder, store, thorough=False)
    found = [fault for fault in look.faults() if not fault.idle]
    if not found:
        return
    lines = [f"  {fault.kind}: {fault}" for fault in found[:TOLD]]
    if len(found) > TOLD:
        lines.append(f"  and {len(found) - TOLD} more")
    text = "\n".join(lines)
    raise RunError(
        f"The run in {folder.path} cannot continue, because its files were "
        f"changed:\n{text}\n{look.remedy(found)} `flywheel data verify {folder.path}` checks "
        "every byte."
    )


def _entries(folder: Path) -> list[Path]:
    """The finished files in a folder; none if it cannot be read."""
    try:
        found = sorted(folder.iterdir())
    except OSError:  # a fault of its own
        return []
    return [path for path in found if not UNFINISHED.fullmatch(path.name)]


def _number(name: str) -> int:
    """The number of the iteration that a name begins with."""
    return int(name[1:].partition("-")[0])


def _same(one: IterationResult, other: IterationResult) -> bool:
    return one.model_dump_json() == other.model_dump_json()  # NaN is not itself
