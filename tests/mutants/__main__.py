"""Count how many small faults of the source its tests notice: `python -m tests.mutants --help`.

Each fault is one change of one line: another operator, a number one off, a statement left out.
"""

import argparse
import signal
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from tests.mutants.mutation import Mutant
from tests.mutants.sample import Source, drawn, equivalents, outdated, sources
from tests.mutants.trial import ELSEWHERE, PASSED, TIMED_OUT, Bench, Outcome, prepare

SLOWER, SPARE = (
    3.0,
    5.0,
)  # a mutant may compute so many times as long as the sound source, and so much [s]


@dataclass(frozen=True)
class Row:
    """What became of the mutants of one file."""

    caught: int
    equivalent: int
    survived: tuple[Mutant, ...]

    @property
    def total(self) -> int:
        return self.caught + self.equivalent + len(self.survived)


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
      SystemExit: the tests of the sound file fail, or somebody is editing it.
    """
    if (bench.tree / source.path).read_text() != source.text:
        raise SystemExit(f"{source.path} was edited while it was copied. Begin again.")
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
    parser.add_argument("files", nargs="*", help="sources; all in sources.toml by default")
    parser.add_argument("--tests", nargs="+", default=(), help="in the place of those listed there")
    parser.add_argument("--seed", type=int, default=0, help="of the sample")
    parser.add_argument("--sample", type=int, default=200, help="mutants in all")
    parser.add_argument("--least", type=float, default=0.9, help="share that must be caught")
    parser.add_argument("--list", action="store_true", help="show the mutants and test nothing")
    asked = parser.parse_args(arguments)
    files = sources(asked.files, asked.tests)
    chosen = drawn(files, asked.seed, asked.sample)
    if asked.list:
        print(*(mutant for mutants in chosen.values() for mutant in mutants), sep="\n")
        return 0
    known = equivalents()
    for path, *change in outdated(known, files):
        print(f"{path}: equivalent.toml lists what is no mutant any more: {change}")
    rows = count(files, chosen, known)
    caught = sum(row.caught for row in rows.values())
    return (
        0 if caught >= asked.least * sum(row.total - row.equivalent for row in rows.values()) else 1
    )


def count(
    files: Sequence[Source],
    chosen: Mapping[str, Sequence[Mutant]],
    known: Mapping[tuple[str, ...], str],
) -> dict[str, Row]:
    """Test the chosen mutants of all files and show what became of them, if it is ended before, too."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # through `finally`: the copy goes
    begun, rows = time.monotonic(), dict[str, Row]()
    prepare()
    try:
        with Bench() as bench:
            progress = Progress(sum(map(len, chosen.values())))
            for source in files:
                if mutants := chosen[source.path]:
                    rows[source.path] = counted(bench, source, mutants, known, progress)
    finally:
        show(rows, time.monotonic() - begun)
    return rows


if __name__ == "__main__":
    sys.exit(main())
