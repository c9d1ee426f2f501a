"""Designed scripts can be played, and are what they are said to be."""

from dataclasses import replace

import numpy as np
import pytest

from flywheel.diagnosis.experiments.command_scripts import FAMILIES, WinchRange, varied
from flywheel.diagnosis.experiments.design import Design, Designer, Rival
from flywheel.diagnosis.experiments.information import information_of, simulate_scripts
from flywheel.diagnosis.fitting.windows import ChannelNoise
from flywheel.diagnosis.settings import Settings, changed
from flywheel.dynamics.plant import Plant
from flywheel.errors import DataError, UnknownNameError
from flywheel.options import DesignOptions
from flywheel.reports.experiment_page import design_sentence
from flywheel.robots import Robot, load_robot

pytestmark = pytest.mark.slow

SIGMA = 0.009


@pytest.mark.parametrize("name", ["prism3", "platform4"])
def test_scripts_stay_where_winches_can_go(name: str, seed: int) -> None:
    robot, rng, dt = load_robot(name), np.random.default_rng(seed), 0.01
    start = robot.winch_of(robot.keyframe)
    reach = WinchRange.around(robot, start, dt)
    wishes = [family(reach, 137, rng) for family in FAMILIES.values()]
    wishes += [varied(reach, wishes[i], wishes[i - 1], 0.3, rng) for i in range(len(wishes))]
    path = reach.path(np.stack(wishes))
    commands = reach.commands(path)
    assert (commands >= robot.control_low).all()
    assert (commands <= robot.control_high).all()
    assert (path >= np.maximum(robot.rest_low, reach.low) - 1e-9).all()
    assert (path <= np.minimum(robot.rest_high, reach.high) + 1e-9).all()
    reached = robot.dead_reckon(np.tile(start, (len(path), 1)), commands, dt)[:, 1:]
    rate = robot.rate_driven
    assert np.allclose(reached[..., rate], path[..., rate], atol=1e-9), seed
    moved = np.ptp(path, axis=1).max(axis=1)
    assert (moved > 1e-3 * start.min()).all(), (seed, moved)


def test_rivals_are_found_by_name_and_place(robot: Robot) -> None:
    assert len(Rival.named("payload", robot).candidates) == len(robot.points)
    (one,) = Rival.named("payload@s2", robot).candidates
    assert one.label == "payload at s2"
    with pytest.raises(UnknownNameError, match="Did you mean 'capstan'"):
        Rival.named("capstn", robot)
    with pytest.raises(UnknownNameError, match="no place of payload 's9'"):
        Rival.named("payload@s9", robot)
    with pytest.raises(DataError, match="of the whole robot"):
        Rival.named("capstan@s2", robot)


def rivals(robot: Robot, *names: str) -> list[Rival]:
    return [Rival.named(name, robot) for name in names]


@pytest.mark.parametrize("names", [(), ("capstan",), ("payload", "payload@s1")])
def test_a_design_needs_different_rivals(robot: Robot, names: tuple[str, ...]) -> None:
    with pytest.raises(DataError, match="two or more different rivals"):
        Designer(Plant(robot), rivals(robot, *names), SIGMA)


def designer_of(robot: Robot, seconds: float, count: int, seed: int = 0) -> Designer:
    options = DesignOptions(seconds=seconds, candidates=count, seed=seed)
    named = rivals(robot, "cable_friction", "payload@s1", "capstan")
    return Designer(Plant(robot), named, SIGMA, options)


@pytest.mark.parametrize(("seconds", "count"), [(0.02, 4), (1.0, 0)])
def test_a_design_needs_something_to_try(robot: Robot, seconds: float, count: int) -> None:
    with pytest.raises(DataError, match=f"got {count} of {round(seconds / 0.01)}"):
        designer_of(robot, seconds, count).design()


@pytest.fixture(scope="module")
def designer(robot: Robot, seed: int) -> Designer:
    return designer_of(robot, 0.6, 8, seed)


@pytest.fixture(scope="module")
def design(designer: Designer) -> Design:
    return designer.design()


def test_a_design_says_what_its_commands_are_worth(designer, design, seed):
    """The search's own number comes out again from the commands alone."""
    scripts = design.controls[None]
    motion = simulate_scripts(designer.plant, scripts)
    again = information_of(designer.plant, scripts, motion, designer.library, SIGMA)
    assert motion.finite.all()
    apart = [again.separation(i, j)[0] for i in range(3) for j in range(3) if i != j]
    assert min(apart) == pytest.approx(design.separation, rel=1e-6), seed
    assert min(pair.separation for pair in design.pairs) == pytest.approx(design.separation)
    assert len(design.pairs) == 3


def test_the_search_never_loses_what_it_had(design: Design, seed: int) -> None:
    assert list(design.history) == sorted(design.history), seed
    assert design.history[-1] == design.separation
    assert design.separation >= design.plain
    assert design.tried == 8 + 4 * 2


def test_the_same_seed_gives_the_same_script(robot: Robot, seed: int) -> None:
    one, same, other = (
        designer_of(robot, 0.3, 1, s).design().controls for s in (seed, seed, seed + 1)
    )
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


def test_rivals_are_told_apart_by_the_threshold_of_the_diagnosis(robot: Robot) -> None:
    strict = changed(Settings(), {"limits.threshold": 36.0})
    named = rivals(robot, "cable_friction", "capstan")
    options = DesignOptions(seconds=0.3, candidates=1)
    found = Designer(Plant(robot), named, SIGMA, options, strict).design()
    assert found.needed == found.summary()["enough"] == 6.0
    assert found.summary()["settings"] == {"limits.threshold": 36.0}
    assert [replace(found, separation=apart).enough for apart in (5.9, 6.1)] == [False, True]


def test_load_cells_separate_what_points_alone_do_not(robot: Robot) -> None:
    cells = [ChannelNoise(("tension", cable.name), 0.5) for cable in robot.cables]
    named = rivals(robot, "cable_friction", "capstan")
    few = DesignOptions(seconds=0.3, candidates=1)
    found = Designer(Plant(robot), named, SIGMA, few, channels=cells).design()
    designer = Designer(Plant(robot), named, SIGMA)
    scripts = found.controls[None]
    motion = simulate_scripts(designer.plant, scripts)
    bare = information_of(designer.plant, scripts, motion, designer.library, SIGMA)
    assert found.by_points == designer.separation(bare, [(0, 1)])[0] < found.separation
    assert found.summary()["by_points_alone"] == found.by_points
    assert f"By points alone it is {found.by_points:.1f}." in design_sentence(found)
