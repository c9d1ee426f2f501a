"""A picture of a robot with the names of its bodies, cables, winches and points."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from flywheel.dynamics.plant.portrait import Label
from flywheel.records import Floats
from flywheel.reports import style

COLOURS = {"body": style.INK, "cable": style.MPPI, "point": style.MISSED}
NAMES = {"body": "body", "cable": "cable (winch)", "point": "tracked point"}
DPI = 130  # of the file
LETTER = np.array([7.2, 15.0])  # width and height of a letter [pixels]
GAP = 6.0  # between a part and its name [pixels]
ROWS = (0, 1, -1, 2, -2, 3, -3)  # where a name may be, in lines above its part, the best first


def portrait_figure(pixels: NDArray[np.uint8], labels: Sequence[Label]) -> Figure:
    """The picture, with a name at each part."""
    height, width = pixels.shape[:2]
    figure = Figure(figsize=(width / DPI, height / DPI + 0.3))
    axes = figure.subplots()
    axes.imshow(pixels)
    axes.set_axis_off()
    for label, (x, y) in zip(labels, _free_places(labels), strict=True):
        colour = COLOURS[label.kind]
        axes.plot([label.at[0], x], [label.at[1], y], color=colour, linewidth=0.5)
        axes.plot(*label.at, ".", color=colour, markersize=4)
        axes.text(
            x, y, label.text, fontsize=6.5, color=colour, va="center", parse_math=False,
            fontweight="bold" if label.kind == "body" else "normal",
            bbox={"boxstyle": "round,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.75},
        )  # fmt: skip
    for kind, name in NAMES.items():
        axes.plot([], [], ".", color=COLOURS[kind], label=name)
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)
    figure.legend(loc="outside upper left", ncols=3)
    return figure


def _free_places(labels: Sequence[Label]) -> list[Floats]:
    """The left middle of each name (2,) [pixels], where few other names are."""
    taken: list[Floats] = []  # left, top, right, bottom
    found = []
    for label in labels:
        size = LETTER * [len(label.text), 1.0]
        places = [
            label.at + [GAP if right else -GAP - size[0], -row * size[1]]
            for row, right in product(ROWS, (True, False))
        ]
        boxes = [np.concatenate([p - [0, size[1] / 2], p + [size[0], size[1] / 2]]) for p in places]
        best = int(np.argmin([sum(_shared(box, other) for other in taken) for box in boxes]))
        taken.append(boxes[best])
        found.append(places[best])
    return found


def _shared(a: Floats, b: Floats) -> float:
    """Area that two boxes share [pixels^2]."""
    sides = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    return float(np.maximum(sides, 0).prod())
