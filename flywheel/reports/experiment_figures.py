"""The figures of planned experiments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flywheel.diagnosis.experiments.design import Design
from flywheel.diagnosis.experiments.power import Power
from flywheel.records import Floats
from flywheel.reports import style

LIKE = 20  # candidates of the matrix


def smallest_sizes(found: Power) -> Figure:
    """Smallest visible size of every visible candidate."""
    shown = [prospect for prospect in found.prospects if prospect.visible][::-1]
    figure = Figure(figsize=(8.0, 1.0 + 0.22 * max(1, len(shown))))
    axes = figure.add_subplot()
    colours = [style.MPPI if prospect.shown else style.FAINT for prospect in shown]
    axes.barh(range(len(shown)), [p.smallest for p in shown], color=colours, height=0.7)
    if by_points := found.bare_sizes:
        bare = [by_points[p.candidate.label] for p in shown]
        (marks,) = axes.plot(bare, range(len(shown)), "o", color=style.INK, label="by points alone")
        marks.set_markerfacecolor("none")
    axes.set_yticks(range(len(shown)), [p.candidate.label for p in shown])
    axes.axvline(found.size, color=style.INK, linestyle=(0, (1, 1.6)), label="requested size")
    style.logarithmic(axes.xaxis)
    axes.set_ylim(-0.7, len(shown) - 0.3)
    axes.set_xlabel("smallest visible size, in typical sizes")
    axes.grid(axis="y", visible=False)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return figure


def likeness(found: Power) -> Figure:
    """|cosine| between the most visible candidates."""
    labels = [prospect.candidate.label for prospect in found.prospects[:LIKE]]
    size = 1.6 + 0.32 * len(labels)
    figure = Figure(figsize=(size + 2.2, size + 0.8))
    axes = figure.add_subplot()
    image = axes.imshow(found.likeness[:LIKE, :LIKE], vmin=0, vmax=1, cmap="Blues")
    axes.set_xticks(range(len(labels)), labels, rotation=50, ha="right")
    axes.set_yticks(range(len(labels)), labels)
    axes.grid(visible=False)
    figure.colorbar(image, ax=axes, label="|cosine|", shrink=0.8)
    return figure


def told_apart(found: Design) -> Figure:
    """Separation of every pair of effects, compared with plain random scripts."""
    figure = Figure(figsize=(8.0, 1.1 + 0.5 * len(found.pairs)))
    axes = figure.add_subplot()
    place = np.arange(len(found.pairs))[::-1]
    own = [pair.separation for pair in found.pairs]
    axes.barh(place + 0.19, own, height=0.36, color=style.MPPI, label="this script")
    plain = [pair.plain for pair in found.pairs]
    axes.barh(place - 0.19, plain, height=0.36, color=style.FAINT, label="random steps, median")
    axes.set_yticks(place, [f"{p.first.label} or {p.second.label}" for p in found.pairs])
    axes.axvline(found.needed, color=style.INK, linestyle=(0, (1, 1.6)), label="distinguished")
    axes.set_xlabel("separation [sigma]")
    axes.grid(axis="y", visible=False)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=3)
    return figure


def search(found: Design) -> Figure:
    """Best separation after the first scripts, and after each round."""
    figure = Figure(figsize=(8.0, 2.4))
    axes = figure.add_subplot()
    rounds = range(len(found.history))
    axes.plot(rounds, found.history, "o-", color=style.MPPI, label="best so far")
    axes.axhline(
        found.plain, color=style.FAINT, linestyle=(0, (5, 2)), label="random steps, median"
    )
    axes.set_xticks(rounds, ["drawn", *(f"round {i}" for i in rounds[1:])])
    axes.set_ylim(0, None)
    axes.set_ylabel("separation [sigma]")
    axes.legend(loc="lower right")
    return figure


def winch_paths(found: Design, winches: Sequence[str]) -> Figure:
    """Positions of each winch under the script."""
    columns = min(3, len(winches))
    rows = -(-len(winches) // columns)
    figure = Figure(figsize=(9.5, 0.5 + 1.5 * rows))
    parts: list[Axes] = (
        figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel().tolist()
    )
    time: Floats = found.dt * np.arange(1, len(found.path) + 1)
    for axes, name, path in zip(parts, winches, found.path.T, strict=False):
        axes.plot(time, path, color=style.MPPI)
        axes.set_title(name)
    for axes in parts[len(winches) :]:
        axes.set_visible(False)
    for axes in parts[-columns:]:
        axes.set_xlabel("time [s]")
    parts[0].set_ylabel("[m]")
    return figure
