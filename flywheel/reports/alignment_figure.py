"""Cables by their winches and by the points, after the clocks of two files were aligned."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from flywheel.data.recordings import Aligned
from flywheel.reports import style

ROW = 1.8  # height of a cable's panel [inches]


def alignment_figure(cables: Sequence[Aligned]) -> Figure | None:
    """A panel for each cable; None without any."""
    if not cables:
        return None
    figure = Figure(figsize=(9.6, 0.6 + ROW * len(cables)))
    panels = np.ravel(figure.subplots(len(cables), 1, sharex=True, squeeze=False))
    for axes, cable in zip(panels, cables, strict=True):
        axes.plot(cable.winch_time, 1e3 * cable.made, color=style.CONTROL, label="by the winch")
        axes.plot(
            cable.time,
            1e3 * cable.lengths,
            color=style.MPPI,
            linewidth=1.0,
            label="between the points",
        )
        clock = cable.clock
        axes.set_title(
            f"{cable.cable}: {cable.file} from {clock.offset:.4f} s on, pace {clock.pace:.6f}",
            parse_math=False,
        )
        axes.set_ylabel("length [mm]")
    panels[-1].set_xlabel("time of the first file [s]")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
    return figure
