"""The document has every effect of the library, as the library has it."""

from pathlib import Path

import pytest

from flywheel.effects import NAMED

DOCUMENT = (Path(__file__).parents[3] / "docs" / "effects.md").read_text()


@pytest.mark.parametrize("name", NAMED)
def test_an_effect_is_documented_with_its_parameters_and_equation(name: str) -> None:
    effect = NAMED[name]
    (row,) = (line for line in DOCUMENT.splitlines() if line.startswith(f"| `{name}`"))
    for parameter in effect.parameters:
        assert f"{parameter.name} [{parameter.unit}]" in row
    assert effect.equation.replace("|", "\\|") in row
    assert effect.shown_by in row
    assert effect.source in row
