"""Elements that code adds: MuJoCo's own defaults, whatever the MJCF says in its <default>."""

from typing import Any

import mujoco
import numpy as np
import pytest

from flywheel.robots import add_plain, free_name
from tests.contracts.rewritings import HOSTILE

IN_BODIES = ("geom", "site", "joint", "camera", "light")
DEFAULTS = "".join(
    f"<{kind} {' '.join(f'{name}={other!r}' for name, (other, _) in values.items())}/>"
    for kind, values in HOSTILE.items()
)
XML = f"<mujoco><default>{DEFAULTS}</default></mujoco>"
OF_SPEC = {"general": "actuator"}


def added(spec: mujoco.MjSpec, kind: str) -> Any:
    return add_plain(spec.worldbody if kind in IN_BODIES else spec, kind)


def said(element: Any) -> dict[str, Any]:
    """All fields of an element, but for where it is."""
    found = {}
    for name in dir(type(element)):
        value = getattr(element, name)
        if isinstance(value, np.ndarray):
            value = value.tolist()
        if isinstance(value, int | float | str | list) and name not in ("id", "info", "signature"):
            found[name] = repr(value)
    return found


@pytest.mark.parametrize("kind", [OF_SPEC.get(kind, kind) for kind in HOSTILE])
def test_an_added_element_has_none_of_the_mjcfs_defaults(kind: str) -> None:
    spec, empty = mujoco.MjSpec.from_string(XML), mujoco.MjSpec()
    assert said(added(spec, kind)) == said(added(empty, kind))
    parent = spec.worldbody if kind in IN_BODIES else spec
    assert said(getattr(parent, f"add_{kind}")()) != said(added(empty, kind))  # as it would be


def test_an_added_element_has_the_fields_that_are_given() -> None:
    spec = mujoco.MjSpec.from_string(XML)
    body = add_plain(spec.worldbody, "body", name="load", pos=[1, 2, 3])
    geom = add_plain(body, "geom", size=[2, 0, 0], friction=[3, 2, 1], group=4)
    assert (geom.parent.name, geom.group) == ("load", 4)
    assert [*geom.size, *geom.friction] == [2, 0, 0, 3, 2, 1]


@pytest.mark.parametrize(
    ("taken", "name"),
    [((), "box"), (("box",), "box_1"), (("box_1",), "box"), (("box", "box_2", "box_1"), "box_3")],
)
def test_a_name_is_given_that_nothing_has(taken: tuple[str, ...], name: str) -> None:
    spec = mujoco.MjSpec()
    for each in taken:
        add_plain(spec.worldbody, "geom", name=each)
    assert free_name("box", spec.geoms) == name
