from pathlib import Path

import pytest

from flywheel.effects import WrittenTerm
from flywheel.runtime.workers.trainer_worker import TrainingOrder
from flywheel.training import TrainingConfig

FRICTION = WrittenTerm(effect="cable_friction", parameters={"force": 700.0})
PAYLOAD = WrittenTerm(effect="payload", location="s5", parameters={"mass": 29.0})


@pytest.mark.parametrize(
    ("effects", "asked", "used"),
    [
        ((), True, True),
        ((FRICTION,), True, True),
        ((FRICTION, PAYLOAD), True, False),
        ((), False, False),
    ],
)
def test_a_robot_with_an_effect_at_one_place_has_no_like_sides(effects, asked, used):
    order = TrainingOrder("i0001-mppi", Path("model"), Path("cache"), None, 7, effects)
    recipe = order.recipe(TrainingConfig(symmetries=asked))
    assert (recipe.symmetries, recipe.seed) == (used, 7)
