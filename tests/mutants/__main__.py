"""Count how many small faults of the source its tests notice: `python -m tests.mutants --help`.

Each fault is one change of one line: another operator, a number one off, a statement left out.
"""

import argparse
import ast
import signal
import sys
import time
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence

from tests.mutants.mutation import Mutant
from tests.mutants.sample import Source, drawn, equivalents, outdated, sources
from tests.mutants.trial import ELSEWHERE, PASSED, TIMED_OUT, Bench, prepare

# A mutant may compute so many times as long as the sound source, and so much longer [s].
SLOWER, SPARE = 3.0, 5.0
SAME, CAUGHT, LATE, SURVIVED = FATES = "equivalent", "caught", "timed out", "survived"


def fates(
    bench: Bench, source: Source, mutants: Sequence[Mutant], known: Collection[tuple[str, ...]]
) -> Iterator[tuple[Mutant, str, float]]:
    """Mutants of one file, with one of `FATES` and the time that their tests computed [s].

    Raises:
      SystemExit: the tests of the sound file fail, or do not import the copied tree.
    """
    same = ast.unparse(ast.parse(source.text))  # as mutants are: without comments
    sound = bench.tested(source.tests, 600.0, source.path, same)
    if sound.code != PASSED:
        raise SystemExit(f"{source.path} as it is does not pass its tests.\n{sound.printed}")
    for mutant in mutants:
        if mutant.key in known:
            yield mutant, SAME, 0.0
            continue
        limit = SLOWER * sound.seconds + SPARE
        code, seconds, _ = bench.tested(source.tests, limit, mutant.path, mutant.source)
        if code == ELSEWHERE:
            raise SystemExit("The tests did not import the copied tree; nothing was tested.")
        yield mutant, {PASSED: SURVIVED, TIMED_OUT: LATE}.get(code, CAUGHT), seconds


def count(
    files: Sequence[Source],
    chosen: Mapping[str, Sequence[Mutant]],
    known: Collection[tuple[str, ...]],
) -> dict[Mutant, str]:
    """Test the chosen mutants of all files, and say after each how long the rest will take."""
    begun, told, total = time.monotonic(), dict[Mutant, str](), sum(map(len, chosen.values()))
    with Bench() as bench:
        try:
            for source in (source for source in files if chosen[source.path]):
                for mutant, fate, seconds in fates(bench, source, chosen[source.path], known):
                    told[mutant] = fate
                    left = (total - len(told)) * (time.monotonic() - begun) / len(told)
                    place = f"{mutant.path}:{mutant.line}"
                    print(f"[{len(told):3d}/{total}] {fate:10s} {seconds:5.1f} s  {place}", end="")
                    print(f"  ({left / 60:.0f} min left)", flush=True)
        finally:
            show(told, time.monotonic() - begun)
    return told


def show(told: Mapping[Mutant, str], seconds: float) -> None:
    """Print every survivor, and a table of the files."""
    for mutant, fate in told.items():
        if fate == SURVIVED:
            print(f"survived: {mutant}")
    print(f"\n{'file':45s}", *(f"{fate:>10s}" for fate in FATES))
    counts = Counter((mutant.path, fate) for mutant, fate in told.items())
    for path in dict.fromkeys(mutant.path for mutant in told):
        print(f"{path:45s}", *(f"{counts[path, fate]:10d}" for fate in FATES))
    print(f"{share(told):.1%} of those that are not equivalent are caught. {seconds:.0f} s.")


def share(told: Mapping[Mutant, str]) -> float:
    """Of the mutants that tests could notice, those that they did [-]; 1 of none."""
    noticed = [fate != SURVIVED for fate in told.values() if fate != SAME]
    return sum(noticed) / len(noticed) if noticed else 1.0


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
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # through `finally`: the copy goes
    prepare()
    return 0 if share(count(files, chosen, known)) >= asked.least else 1


if __name__ == "__main__":
    sys.exit(main())
