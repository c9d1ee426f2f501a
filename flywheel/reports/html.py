"""Pages from the templates next to this file: names in them are text, never HTML."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined


@dataclass(frozen=True)
class Shown:
    """A figure or video in the form for templates."""

    name: str
    title: str
    caption: str
    uri: str


def render(template: str, **fields: Any) -> str:
    """The text of a page.

    Args:
      template: its name, without the ending.
      fields: of the template.
    """
    environment = Environment(
        loader=PackageLoader("flywheel.reports"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(f"{template}.html.jinja").render(**fields)


def data_uri(content: bytes, kind: str) -> str:
    """A file's bytes as the address of an image or video inside a page."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
