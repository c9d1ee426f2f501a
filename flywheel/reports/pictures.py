"""Figures with their captions, as files and for pages."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from io import BytesIO
from typing import Generic, Literal, TypeVar

import matplotlib
from matplotlib.figure import Figure

from flywheel.reports import style
from flywheel.reports.html import Shown, data_uri

F = TypeVar("F")


@dataclass(frozen=True)
class Picture(Generic[F]):
    """One figure of a result.

    Attributes:
      draw: makes it, or returns None without data.
      title: above it.
      caption: below it; explains each line and mark.
    """

    draw: Callable[[F], Figure | None]
    title: str
    caption: str


def as_file(
    drawn: Callable[[], Figure | None], format: Literal["svg", "png"] = "svg"
) -> bytes | None:
    """A figure in the common style as a file's bytes, the same for the same data; None without data."""
    with matplotlib.rc_context(style.RC):
        figure = drawn()
        if figure is None:
            return None
        file = BytesIO()
        metadata = {"Date": None} if format == "svg" else {"Software": None}
        figure.savefig(file, format=format, metadata=metadata, dpi=130)
    return file.getvalue()


def shown(
    pictures: Mapping[str, Picture[F]], found: F, names: Iterable[str] | None = None
) -> list[Shown]:
    """The figures with data, for a page.

    Args:
      pictures: by name.
      found: result that they show.
      names: of the wanted ones, in order; all by default.
    """
    made = []
    for name in pictures if names is None else names:
        picture = pictures[name]
        content = as_file(lambda picture=picture: picture.draw(found))  # type: ignore[misc]
        if content is not None:
            uri = data_uri(content, "image/svg+xml")
            made.append(Shown(name, picture.title, picture.caption, uri))
    return made
