import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from flywheel.training import Schedule, Stage, TrainingConfig
from flywheel.training.schedules import learning_rate, spans, stage_at

SCHEDULES = st.builds(
    lambda stages, spare, warmup: Schedule(
        steps=len(stages) + spare,
        stages=tuple(Stage(chunks=c, share=s) for c, s in stages),
        learning_rate=1e-3,
        warmup_steps=warmup,
    ),
    st.lists(st.tuples(st.integers(1, 32), st.floats(1e-3, 10.0)), min_size=1, max_size=6),
    st.integers(0, 5000),
    st.integers(0, 300),
)


@settings(deadline=None)
@given(SCHEDULES)
def test_the_stages_fill_the_budget_without_gap_or_overlap(schedule):
    stages = spans(schedule)
    assert stages[0].start == 0
    assert stages[-1].stop == schedule.steps
    for before, after in itertools.pairwise(stages):
        assert before.stop == after.start
    assert all(stage.stop > stage.start for stage in stages)
    assert [s.chunks for s in stages] == [s.chunks for s in schedule.stages]


@settings(deadline=None)
@given(SCHEDULES, st.data())
def test_every_step_belongs_to_the_stage_around_it(schedule, data):
    step = data.draw(st.integers(0, schedule.steps - 1))
    stage = stage_at(schedule, step)
    assert stage.start <= step < stage.stop


def test_shares_divide_the_budget():
    stages = tuple(Stage(chunks=c, share=s) for c, s in ((1, 1), (2, 1), (4, 2)))
    schedule = Schedule(steps=1000, stages=stages, learning_rate=1.0, warmup_steps=0)
    lengths = [s.stop - s.start for s in spans(schedule)]
    assert lengths == pytest.approx([250, 250, 500], abs=2)


def test_the_rate_rises_linearly_and_falls_to_its_last_value():
    schedule = Schedule(
        steps=500,
        stages=(Stage(chunks=1, share=1),),
        learning_rate=0.4,
        warmup_steps=100,
        final_rate=0.05,
    )
    assert learning_rate(schedule, 0) == pytest.approx(0.004)
    assert learning_rate(schedule, 49) == pytest.approx(0.2)
    assert learning_rate(schedule, 100) == pytest.approx(0.4)
    assert learning_rate(schedule, 499) == pytest.approx(0.02)
    falling = [learning_rate(schedule, s) for s in range(100, 500)]
    assert falling == sorted(falling, reverse=True)


def test_a_budget_with_fewer_steps_than_stages_is_refused():
    with pytest.raises(ValidationError, match="too few"):
        Schedule(
            steps=1,
            stages=(Stage(chunks=1, share=1), Stage(chunks=2, share=1)),
            learning_rate=1e-3,
            warmup_steps=0,
        )


def test_unknown_settings_are_refused():
    with pytest.raises(ValidationError, match="learningrate"):
        TrainingConfig(learningrate=1e-3)
