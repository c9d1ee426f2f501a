"""A disk without room for more, without a disk: the kernel lets no file grow beyond a size."""

import resource
from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def files_end_at(size: int) -> Iterator[None]:
    """Nothing that this process, or one that it starts, writes can become larger [bytes]."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def complaints(capfd: pytest.CaptureFixture[str]) -> list[str]:
    """Lines on standard error but Ray's: the log of a driver that another test started ends there too."""
    return [line for line in capfd.readouterr().err.splitlines() if "[ray_log_sink]" not in line]
