"""What a run becomes at MLflow, with notes in MLflow's place."""

from collections import defaultdict
from types import MappingProxyType

import pytest

from flywheel.runtime.run.folder import RunFolder
from flywheel.runtime.run.publish import Page
from flywheel.runtime.tracking.dashboard import DATABASE
from flywheel.runtime.tracking.mlflow_client import Run
from tests.unit.reports.fake_run import fake_run


class Notes:
    """A board that notes what it is asked for; fails at the call of a given number."""

    def __init__(self, path, fails_at=-1):
        self.uri = f"sqlite:///{path / DATABASE}"
        self.points = {}  # (run, name, step, time stamp) -> value
        self.runs, self.parents, self.params = {}, {}, {}
        self.told = defaultdict(list)
        self.calls, self.fails_at = 0, fails_at

    def _call(self, kind, *what):
        self.calls += 1
        if self.calls == self.fails_at:
            raise ConnectionError(kind)
        self.told[kind].append(what)

    def run(self, key, name, tags, parent=None, begun=0.0):
        self._call("run", key)
        if key not in self.runs:
            self.runs[key] = Run(key, int(1000 * begun) or 1, dict(tags))
            self.parents[key] = parent.id if parent else ""
        return self.runs[key]

    def log(self, run, rows, since=None):
        self._call("log", run.id)
        at = (since or run).begun
        for step, values in rows:
            for name, value in values.items():
                old = self.points.setdefault((run.id, name, step, at), value)
                assert old == value or old != old, name

    def describe(self, run, params=MappingProxyType({}), tags=MappingProxyType({})):
        self._call("describe", run.id)
        self.params |= params
        run.tags.update(tags)

    def status(self, run, status, at=0.0):
        self._call("status", run.id, status)

    def dataset(self, run, name, digest, profile):
        self._call("dataset", digest)

    def artifact(self, run, path):
        self._call("artifact", path)

    def model(self, run, key, name, digest, folder, shape, tags, step=0):
        self._call("model", digest)

    def promote(self, run, digest, decision):
        self._call("promote", digest, decision.promoted)

    def steps(self, run, name):
        """The steps of a line, each of which must have one time stamp only."""
        found = sorted(step for r, n, step, _ in self.points if (r, n) == (run, name))
        assert len(found) == len(set(found)), (run, name)
        return found


@pytest.fixture
def notes(tmp_path):
    (tmp_path / DATABASE).write_text("there")
    return Notes(tmp_path)


def page(notes, tmp_path):
    return Page(notes, RunFolder(tmp_path), (6, 6))


def test_an_iteration_makes_a_child_and_lines_that_share_their_names(tmp_path, notes):
    run = fake_run(iterations=3)
    page(notes, tmp_path).publish(run, "FINISHED")
    key = run.key
    children = {f"{key}/{i.arm}-{i.iteration:04d}" for i in run.iterations}
    assert len(children) == 5
    assert {child for child, parent in notes.parents.items() if parent == key} == children
    lines = ("control-arm", "floor", "informed-floor", "oracle")
    beside = {child for child, parent in notes.parents.items() if not parent}
    assert beside == {key, *(f"{key}/{line}" for line in lines)}
    for line in (key, f"{key}/control-arm", f"{key}/floor"):
        assert notes.steps(line, "error_pooled/short_e_rot_deg") == [0, 1, 2], line
    for line in (key, f"{key}/control-arm"):
        assert notes.steps(line, "closed_loop/success_rate") == [0, 1, 2], line
    values = {(r, n, s): v for (r, n, s, _), v in notes.points.items()}
    rate = run.iterations[2].navigation.success.rate
    assert values[key, "closed_loop/success_rate", 2] == rate
    assert (
        values[f"{key}/control-arm", "closed_loop/success_rate", 0]
        == values[key, "closed_loop/success_rate", 0]
    )
    assert {digest for (digest,) in notes.told["dataset"]} == {i.snapshot for i in run.iterations}
    params = notes.params
    assert params["mppi.beta"] == "0.05" and params["seed"] == "0"


def test_every_model_is_logged_and_the_gate_decides_on_the_champion(tmp_path, notes):
    run = fake_run(iterations=4)
    page(notes, tmp_path).publish(run, "FINISHED")
    assert [digest for (digest,) in notes.told["model"]] == [i.model for i in run.iterations]
    gates = [(i.model, i.gate.promoted) for i in run.iterations if i.gate is not None]
    assert notes.told["promote"] == gates
    assert {promoted for _, promoted in gates} == {True, False}


def test_what_is_there_is_not_published_again(tmp_path, notes):
    run = fake_run(iterations=2)
    part = run.model_copy(update={"iterations": run.iterations[:1], "finished": False})
    writer = page(notes, tmp_path)
    writer.publish(part, "RUNNING")
    writer.publish(run, "FINISHED")
    before, points = dict(notes.told), len(notes.points)
    (tmp_path / "published.txt").unlink()
    page(notes, tmp_path).publish(run, "FINISHED")  # another process looks, and finds all of it
    assert len(notes.points) == points > 100
    for kind in ("log", "dataset", "artifact", "model", "promote", "status"):
        assert notes.told[kind] == before[kind], kind
    calls = notes.calls
    page(notes, tmp_path).publish(run, "FINISHED")  # the mark says it without a look
    assert notes.calls == calls
    (tmp_path / DATABASE).unlink()
    page(notes, tmp_path).publish(run, "FINISHED")  # a lost database counts, a mark does not
    assert notes.calls > calls


def test_wherever_a_publication_breaks_off_the_next_completes_it_without_doubles(tmp_path):
    run = fake_run(iterations=2)
    whole = Notes(tmp_path)
    page(whole, tmp_path).publish(run, "FINISHED")
    stable = {key[:3] for key in whole.points}
    for fails_at in range(1, whole.calls + 1, 7):
        notes = Notes(tmp_path, fails_at)
        (tmp_path / "published.txt").unlink(missing_ok=True)
        with pytest.raises(ConnectionError):
            page(notes, tmp_path).publish(run, "FINISHED")
        page(notes, tmp_path).publish(run, "FINISHED")
        assert {key[:3] for key in notes.points} == stable
        assert len(notes.points) == len(stable)


@pytest.mark.parametrize("status", ["RUNNING", "KILLED", "FAILED"])
def test_an_unfinished_run_has_the_state_it_is_in(tmp_path, notes, status):
    run = fake_run(iterations=2).model_copy(update={"finished": False})
    page(notes, tmp_path).publish(run, status)
    assert notes.told["status"][-1] == (run.key, status)
    assert not (tmp_path / "published.txt").exists()
