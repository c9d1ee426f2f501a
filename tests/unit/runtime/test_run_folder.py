"""When a folder may be begun, and when it may be continued."""

import pytest

from flywheel.errors import ConfigError, RunError
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
