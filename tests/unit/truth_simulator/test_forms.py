"""Laws that the library does not have: they move the robot, and stay out of the library."""

import numpy as np
import pytest

from flywheel.effects import NAMED
from flywheel.robots import load_robot
from flywheel.truth_simulator import HIDDEN, OTHER_FORMS, UNKNOWN_LAWS, TruthSimulator
from flywheel.truth_simulator.scripts import script
from flywheel.truth_simulator.written import hidden_effects

ROBOT, DT = load_robot("prism3"), 0.01
KINDS = {**OTHER_FORMS, **UNKNOWN_LAWS}
CONTROLS = script("random_steps", ROBOT, 2.5, DT, np.random.default_rng(0))


@pytest.fixture(scope="module")
def plain():
    return TruthSimulator(ROBOT).run(CONTROLS, DT, settle=0.2).points


def test_half_of_them_at_least_have_no_name_in_the_library() -> None:
    assert len(UNKNOWN_LAWS) >= len(KINDS) / 2 and len(KINDS) >= 12
    assert not UNKNOWN_LAWS.keys() & NAMED.keys()
    assert {kind.family for kind in OTHER_FORMS.values()} <= NAMED.keys() & HIDDEN.keys()


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_it_moves_the_robot_and_of_size_zero_it_does_not(name: str, plain) -> None:
    [typical] = hidden_effects([name], ROBOT)
    nothing, few = typical.scaled(0.0), CONTROLS[:40]
    still = TruthSimulator(ROBOT, [nothing]).run(few, DT, settle=0.2).points
    np.testing.assert_array_equal(still, plain[: len(still)])
    moved = TruthSimulator(ROBOT, [typical]).run(CONTROLS, DT, settle=0.2).points
    off = np.sqrt(((moved - plain) ** 2).sum(-1).mean(-1)).max() / ROBOT.length
    assert 5e-4 < off < 0.3
