"""Every number of every setting is bounded: none takes infinity, NaN, or what no machine could do."""

import importlib
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

import pytest
from pydantic import BaseModel

import flywheel
from flywheel.diagnosis.results.answer import Answer
from flywheel.dynamics.baselines import LinearConfig
from flywheel.dynamics.residual import CorrectedPlant, ResidualConfig
from flywheel.effects import AdoptedPlant
from flywheel.errors import ConfigError
from flywheel.quantities import Bounds
from flywheel.results import ResultRecord
from flywheel.runtime.config.run_config import RunConfig
from flywheel.training.baselines import FitSettings
from flywheel.training.residual import ResidualTraining
from flywheel.validation import validated

SETTINGS = (
    RunConfig,
    AdoptedPlant,
    ResidualConfig,
    ResidualTraining,
    CorrectedPlant,
    LinearConfig,
    FitSettings,
)
NOT_ALLOWED = (math.inf, -math.inf, math.nan, 1e300, -1e300, 10**30, 10**400, True, "5", [1])
# Evidence, which is shown, and compared at most.
SHOWN_ONLY = ("Fitted.low", "Fitted.high", "HeldOut.")


@dataclass(frozen=True)
class Number:
    """A number somewhere in a model.

    Attributes:
      path: "a.b.0.c"; "x" is any key of a mapping.
      sizes: at each part of the path, the length of the list that it is an index of; 0 for a name.
      bounded: its type has bounds.
    """

    path: tuple[str, ...] = ()
    sizes: tuple[int, ...] = ()
    bounded: bool = False

    def within(self, part: str, size: int = 0) -> "Number":
        """The same number, seen from outside."""
        return Number((part, *self.path), (size, *self.sizes), self.bounded)

    def as_values(self, value: object) -> dict[str, Any]:
        """Plain values with this one in its place, and in its neighbours'."""
        for part, size in zip(reversed(self.path), reversed(self.sizes), strict=True):
            value = [value] * size if size else {part: value}
        assert isinstance(value, dict)
        return value


def numbers(annotation: Any, bounded: bool = False, deep: bool = True) -> Iterator[Number]:
    """All numbers in a type; with `deep` also those in models within it."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if annotation in (int, float):
        yield Number(bounded=bounded)
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield from numbers_of(annotation) if deep else ()
    elif origin is Annotated:
        bounded = any(isinstance(each, Bounds) for each in arguments[1:])
        yield from numbers(arguments[0], bounded, deep)
    elif origin is tuple:
        items = [each for each in arguments if each is not Ellipsis]
        for index, item in enumerate(items):
            yield from (n.within(str(index), len(items)) for n in numbers(item, False, deep))
    elif origin is dict:
        yield from (number.within("x") for number in numbers(arguments[1], False, deep))
    else:
        for argument in arguments:
            yield from numbers(argument, False, deep)


def numbers_of(model: type[BaseModel], deep: bool = True) -> Iterator[Number]:
    """Of all fields of a model."""
    for name, field in model.model_fields.items():
        bounded = any(isinstance(each, Bounds) for each in field.metadata)
        yield from (n.within(name) for n in numbers(field.annotation, bounded, deep))


PLACES = [
    pytest.param(model, number, id=f"{model.__name__}.{'.'.join(number.path)}")
    for model in SETTINGS
    for number in numbers_of(model)
]


def test_the_walk_finds_numbers_in_parts_lists_and_mappings() -> None:
    found = {".".join(number.path) for number in numbers_of(RunConfig)}
    assert {
        "seed",
        "collect.mppi_samples",
        "datasets.0.plant.mass",
        "effects.0.parameters.x",
        "diagnose.unsure.x",
        "task.radius.1",
        "task.obstacles.0.half_size.2",
        "training.initial.stages.0.chunks",
        "training.mix.x",
    } <= found
    assert len(found) > 100


@pytest.mark.parametrize(("model", "number"), PLACES)
def test_no_setting_takes_a_number_without_bounds(model: type[BaseModel], number: Number) -> None:
    where = re.escape(".".join(number.path))
    for value in NOT_ALLOWED:
        with pytest.raises(ConfigError) as caught:
            validated(model, number.as_values(value), "x", ConfigError)
        message = str(caught.value)
        assert re.search(
            rf"^  {where}: must be a (whole )?number (from|above|at least) .*; got .", message, re.M
        ), message
        assert len(message) < 10_000


def models() -> Iterator[type[BaseModel]]:
    """Every model of the library."""
    folder = Path(flywheel.__file__).parent
    for file in folder.rglob("*.py"):
        if "pydantic" in file.read_text():
            name = file.relative_to(folder.parent).with_suffix("").as_posix().replace("/", ".")
            importlib.import_module(name)
    classes: list[type[BaseModel]] = [BaseModel]
    for each in classes:
        classes += each.__subclasses__()
    return (each for each in classes if each.__module__.startswith("flywheel."))


def test_what_people_write_has_bounds_in_models_to_come_too() -> None:
    written = [
        model
        for model in models()
        if not issubclass(model, ResultRecord) and not model.__module__.endswith(".mapping")
    ]
    assert Answer in written
    unbounded = {
        f"{model.__name__}.{number.path[0]}"
        for model in written
        for number in numbers_of(model, deep=False)
        if not number.bounded
    }
    assert {each for each in unbounded if not each.startswith(SHOWN_ONLY)} == set()
