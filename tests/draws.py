"""Seeds for what tests draw: the same ones every time, unless fresh ones are asked for.

pytest --draws fresh    # hunts; the number that it shows brings the same draws back
pytest --draws 12345
"""

import os
import sys
import zlib

_chosen = 0
_asked: dict[tuple[str, str], int] = {}
_test = ""


def choose(number: int) -> None:
    """Let all draws depend on a number."""
    global _chosen
    _chosen = number


def seed() -> int:
    """A number below 2^31 that depends on the function that asks, and how often it asked in this test.

    It does not depend on which tests ran before.
    """
    global _test
    if (test := os.environ.get("PYTEST_CURRENT_TEST", "").rpartition(" ")[0]) != _test:
        _test = test
        _asked.clear()
    caller = sys._getframe(1)
    who = (caller.f_code.co_filename.rpartition("tests")[2], caller.f_code.co_name)
    _asked[who] = _asked.get(who, 0) + 1
    return zlib.crc32(f"{who} {_asked[who]} {_chosen}".encode()) >> 1
