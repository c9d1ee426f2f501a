"""Numbers within bounds: what passes, what does not, and what is said of it."""

import math
import subprocess
import sys
from fractions import Fraction
from typing import Annotated

import numpy as np
import pytest
import torch
from pydantic import BaseModel, ValidationError

from flywheel.errors import RobotError
from flywheel.quantities import SEED, Bounds

NOT_NUMBERS = (None, True, False, "1", [1], {}, 1j)
NOT_FINITE = (math.inf, -math.inf, math.nan, 1e300, -1e300, 10**400)


class Setting(BaseModel):
    count: Annotated[int, Bounds(1, 1000)] = 3
    seconds: Annotated[float, Bounds(0, 86_400, "s", above=True)] | None = 1.0
    range: tuple[Annotated[float, Bounds(0, 1, below=True)], ...] = ()


@pytest.mark.parametrize("value", [1, 1000, 5.0, np.int64(7), Fraction(6, 2)])
def test_whole_numbers_within_the_bounds_pass_however_they_are_written(value: float) -> None:
    read = Setting.model_validate({"count": value}).count
    assert (type(read), read) == (int, value)


@pytest.mark.parametrize("value", [0, 1001, 2.5, 1e18, *NOT_NUMBERS, *NOT_FINITE])
def test_whatever_is_no_whole_number_within_the_bounds_is_refused(value: object) -> None:
    with pytest.raises(ValidationError, match="count\n  must be a whole number from 1 to 1,000"):
        Setting.model_validate({"count": value})


@pytest.mark.parametrize("value", [0, -1, 86_401, *NOT_NUMBERS[1:], *NOT_FINITE])
def test_optional_numbers_have_bounds_too(value: object) -> None:
    with pytest.raises(ValidationError, match="a number above 0 and at most 86,400 s"):
        Setting.model_validate({"seconds": value})
    assert Setting(seconds=None).seconds is None


def test_numbers_in_lists_are_named_by_their_place() -> None:
    with pytest.raises(ValidationError, match=r"range.1\n  must be .* at least 0 and below 1"):
        Setting(range=(0.5, 1.0))


def test_a_number_from_elsewhere_is_checked_by_the_same_bounds() -> None:
    bounds = Bounds(1e-6, 1, "s")
    assert bounds.check(0.005, "The timestep", RobotError) == 0.005
    with pytest.raises(
        RobotError, match=r"The timestep must be a number from 1e-06 to 1 s; got inf\."
    ):
        bounds.check(math.inf, "The timestep", RobotError)


def test_what_the_command_line_imports_leaves_pydantic_for_later() -> None:
    code = "import sys, flywheel.quantities; sys.exit('pydantic' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_torch_draws_other_numbers_by_each_allowed_seed_and_repeats_them_beyond() -> None:
    def drawn(seed: int) -> list[float]:
        return torch.rand(4, generator=torch.Generator().manual_seed(seed)).tolist()

    last = int(SEED.high)
    assert len({tuple(drawn(seed)) for seed in (0, 1, 2**31, last)}) == 4
    assert drawn(last + 1) == drawn(0)
    assert last in SEED
    assert last + 1 not in SEED
