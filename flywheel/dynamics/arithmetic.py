"""Where and how exactly a network is computed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Device = Literal["cpu", "cuda"]
Precision = Literal["float32", "bfloat16", "auto"]


@dataclass(frozen=True)
class Arithmetic:
    """Where and how exactly a network is computed.

    Attributes:
      device: of the computation; "cuda" for a GPU.
      precision: of the factors of matrix products on the processor, whose sums are float32. "auto" is
        bfloat16 where the processor has instructions for it.
    """

    device: Device = "cpu"
    precision: Precision = "float32"
