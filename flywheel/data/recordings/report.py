"""Report of an import: every masked, repaired or dropped sample has a line here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from flywheel.records import Floats

Action = Literal["masked", "repaired", "resampled", "left out", "split", "noted", "aligned"]
SPANS_KEPT = 20  # spans kept per finding: a flickering marker has thousands


@dataclass(frozen=True)
class Finding:
    """One kind of finding in a log.

    Attributes:
      kind: "missing", "infinite", "far", "repeat", "duplicate stamp", "irregular stamp", "gap",
        "swap", "flip", "leap", "rod length", "rate", "height", "cable", "clock", "file", "column" or
        "channel".
      action: taken.
      subject: the marker, pair or column; "" for the whole log.
      count: samples (or rows).
      spans: the first intervals of time [s], (begin, end) each.
      more_spans: number of the others.
      words: for people.
    """

    kind: str
    action: Action
    subject: str
    count: int
    spans: tuple[tuple[float, float], ...] = ()
    more_spans: int = 0
    words: str = ""

    @classmethod
    def over(
        cls,
        kind: str,
        action: Action,
        subject: str,
        where: NDArray[np.bool_],
        time: Floats,
        words: str = "",
    ) -> Finding:
        """A finding about the rows where a mask (N,) is true, at times (N,) [s]."""
        return cls(kind, action, subject, int(where.sum()), *spans_of(where, time), words)

    @property
    def when(self) -> str:
        """Its times, for a table."""
        shown = [f"{a:.3f}" if a == b else f"{a:.3f} to {b:.3f}" for a, b in self.spans[:3]]
        more = len(self.spans) - len(shown) + self.more_spans
        return ", ".join(shown) + (f" and {more} more" if more else "")


@dataclass(frozen=True)
class ImportReport:
    """Result of one log.

    Attributes:
      file: its name.
      digest: sha256 of its bytes.
      rows: of the log.
      seconds: duration [s].
      period: usual time between two rows [s].
      dt: control step of its episodes [s].
      episodes: their ids, one for each part without a gap.
      steps: control steps of each.
      seen: usable fraction of the points' samples, at the log's own rate.
      findings: all masked, repaired, resampled or dropped samples.
    """

    file: str
    digest: str
    rows: int
    seconds: float
    period: float
    dt: float
    episodes: tuple[str, ...]
    steps: tuple[int, ...]
    seen: float
    findings: tuple[Finding, ...]


def spans_of(where: NDArray[np.bool_], time: Floats) -> tuple[tuple[tuple[float, float], ...], int]:
    """First and last time [s] of the first runs of true values, and the number of the other runs."""
    edges = np.diff(where.astype(np.int8), prepend=0, append=0)
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    kept = zip(time[begins[:SPANS_KEPT]].tolist(), time[ends[:SPANS_KEPT]].tolist(), strict=True)
    return tuple(kept), len(begins[SPANS_KEPT:])


def counted(number: int, what: str) -> str:
    """`1 column`, `2 columns`."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def listed(names: Sequence[str], most: int = 8) -> str:
    """Names for a message, up to a number of them."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
