"""Declaration of an effect: its name, its place, its parameters with their bounds.

The contract tests check it for effects of the package, and loading for those of a law file.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterator
from typing import Any, get_args

from flywheel.effects.effect import (
    CommandEffect,
    Effect,
    ModelEffect,
    Parameter,
    TensionEffect,
    Where,
    WinchEffect,
)
from flywheel.effects.scales import Scales
from flywheel.files import shown

# Which places each way to act knows of.
PLACES: dict[type[Effect], tuple[str, ...]] = {
    ModelEffect: get_args(Where),
    CommandEffect: ("robot", "winch"),
    WinchEffect: ("robot", "winch"),
    TensionEffect: ("robot", "cable"),
}
WORDS = ("equation", "source", "shown_by")
SOME = Scales(length=1.0, mass=1.0, cap=0.05, bodies=3)  # at which typical values are tried
LONGEST_NAME = 60


def wrong_in_declaration(kind: type[Effect]) -> str:
    """The first fault in the declaration of a class, as the end of a sentence; "" for none."""
    return next(_wrong(kind), "")


def _wrong(kind: type[Effect]) -> Iterator[str]:
    name = getattr(kind, "name", None)
    if name is None:
        yield "has no `name`"
    if not isinstance(name, str) or not name.isidentifier() or len(name) > LONGEST_NAME:
        yield (
            f"has the name {shown(name)}: a name consists of letters, digits and _, does not "
            f"begin with a digit, and has at most {LONGEST_NAME} characters"
        )
    way = next((way for way in PLACES if issubclass(kind, way)), None)
    if way is None:
        ways = ", ".join(each.__name__ for each in PLACES)
        yield f"must be one of these kinds: {ways}"
        return
    if missing := sorted(getattr(kind, "__abstractmethods__", ())):
        yield f"has no method `{missing[0]}`, which a {way.__name__} needs"
    if kind.where not in PLACES[way]:
        allowed = " or ".join(repr(place) for place in PLACES[way])
        yield f"has where = {shown(kind.where)}: a {way.__name__} is at {allowed}"
    if way is CommandEffect and not _is_number(getattr(kind, "stage", None)):
        yield "has no number as `stage`, its place on the way from the computer (0) to the spool"
    for word in WORDS:
        said = inspect.getattr_static(kind, word, None)
        if not isinstance(said, str) or not said.strip():
            yield f"does not declare its `{word}` as text"
    yield from _wrong_parameters(kind)


def _wrong_parameters(kind: type[Effect]) -> Iterator[str]:
    sizes, shapes = getattr(kind, "sizes", ()), kind.shapes
    for what, group in (("sizes", sizes), ("shapes", shapes)):
        if not isinstance(group, tuple) or not all(isinstance(p, Parameter) for p in group):
            yield f"has {what} that are not a tuple of Parameter; for one, write (Parameter(...),)"
            return
    if not sizes:
        yield "has no sizes, which are zero where the cause is absent"
    names = [parameter.name for parameter in (*sizes, *shapes)]
    if len(set(map(str, names))) < len(names):
        yield f"has two parameters of one name: {', '.join(map(str, names))}"
    for parameter in (*sizes, *shapes):
        for problem in _wrong_parameter(parameter):
            yield f"has a parameter {shown(parameter.name)} {problem}"
    yield from _wrong_ranges(sizes, shapes)


def _wrong_ranges(sizes: tuple[Parameter, ...], shapes: tuple[Parameter, ...]) -> Iterator[str]:
    """Sizes must include zero, and shapes need alternatives."""
    for size in sizes:
        if not size.low <= 0.0 <= size.high:
            yield (
                f"has a size {size.name} from {size.low:g} to {size.high:g} typical sizes: its bounds must "
                "include 0, where the cause is absent"
            )
    for shape in shapes:
        grid = shape.grid
        within = isinstance(grid, tuple) and all(
            _is_number(each) and shape.low <= each <= shape.high for each in grid
        )
        if not grid or not within:
            yield (
                f"has a shape {shape.name} whose grid is {shown(grid)}: a tuple of multiples of the typical "
                f"value, from {shape.low:g} to {shape.high:g}, is needed"
            )


def _wrong_parameter(parameter: Parameter) -> Iterator[str]:
    if not isinstance(parameter.name, str) or not parameter.name.isidentifier():
        yield "whose name does not consist of letters, digits and _"
    if not isinstance(parameter.unit, str) or not parameter.unit.strip():
        yield 'without a unit; write "-" for none'
    if not (_is_number(parameter.low) and _is_number(parameter.high)):
        yield (
            f"without bounds: low {shown(parameter.low)} and high {shown(parameter.high)} must be finite "
            "numbers, in typical sizes"
        )
        return
    if parameter.low >= parameter.high:
        yield f"whose low, {parameter.low:g}, is not below its high, {parameter.high:g}"
    try:
        typical: Any = parameter.typical(SOME)
    except Exception as problem:
        yield f"whose typical value raises {type(problem).__name__}: {problem}"
        return
    if not _is_number(typical) or typical <= 0:
        yield f"whose typical value is {shown(typical)}, not a positive number"


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
