"""The figures of a comparison."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from flywheel.diagnosis.comparison import Bins, Comparison, Judgement
from flywheel.records import Floats
from flywheel.reports import style
from flywheel.reports.pictures import Picture

COLOURS = (style.MISSED, style.MPPI, style.CONTROL, style.INFORMED, style.INK)
MARKS = ("-", "--", "-.", ":")
NOISE = style.ORACLE
LABELLED = 12  # windows that are named on an axis
MILLI = 1000.0


def lead_time(found: Comparison) -> Figure:
    """Error of every model against lead time."""
    figure = Figure(figsize=(9.5, 3.8))
    axes = figure.add_subplot()
    scale, time = MILLI * found.windows.sigma, found.lead_seconds
    for number, model in enumerate(found.models):
        colour = colour_of(number)
        low, high = scale * np.sqrt(model.band)
        axes.fill_between(time, low, high, color=colour, alpha=0.16, linewidth=0)
        axes.plot(
            time,
            scale * np.sqrt(model.by_lead),
            color=colour,
            linestyle=MARKS[number % len(MARKS)],
            label=model.name,
        )
    axes.plot(
        time, scale * np.sqrt(found.persistence), label="nothing moves", **style.PERSISTENCE_LINE
    )
    axes.axhline(scale, color=NOISE, linestyle=(0, (5, 2)), linewidth=1.4, label="noise")
    style.logarithmic(axes.yaxis)
    axes.set_xlim(0, time[-1])
    axes.set_xlabel("lead time [s]")
    axes.set_ylabel("root mean square error [mm]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=4)
    return figure


def heat(found: Comparison) -> Figure:
    """Mean square residual of every window and tracked point, for every model."""
    windows, count = found.windows, len(found.models)
    figure = Figure(figsize=(9.5, (0.9 + 0.28 * len(windows.robot.points)) * count + 0.7))
    parts = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    means = [model.squares.mean for model in found.models]
    top = max(4.0, float(np.nanquantile(np.stack(means), 0.98)))
    names = [point.name for point in windows.robot.points]
    for axes, model, mean in zip(parts, found.models, means, strict=True):
        image = axes.imshow(
            np.maximum(mean.T, 1.0), norm=LogNorm(1.0, top), cmap="YlOrRd", aspect="auto"
        )
        axes.set_title(model.name)
        axes.set_yticks(range(len(names)), names)
        axes.grid(visible=False)
    _name_windows(parts[-1], windows.labels)
    bar = figure.colorbar(image, ax=list(parts), label="mean square\n[noise variances]")
    style.logarithmic(bar.ax.yaxis)
    return figure


def points(found: Comparison) -> Figure:
    """Bars by end cap and by its state of motion."""
    return _bars(found, "points", ("end cap", "contact", "speed"))


def cables(found: Comparison) -> Figure:
    """Bars by cable and by its state."""
    return _bars(found, "cables", ("cable", "tension", "command"))


def channels(found: Comparison) -> Figure | None:
    """Bars by channel: the errors of models, over those by noise alone."""
    if not found.channels:
        return None
    labels, errors = zip(*((channel.label, each) for channel, each in found.channels), strict=True)
    over = np.array([[np.nan if e is None else e.rms / e.by_noise for e in row] for row in errors])
    figure = Figure(figsize=(9.5, 1.3 + 0.24 * len(labels) * max(1.0, 0.6 * len(found.models))))
    axes = figure.add_subplot()
    _beside_each_other(axes, found.models, list(over.T), labels)
    axes.set_xlabel("error, over that by noise alone")
    if len(found.models) > 1:
        figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=4)
    return figure


def _bars(found: Comparison, of: str, wanted: Sequence[str]) -> Figure:
    here = [[b for b in m.bins if b.of == of and b.by in wanted] for m in found.models]
    rows = [sum(bool(n) for n in b.sums.count) for b in here[0]]
    heights = [0.7 + 0.24 * n * max(1.0, 0.6 * len(here)) for n in rows]
    figure = Figure(figsize=(9.5, sum(heights) + 0.9))
    parts = figure.subplots(len(rows), 1, height_ratios=heights, squeeze=False)[:, 0]
    for number, axes in enumerate(parts):
        _criterion(axes, found.models, [bins[number] for bins in here])
    parts[-1].set_xlabel("mean square [noise variances]")
    if len(here) > 1:
        figure.legend(*parts[0].get_legend_handles_labels(), loc="outside upper left", ncols=4)
    return figure


def _criterion(axes: Axes, models: Sequence[Judgement], bins: Sequence[Bins]) -> None:
    there = np.flatnonzero(bins[0].sums.count)
    counts = bins[0].sums.count[there]
    shares = 100 * counts / counts.sum()
    labels = [f"{bins[0].labels[i]} ({share:.0f}%)" for i, share in zip(there, shares, strict=True)]
    _beside_each_other(axes, models, [each.sums.mean[there] for each in bins], labels)
    axes.set_title(f"by {bins[0].by}")


def _beside_each_other(
    axes: Axes,
    models: Sequence[Judgement],
    lengths: Sequence[Floats],
    labels: Sequence[str],
) -> None:
    """Bars from (models, rows) lengths, of which noise alone gives 1."""
    place, thick = np.arange(len(labels)), 0.8 / len(models)
    for number, (model, each) in enumerate(zip(models, lengths, strict=True)):
        shift = thick * (number - (len(models) - 1) / 2)
        axes.barh(place + shift, each, 0.9 * thick, color=colour_of(number), label=model.name)
    axes.axvline(1.0, color=NOISE, linestyle=(0, (5, 2)), linewidth=1.4)
    style.logarithmic(axes.xaxis)
    axes.set_yticks(place, labels)
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)


def _name_windows(axes: Axes, labels: Sequence[str]) -> None:
    if len(labels) <= LABELLED:
        axes.set_xticks(range(len(labels)), labels, rotation=25, ha="right")
    else:
        axes.set_xlabel("window")
        style.whole_numbers(axes.xaxis)


def colour_of(number: int) -> str:
    """Colour of the model with this index on the page."""
    return COLOURS[number % len(COLOURS)]


PICTURES: dict[str, Picture[Comparison]] = {
    "lead_time": Picture(
        lead_time,
        "Horizon of reliable predictions",
        "Bands: 95 % of each model's errors if noise in its start were the only cause. Dashed "
        "green: the noise itself, which no model can beat.",
    ),
    "heat": Picture(
        heat,
        "Where and when",
        "Mean square error of every window and tracked point. One is the noise itself.",
    ),
    "points": Picture(
        points,
        "By end cap and its motion",
        "In brackets: fraction of the samples. Contact is a height of less than three sigmas; "
        "speeds are thirds of the samples.",
    ),
    "cables": Picture(
        cables,
        "By cable and its state",
        "Error of the distance between the tracked points at a cable's ends. Tensions are those of "
        "nominal cables in the measured poses, in thirds of the taut samples; a winch moves above "
        "2 % of its range of commands.",
    ),
    "channels": Picture(
        channels,
        "Beside the points",
        "Error of the predictions of each channel; other models than plants predict winches only. Dashed "
        "green: one is what noise alone gives, that of the channel and that in the starts.",
    ),
}
