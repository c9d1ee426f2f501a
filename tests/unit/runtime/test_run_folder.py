"""When a folder may be begun, and when it may be continued."""

import json
import re

import pytest

from flywheel.data import TrajectoryStore
from flywheel.errors import ConfigError, DataError, FlywheelError, RunError
from flywheel.results import DiagnosisNote, IterationResult
from flywheel.robot_link import StandInConfig
from flywheel.robots import load_robot
from flywheel.runtime.config.robot_config import STAND_IN_FILE
from flywheel.runtime.config.run_config import RunConfig, config_digest, continued
from flywheel.runtime.loop import _from_here_on
from flywheel.runtime.pool.progress import Lines
from flywheel.runtime.run.folder import RunFolder
from flywheel.runtime.run.inventory import Inventory


@pytest.fixture
def folder(tmp_path):
    return RunFolder(tmp_path)


def test_a_run_keeps_its_key_when_it_is_resumed(folder):
    begun = folder.begin(RunConfig(name="a"), resume=False)
    assert folder.begin(RunConfig(name="a"), resume=True) == begun
    assert begun.key.startswith("a-")


@pytest.mark.parametrize("name", ["[bold]x[/]<b>&", "a/../b", "ü"])
def test_whatever_a_run_is_called_its_key_is_one_that_mlflow_takes(folder, name):
    key = folder.begin(RunConfig(name=name), resume=False).key
    assert re.fullmatch(r"[A-Za-z0-9._-]{1,100}", key)


@pytest.mark.parametrize("begun", [True, False])
def test_what_a_killed_driver_was_writing_is_gone_when_it_is_resumed(folder, begun):
    if begun:
        folder.begin(RunConfig(), resume=False)
    served = folder.weights(0, "mppi").parent if begun else folder.robot_folder
    parts = map(folder.path.joinpath, ("figures", "iterations", "robot") if begun else ("robot",))
    for place in (folder.path, *parts, served.parent, served):
        place.mkdir(parents=True, exist_ok=True)
        (place / ".flywheel-123.tmp").touch()
    (served / "weights.npz").touch()
    folder.begin(RunConfig(), resume=True)
    assert list(folder.path.rglob(".flywheel-*")) == []
    assert (served / "weights.npz").exists()


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


def test_what_changes_no_result_may_change_and_then_counts(folder):
    here = {"hidden": ["payload"], "noise": 0.01}
    folder.begin(RunConfig(robot=here), resume=False)
    given = {"name": "b", "workers": {"sim": 9}, "tracking": {"uri": "http://there"}}
    changed = RunConfig(robot={**here, "links": 2}, **given)
    folder.begin(changed, resume=True)
    config = continued(folder.config(), changed)
    assert (config.name, config.workers.sim, config.tracking.uri) == ("b", 9, "http://there")
    assert config.robot.links == 2
    assert config.robot.stand_in == StandInConfig(), "a secret"
    assert config_digest(config) == config_digest(changed)


def test_settings_that_are_not_as_at_the_start_are_told():
    said: list[str] = []
    stored = RunConfig.model_validate({"workers": {"sim": 1}, "tracking": {"uri": "http://there"}})
    assert _from_here_on(stored, RunConfig(), Lines(said.append)) == RunConfig()
    assert [line.partition(": ")[2] for line in said] == [
        "tracking.uri: http://there -> ''.",
        "workers.sim: 1 -> 2.",
    ]
    assert _from_here_on(stored, stored, Lines(said.append)) == stored and len(said) == 2


@pytest.mark.parametrize("given", [{}, {"hidden": ["payload"], "noise": 0.01}])
@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "There is no file .*stand_in.yaml. Restore a copy"),
        ("", "stand_in.yaml was altered: it lacks burst, contact, "),
        (
            "hidden: [payload]\nnoise: 0.01\n",
            "stand_in.yaml was altered: it lacks burst, contact, ",
        ),
    ],
)
def test_a_run_does_not_go_on_with_another_stand_in_where_its_own_is_gone(
    folder, given, text, message
):
    folder.begin(RunConfig(robot={"hidden": ["payload"], "noise": 0.01}), resume=False)
    file = folder.robot_folder / STAND_IN_FILE
    file.unlink()
    if text is not None:
        file.write_text(text)
    with pytest.raises(ConfigError, match=message):
        folder.begin(RunConfig(robot=given), resume=True)


def test_a_missing_diagnosis_of_a_finished_iteration_is_a_fault(folder, tmp_path):
    folder.begin(RunConfig(), resume=False)
    note = DiagnosisNote(verdict="EFFECT", adopted=True, noise=1.0, baseline=2.0, augmented=1.0)
    note = folder.keep_diagnosis(1, note, "page")
    folder.finish(IterationResult(iteration=1, snapshot="s", model="m", diagnosis=note))

    def missing() -> list[str]:
        faults = Inventory(folder, TrajectoryStore(tmp_path / "store")).faults()
        return [fault.where for fault in faults if "diagnosis" in fault.where]

    assert missing() == []
    (tmp_path / "iterations" / "i0001-diagnosis.json").unlink()
    assert missing() == ["iterations/i0001-diagnosis.json"]


