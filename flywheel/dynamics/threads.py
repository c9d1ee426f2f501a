"""A batch's blocks for several threads, and torch on one thread for each of them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import torch


def shares(batch: int, block: int, threads: int) -> list[slice]:
    """Blocks of a batch: of equal size, at most `block`, for all threads if that pays off.

    A batch of at most one block is never cut, so that blocks are the same wherever they are
    computed.
    """
    worth_a_thread = block // 2 + 1  # with fewer candidates each, threads wait for each other
    count = max(1, -(-batch // block), min(threads, batch // worth_a_thread))
    if count > threads:
        count = -(-count // threads) * threads
    ends = np.linspace(0, batch, count + 1).round().astype(int)
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(ends)]


@contextmanager
def one_thread_per_operation() -> Iterator[None]:
    """Keep torch from splitting one small operation over threads, which is slower on a busy machine."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
