"""Elements added to a robot's MJCF in code, independent of its <default>."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import count
from typing import Any

import mujoco

_EMPTY = mujoco.MjSpec()  # kept as long as its defaults, which are MuJoCo's own


def add_plain(parent: mujoco.MjSpec | mujoco.MjsBody, kind: str, **fields: Any) -> Any:
    """Add an element whose fields are MuJoCo's own built-in ones, except for the given ones.

    The only way in which code adds to a spec: MuJoCo's own `add_...` would start from the MJCF's
    <default>, so that one robot written in two ways would become two.

    Args:
      parent: the spec, or the body.
      kind: of element: "actuator", "body", "geom", "hfield", ...
      fields: MuJoCo's names. A name, if it is referred to, comes from `free_name`.

    Returns:
      MuJoCo's element.
    """
    plain = (_EMPTY.default,) if hasattr(_EMPTY.default, kind) else ()
    return getattr(parent, f"add_{kind}")(*plain, **fields)


def free_name(wanted: str, elements: Iterable[Any]) -> str:
    """The given name, or one with a number appended if an element has that already.

    Args:
      wanted: name.
      elements: all those of a spec of the same kind.
    """
    taken = {element.name for element in elements}
    names = (f"{wanted}_{number}" if number else wanted for number in count())
    return next(name for name in names if name not in taken)
