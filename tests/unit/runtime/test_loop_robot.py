"""A run on a robot that is not its model: nobody knows what it is, and all it gives are measurements."""

import json
from pathlib import Path

import pytest
from pydantic import ValidationError
from typer.testing import CliRunner

from flywheel.cli.main import app
from flywheel.errors import ConfigError, LinkError, RunError
from flywheel.results import RunResult
from flywheel.runtime.config.run_config import RunConfig, config_digest
from flywheel.runtime.workers import robot_worker
from flywheel.runtime.workers.episode_plan import first_recordings
from tests.unit.runtime.tiny_run import TINY, Bench

HERE = {
    "hidden": ["torque_speed:3"],
    "first": 3,
    "first_seconds": 1.6,
    "drives": 1,
    "planners": ["network", "plant"],
    "validation": 0.34,
    "test": 0.34,
}
EVALUATE = {**TINY["evaluate"], "floor": False}


def outcome(result: RunResult) -> str:
    """Everything in a result that is no time on a clock, and no name."""
    values = result.model_dump(mode="json")
    for name in ("key", "name", "config", "config_digest"):
        del values[name]
    return json.dumps(_timeless(values))


def unreachable(*arguments: object) -> None:
    raise LinkError("There is no robot.")


def _timeless(value: object) -> object:
    if isinstance(value, dict):
        clock = ("plan_seconds", "seconds", "cpu_seconds", "curve")
        return {k: _timeless(v) for k, v in value.items() if k not in clock}
    return [_timeless(each) for each in value] if isinstance(value, list) else value


@pytest.mark.nightly
@pytest.mark.slow
def test_the_transcripts_of_a_run_give_the_same_run_without_a_robot(tmp_path, monkeypatch):
    here = {**HERE, "planners": ["network", "plant", "residual"]}
    training = {"horizon": 0.3, "steps": 4, "batch": 4, "spacing": 0.1, "validate_every": 2}
    more = {"evaluate": EVALUATE, "residual": {"on": True, "training": training}}
    bench = Bench(tmp_path / "run", robot=here, **more)
    bench.files.path.mkdir()
    result = bench.turn()
    assert set(result.iterations[1].robot.errors) == {"network", "given", "plant", "residual"}
    assert set(result.iterations[1].robot.drives) == {"network", "plant", "residual"}
    monkeypatch.setattr(robot_worker, "open_link", unreachable)
    played = {**here, "link": f"transcripts:{bench.files.robot_folder}"}
    again = Bench(tmp_path / "again", robot=played, **more)
    again.files.path.mkdir()
    assert outcome(again.turn()) == outcome(result)

    (tmp_path / "run" / "iterations" / "i0001-mppi.json").unlink()
    (tmp_path / "run" / "result.json").unlink()
    assert outcome(bench.turn(resume=True)) == outcome(result), "no episode is driven again"

    for logs, model in (("a", "residual"), ("b", str(bench.files.residual(0)))):
        more = ["--model", model, "--logs", str(tmp_path / logs)]
        done = CliRunner().invoke(app, ["drive", str(bench.files.path), *more])
        assert done.exit_code == 0, done.output
        assert (tmp_path / logs / "residual-0.csv").exists()


@pytest.mark.slow
def test_what_the_robot_is_stands_in_no_file_but_its_own(tmp_path: Path) -> None:
    hidden = {**HERE, "hidden": ["cogging:3"], "latency": 0.07, "latency_told": False}
    bench = Bench(tmp_path / "run", iterations=0, robot=hidden, evaluate=EVALUATE)
    bench.files.path.mkdir()
    bench.turn()
    telling = {
        path.relative_to(bench.files.path).as_posix()
        for path in bench.files.path.rglob("*")
        if path.is_file() and (b"cogging" in path.read_bytes() or b"0.07\n" in path.read_bytes())
    }
    assert telling == {"robot/stand_in.yaml"}


def test_what_the_robot_is_is_in_no_digest_and_no_text_of_a_configuration() -> None:
    plain, hidden = (
        RunConfig.model_validate({"robot": {"hidden": names}}) for names in ([], ["payload:2"])
    )
    assert config_digest(plain) == config_digest(hidden)
    assert hidden.robot is not None and hidden.robot.stand_in.hidden == ("payload:2",)
    assert "payload" not in f"{hidden!r} {hidden} {hidden.model_dump()} {hidden.model_dump_json()}"
    by_port = RunConfig.model_validate({"robot": {"link": "tcp://127.0.0.1:7420"}})
    assert config_digest(by_port) == config_digest(plain)


def test_a_run_goes_on_with_the_robot_that_it_was_begun_with(tmp_path: Path) -> None:
    bench = Bench(tmp_path, robot=HERE)
    bench.files.begin(bench.config, resume=False)
    bench.files.begin(bench.config, resume=True)
    bench.files.begin(bench.files.config(), resume=True)  # which does not say what the robot is
    other = Bench(tmp_path, robot={**HERE, "hidden": ["payload"]})
    with pytest.raises(ConfigError, match="started on another robot: its hidden effects"):
        bench.files.begin(other.config, resume=True)


def test_a_lost_robot_ends_the_run_and_what_it_measured_is_kept(tmp_path, monkeypatch):
    bench = Bench(tmp_path / "run", iterations=0, robot={**HERE}, evaluate=EVALUATE)
    bench.files.path.mkdir()
    opened = robot_worker.open_link

    def fragile(*arguments: object) -> object:
        link, left = opened(*arguments), [30]
        observe = link.observe

        def sometimes() -> object:
            left[0] -= 1
            if not left[0]:
                raise LinkError("The cable was pulled.")
            return observe()

        link.observe = sometimes
        return link

    monkeypatch.setattr(robot_worker, "open_link", fragile)
    with pytest.raises(RunError, match="The cable was pulled. The measurements until then are in"):
        bench.turn()
    (log,) = bench.files.robot_folder.glob("*-lost.csv")
    assert 20 < len(log.read_text().splitlines()) < 40
    monkeypatch.setattr(robot_worker, "open_link", opened)
    assert bench.turn(resume=True).finished


@pytest.mark.parametrize(
    ("robot", "words"),
    [
        ("swing.xml", "robot is the robot that is driven .* model='swing.xml'"),
        ({"link": "tcp://here", "links": 2}, "a robot at tcp://here is one robot, got 2 links"),
        ({"link": "tcp://here", "hidden": ["payload"]}, "goes with simulated, got 'tcp://here'"),
        ({"link": "smoke signals"}, "link: A robot is reached by"),
        ({"link": "tcp://here:99999"}, "link: .*no port from 1 to 65535"),
        ({"link": "simulated", "arguments": {"port": "1"}}, "'simulated' takes none"),
        ({"planners": ["plant", "plant"]}, "each at most once, got plant, plant"),
        ({"wings": 2}, "wings"),
    ],
)
def test_a_robot_that_cannot_be_is_refused(robot: object, words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        RunConfig.model_validate({"model": "prism3", "robot": robot})


def test_a_robot_without_a_recording_for_tests_is_refused() -> None:
    config = RunConfig.model_validate({"robot": {"first": 1}})
    with pytest.raises(ConfigError, match="no test recording of the robot. Raise robot.first"):
        first_recordings(config)
