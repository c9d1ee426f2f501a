"""Count how many small faults of the source its tests notice: `python -m tests.mutants --help`."""

from __future__ import annotations

import argparse
import hashlib
import signal
import sys
import time
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.mutants.mutation import Mutant, mutants_of
from tests.mutants.trial import ELSEWHERE, PASSED, ROOT, TIMED_OUT, Bench, Outcome, prepare

HERE = Path(__file__).parent
SLOWER = 3.0  # times as long as with the sound source, and a mutant's tests are ended
SPARE = 20.0  # beside that, for a machine that others use too [s]


@dataclass(frozen=True)
class Source:
    """A file and the tests that should notice its changes."""

    path: str
    tests: tuple[str, ...]
    text: str

    @property
    def lines(self) -> int:
        """Its size: lines that are not empty."""
        return sum(bool(line.strip()) for line in self.text.splitlines())


@dataclass(frozen=True)
class Row:
    """What became of the mutants of one file."""

    caught: int
    equivalent: int
    survived: tuple[Mutant, ...]

    @property
    def total(self) -> int:
        return self.caught + self.equivalent + len(self.survived)


def sources(wanted: Sequence[str]) -> list[Source]:
    """Those in sources.toml; all, or the wanted ones.

    Raises:
      SystemExit: a wanted file is not there.
    """
    found: dict[str, Source] = {}
    for entry in tomllib.loads((HERE / "sources.toml").read_text())["source"]:
        for file in sorted(ROOT.glob(entry["files"])):
            path = file.relative_to(ROOT).as_posix()
            found[path] = Source(path, tuple(entry["tests"]), file.read_text())
    if unknown := [path for path in wanted if path not in found]:
        raise SystemExit(f"Not in {HERE / 'sources.toml'}: {', '.join(unknown)}.")
    return [found[path] for path in wanted or sorted(found)]


def equivalents() -> dict[tuple[str, ...], str]:
    """Mutants that no test should notice -> why, of equivalent.toml."""
    entries = tomllib.loads((HERE / "equivalent.toml").read_text()).get("mutant", [])
    return {(e["file"], e["where"], e["line"], e["becomes"]): e["why"] for e in entries}


def shares(sizes: Sequence[int], most: Sequence[int], total: int) -> list[int]:
    """Whole numbers in proportion to sizes, each at most what there is, that add up to the total."""
    given = [0] * len(sizes)
    for _ in range(min(total, sum(most))):
        # the one that is furthest behind its share
        open_ = [i for i, n in enumerate(given) if n < most[i]]
        given[min(open_, key=lambda i: (given[i] + 0.5) / sizes[i])] += 1
    return given


def drawn(files: Sequence[Source], seed: int, sample: int) -> dict[str, list[Mutant]]:
    """Mutants of each file, in proportion to its lines. Which ones hangs on the seed and on themselves.

    So an edit of a file hardly changes what else is drawn of it, and nothing of the other files.
    """
    every = [mutants_of(source.path, source.text) for source in files]
    counts = shares([s.lines for s in files], [len(m) for m in every], sample)

    def lot(mutant: Mutant) -> bytes:
        return hashlib.sha256(f"{seed} {mutant.key}".encode()).digest()

    return {
        source.path: sorted(sorted(mutants, key=lot)[:count], key=lambda m: m.line)
        for source, mutants, count in zip(files, every, counts, strict=True)
    }


class Progress:
    """Says after each mutant what became of it, at what rate, and how long the rest will take."""

    def __init__(self, total: int) -> None:
        self._total, self._done, self._begun = total, 0, time.monotonic()

    def told(self, mutant: Mutant, what: str, seconds: float = 0.0) -> None:
        self._done += 1
        passed = time.monotonic() - self._begun
        left = (self._total - self._done) * passed / self._done
        rate = 60 * self._done / passed
        print(
            f"[{self._done:3d}/{self._total}] {what:10s} {seconds:5.1f} s  {mutant.path}:{mutant.line}"
            f"  ({rate:.0f} a minute, {left / 60:.0f} min left)",
            flush=True,
        )


def counted(
    bench: Bench,
    source: Source,
    mutants: Sequence[Mutant],
    known: Mapping[tuple[str, ...], str],
    progress: Progress,
) -> Row:
    """Test the mutants of one file.

    Raises:
      SystemExit: the tests of the sound file fail.
    """
    sound = bench.tested(source.tests, 600.0)
    if sound.code != PASSED:
        raise SystemExit(f"{source.path} as it is does not pass its tests.\n{sound.printed}")
    caught, equivalent, survived = 0, 0, []
    for mutant in mutants:
        if mutant.key in known:
            equivalent += 1
            progress.told(mutant, "equivalent")
            continue
        limit = SLOWER * sound.seconds + SPARE
        outcome = bench.tested(source.tests, limit, mutant.path, mutant.source)
        caught += outcome.caught
        progress.told(mutant, _in_a_word(outcome), outcome.seconds)
        if not outcome.caught:
            survived.append(mutant)
            print(mutant, flush=True)
    return Row(caught, equivalent, tuple(survived))


def _in_a_word(outcome: Outcome) -> str:
    if outcome.code == ELSEWHERE:
        raise SystemExit("The tests did not import the copied tree; nothing was tested.")
    if not outcome.caught:
        return "SURVIVED"
    return "timed out" if outcome.code == TIMED_OUT else "caught"


def show(rows: Mapping[str, Row], seconds: float) -> None:
    """A table of the files, and every survivor."""
    print(f"\n{'file':40s} mutants equivalent caught survived")
    for path, row in rows.items():
        print(
            f"{path:40s} {row.total:7d} {row.equivalent:10d} {row.caught:6d} {len(row.survived):8d}"
        )
    total, same, caught = (
        sum(getattr(row, what) for row in rows.values())
        for what in ("total", "equivalent", "caught")
    )
    left = total - same
    print(f"{'all':40s} {total:7d} {same:10d} {caught:6d} {left - caught:8d}")
    share = f"{caught / left:.1%}" if left else "none"
    print(f"\n{caught} of {left} that are not equivalent are caught: {share}. {seconds:.0f} s.")
    for row in rows.values():
        for mutant in row.survived:
            print(f"survived: {mutant}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit code 0 if enough of the mutants are caught."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument(
        "files", nargs="*", help="sources, as in sources.toml; all of them by default"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the sample")
    parser.add_argument("--sample", type=int, default=200, help="mutants in all")
    parser.add_argument("--least", type=float, default=0.9, help="share that must be caught")
    parser.add_argument("--list", action="store_true", help="show the mutants and test nothing")
    asked = parser.parse_args(arguments)
    files = sources(asked.files)
    chosen = drawn(files, asked.seed, asked.sample)
    if asked.list:
        print(*(mutant for mutants in chosen.values() for mutant in mutants), sep="\n")
        return 0
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # through `finally`: the copy goes
    begun, known = time.monotonic(), equivalents()
    progress = Progress(sum(map(len, chosen.values())))
    prepare()
    rows: dict[str, Row] = {}
    try:
        with Bench() as bench:
            for source in files:
                mutants = chosen[source.path]
                if mutants:
                    rows[source.path] = counted(bench, source, mutants, known, progress)
    finally:
        show(rows, time.monotonic() - begun)
    caught = sum(row.caught for row in rows.values())
    left = sum(row.total - row.equivalent for row in rows.values())
    return 0 if caught >= asked.least * left else 1


if __name__ == "__main__":
    sys.exit(main())
