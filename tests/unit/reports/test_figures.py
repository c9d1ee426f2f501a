"""Every figure draws whatever a run has, and nothing where it has nothing."""

import math

import numpy as np
import pytest
from matplotlib.patches import Polygon

from flywheel.errors import UnknownNameError
from flywheel.reports.error_figures import (
    error_by_lead_time,
    error_over_iterations,
    training_curves,
)
from flywheel.reports.figures import FIGURES, draw, write_figures
from flywheel.reports.goal_figures import unseen_courses, walks
from flywheel.results import RunResult
from flywheel.robots import Box, load_course
from tests.unit.reports.fake_run import fake_errors, fake_run, turnless, with_robot


@pytest.fixture(scope="module")
def run():
    return with_robot(fake_run(2))


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_is_drawn_from_a_run_and_not_at_all_from_nothing(name, run):
    first = draw(name, run)
    assert first is not None and first.startswith(b"<?xml")
    assert draw(name, RunResult(name="empty", key="k")) is None


def test_a_figure_is_the_same_file_for_the_same_run(run):
    assert draw("success", run) == draw("success", run)


@pytest.mark.parametrize("name", sorted({*FIGURES} - {"ladder", "unseen"}))
def test_a_figure_of_one_iteration_of_an_unfinished_run_without_rotations_is_drawn(name):
    assert draw(name, turnless(with_robot(fake_run(1, finished=False)))) is not None


@pytest.mark.slow
def test_unseen_courses_have_a_row_each_and_the_walls_of_their_own(run):
    (maze,) = run.unseen
    alone = maze.model_copy(update={"course": "alone", "oracle": None})
    figure = unseen_courses(run.model_copy(update={"unseen": (maze, alone)}))
    assert [axes.get_title().split(":")[0] for axes in figure.axes] == [
        "maze",
        "maze, oracle",
        "alone",
    ]
    walls = len(load_course("maze").obstacles)
    for axes in figure.axes:
        assert sum(isinstance(patch, Polygon) for patch in axes.patches) == walls


@pytest.mark.slow
def test_a_run_with_holes_is_drawn_around_them(run):
    bad = fake_errors(math.nan, full=False)
    holes = [
        run.iterations[0].model_copy(update={"navigation": None, "overlay": None}),
        run.iterations[1].model_copy(update={"test": bad, "gate": None, "curve": ()}),
        run.iterations[2].model_copy(update={"test": None, "navigation": None}),
    ]
    changes = {"iterations": tuple(holes), "pooled": (), "oracle": None, "floor": None}
    holed = run.model_copy(update=changes)
    drawn = {name for name in FIGURES if draw(name, holed) is not None}
    assert drawn == set(FIGURES)


def on_a_course(run: RunResult, obstacles: list[tuple[Box, ...]]) -> RunResult:
    """The same walks, among the obstacles in turn."""

    def among(navigation):
        moved = [
            walk.model_copy(update={"obstacles": obstacles[i % len(obstacles)]})
            for i, walk in enumerate(navigation.walks)
        ]
        return navigation.model_copy(update={"walks": tuple(moved)})

    turns = [
        t.model_copy(update={"navigation": t.navigation and among(t.navigation)})
        for t in run.iterations
    ]
    oracle = run.oracle and among(run.oracle)
    return run.model_copy(update={"iterations": tuple(turns), "oracle": oracle})


def test_walks_on_a_course_are_where_they_were_among_its_obstacles(run):
    course = load_course("s_course").obstacles
    figure = walks(on_a_course(run, [course]))
    for axes in (axes for axes in figure.axes if axes.get_visible()):
        drawn = [p for p in axes.patches if isinstance(p, Polygon)]
        outlines = [patch.get_xy() for patch in drawn]
        centers = {tuple(np.round((o.min(0) + o.max(0)) / 2, 9)) for o in outlines}
        assert centers == {box.center[:2] for box in course}
        low, high = (np.array([axes.get_xlim(), axes.get_ylim()]).T)[[0, 1]]
        assert all((low <= outline).all() and (outline <= high).all() for outline in outlines)
    assert figure.axes[-1].get_xlabel() == "x [m]"


def test_walks_among_obstacles_of_their_own_begin_at_one_point(run):
    course = load_course("s_course").obstacles
    figure = walks(on_a_course(run, [course[:1], course[1:]]))
    assert not any(isinstance(p, Polygon) for axes in figure.axes for p in axes.patches)
    assert figure.axes[-1].get_xlabel() == "x - start [m]"


@pytest.mark.slow
def test_figures_are_written_under_their_names(tmp_path, run):
    small = run.model_copy(update={"iterations": (), "oracle": None, "unseen": ()})
    assert write_figures(small, tmp_path) == []
    only = run.model_copy(update={"iterations": run.iterations[:1], "pooled": (), "oracle": None})
    written = write_figures(only, tmp_path / "figures")
    assert written and {path.stem for path in written} <= set(FIGURES)
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in written)


def test_an_unknown_figure_is_refused_with_the_known_ones(run):
    with pytest.raises(UnknownNameError, match="success"):
        draw("succes", run)


def test_what_a_robot_does_not_show_has_no_axes(run):
    for draw_errors in (error_by_lead_time, error_over_iterations, training_curves):
        labels = [axes.get_ylabel() for axes in draw_errors(turnless(run)).axes]
        assert not any("rotation" in label for label in labels)
        assert any("rotation" in axes.get_ylabel() for axes in draw_errors(run).axes)


def test_steps_of_a_short_training_are_whole_numbers(run):
    short = [
        each.model_copy(
            update={
                "curve": tuple(
                    p.model_copy(update={"step": 20 + 10 * k}) for k, p in enumerate(each.curve[:3])
                )
            }
        )
        for each in run.iterations
    ]
    figure = training_curves(run.model_copy(update={"iterations": tuple(short)}))
    for axes in figure.axes:
        assert all(float(tick).is_integer() for tick in axes.get_xticks())
