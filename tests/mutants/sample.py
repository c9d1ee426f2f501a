"""Which changes of which sources are tested, by which tests."""

import hashlib
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from tests.mutants.mutation import Mutant, mutants_of
from tests.mutants.trial import ROOT

HERE = Path(__file__).parent


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

    @cached_property
    def mutants(self) -> list[Mutant]:
        """All of its changes."""
        return mutants_of(self.path, self.text)


def sources(wanted: Sequence[str] = (), tests: Sequence[str] = ()) -> list[Source]:
    """Those in sources.toml, or the wanted ones, with their own tests or those given.

    Raises:
      SystemExit: a wanted file is not listed, and no tests are given.
    """
    listed = {
        file.relative_to(ROOT).as_posix(): tuple(known)
        for pattern, known in tomllib.loads((HERE / "sources.toml").read_text()).items()
        for file in ROOT.glob(pattern)
    }
    if tests:
        listed = {path: tuple(tests) for path in wanted or listed}
    if unknown := [path for path in wanted if path not in listed]:
        raise SystemExit(
            f"Not in {HERE / 'sources.toml'}: {', '.join(unknown)}. Give their tests with --tests."
        )
    paths = wanted or sorted(listed)
    return [Source(path, listed[path], (ROOT / path).read_text()) for path in paths]


def equivalents() -> dict[tuple[str, ...], str]:
    """Mutants that no test should notice -> why, of equivalent.toml."""
    reasons = tomllib.loads((HERE / "equivalent.toml").read_text())
    return {tuple(key): why for why, keys in reasons.items() for key in keys}


def outdated(known: Iterable[tuple[str, ...]], files: Sequence[Source]) -> list[tuple[str, ...]]:
    """Which known mutants of these files are none any more: somebody edited their lines."""
    there = {source.path: {mutant.key for mutant in source.mutants} for source in files}
    return [key for key in known if key[0] in there and key not in there[key[0]]]


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
    counts = shares([s.lines for s in files], [len(s.mutants) for s in files], sample)

    def lot(mutant: Mutant) -> bytes:
        return hashlib.sha256(f"{seed} {mutant.key}".encode()).digest()

    return {
        source.path: sorted(sorted(source.mutants, key=lot)[:count], key=lambda m: m.line)
        for source, count in zip(files, counts, strict=True)
    }
