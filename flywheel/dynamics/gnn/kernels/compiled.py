"""How the kernels are compiled: once per machine, for loops over samples that need no Python.

A kernel computes on the processor what torch operations of `features`, `attachments`, `rigid`,
`winches` and `fused` compute, in one pass through the data. Those remain the readable form, and serve
other devices; a test holds the two together. Loops over samples are innermost and contiguous, so that
they become vector instructions.

Arrays are float32 and component-major, (C, M, K) for C components of M items of K samples. `x_adjoint`
is the adjoint of `x`: it takes gradients of the outputs and *adds* to those of the inputs, whose names
begin with `g_`.

What is compiled is kept, and compiled anew when the kernel's own file changes. After a change of this
file, delete the folders `__pycache__` beside it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

F = NDArray[np.float32]
Index = NDArray[np.int64]

# Sums may be taken in another order; NaN and infinity keep their meaning.
_FAST = {"contract", "nsz", "arcp", "afn", "reassoc"}

SMALL = np.float32(1e-18)  # [m^2] least squared length of a vector
SMALL_AXIS = np.float32(1e-12)  # least squared length of one that is made a unit vector
ONE = np.float32(1.0)
ZERO = np.float32(0.0)

compiled: Any = njit(cache=True, nogil=True, error_model="numpy", fastmath=_FAST)


@compiled
def norm(x: float, y: float, z: float, least: float) -> float:
    """Length of a vector, whose square is at least `least`."""
    return math.sqrt(max(x * x + y * y + z * z, least))


@compiled
def asinh(x: float) -> float:
    """Inverse hyperbolic sine; as vector instructions, which `math.asinh` is not."""
    size = abs(x)
    root = math.log(size + math.sqrt(size * size + ONE))
    return root if x > 0 else -root
