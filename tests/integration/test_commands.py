"""The commands that look at a run, on a run."""

import json
import re
import shutil
from pathlib import Path

import pytest

from tests.conftest import Stranger
from tests.damage import flip

pytestmark = [pytest.mark.ray, pytest.mark.slow, pytest.mark.usefixtures("first_run")]
CONFIG, RUN = "configs/smoke_robot.yaml", "runs/smoke_robot"


def result(stranger: Stranger) -> dict:
    return json.loads((stranger.folder / RUN / "result.json").read_text())


def test_evaluate_finds_the_numbers_that_the_run_reported(stranger: Stranger) -> None:
    evaluate = result(stranger)["config"]["evaluate"]
    settings = f"--horizon {evaluate['horizon_seconds']} --starts {evaluate['starts']}"
    printed, _ = stranger.ask(f"flywheel evaluate {RUN} --by iteration {settings}")
    # The run reports on the plant with what was found: on the episodes of its last iteration.
    for pooled in result(stranger)["pooled"]:
        name = f"i{pooled['iteration']:04d}-{pooled['arm']}"
        (line,) = (each for each in printed.splitlines() if re.match(rf"\W+1\W+{name}", each))
        _, *numbers = [float(n) for n in re.findall(r" (\d[\d.e+-]*) ", line)]
        short, full = pooled["errors"]["short"], pooled["errors"]["full"]
        expected = [
            part[key] for part in (short, full) for key in ("e_pos_mse", "e_pos_rmse", "e_rot")
        ]
        assert numbers[: len(expected)] == pytest.approx(expected, rel=1e-3)


def test_evaluate_scores_subsets_apart(stranger: Stranger) -> None:
    settings = "--starts 1 --horizon 0.5"
    whole, _ = stranger.ask(f"flywheel evaluate {RUN} {settings}")
    apart, _ = stranger.ask(f"flywheel evaluate {RUN} {settings} --by controller")

    def predictions(printed: str) -> int:
        lines = [line.strip(" │┃|") for line in printed.splitlines() if "persistence" in line]
        return sum(int(re.findall(r"(\d+)\s*(?:[│|]|$)", line)[-1]) for line in lines)

    assert sum(kind in apart for kind in ("gait:", "random", "drop", "mppi ")) >= 2
    assert predictions(apart) == predictions(whole) > 0
    assert not re.search(r"^\W+noise ", whole, re.M), "simulated episodes have none"
    by_source, _ = stranger.ask(f"flywheel evaluate {RUN} {settings} --by source")
    assert re.findall(r"^\W+(\w+)\W+noise ", by_source, re.M) == ["recording"]
    _, refused = stranger.ask(f"flywheel evaluate {RUN} --horizon 100", code=2)
    assert "No test episode has 100 s to predict; the longest is of" in refused
    _, refused = stranger.ask(f"flywheel evaluate {RUN} --by controler", code=2)
    assert "Did you mean 'controller'" in refused


def test_the_stored_episodes_are_shown_and_sound(stranger: Stranger) -> None:
    shown, _ = stranger.ask(f"flywheel data show {RUN}")
    assert "i0001-mppi" in shown
    episodes, _ = stranger.ask(f"flywheel data show {RUN} --snapshot i0001-mppi")
    assert "i0001-mppi-collect-0000" in episodes
    assert "as they were committed" in stranger.ask(f"flywheel data verify {RUN}")[0]


def test_a_flipped_bit_is_found_and_the_episode_named(stranger: Stranger, tmp_path: Path) -> None:
    copy = tmp_path / "store"
    shutil.copytree(stranger.folder / RUN / "store", copy)
    victim = sorted(copy.glob("segments/*/*.zarr/controls/c.0.0"))[0]
    flip(victim)
    printed, _ = stranger.ask(f"flywheel data verify {copy}", code=1)
    assert victim.relative_to(copy).parts[1] in printed


@pytest.mark.renders
def test_navigate_drives_with_the_champion_and_films_it(stranger: Stranger) -> None:
    printed, _ = stranger.ask(f"flywheel navigate {RUN} --video champion.mp4 -- task.seconds=1")
    assert "goal" in printed
    assert (stranger.folder / "champion.mp4").stat().st_size > 1000


def test_navigate_goes_on_after_the_episodes_it_has_results_of(stranger: Stranger) -> None:
    command = (
        "flywheel navigate configs/smoke.yaml --model oracle --hidden slope:0.5 --no-film"
        " --results drives/all.jsonl --logs logs --picture drives/all.png"
    )
    stranger.ask(f"{command} -- task.seconds=1")
    printed, _ = stranger.ask(f"{command} --episodes 2 -- task.seconds=1")
    _, refused = stranger.ask(f"{command} --seed 1 -- task.seconds=0.5", code=2)
    assert "oracle-1.csv exists already" in refused
    assert "Seed 0 is in" in printed
    assert "of 2" in printed
    lines = (stranger.folder / "drives/all.jsonl").read_text().splitlines()
    assert [json.loads(line)["seed"] for line in lines] == [0, 1]
    assert all("slope" in json.loads(line)["setting"]["hidden"][0] for line in lines)
    assert all(json.loads(line)["setting"]["fineness"] == 4 for line in lines)
    assert sorted(p.name for p in (stranger.folder / "logs").iterdir()) == [
        "oracle-0.csv",
        "oracle-1.csv",
    ]
    assert (stranger.folder / "drives/all.png").stat().st_size > 1000


def test_navigate_without_a_run_has_no_champion(stranger: Stranger) -> None:
    _, said = stranger.ask(f"flywheel navigate {CONFIG}", code=2)
    assert "--model oracle" in said


def test_a_run_is_not_begun_twice_in_one_folder(stranger: Stranger) -> None:
    _, said = stranger.ask(f"flywheel run {CONFIG}", code=2)
    assert "--resume" in said


def test_a_finished_run_is_resumed_at_no_cost_and_not_with_another_configuration(stranger):
    before = result(stranger)
    stranger.ask(f"flywheel run {CONFIG} --resume")
    assert result(stranger) == before
    _, said = stranger.ask(f"flywheel run {CONFIG} seed=7 --resume", code=2)
    assert "seed: 0 -> 7" in said


def test_runs_are_listed(stranger: Stranger) -> None:
    assert RUN in stranger.ask("flywheel list runs")[0]
