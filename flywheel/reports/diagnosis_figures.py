"""The figures of a diagnosis."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flywheel.diagnosis import Diagnosis
from flywheel.reports import style
from flywheel.reports.pictures import Picture

BEFORE, AFTER, NOISE = style.MISSED, style.MPPI, style.ORACLE
SHOWN = 12  # candidates of the ranking
MILLI = 1000.0
LEAST_HEIGHT = 2.2  # of a picture with a colour bar, so that its label fits beside it [inch]


def ladder(found: Diagnosis) -> Figure:
    """Errors from the initial plant to the last model, on fitted and on held-out recordings."""
    rungs = found.evidence.ladder
    figure = Figure(figsize=(8.0, 0.9 + 0.45 * (len(rungs) + 3)))
    axes = figure.add_subplot()
    labels = [rung.label for rung in rungs]
    values = [MILLI * rung.error for rung in rungs]
    colours = [BEFORE, *[AFTER] * (len(rungs) - 1)]
    if found.held_out is not None:
        labels += ["held out, initial plant", "held out, last model"]
        values += [MILLI * found.held_out.baseline, MILLI * found.held_out.augmented]
        colours += [BEFORE, AFTER]
    place = np.arange(len(labels))[::-1]
    axes.barh(place, values, color=colours, height=0.62)
    for y, value in zip(place, values, strict=True):
        axes.text(value, y, f" {value:.2f}", va="center")
    axes.axvline(MILLI * found.errors.noise, color=NOISE, linestyle=(0, (5, 2)), label="noise")
    axes.set_yticks(place, labels)
    axes.set_xlim(0, 1.15 * max(values))
    axes.set_xlabel("root mean square of measured minus predicted [mm]")
    axes.legend(loc="lower right")
    axes.grid(axis="y", visible=False)
    return figure


def ranking(found: Diagnosis) -> Figure:
    """Scores of the best candidates on top of the initial plant."""
    scores = [s for s in found.ranking if s.score > 0][:SHOWN][::-1]
    figure = Figure(figsize=(8.0, 1.0 + 0.3 * max(1, len(scores))))
    axes = figure.add_subplot()
    named = {(f.effect, f.location) for answer in found.answers[:1] for f in answer}
    mine = [(s.candidate.effect.name, s.candidate.location) in named for s in scores]
    colours = [AFTER if own else style.FAINT for own in mine]
    axes.barh(range(len(scores)), [s.score for s in scores], color=colours, height=0.7)
    axes.set_yticks(range(len(scores)), [s.candidate.label for s in scores])
    axes.axvline(
        found.threshold, color=style.INK, linestyle=(0, (1, 1.6)), label="counts as visible"
    )
    style.logarithmic(axes.xaxis)
    axes.set_xlabel("score: what it would explain, in noise variances per size")
    figure.legend(loc="outside upper left")
    axes.grid(axis="y", visible=False)
    return figure


def worst_window(found: Diagnosis) -> Figure | None:
    """Measured and predicted path of the point with the largest error."""
    evidence = found.evidence
    squares = np.nan_to_num(evidence.squares(evidence.before))
    squares[:, ~evidence.places] = 0.0
    window, point = np.unravel_index(squares.argmax(), squares.shape)
    time = (evidence.first[window] + np.arange(evidence.measured.shape[1])) * evidence.dt
    figure = Figure(figsize=(9.5, 2.9))
    parts = figure.subplots(1, 3, sharex=True)
    for axis, axes in enumerate(parts):
        seen = evidence.measured[window, :, point, axis]
        axes.fill_between(
            time, seen - 2 * evidence.sigma, seen + 2 * evidence.sigma, color=style.FAINT, alpha=0.35,
            linewidth=0, label="measured, two sigmas",
        )  # fmt: skip
        axes.plot(
            time,
            evidence.before[window, :, point, axis],
            color=BEFORE,
            linestyle="--",
            label="initial plant",
        )
        axes.plot(time, evidence.after[window, :, point, axis], color=AFTER, label="last model")
        axes.set_title(f"{evidence.points[point]}, {'xyz'[axis]} [m]")
        axes.set_xlabel(f"time in recording {evidence.recording[window]} [s]")
    handles, labels = parts[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=3)
    return figure


def heat(found: Diagnosis) -> Figure:
    """Mean square residual of every window and point, before and after."""
    evidence = found.evidence
    figure = Figure(figsize=(9.5, max(LEAST_HEIGHT, 1.2 + 0.3 * len(evidence.points))))
    parts = figure.subplots(1, 2, sharey=True)
    before, after = evidence.squares(evidence.before), evidence.squares(evidence.after)
    top = max(2.0, float(np.nanquantile(before, 0.98)))
    for axes, squares, title in zip(
        parts, (before, after), ("initial plant", "last model"), strict=True
    ):
        image = axes.imshow(squares.T, vmin=0.8, vmax=top, cmap="YlOrRd", aspect="auto")
        axes.set_title(title)
        axes.set_xlabel("window")
        style.whole_numbers(axes.xaxis)
        axes.grid(visible=False)
    parts[0].set_yticks(range(len(evidence.points)), evidence.points)
    figure.colorbar(image, ax=parts, label="mean square\n[noise variances]")
    return figure


def places(found: Diagnosis) -> Figure | None:
    """Residual explained by a change of each cable, window by window."""
    if found.location is None or not found.location.cables.any():
        return None
    names = found.evidence.cables
    figure = Figure(figsize=(9.5, max(LEAST_HEIGHT, 1.2 + 0.2 * len(names))))
    axes = figure.add_subplot()
    image = axes.imshow(found.location.cables.T, vmin=0, cmap="YlOrRd", aspect="auto")
    axes.set_yticks(range(len(names)), names)
    axes.set_xlabel("window")
    style.whole_numbers(axes.xaxis)
    axes.grid(visible=False)
    figure.colorbar(image, ax=axes, label="explained\n[noise variances]")
    return figure


def likeness(found: Diagnosis) -> Figure | None:
    """Similarity of candidates."""
    evidence = found.evidence
    if len(evidence.rivals) < 2:
        return None
    size = 1.6 + 0.42 * len(evidence.rivals)
    figure = Figure(figsize=(size + 2.2, size + 0.6))
    axes = figure.add_subplot()
    image = axes.imshow(evidence.likeness, vmin=0, vmax=1, cmap="Blues")
    names = [rival.label for rival in evidence.rivals]
    axes.set_xticks(range(len(names)), names, rotation=40, ha="right")
    axes.set_yticks(range(len(names)), names)
    for (row, column), value in np.ndenumerate(evidence.likeness):
        colour = "white" if value > 0.6 else style.INK
        axes.text(column, row, f"{value:.2f}", ha="center", va="center", color=colour, fontsize=8)
    axes.grid(visible=False)
    figure.colorbar(image, ax=axes, label="|cosine|", shrink=0.8)
    return figure


def whiteness(found: Diagnosis) -> Figure:
    """Autocorrelation of the residual."""
    evidence = found.evidence
    figure = Figure(figsize=(8.0, 2.6))
    axes = figure.add_subplot()
    lags = np.arange(1, len(evidence.lags_before) + 1) * evidence.dt
    axes.axhspan(-evidence.band, evidence.band, color=NOISE, alpha=0.25, label="white noise, 95 %")
    axes.plot(lags, evidence.lags_before, "o--", color=BEFORE, label="initial plant")
    axes.plot(lags, evidence.lags_after, "o-", color=AFTER, label="last model")
    axes.set_xlabel("lag [s]")
    axes.set_ylabel("autocorrelation")
    axes.legend()
    return figure


PICTURES: dict[str, Picture[Diagnosis]] = {
    "ladder": Picture(
        ladder,
        "The error, effect by effect",
        "The starts of all windows are fitted in every row, so that noise alone would reach the "
        "dashed line. On held-out recordings nothing else is fitted.",
    ),
    "ranking": Picture(
        ranking,
        "Candidate explanations",
        "Score of each effect alone on top of the initial plant, after the part that unknown "
        "starts, winch offsets and smaller time steps could explain was removed.",
    ),
    "worst": Picture(
        worst_window, "The largest error", "The tracked point and window of the largest error."
    ),
    "heat": Picture(heat, "Where and when", "Mean square residual; one is noise."),
    "places": Picture(
        places,
        "The unexplained error: when and at which cable it would have to act",
        "Residual explained by a change of one cable, in one window alone.",
    ),
    "likeness": Picture(
        likeness,
        "Similar candidates",
        "Of the best candidates: near one, these recordings can hardly distinguish the two.",
    ),
    "whiteness": Picture(
        whiteness,
        "The residual",
        "White noise has no memory: its autocorrelation stays within the band.",
    ),
}
