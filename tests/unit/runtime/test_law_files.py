"""Law files of a run: named in its configuration, kept in its folder, run by its workers."""

import pickle
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from flywheel.data import TrajectoryStore
from flywheel.data.recordings import read_recording, store_recording
from flywheel.diagnosis.adoption import adoptable
from flywheel.effects import NAMED, AdoptedPlant, WrittenTerm
from flywheel.effects.own import LawFile
from flywheel.errors import ConfigError, DataError, UnknownNameError
from flywheel.options import ImportOptions
from flywheel.records import Split
from flywheel.robots import load_robot
from flywheel.runtime.config.loading import yaml_of
from flywheel.runtime.config.run_config import RunConfig, config_digest, load_config
from flywheel.runtime.run.folder import RunFolder
from flywheel.runtime.run.inventory import Inventory
from flywheel.runtime.run.suitability import check_suits
from flywheel.runtime.workers.sim_worker import SimWorker
from flywheel.seals import file_sha256
from flywheel.truth_simulator import hidden_effect
from flywheel.truth_simulator.recording import record
from tests import own_laws
from tests.unit.runtime.tiny_run import TINY

COGGING = {"effect": "cogging", "parameters": {"sine": 0.4, "cosine": 0.0, "pitch": 0.15}}


def configured(folder: Path, text: str = "effects_from: my_laws.py\n") -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / "mine.yaml"
    path.write_text(text)
    return path


def test_a_law_file_is_found_beside_the_configuration(tmp_path, monkeypatch):
    law = own_laws.law_file(tmp_path / "laws")
    path = configured(tmp_path / "configs", "effects_from: ../laws/my_laws.py\n")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    (file,) = load_config(path).effects_from
    assert (file.file, file.sha256) == ("my_laws.py", file_sha256(law, "law file"))
    assert load_config(path, [f"effects_from=[{law}]"]) == load_config(path)
    (tmp_path / "further").mkdir()
    further = tmp_path / "further" / "b.yaml"
    further.write_text("extends: ../configs/mine.yaml\nseed: 3\n")
    assert load_config(further).effects_from == (file,)


def test_reading_a_configuration_does_not_run_its_law_file(tmp_path: Path) -> None:
    text = f"from pathlib import Path\nPath({str(tmp_path / 'ran')!r}).touch()\n"
    own_laws.law_file(tmp_path, text)
    config = load_config(configured(tmp_path))
    assert not (tmp_path / "ran").exists()
    with pytest.raises(ConfigError, match="defines no effect"):
        config.library()
    assert (tmp_path / "ran").exists()


def test_the_text_of_a_law_file_counts_into_the_digest_and_nothing_else_does(tmp_path):
    path = configured(tmp_path)
    own_laws.law_file(tmp_path)
    one = config_digest(load_config(path))
    own_laws.law_file(tmp_path / "moved")
    path.write_text("effects_from: [moved/my_laws.py]\n")
    assert config_digest(load_config(path)) == one
    own_laws.law_file(tmp_path / "moved", own_laws.COGGING + "# changed\n")
    assert config_digest(load_config(path)) != one
    assert "effects_from" not in str(RunConfig().model_dump(exclude_defaults=True))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("effects_from: nowhere.py\n", "effects_from.0: There is no law file .*nowhere.py"),
        ("effects_from: mine.yaml\n", r"effects_from.0: A law file is Python and ends in \.py"),
        ("effects_from: 3\n", "effects_from.0: must be a mapping; got 3"),
        ("effects_from: [my_laws.py, more/my_laws.py]\n", "Two law files are called my_laws.py"),
        ("diagnose: {effects: [cogging]}\n", "diagnose: There is no effect 'cogging'"),
        (
            f"effects_from: {{file: my_laws.py, sha256: '{'0' * 64}'}}\n",
            "was changed: its sha256 is .*, not 000000000000",
        ),
    ],
)
def test_what_cannot_be_is_refused(tmp_path: Path, text: str, message: str) -> None:
    own_laws.law_file(tmp_path)
    own_laws.law_file(tmp_path / "more")
    with pytest.raises(ConfigError, match=message):
        load_config(configured(tmp_path, text))


def test_a_law_that_cannot_be_used_is_refused_before_a_run_begins(tmp_path: Path) -> None:
    robot, law = load_robot("prism3"), tmp_path / "my_laws.py"
    named = {"effects_from": str(law), "effects": [COGGING]}
    own_laws.law_file(tmp_path)
    check_suits(RunConfig.model_validate({**TINY, **named}), robot)
    with pytest.raises(UnknownNameError, match="no effect 'coging'"):
        wrong = {**TINY, **named, "diagnose": {"effects": ["coging"]}}
        check_suits(RunConfig.model_validate(wrong), robot)
    with pytest.raises(DataError, match="cogging is not a single number"):
        wrong = {**TINY, **named, "diagnose": {"unsure": {"cogging": 0.1}}}
        check_suits(RunConfig.model_validate(wrong), robot)
    own_laws.law_file(tmp_path, own_laws.COGGING.replace("rate * (1.0", "rate * (1.1"))
    with pytest.raises(ConfigError, match="changes rates although its sizes are zero"):
        check_suits(RunConfig.model_validate({**TINY, **named}), robot)


