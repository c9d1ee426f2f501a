"""Results of one model are never taken for those of another."""

from pathlib import Path

import pytest

from benchmarks.diagnosis.bench import examine
from benchmarks.diagnosis.case_result import CaseResult
from benchmarks.diagnosis.cases import cases
from flywheel.cli.models import open_trained
from flywheel.dynamics.gnn import ChunkNetwork, NetworkConfig, save_weights
from flywheel.errors import ConfigError
from flywheel.robots import load_robot
from flywheel.runtime.tracking.dashboard import DATABASE


def test_a_folder_of_another_model_is_refused_and_left_as_it_is(tmp_path: Path) -> None:
    (case,) = cases(load_robot("prism3"), ["none"], (), (0,))
    kept = tmp_path / f"{case.name}.json"
    kept.write_text(
        CaseResult(name=case.name, group="none", robot="prism3", model="f" * 64).model_dump_json()
    )
    before = kept.read_text()
    with pytest.raises(
        ConfigError, match="has results of ffffffffffff; the plant is to be tested now"
    ):
        examine(tmp_path, "prism3", ["none"], [1.0], [0], "", None, None)
    assert kept.read_text() == before


def test_another_network_in_the_same_file_is_another_model(tmp_path: Path) -> None:
    robot, weights, folder = load_robot("prism3"), tmp_path / "weights.npz", tmp_path / "results"
    folder.mkdir()
    config = NetworkConfig(dt=0.01, width=8, rounds=1)
    (case,) = cases(robot, ["none"], (), (0,))
    digest = save_weights(ChunkNetwork(robot, config), weights)
    assert open_trained(str(weights), robot).weights.digest == digest
    done = CaseResult(name=case.name, group="none", robot="prism3", model=digest)
    (folder / f"{case.name}.json").write_text(done.model_dump_json())
    save_weights(ChunkNetwork(robot, config), weights)
    with pytest.raises(ConfigError, match=f"has results of {digest[:12]}; .* is to be tested now"):
        examine(folder, "prism3", ["none"], [1.0], [0], "", str(weights), None)


@pytest.mark.slow
@pytest.mark.parametrize("folder", ["", "results"])
def test_results_that_are_there_are_shown_and_not_made_again(tmp_path, capsys, monkeypatch, folder):
    monkeypatch.chdir(tmp_path)  # most folders are named from where one is
    there = tmp_path / folder
    there.mkdir(exist_ok=True)
    (case,) = cases(load_robot("prism3"), ["none"], (), (0,))
    done = CaseResult(
        name=case.name, group="none", robot="prism3", verdict="NOISE_ONLY", answers=((),)
    )
    (there / f"{case.name}.json").write_text(done.model_dump_json())
    examine(Path(folder), "prism3", ["none"], [1.0], [0], "", None, None)
    assert "NOISE_ONLY 1" in capsys.readouterr().out
    head, rule, row = (there / "table.md").read_text().splitlines()
    assert head.startswith("| hidden") and set(rule) == set("|-") and "NOISE_ONLY 1" in row
    from mlflow import MlflowClient  # slow to import

    client = MlflowClient(tracking_uri=f"sqlite:///{there / DATABASE}")
    (experiment,) = client.search_experiments(filter_string="name != 'Default'")
    (run,) = client.search_runs([experiment.experiment_id])
    assert run.data.metrics["all: none/right"] == 1.0
    assert [file.path for file in client.list_artifacts(run.info.run_id)] == ["table.md"]