def test_another_store_is_refused_since_other_commands_would_not_know_it(folder):
    folder.begin(RunConfig(), resume=False)
    with pytest.raises(ConfigError, match="store: '' -> elsewhere"):
        folder.begin(RunConfig(store="elsewhere"), resume=True)


def test_an_iteration_is_done_once_its_file_is_there(folder):
    folder.begin(RunConfig(), resume=False)
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


@pytest.mark.parametrize("name", ["run.json", "config.yaml", "robot.xml"])
def test_what_a_run_was_begun_with_may_not_change(folder, name):
    folder.begin(RunConfig(), resume=False)
    path = folder.path / name
    sound = path.read_bytes()
    for content in (b"", sound[:-10], sound + b"\n", b"\xff\xfe\x00", b"[]", b"{}", b"null"):
        path.write_bytes(content)
        with pytest.raises(DataError, match=f"{name}.*Restore a copy of it"):
            folder.begin(RunConfig(), resume=True)
    path.unlink()
    with pytest.raises(FlywheelError, match=name):
        (folder.path / "iterations").mkdir()
        folder.begin(RunConfig(), resume=True)
    path.write_bytes(sound)
    assert folder.begin(RunConfig(), resume=True).key == folder.begun().identity.key


def test_a_run_whose_configuration_is_gone_is_not_begun_again_over_what_it_left(folder):
    folder.begin(RunConfig(), resume=False)
    folder.config_file.unlink()  # killed while it was begun: nothing is lost
    folder.begin(RunConfig(), resume=False)
    (folder.path / "models").mkdir()
    folder.config_file.unlink()
    for resume in (False, True):
        with pytest.raises(ConfigError, match="no config.yaml, .* it has models"):
            folder.begin(RunConfig(), resume=resume)


SEEDED = RunConfig(seed=3)


@pytest.fixture
def seeded(folder):
    """A run with one iteration."""
    folder.begin(SEEDED, resume=False)
    folder.finish(IterationResult(iteration=0, snapshot="s", model="m"))
    return folder


@pytest.mark.parametrize("name", ["iterations/i0000-mppi.json", "run.json"])
def test_a_file_without_its_seal_was_altered(seeded, name):
    values = json.loads((seeded.path / name).read_text())
    del values["seal"]
    (seeded.path / name).write_text(json.dumps(values))
    with pytest.raises(DataError, match=f"{name} was altered: it has no seal"):
        seeded.finished(0, "mppi")


@pytest.mark.parametrize("name", ["iterations/i0000-mppi.json", "config.yaml", "run.json"])
@pytest.mark.parametrize("content", ["", "{", "[]", "null", '{"key": 5}', "\0"])
def test_other_contents_are_refused_with_a_message(seeded, content, name):
    (seeded.path / name).write_text(content)
    with pytest.raises(
        FlywheelError, match=r"i0000-mppi\.json|config\.yaml|run\.json|seed: 0 -> 3"
    ):
        seeded.begin(SEEDED, resume=True)
        seeded.finished(0, "mppi")


@pytest.mark.parametrize("path", ["../a.mp4", "/etc/passwd", "videos/../../a", "a\0b"])
def test_no_path_in_a_result_leads_out_of_the_run(folder, path):
    with pytest.raises(ValueError, match="leaves the run's folder"):
        IterationResult(iteration=0, snapshot="s", model="m", video=path)
    with pytest.raises(ValueError, match="leaves the run's folder"):
        DiagnosisNote(verdict="x", noise=0, baseline=0, augmented=0, page=path)


@pytest.fixture
def own(tmp_path):
    """A user's own MJCF, and a run begun with it."""
    mjcf = tmp_path / "mine" / "swing.xml"
    mjcf.parent.mkdir()
    mjcf.write_text(load_robot("platform4").xml)
    folder, config = RunFolder(tmp_path / "run"), RunConfig(model=str(mjcf))
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


@pytest.mark.parametrize(
    "name", ["../x", "my run", "[red]a[/red]", "ü", "a'b", "", "x" * 200, "a\n"]
)
def test_whatever_a_run_is_called_its_key_is_plain_and_nothing_leaves_its_folder(name, tmp_path):
    folder = tmp_path / "runs" / "one"
    folder.mkdir(parents=True)
    config = RunConfig.model_validate({"name": name, "workers": {"least_free_gb": 0}})
    key = RunFolder(folder).begin(config, resume=False).key
    assert re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9._-]*-[0-9a-f]{8}", key)
    assert RunFolder(folder).begin(config, resume=True).key == key
    assert [path.name for path in tmp_path.rglob("*.yaml")] == ["config.yaml"]
