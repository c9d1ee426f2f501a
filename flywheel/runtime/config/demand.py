"""Estimates of memory and disk space, before anything starts.

The bounds of single settings are in `flywheel.quantities`; here the product of several is bounded.
The estimates are right to a factor of about three on the shipped robots. Rejected work would fill
the memory or the disk long before its end.
"""

from __future__ import annotations

from dataclasses import dataclass

from flywheel.errors import ConfigError

GB = 1e9  # [bytes]
MEMORY = 16 * GB  # that one process may use for one purpose
DISK = 1000 * GB  # that a run may fill
PREDICTED = 2e3  # for each step of a prediction [bytes]; measured on prism3 and icosa6


@dataclass(frozen=True)
class Demand:
    """Memory or disk space needed for one purpose.

    Attributes:
      what: name of the purpose in the plural, with the settings that determine it.
      bytes: needed.
      most: allowed.
    """

    what: str
    bytes: float
    most: float = MEMORY

    def __str__(self) -> str:
        return (
            f"{self.what} take about {self.bytes / GB:,.0f} GB; at most {self.most / GB:,.0f} GB are "
            "allowed"
        )


def check_predictions(number: int, seconds: float, dt: float, options: str) -> None:
    """Check that simultaneous predictions fit into the memory.

    Args:
      number: of predictions.
      seconds: length of each [s].
      dt: control step [s].
      options: of the command that determine these numbers, e.g. "--draws, --horizon and --dt".

    Raises:
      ConfigError: they do not fit.
    """
    what = f"{number:,} predictions of {seconds:g} s in control steps of {dt:g} s ({options})"
    demand = Demand(what, PREDICTED * number * seconds / dt)
    if demand.bytes > demand.most:
        raise ConfigError(f"{demand}.")
