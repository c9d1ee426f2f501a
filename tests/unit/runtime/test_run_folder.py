"""When a folder may be begun, and when it may be continued."""

import re

import pytest

from flywheel.errors import ConfigError, RunError
from flywheel.robots import load_robot
from flywheel.runtime.config import RunConfig, WorkersConfig
from flywheel.runtime.results import IterationResult
from flywheel.runtime.run_folder import RunFolder


@pytest.fixture
def folder(tmp_path):
    return RunFolder(tmp_path)


def test_a_run_keeps_its_key_when_it_is_resumed(folder):
    begun = folder.begin(RunConfig(name="a"), resume=False)
    assert folder.begin(RunConfig(name="a"), resume=True) == begun
    assert begun.key.startswith("a-")


@pytest.mark.parametrize("name", ["[bold]x[/]<b>&", "a/../b", "ü", "x" * 500])
def test_whatever_a_run_is_called_its_key_is_one_that_mlflow_takes(folder, name):
    key = folder.begin(RunConfig(name=name), resume=False).key
    assert re.fullmatch(r"[A-Za-z0-9._-]{1,100}", key)


def test_a_folder_with_a_run_is_not_begun_again(folder):
    folder.begin(RunConfig(), resume=False)
    with pytest.raises(ConfigError, match="--resume"):
        folder.begin(RunConfig(), resume=False)


def test_resuming_an_empty_folder_begins(folder):
    assert folder.begin(RunConfig(), resume=True).key


def test_a_changed_configuration_is_refused_with_every_difference(folder):
    folder.begin(RunConfig(), resume=False)
    changed = RunConfig.model_validate({"seed": 4, "mppi": {"samples": 7}})
    with pytest.raises(ConfigError) as caught:
        folder.begin(changed, resume=True)
    assert "seed: 0 -> 4" in str(caught.value)
    assert "mppi.samples: " in str(caught.value)
    assert len(str(caught.value).splitlines()) == 4


def test_a_change_of_workers_is_no_change(folder):
    folder.begin(RunConfig(), resume=False)
    folder.begin(RunConfig(workers=WorkersConfig(sim=9)), resume=True)


def test_an_iteration_is_done_once_its_file_is_there(folder):
    assert folder.finished(1, "mppi") is None
    result = IterationResult(iteration=1, snapshot="s", model="m")
    folder.finish(result)
    assert folder.finished(1, "mppi") == result
    assert folder.finished(1, "control") is None


def test_an_almost_full_disk_is_told_before_anything_starts(folder):
    with pytest.raises(RunError, match="workers.least_free_gb"):
        folder.check_space(least_gb=1e9)
    folder.check_space(least_gb=0.0)


def test_a_run_refused_for_lack_of_space_leaves_nothing_to_resume(tmp_path):
    folder = RunFolder(tmp_path)
    greedy = RunConfig.model_validate({"workers": {"least_free_gb": 1e9}})
    for _ in range(2):
        with pytest.raises(RunError, match="workers.least_free_gb"):
            folder.begin(greedy, resume=False)
    assert not any(tmp_path.iterdir())


@pytest.fixture
def own(tmp_path):
    """A user's own MJCF, and a run begun with it."""
    mjcf = tmp_path / "mine" / "swing.xml"
    mjcf.parent.mkdir()
    mjcf.write_text(load_robot("platform4").xml)
    folder, config = RunFolder(tmp_path / "run"), RunConfig(robot=str(mjcf))
    folder.path.mkdir()
    folder.begin(config, resume=False)
    return mjcf, folder, config


def test_a_run_keeps_the_mjcf_it_was_begun_with(own):
    mjcf, folder, config = own
    kept = folder.robot(config).digest
    assert kept == load_robot("platform4").digest
    mjcf.unlink()
    folder.begin(config, resume=True)
    assert folder.robot(config).digest == kept


def test_an_mjcf_that_was_edited_since_is_refused_and_one_laid_out_anew_is_not(own):
    mjcf, folder, config = own
    mjcf.write_text(mjcf.read_text().replace("</mujoco>", "<!-- mine -->\n</mujoco>"))
    folder.begin(config, resume=True)
    mjcf.write_text(mjcf.read_text().replace("<option ", '<option wind="0 0 1" ', 1))
    with pytest.raises(ConfigError, match="has changed since the run .* robot.xml"):
        folder.begin(config, resume=True)
