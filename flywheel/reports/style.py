"""Style of all figures, with colours that people with colour blindness can distinguish.

The colours are those of Okabe and Ito (2008, jfly.uni-koeln.de/color); their meaning is the same in
every figure and on MLflow's charts, and nothing is shown by colour alone.
"""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import LinearSegmentedColormap, to_hex
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, MaxNLocator

COLOURS = {
    "mppi": "#0072B2",
    "control arm": "#E69F00",
    "floor": "#4a4a4a",
    "informed floor": "#CC79A7",
    "oracle": "#009E73",
}
INK = "#1f2933"
FAINT = "#9aa5b1"
MPPI = COLOURS["mppi"]
CONTROL = COLOURS["control arm"]
ORACLE = COLOURS["oracle"]
FLOOR = COLOURS["floor"]
INFORMED = COLOURS["informed floor"]
MISSED = "#D55E00"
ARM_COLOURS = {"mppi": MPPI, "control": CONTROL}
ARM_NAMES = {"mppi": "MPPI arm", "control": "control arm (random controls)"}
ARM_MARKERS = {"mppi": "o", "control": "s"}
FLOOR_LINE: dict[str, Any] = {"color": FLOOR, "linestyle": (0, (5, 2)), "linewidth": 1.4}
INFORMED_LINE: dict[str, Any] = {"color": INFORMED, "linestyle": (0, (5, 2)), "linewidth": 1.4}
ORACLE_LINE: dict[str, Any] = {"color": ORACLE, "linestyle": (0, (5, 2)), "linewidth": 1.4}
PERSISTENCE_LINE: dict[str, Any] = {"color": FAINT, "linestyle": (0, (1, 1.6)), "linewidth": 1.4}

RC: dict[str, Any] = {
    "axes.edgecolor": FAINT,
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.labelsize": 10,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlecolor": INK,
    "axes.titlelocation": "left",
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "figure.constrained_layout.use": True,
    "figure.dpi": 110,
    "figure.facecolor": "white",
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "grid.color": "#e4e7eb",
    "grid.linewidth": 0.8,
    "legend.fontsize": 9,
    "legend.frameon": False,
    "lines.linewidth": 2.0,
    "lines.markersize": 6,
    "svg.hashsalt": "flywheel",
    "text.color": INK,
    "text.parse_math": False,  # a name may hold a "$"
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
}

_RAMP = LinearSegmentedColormap.from_list("iterations", ["#a6cbe3", "#3d8dc4", "#08306b"])


def iteration_colour(place: int, count: int) -> str:
    """Light for the first iteration, dark for the last of `count`."""
    return to_hex(_RAMP(place / (count - 1) if count > 1 else 1.0))


def whole_steps(axes: Axes, iterations: list[int]) -> None:
    """Mark exactly the iterations on the x-axis."""
    axes.set_xticks(iterations)
    low, high = min(iterations), max(iterations)
    room = 0.12 * max(1, high - low)
    axes.set_xlim(low - room, high + room)
    axes.set_xlabel("iteration")


class PlainNumbers(LogFormatter):
    """Numbers of a logarithmic axis in plain notation: 0.9 and 1.025, not 9e-01 and 1.025 x 10^0."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """The label of a tick; empty if there is no room for one."""
        return f"{x:g}" if super().__call__(x, pos) else ""


def logarithmic(axis: Axis) -> None:
    """Make an axis logarithmic, with labels between the powers of ten if it has few of these."""
    which = "x" if axis is axis.axes.xaxis else "y"
    axis.axes.set(**{f"{which}scale": "log"})
    axis.set_major_formatter(PlainNumbers())
    axis.set_minor_formatter(PlainNumbers(minor_thresholds=(1.2, 0.5)))


def whole_numbers(axis: Axis) -> None:
    """Give an axis that counts something ticks at whole numbers only, however short it is."""
    axis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))


def legend_above(figure: Figure, axes: Axes) -> None:
    """One legend for the whole figure from the lines of `axes`, the MPPI arm first."""
    entries = sorted(
        zip(*axes.get_legend_handles_labels(), strict=True),
        key=lambda entry: entry[1] != ARM_NAMES["mppi"],
    )
    handles, labels = zip(*entries, strict=True)
    figure.legend(handles, labels, loc="outside upper left", ncols=3)
