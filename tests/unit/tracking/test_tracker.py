"""The tracker's records, with a list in MLflow's place."""

import math

import pytest

from flywheel.errors import ConfigError
from flywheel.results import GateDecision
from flywheel.runtime.tracking.publish import (
    publish_end,
    publish_iteration,
    publish_start,
)
from flywheel.runtime.tracking.tracker import Tracker
from tests.unit.reports.fake_run import fake_iteration, fake_run


class Notes:
    """A receiver that keeps the records."""

    def __init__(self):
        self.records = []

    def deliver(self, record):
        self.records.append(record)

    def is_permanent(self, error):
        return False

    def of(self, kind):
        return [record for record in self.records if record["kind"] == kind]

    def points(self):
        """(run, name, step) -> value of every number, each seen once."""
        points = {}
        for record in self.of("log"):
            for name, step, value in record["values"]:
                assert (record["run"], name, step) not in points
                points[record["run"], name, step] = value
        return points


@pytest.fixture
def notes():
    return Notes()


def test_a_number_is_logged_once_per_run_name_and_step_even_after_a_restart(tmp_path, notes):
    for value in (1.0, 2.0):
        tracker = Tracker(tmp_path, "key", notes)
        tracker.log("key", {"a": value}, step=3)
        tracker.log("key", {"a": value, "b": value}, step=4)
        tracker.log("other", {"a": value}, step=3)
        assert tracker.close(5)
    assert notes.points() == {
        ("key", "a", 3): 1.0,
        ("key", "a", 4): 1.0,
        ("key", "b", 4): 1.0,
        ("other", "a", 3): 1.0,
    }


@pytest.mark.parametrize("odd", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_not_finite_becomes_a_tag_and_a_health_warning(tmp_path, notes, odd):
    tracker = Tracker(tmp_path, "key", notes)
    tracker.log("key", {"error/e_rot": odd, "error/e_pos": 2.0}, step=7)
    assert tracker.close(5)
    assert notes.points() == {("key", "error/e_pos", 7): 2.0, ("key", "health/nonfinite", 7): 1.0}
    assert notes.of("describe")[0]["tags"] == {"nonfinite/error/e_rot": f"{odd} at 7"}


def test_only_the_gate_makes_a_champion_and_only_with_a_finite_number(tmp_path, notes):
    tracker = Tracker(tmp_path, "key", notes)
    refused = GateDecision(promoted=False, measure="e_rot [deg]", number=3.0)
    odd = GateDecision(promoted=True, measure="e_rot [deg]", number=math.nan)
    good = GateDecision(promoted=True, measure="e_rot [deg]", number=2.5, reason="lower")
    for decision in (refused, odd):
        with pytest.raises(ConfigError, match="passed the gate"):
            tracker.promote("weights", decision)
    tracker.promote("weights", good)
    assert tracker.close(5)
    assert [record["decision"]["number"] for record in notes.of("promote")] == ["2.5"]


def test_the_end_of_the_parent_ends_every_run_still_open(tmp_path, notes):
    tracker = Tracker(tmp_path, "key", notes)
    tracker.open("key", "name", {})
    tracker.open("key/a", "a", {}, parent="key")
    tracker.open("key/b", "b", {}, parent="key")
    tracker.end("key/a")
    tracker.end("key", "KILLED")
    assert tracker.close(5)
    ends = [(record["run"], record["status"]) for record in notes.of("end")]
    assert ends == [("key/a", "FINISHED"), ("key/b", "KILLED"), ("key", "KILLED")]


def test_files_outside_the_run_folder_and_odd_keys_are_refused(tmp_path, notes):
    tracker = Tracker(tmp_path / "run", "key", notes)
    with pytest.raises(ConfigError, match="inside"):
        tracker.artifact("key", tmp_path / "elsewhere.png")
    tracker.artifact("key", tmp_path / "run" / "figures" / "a.png")
    assert tracker.close(5)
    assert notes.of("artifact")[0]["path"] == "figures/a.png"
    with pytest.raises(ConfigError, match="letters"):
        Tracker(tmp_path, "it's", notes)


def test_an_iteration_makes_a_child_and_lines_that_share_their_names(tmp_path, notes):
    run = fake_run(iterations=3)
    tracker = Tracker(tmp_path, "key", notes)
    publish_start(tracker, run.config, {"config": run.config_digest})
    for iteration in run.iterations:
        publish_iteration(tracker, iteration)
    publish_end(tracker, run)
    assert tracker.close(5)
    opened = {record["run"]: record["parent"] for record in notes.of("open")}
    children = {f"key/{i.arm}-{i.iteration:04d}" for i in run.iterations}
    assert len(children) == 5
    assert {key for key, parent in opened.items() if parent == "key"} == children
    beside = {key for key, parent in opened.items() if not parent}
    lines = ("control-arm", "floor", "informed-floor", "oracle")
    assert beside == {"key", *(f"key/{line}" for line in lines)}
    points = notes.points()
    for line in ("key", "key/control-arm", "key/floor"):
        steps = [s for (r, n, s) in points if r == line and n == "error_pooled/short_e_rot_deg"]
        assert sorted(steps) == [0, 1, 2], line
    assert points["key", "closed_loop/success_rate", 2] == run.iterations[2].navigation.success.rate
    assert (
        points["key/control-arm", "closed_loop/success_rate", 0]
        == points["key", "closed_loop/success_rate", 0]
    )
    digests = {record["digest"] for record in notes.of("dataset")}
    assert digests == {iteration.snapshot for iteration in run.iterations}
    params = notes.of("describe")[0]["params"]
    assert params["mppi.beta"] == "0.05" and params["seed"] == "0"


def test_publishing_a_resumed_run_again_adds_no_number(tmp_path, notes):
    run = fake_run(iterations=2)
    counts = []
    for _ in range(2):
        tracker = Tracker(tmp_path, "key", notes)
        publish_start(tracker, run.config, {})
        for iteration in run.iterations:
            publish_iteration(tracker, iteration)
        publish_end(tracker, run)
        assert tracker.close(5)
        counts.append(len(notes.points()))
    assert counts[0] == counts[1] > 100


def test_a_refused_model_is_logged_but_not_promoted(tmp_path, notes):
    (tmp_path / "models").mkdir()
    tracker = Tracker(tmp_path, "key", notes)
    tracker.open("key", "name", {})
    good, refused = fake_iteration(2), fake_iteration(3)
    for result in (good, refused):
        publish_iteration(tracker, result, model_folder=tmp_path / "models", model_shape=(6, 6))
    assert tracker.close(5)
    assert [record["digest"] for record in notes.of("model")] == [good.model, refused.model]
    assert [record["digest"] for record in notes.of("promote")] == [good.model]