def test_an_adopted_plant_wants_its_law_file_in_the_configuration(tmp_path: Path) -> None:
    robot, file = load_robot("prism3"), LawFile.read(own_laws.law_file(tmp_path))
    plant = AdoptedPlant(
        robot=robot.name,
        digest=robot.digest,
        version=1,
        effects=(WrittenTerm.model_validate(COGGING),),
        effects_from=(file.reference,),
    )
    path = plant.write(tmp_path / "plants", robot, [file])
    with pytest.raises(ValidationError, match="my_laws.py .* is missing: add --effects-from"):
        RunConfig.model_validate({"effects": str(path)})
    config = RunConfig.model_validate(
        {"effects": str(path), "effects_from": [str(tmp_path / "my_laws.py")]}
    )
    assert config.effects == plant.effects and config.effects_from == (file,)
    assert set(config.library()) == {*NAMED, "cogging"}


def test_a_run_keeps_its_law_file_and_goes_on_without_the_original(tmp_path: Path) -> None:
    law, folder = own_laws.law_file(tmp_path), RunFolder(tmp_path / "run")
    folder.path.mkdir()
    config = load_config(configured(tmp_path))
    begun = folder.begin(config, resume=False)
    law.unlink()
    kept = folder.path / "my_laws.py"
    assert kept.read_text() == own_laws.COGGING
    assert folder.config() == config
    assert folder.begin(load_config(folder.config_file), resume=True) == begun
    look = Inventory(folder, TrajectoryStore(folder.store_url(config)))
    assert look.strangers() == [] and look.faults() == []
    kept.write_text(own_laws.COGGING + "\n")
    assert [(fault.kind, fault.where) for fault in look.faults()] == [("altered", "my_laws.py")]
    with pytest.raises(DataError, match="my_laws.py was altered since the start of the run"):
        folder.config()
    own_laws.law_file(tmp_path, own_laws.COGGING + "# changed\n")
    kept.write_text(own_laws.COGGING)
    with pytest.raises(ConfigError, match=r"effects_from: \[\{'file': 'my_laws.py'.* -> "):
        folder.begin(load_config(tmp_path / "mine.yaml"), resume=True)


def test_a_stored_configuration_names_files_of_its_own_folder_only(tmp_path: Path) -> None:
    own_laws.law_file(tmp_path)
    stored = configured(tmp_path / "run", "effects_from: ../my_laws.py\n")
    with pytest.raises(ConfigError, match="may only name files in its own folder"):
        load_config(stored, stored=True)
    assert load_config(stored).effects_from


def test_what_is_written_of_a_law_file_is_its_name_and_digest(tmp_path: Path) -> None:
    own_laws.law_file(tmp_path)
    text = yaml_of(load_config(configured(tmp_path)))
    assert "import numpy" not in text and "file: my_laws.py" in text


def test_a_worker_of_a_run_simulates_with_a_law_of_ones_own(tmp_path: Path) -> None:
    law = own_laws.law_file(tmp_path)
    config = RunConfig.model_validate({"effects_from": [str(law)]})
    law.unlink()  # where the worker is, it is not
    elsewhere = pickle.loads(pickle.dumps(config))
    worker = SimWorker(elsewhere, str(tmp_path / "store"), load_robot("prism3"))
    values = {"sine": 0.3, "cosine": 0.0, "pitch": 0.15}
    written = WrittenTerm(effect="cogging", location="", parameters=values)
    assert worker._recorder.plant(0, (written,)).terms[0].effect is elsewhere.library()["cogging"]


@pytest.mark.nightly
@pytest.mark.slow
def test_a_worker_of_a_run_finds_a_law_of_ones_own(tmp_path: Path) -> None:
    robot, store, names = load_robot("prism3"), str(tmp_path / "store"), []
    hidden = hidden_effect("cogging").typical(robot, np.random.default_rng(0))
    splits: tuple[Split, ...] = ("train", "test")
    for seed, split in enumerate(splits, 1):
        made = record(robot, [hidden], seconds=0.7, seed=seed)
        log, _ = made.write(tmp_path / "logs", split, robot)
        recording = read_recording(log, robot, ImportOptions(split=split))
        names.append(store_recording(TrajectoryStore(store), recording)[0])
    law = own_laws.law_file(tmp_path)
    config = RunConfig.model_validate(
        {
            "effects_from": [str(law)],
            "collect": {"recordings": names},
            "diagnose": {"on": True, "effects": ["cogging"]},
        }
    )
    law.unlink()  # where the worker is, it is not
    worker = SimWorker(pickle.loads(pickle.dumps(config)), store, robot)
    found = pickle.loads(pickle.dumps(worker.diagnose((), names[:1], names[1:])))
    assert [effect.effect for effect in found.answers[0]] == ["cogging"]
    assert found.held_out.augmented < 0.95 * found.held_out.baseline
    assert found.summary()["effects_from"] == [config.effects_from[0].reference.model_dump()]
    (written,) = adoptable(found.summary())
    assert worker._recorder.plant(0, (written,)).terms[0].effect is config.library()["cogging"]
