"""Spoil inputs of every kind, and show what becomes of them.

    python -m tests.fuzz                          # some hundred of each kind
    python -m tests.fuzz --kinds csv,mjcf --inputs 5000 --seed fresh --keep faults

Exits with 1 if an input led to a traceback, a hang, a crash, too much memory or a file outside its folder;
`--keep` writes each of these inputs and what was said.
"""

import argparse
import secrets
import sys
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeRemainingColumn
from rich.table import Table

from tests.fuzz.asking import Kind
from tests.fuzz.judging import RIGHT, Limits, Verdict, judged, source
from tests.fuzz.kinds import KINDS


def main() -> int:
    """Fuzz what was asked for; the exit code."""
    asked = _arguments()
    seed = secrets.randbits(32) if asked.seed == "fresh" else int(asked.seed)
    limits = Limits(asked.seconds, asked.memory)
    out = Console(stderr=True)
    found: dict[str, list[Verdict]] = {}
    with TemporaryDirectory(prefix="fuzz-samples-") as work, _progress(out) as bar:
        for name in asked.kinds.split(","):
            kind = KINDS[name](Path(work))
            task = bar.add_task(name, total=asked.inputs)
            found[name] = []
            for verdict in judged(KINDS[name], Path(work), asked.inputs, seed, limits):
                found[name].append(verdict)
                bar.advance(task)
                if not verdict.right:
                    _tell(out, kind, seed, verdict, asked.keep)
    Console().print(_table(found, seed))
    return int(any(not verdict.right for each in found.values() for verdict in each))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--kinds", default=",".join(KINDS), help="which, separated by commas")
    parser.add_argument("--inputs", type=int, default=300, help="of each kind")
    parser.add_argument("--seed", default="0", help='a number, or "fresh"')
    parser.add_argument("--seconds", type=float, default=Limits.seconds, help="an input may take")
    parser.add_argument(
        "--memory", type=float, default=Limits.memory, help="an input may take [MB]"
    )
    parser.add_argument("--keep", type=Path, help="folder for inputs that did harm")
    return parser.parse_args()


def _progress(out: Console) -> Progress:
    rate = TextColumn("{task.completed} of {task.total}, {task.speed:.1f} per second")
    columns = (SpinnerColumn(), TextColumn("{task.description}"), rate, TimeRemainingColumn())
    return Progress(*columns, console=out, disable=not out.is_terminal)


def _tell(out: Console, kind: Kind, seed: int, verdict: Verdict, keep: Path | None) -> None:
    last = verdict.words.strip().splitlines()[-1:] or [""]
    out.print(f"{kind.name} {verdict.number}: {verdict.outcome}: {last[0][:200]}", markup=False)
    if keep is None:
        return
    keep.mkdir(parents=True, exist_ok=True)
    stem = f"{kind.name}-{seed}-{verdict.number}-{verdict.outcome}"
    spoilt = kind.draw(source(kind.name, seed, verdict.number))
    (keep / f"{stem}.input").write_bytes(spoilt.content)
    (keep / f"{stem}.txt").write_text(f"{spoilt.file}\n{verdict.words}\n", encoding="utf-8")


def _table(found: dict[str, list[Verdict]], seed: int) -> Table:
    table = Table(title=f"What became of spoilt inputs (seed {seed})")
    for column in ("kind", "inputs", *RIGHT, "faults", "slowest [s]", "most memory [MB]"):
        table.add_column(column, justify="left" if column == "kind" else "right")
    for name, verdicts in found.items():
        counts = Counter(verdict.outcome for verdict in verdicts)
        faults = {outcome: n for outcome, n in counts.items() if outcome not in RIGHT}
        table.add_row(
            name,
            str(len(verdicts)),
            *(str(counts[outcome]) for outcome in RIGHT),
            ", ".join(f"{n} {outcome}" for outcome, n in faults.items()) or "none",
            f"{max((v.seconds for v in verdicts), default=0.0):.1f}",
            f"{max((v.memory for v in verdicts), default=0.0):.0f}",
        )
    return table


if __name__ == "__main__":
    sys.exit(main())
