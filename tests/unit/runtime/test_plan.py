"""What a run means to record follows from its configuration alone."""

from collections import Counter

import pytest

from flywheel.errors import ConfigError
from flywheel.runtime.config.parts import CollectConfig, DataSet, EvaluateConfig
from flywheel.runtime.config.run_config import RunConfig
from flywheel.runtime.workers.episode_plan import (
    ceiling,
    collection,
    evaluation,
    unseen,
    unseen_ceiling,
)

CONFIG = RunConfig(
    collect=CollectConfig(gaits=6, random=10, drops=5, mppi=10, validation=0.2, test=0.2),
    evaluate=EvaluateConfig(tasks=3),
    datasets=(DataSet(), DataSet(name="soft")),
)


def everything(config: RunConfig):
    arms = ("mppi", "control")
    later = [p for i in (1, 2) for arm in arms for p in collection(config, i, arm)]
    judged = [p for i in (0, 1, 2) for p in evaluation(config, i, "mppi")]
    elsewhere = [
        p
        for course in ("maze", "a/wall.xml", "b/wall.xml")
        for p in (*unseen(config, course), *unseen_ceiling(config, course))
    ]
    return [*collection(config, 0, "mppi"), *later, *judged, *ceiling(config), *elsewhere]


def test_every_episode_of_a_run_has_its_own_name():
    names = Counter(plan.id for plan in everything(CONFIG))
    assert max(names.values()) == 1


def test_the_plan_is_the_same_whenever_it_is_made():
    assert everything(CONFIG) == everything(CONFIG)


def test_another_seed_gives_other_episodes_of_the_same_names():
    other = everything(CONFIG.model_copy(update={"seed": 1}))
    assert [p.id for p in other] == [p.id for p in everything(CONFIG)]
    assert not {p.seed for p in other} & {p.seed for p in everything(CONFIG)}


def test_each_kind_of_episode_is_split_by_the_shares():
    plans = collection(CONFIG, 0, "mppi")
    gaits = Counter(p.split for p in plans if p.controller.startswith("gait"))
    random = Counter(p.split for p in plans if p.controller == "random")
    assert gaits == {"train": 4, "validation": 1, "test": 1}
    assert random == {"train": 6, "validation": 2, "test": 2}
    assert Counter(p.split for p in collection(CONFIG, 1, "mppi")) == {"train": 8, "validation": 2}


def test_only_tests_are_judged_on_and_only_iteration_zero_collects_them():
    assert {p.split for p in evaluation(CONFIG, 1, "mppi")} == {"test"}
    assert "test" not in {p.split for p in collection(CONFIG, 2, "control")}


def test_all_iterations_and_the_ceiling_are_judged_on_the_same_tasks():
    tasks = [p.task_seed for p in evaluation(CONFIG, 0, "mppi")]
    assert len(set(tasks)) == 3
    assert tasks == [p.task_seed for p in evaluation(CONFIG, 2, "mppi")]
    assert tasks == [p.task_seed for p in ceiling(CONFIG)]


def test_the_control_arm_has_as_many_episodes_from_the_same_starts_but_no_tasks():
    mppi, control = (collection(CONFIG, 1, arm) for arm in ("mppi", "control"))
    assert [p.seed for p in mppi] == [p.seed for p in control]
    assert [p.split for p in mppi] == [p.split for p in control]
    assert {p.controller for p in control} == {"random"}
    assert {p.task_seed for p in control} == {None}


def test_only_collecting_may_try_fewer_plans():
    fewer = CONFIG.collect.model_copy(update={"mppi_samples": 7})
    config = CONFIG.model_copy(update={"collect": fewer})
    assert {p.samples for p in collection(config, 1, "mppi")} == {7}
    others = [
        p for p in everything(config) if not p.id.startswith(("i0001-mppi-coll", "i0002-mppi-coll"))
    ]
    assert {p.samples for p in others} == {None}
    assert {p.samples for p in everything(CONFIG)} == {None}


def test_all_gaits_and_all_data_sets_are_recorded():
    plans = collection(CONFIG, 0, "mppi")
    assert {"gait:roll", "gait:cw", "gait:ccw", "random", "drop"} == {p.controller for p in plans}
    assert {p.dataset for p in plans} == {0, 1}
    assert {p.dataset for p in collection(CONFIG, 1, "mppi")} == {0}


def test_too_few_episodes_for_all_splits_are_refused_with_the_settings_to_change():
    few = CONFIG.model_copy(update={"collect": CollectConfig(gaits=1, random=1, drops=0)})
    with pytest.raises(ConfigError, match="no test and no validation episode.*collect.gaits"):
        collection(few, 0, "mppi")


def test_courses_are_taken_in_turn_and_only_by_what_is_collected() -> None:
    courses = ("s_course", "incline", "corridor")
    collect = CONFIG.collect.model_copy(update={"courses": courses})
    config = CONFIG.model_copy(update={"collect": collect, "datasets": (DataSet(),)})
    first, later = collection(config, 0, "mppi"), collection(config, 1, "mppi")
    for kind in ("gait", "random", "drop"):
        of = [p.course for p in first if p.controller.startswith(kind)]
        assert of == [courses[n % 3] for n in range(len(of))]
    assert [p.course for p in later] == [courses[n % 3] for n in range(10)]
    assert all(p.task_seed is None for p in first) and all(p.task_seed for p in later)
    assert {p.course for p in evaluation(config, 0, "mppi")} == {""}
    assert {p.course for p in everything(CONFIG) if p.iteration >= 0} == {""}


def test_every_data_set_meets_every_course() -> None:
    collect = CONFIG.collect.model_copy(update={"courses": ("incline", "corridor")})
    plans = collection(CONFIG.model_copy(update={"collect": collect}), 0, "mppi")
    met = {(p.dataset, p.course) for p in plans if p.controller == "random"}
    assert len(met) == 4


def test_a_course_that_is_none_is_refused_where_the_configuration_is_read() -> None:
    with pytest.raises(ValueError, match="courses[^?]*no course 'walls'"):
        CollectConfig(courses=("walls",))
