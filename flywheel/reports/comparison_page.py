"""The page of a comparison: one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from math import isnan, nan
from pathlib import Path

from flywheel.diagnosis.comparison import Comparison, Judgement, Outcome
from flywheel.outputs import write_output
from flywheel.reports.comparison_figures import PICTURES
from flywheel.reports.html import Shown, data_uri, render
from flywheel.reports.pictures import shown

LIMITS = (
    "The influence of noise on a model's error is simulated by letting the model predict itself, "
    "from pasts as noisy as the recorded ones. Winch positions are assumed to be known as well "
    "as they were there.",
    "A prediction starts from a measured past, which hides small effects; flywheel diagnose, "
    "which fits the starts and tests known effects, is more sensitive.",
    (
        "Tensions of cables are estimates from measured points and nominal cables: use them for "
        "sorting only."
    ),
)


def write_comparison(
    found: Comparison, path: str | Path, about: Mapping[str, str], videos: Mapping[str, Path | str]
) -> Path:
    """Write the page.

    Args:
      found: to show.
      path: of the HTML file.
      about: its provenance, as lines of two columns.
      videos: model -> mp4 of the last model's worst window, or the reason why there is none.
    """
    page = render(
        "comparison",
        found=found,
        sentences=[(model, sentence(found, model)) for model in found.models],
        fitted=any(model.fitted is not None for model in found.models),
        millimetres=1000.0 * found.windows.sigma,
        channels=channel_rows(found),
        figures=shown(PICTURES, found),
        worst=found.windows.labels[found.models[-1].worst],
        videos=_videos(videos),
        about=about,
        limits=(*LIMITS, *about_lengths(found)),
    )
    return write_output(path, page)


def sentence(found: Comparison, model: Judgement) -> str:
    """The verdict on a model in words."""
    low, _, high = model.noise_rms
    error = f"The error of {model.name} is {model.rms:.3g} times the noise"
    by_noise = f"noise in its starts alone gives {low:.3g} to {high:.3g}"
    if not model.forecast_is_off:
        words = f"{error}, which noise alone explains: {by_noise}."
    elif model.rms > high:
        words = f"{error}; {by_noise}."
    else:
        words = (
            f"{error}; {by_noise}, but with another pattern: {model.excess:.3g} times more is "
            "left than noise leaves."
        )
    if model.rms > found.persistence_rms:
        words += " A prediction without motion would have a smaller error."
    if model.fitted is None:
        return words
    fitted = model.fitted
    out = ""
    if fitted.left_out:
        out = (
            f" Fits of {fitted.left_out} of {fitted.windows} windows did not converge: they end far worse "
            "than predictions from measured pasts."
        )
    if not fitted.converged:
        return f"{words}{out}"
    only = "no more than noise" if model.outcome is Outcome.NOISE_ONLY else "more than noise"
    return (
        f"{words} Where each window begins where it fits best, {only} is left: {fitted.noise:.3g} "
        f"times its variance, with a correlation of {fitted.correlation:.2g}.{out}"
    )


def channel_rows(found: Comparison) -> list[list[str]]:
    """Each channel's name, unit and noise, and every model's error and that by noise alone, or dashes."""
    newtons = {"tension", "winch"} if found.windows.robot.tension_driven else {"tension"}
    rows = []
    for channel, errors in found.channels:
        scale, unit = (1.0, "N") if channel.key[0] in newtons else (1000.0, "mm")
        pairs = [(nan, nan) if e is None else (e.rms, e.by_noise) for e in errors]
        numbers = [scale * value for value in (channel.sigma, *chain.from_iterable(pairs))]
        cells = ["–" if isnan(value) else f"{value:.3g}" for value in numbers]
        rows.append([channel.label, unit, *cells])
    return rows


def about_lengths(found: Comparison) -> tuple[str, ...]:
    """How the first lengths of winches that were not measured are known; nothing where they were."""
    windows, unknown = found.windows, "Where winches were when recordings began was not measured"
    if windows.begun is not None:
        moved = f"{windows.moved.max():.2g} m"
        return (
            f"{unknown}: it was fitted to the first windows, and is up to {moved} from the keyframe.",
        )
    if not windows.winches_measured:
        return (f"{unknown}: it was taken from the keyframe.",)
    return ()


def _videos(videos: Mapping[str, Path | str]) -> Sequence[Shown]:
    shown = []
    for name, film in videos.items():
        if isinstance(film, Path):
            shown.append(Shown(name, name, "", data_uri(film.read_bytes(), "video/mp4")))
        else:
            shown.append(Shown(name, name, film, ""))
    return shown
