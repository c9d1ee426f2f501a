"""What `flywheel compare` prints and writes."""

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from flywheel.cli.main import app
from flywheel.cli.models import open_model
from flywheel.data.recordings import write_recording
from flywheel.diagnosis.comparison import Comparison
from flywheel.dynamics.gnn import ChunkNetwork, NetworkConfig, save_weights
from flywheel.dynamics.plant import Plant
from flywheel.errors import ConfigError
from flywheel.records import Episode, Provenance, Trajectory
from flywheel.reports import comparison_video
from flywheel.reports.comparison_page import sentence, write_comparison
from flywheel.reports.comparison_video import film_window
from flywheel.robots import Robot

pytestmark = pytest.mark.slow


def linked(page: str) -> list[str]:
    """What a page needs besides itself."""
    return re.findall(r'(?:src|href)="(?!data:)([^"]*)"', page)


@pytest.mark.parametrize("excess", [1.0, 3.0])
def test_the_page_needs_no_other_file_and_says_what_was_found(found, tmp_path, excess):
    (model,) = found.models
    model = dataclasses.replace(model, name="<my> plant", probability=0.01, excess=excess)
    other = dataclasses.replace(model, name="other")
    both = dataclasses.replace(found, models=(model, other))
    film = tmp_path / "film.mp4"
    film.write_bytes(b"a film")
    videos: dict[str, Path | str] = {"<my> plant": film, "other": "no graphics here"}
    page = write_comparison(both, tmp_path / "new" / "p.html", {"robot": "r"}, videos).read_text()
    assert linked(page) == []
    assert page.count('src="data:image/svg+xml') == 4
    assert page.count('src="data:video/mp4') == 1
    assert "No video: no graphics here" in page
    assert "&lt;my&gt; plant" in page
    assert str(model.outcome) in page
    assert sentence(found, model).endswith(".")
    still = dataclasses.replace(found, persistence=np.zeros_like(found.persistence))
    assert "prediction without motion" in sentence(still, model)


def test_the_command_writes_what_it_found_and_ends_with_the_last_models_verdict(
    robot: Robot,
    nothing_hidden: list[Trajectory],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("no display")

    monkeypatch.setattr(comparison_video, "Film", broken)
    monkeypatch.chdir(tmp_path)
    about = Provenance(robot.digest)
    write_recording(Episode("e", nothing_hidden[0], about, "train"), "monday.csv", robot)
    torch.manual_seed(0)
    save_weights(ChunkNetwork(robot, NetworkConfig()), "raw.npz")
    command = "compare monday.csv --robot prism3 --model raw=raw.npz --model plant --horizon 0.5"
    done = CliRunner().invoke(app, [*command.split(), "--draws", "40", "--json", "a.json"])
    answer = json.loads(Path("a.json").read_text())
    assert done.exit_code == (answer["verdict"] == "MORE_THAN_NOISE"), done.output
    assert [model["model"] for model in answer["models"]] == ["raw", "plant"]
    assert answer["models"][0]["error"]["rms"] > answer["models"][1]["error"]["rms"]
    assert "No video of raw: no display" in done.output
    page = Path("comparison.html").read_text()
    assert linked(page) == []
    assert "No video: no display" in page


@pytest.mark.renders
def test_the_worst_window_is_filmed(found: Comparison, tmp_path: Path) -> None:
    (model,) = found.models
    film = film_window(found, model, model.worst, tmp_path / "w.mp4")
    assert film.stat().st_size > 10_000


def test_a_model_that_is_not_there_is_refused_with_what_is_allowed(robot: Robot) -> None:
    with pytest.raises(
        ConfigError, match=r"no model 'plnat'.*'plant', 'shipped' .*the folder of an adopted"
    ):
        open_model("plnat", Plant(robot))
    named = open_model("mine=plant", Plant(robot))
    assert (named.name, named.dynamics.history) == ("mine", 20)
