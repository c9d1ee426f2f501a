"""The controller in the loop as a table: a run for each seed, on one page."""

from pathlib import Path
from typing import Any

import pytest

from benchmarks.navigation import EpisodeRow
from benchmarks.paper import loop
from benchmarks.paper.__main__ import main
from benchmarks.paper.loop import CONFIGS, make_loop, publish
from benchmarks.rows import read_rows
from flywheel.errors import ConfigError
from flywheel.results import RESULT_FILE, RunResult
from flywheel.runtime.config.run_config import RunConfig, load_config
from flywheel.runtime.config.shipped import config_file
from flywheel.runtime.run.folder import RunFolder
from tests.unit.reports.fake_run import fake_run


def loop_run(seed: int, size: str = "") -> RunResult:
    config = load_config(config_file(CONFIGS[size]), [f"seed={seed}"])
    return fake_run(4, seed).model_copy(update={"config": config.model_dump(mode="json")})


@pytest.mark.parametrize("size", CONFIGS)
def test_at_every_size_icosa6_goes_round_three_times_and_then_into_the_maze(size: str) -> None:
    config = load_config(config_file(CONFIGS[size]))
    assert (config.model, config.iterations, config.evaluate.unseen) == ("icosa6", 3, ("maze",))
    assert (config.task.course, config.collect.gaits) == ("s_course", 0)
    assert (config.task.seconds == 120.0) == (size != "smoke")


def test_the_page_has_each_iteration_and_the_maze_beside_what_was_published(tmp_path: Path) -> None:
    runs = [loop_run(seed) for seed in (0, 1)]
    lines = publish(runs, tmp_path).read_text().splitlines()
    cells = {line.split(" | ")[0]: line.split(" | ") for line in lines if line.startswith("| ")}
    last = [run.of_arm("mppi")[3].navigation.success for run in runs]
    assert cells["| iteration 3"][1].startswith(f"{last[0].reached + last[1].reached}/")
    errors = [run.pooled_errors(run.of_arm("mppi")[3]).short.e_pos_mse for run in runs]
    assert cells["| iteration 3"][3] == f"{errors[0]:.3g}"  # that of both seeds
    assert cells["| iteration 3"][-1] == "slightly worse than 2 |"
    assert cells["| maze, never seen"][-1] == "reached |" and "seeds 0, 1" in "\n".join(lines)
    assert cells["| floor"][1] == cells["| maze, oracle"][3] == ""
    assert (tmp_path / "loop.png").read_bytes().startswith(b"\x89PNG")
    where = {row.where for row in read_rows(EpisodeRow, tmp_path / "episodes.csv")}
    assert where == {"s_course", "maze"}


def test_a_model_that_diverged_with_one_seed_has_no_mean(tmp_path: Path) -> None:
    run = loop_run(0)
    pooled = run.pooled[0]
    lost = pooled.errors.short.model_copy(update={"e_pos_mse": float("nan")})
    errors = pooled.errors.model_copy(update={"short": lost})
    first = pooled.model_copy(update={"errors": errors})
    text = publish(
        [run.model_copy(update={"pooled": (first, *run.pooled[1:])})], tmp_path
    ).read_text()
    assert text.count("diverged") == 1


def test_seeds_are_added_to_the_page_and_other_settings_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ran(config: RunConfig, folder: Path, **more: Any) -> None:
        folder.mkdir(parents=True)
        RunFolder(folder.absolute()).begin(config, resume=False)
        (folder / RESULT_FILE).touch()

    monkeypatch.setattr(loop, "run", ran)
    monkeypatch.setattr(RunResult, "load", lambda path: loop_run(int(path.name[1:]), "smoke"))
    make_loop("smoke", [], tmp_path, None)
    page = make_loop("smoke", ["seed=1"], tmp_path, None)
    assert "seeds 0, 1" in page.read_text()
    with pytest.raises(ConfigError, match="s0 is a run with other settings"):
        make_loop("smoke", ["seed=2", "mppi.samples=9"], tmp_path, None)
    assert not (tmp_path / "s2").exists()


def test_the_loop_has_no_cells_to_choose_from(monkeypatch, capsys) -> None:
    monkeypatch.setattr("sys.argv", ["paper_table.py", "loop", "--only", "network"])
    with pytest.raises(SystemExit, match="2"):
        main()
    assert "--only chooses cells of a table" in capsys.readouterr().err
