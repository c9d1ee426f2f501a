"""The results of the comparison with `mujoco.sysid` as a table: one row per contender of a case."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from benchmarks.sysid.study import CaseStudy, Contender

HIDDEN = ("winch_gain", "cable_friction", "payload")
SHOWN = 3  # of the numbers that have changed, the surest first
HEADER = (
    "| hidden | contender | error [noise] | held out [noise] | CPU [s] | changed |\n"
    "|---|---|---|---|---|---|"
)


@dataclass(frozen=True)
class ContenderRow:
    """One way to explain the recordings of a case.

    Attributes:
      name, hidden: of the case; hidden effects, in words.
      contender: its name.
      fit, held_out: errors over the noise on the recordings and on the held-out one.
      seconds: of one core.
      says: the verdict, or the end of the fit.
      numbers, changed: number of fitted ones, and of significantly changed ones.
      surest: the most significant changes with their 95 % intervals, in words.
    """

    name: str
    hidden: str
    contender: str
    fit: float
    held_out: float
    seconds: float
    says: str
    numbers: int
    changed: int
    surest: str


def rows_of(result: CaseStudy) -> Iterator[ContenderRow]:
    """The rows of a case, one per contender."""
    for each in result.contenders:
        changed = sorted(
            (n for n in each.numbers if n.surely_changed),
            key=lambda n: -abs(n.value - n.nominal) / (n.high - n.low),
        )
        shown = (f"{n.name} {n.value:.3g} [{n.low:.3g}, {n.high:.3g}]" for n in changed[:SHOWN])
        yield ContenderRow(
            name=result.name,
            hidden=result.truth,
            contender=each.name,
            fit=each.fit,
            held_out=each.held_out,
            seconds=each.seconds,
            says=_says(each),
            numbers=len(each.numbers),
            changed=len(changed),
            surest=", ".join(shown),
        )


def table(rows: Sequence[ContenderRow]) -> list[str]:
    """Lines of Markdown: a row per contender, the cases in the order of `HIDDEN`."""
    ordered = [row for name in HIDDEN for row in rows if row.hidden.startswith(name)]
    return [HEADER, *map(line, ordered)]


def line(row: ContenderRow) -> str:
    """A row of the table in Markdown; with a single fitted number, that number."""
    changes = f"{row.changed} of {row.numbers}" if row.numbers > 1 else row.surest
    return (
        f"| {row.hidden} | {row.contender} | {row.fit:.3f} | {row.held_out:.3f} | "
        f"{row.seconds:.0f} | {changes} |"
    )


def _says(contender: Contender) -> str:
    return contender.verdict.split(".")[0]
