"""Timing several things fairly: in turns, so that a busy moment of the machine hits all of them."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping

LEAST_ROUNDS = 3


def interleaved(contenders: Mapping[str, Callable[[], object]], seconds: float) -> dict[str, float]:
    """Median time of one call of each [s], measured in turns after one call to warm up.

    Args:
      contenders: what to call, by name.
      seconds: to spend on each, at least; and at least three calls.
    """
    for call in contenders.values():
        call()
    taken: dict[str, list[float]] = {name: [] for name in contenders}
    until = time.perf_counter() + seconds * len(contenders)
    while time.perf_counter() < until or len(next(iter(taken.values()))) < LEAST_ROUNDS:
        for name, call in contenders.items():
            begun = time.perf_counter()
            call()
            taken[name].append(time.perf_counter() - begun)
    return {name: statistics.median(times) for name, times in taken.items()}
