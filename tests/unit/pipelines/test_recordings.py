"""`flywheel recordings`: reports for people and scripts, and exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from flywheel.data import TrajectoryStore
from flywheel.hidden.measurement import Measurement
from flywheel.hidden.recording import record
from flywheel.robots import load_robot
from flywheel.runtime.config import RunConfig
from flywheel.runtime.run_folder import RunFolder
from pipelines.cli import app

SEED = int(np.random.default_rng().integers(2**31))  # fresh; shown when a test fails


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two logs of prism3; in the second, markers are exchanged."""
    folder, robot = tmp_path_factory.mktemp("logs"), load_robot("prism3")
    settings = [Measurement(), Measurement(swap=True)]
    return [
        record(robot, seconds=1.0, seed=SEED + i, measurement=one).write(folder, f"log{i}", robot)[
            0
        ]
        for i, one in enumerate(settings)
    ]


def ask(*arguments: object, code: int = 0) -> str:
    done = CliRunner().invoke(app, ["recordings", *map(str, arguments)])
    assert done.exit_code == code, f"{done.output}\n{done.exception!r}\n(seed {SEED})"
    return done.output


def test_logs_come_into_a_new_store_with_a_report(logs: list[Path], tmp_path: Path) -> None:
    place = tmp_path / "store"
    known = ("--robot", "prism3", "--store", place)
    looked = ask("import", *logs, *known, "--dry-run")
    assert "dry run" in looked and not place.exists()
    printed = ask("import", *logs, *known, "--split", "test")
    assert "Nothing was masked" in printed and "repair: []" in printed and "repaired" in printed
    store = TrajectoryStore(place)
    first, second = sorted(store.committed())
    assert f"collect.recordings=[{first},{second}]" in printed
    assert all(s.split == "test" for s in (*store.episodes(first), *store.episodes(second)))
    assert "there already" in ask("import", logs[0], *known)
    assert "for ever" in ask("import", logs[0], *known, "--split", "train", code=2)
    shown = ask("show", place)
    assert first in shown and f"collect.recordings=[{first},{second}]" in shown
    as_json = json.loads(ask("show", place, "--json"))
    assert [row["episode"] for row in as_json] == [first, second]
    out = tmp_path / "out.csv"
    assert "101 rows" in ask("export", place, first, out, "--robot", "prism3")
    assert out.read_bytes() == logs[0].read_bytes()
    assert "not written over" in ask("export", place, first, out, "--robot", "prism3", code=2)


def test_a_report_for_scripts_is_json(logs: list[Path], tmp_path: Path) -> None:
    known = ("--robot", "prism3", "--store", tmp_path / "store", "--json")
    clean, swapped = json.loads(ask("import", *logs, *known))
    assert (clean["state"], clean["findings"], clean["rows"]) == ("stored", [], 101)
    assert swapped["findings"][0]["kind"] == "swap"
    again = json.loads(ask("import", logs[0], *known))
    assert again[0]["segment"] == clean["segment"]


def test_if_one_log_is_broken_none_is_stored(logs: list[Path], tmp_path: Path) -> None:
    (tmp_path / "empty.csv").write_text("")
    place = tmp_path / "store"
    said = ask(
        "import", logs[0], tmp_path / "empty.csv", "--robot", "prism3", "--store", place, code=2
    )
    assert "empty.csv is empty" in said and "Nothing was stored of the 2 logs" in said
    assert not place.exists()


def test_one_log_named_twice_is_refused(logs: list[Path], tmp_path: Path) -> None:
    copy = tmp_path / "copy.csv"
    copy.write_bytes(logs[0].read_bytes())
    said = ask("import", logs[0], copy, "--robot", "prism3", "--store", tmp_path / "s", code=2)
    assert "are the same log" in said


def test_a_map_for_all_logs_and_the_run_s_own_robot(logs: list[Path], tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    RunFolder(run).begin(RunConfig(robot="prism3"), resume=False)
    (tmp_path / "map.yaml").write_text("repair: []\nconditions: new cables\n")
    printed = ask("import", logs[1], "--store", run, "--map", tmp_path / "map.yaml")
    assert "as the map says" in " ".join(printed.split())
    assert "new cables" in ask("show", run)
    assert len(TrajectoryStore(run / "store").committed()) == 1


def test_a_store_does_not_say_whose_episodes_it_holds(logs: list[Path], tmp_path: Path) -> None:
    said = ask("import", logs[0], "--store", tmp_path / "store", code=2)
    assert "say with --robot" in said


def test_a_store_without_a_recording_says_so(tmp_path: Path) -> None:
    assert "no recording" in ask("show", tmp_path)
