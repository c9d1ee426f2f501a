"""The configuration of a run: presets, digests, and what may change in a continuation."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from flywheel.dynamics.gnn import NetworkConfig
from flywheel.effects import AdoptedPlant, WrittenTerm
from flywheel.errors import ConfigError
from flywheel.robots import load_robot
from flywheel.runtime.config.heard import NEEDS
from flywheel.runtime.config.loading import yaml_of
from flywheel.runtime.config.run_config import RunConfig, config_digest, load_config
from flywheel.runtime.config.shipped import shipped_configs

CONFIGS = Path(__file__).parents[3] / "configs"


@pytest.mark.parametrize("path", sorted(CONFIGS.rglob("*.yaml")), ids=lambda p: p.name)
def test_every_shipped_configuration_is_valid_and_comes_back_as_it_was(path, tmp_path):
    config = load_config(path)
    assert config.name != "run"  # each has a name of its own
    (tmp_path / "config.yaml").write_text(yaml_of(config), encoding="utf-8")
    assert config_digest(load_config(tmp_path / "config.yaml")) == config_digest(config)


def test_a_network_preset_can_be_named_and_changed():
    config = RunConfig.model_validate({"network": {"preset": "paper", "width": 32}})
    assert config.network == NetworkConfig.paper(width=32)


def test_an_unknown_preset_lists_the_known_ones():
    with pytest.raises(ValidationError, match="Known: hybrid, lean, paper"):
        RunConfig.model_validate({"network": {"preset": "lena"}})


@pytest.mark.parametrize("name", ["a run", "1e3", "2020-02-31", "null", "a: b", "x\ny", "ü", " "])
def test_a_stored_configuration_reads_back_as_it_was(name, tmp_path):
    config = RunConfig.model_validate({"name": name, "network": {"preset": "paper"}, "seed": 3})
    (tmp_path / "config.yaml").write_text(yaml_of(config), encoding="utf-8")
    again = load_config(tmp_path / "config.yaml")
    assert again == config and config_digest(again) == config_digest(config)


def test_one_setting_of_a_schedule_can_be_changed_alone():
    config = load_config(CONFIGS / "prism3.yaml", ["training.initial.steps=321"])
    before = load_config(CONFIGS / "prism3.yaml").training
    assert config.training.initial == before.initial.model_copy(update={"steps": 321})
    assert config.training.fine_tuning == before.fine_tuning
    with pytest.raises(
        ConfigError, match=r"training.initial.stepz: unknown key. Did you mean 'steps'"
    ):
        load_config(CONFIGS / "prism3.yaml", ["training.initial.stepz=321"])


@pytest.mark.parametrize(
    "change",
    [
        {"workers": {"sim": 7, "stall_seconds": 5}},
        {"name": "other"},
        {"tracking": {"uri": "http://somewhere:5000"}},
    ],
)
def test_who_computes_does_not_change_the_digest(change):
    assert config_digest(RunConfig.model_validate(change)) == config_digest(RunConfig())


@pytest.mark.parametrize(
    "change",
    [{"seed": 1}, {"sim_threads": 2}, {"training": {"processes": 5}}, {"mppi": {"samples": 7}}],
)
def test_whatever_changes_a_number_changes_the_digest(change):
    assert config_digest(RunConfig.model_validate(change)) != config_digest(RunConfig())


def test_data_sets_of_one_name_are_refused():
    with pytest.raises(ValidationError, match="different names"):
        RunConfig.model_validate({"datasets": [{"name": "a"}, {"name": "a"}]})


def test_recordings_have_a_place_of_their_own_in_the_one_hot():
    config = RunConfig.model_validate({"datasets": [{"name": "a"}, {"name": "b"}]})
    assert config.dataset_numbers() == {"a": 0, "b": 1, "recording": 2}


def test_more_data_sets_than_the_network_has_places_for_are_refused():
    with pytest.raises(ValidationError, match="network.datasets"):
        RunConfig.model_validate({"network": {"datasets": 1}})


def test_a_misspelt_setting_is_told_its_neighbour(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("collect: {gait: 3}\n")
    with pytest.raises(ConfigError, match="collect.gait: unknown key. Did you mean 'gaits'"):
        load_config(path)


def adopted_plant(folder: Path, robot_name: str = "prism3") -> Path:
    robot = load_robot(robot_name)
    friction = WrittenTerm(effect="cable_friction", parameters={"force": 3.0})
    plant = AdoptedPlant(robot=robot.name, digest=robot.digest, version=1, effects=(friction,))
    return plant.write(folder, robot)


def test_the_effects_of_an_adopted_plant_are_taken_over(tmp_path: Path) -> None:
    path = adopted_plant(tmp_path)
    (written,) = RunConfig.model_validate({"effects": str(path)}).effects
    assert (written.effect, written.parameters) == ("cable_friction", {"force": 3.0})
    assert config_digest(RunConfig(effects=(written,))) != config_digest(RunConfig())


def test_the_effects_of_another_robots_plant_are_refused(tmp_path: Path) -> None:
    path = adopted_plant(tmp_path, "icosa6")
    with pytest.raises(ValidationError, match="adopted for icosa6 .* the run's model is prism3"):
        RunConfig.model_validate({"effects": str(path)})
    with pytest.raises(ValidationError, match="no adopted plant"):
        RunConfig.model_validate({"effects": str(tmp_path / "plants")})


@pytest.mark.parametrize("part", ["training", "residual.training"])
def test_a_run_has_one_seed(part):
    values: dict = {"seed": 4}
    for name in reversed(part.split(".")):
        values = {name: values}
    with pytest.raises(ValidationError, match=f"{part}.seed: the seeds .* set seed, got 4"):
        RunConfig.model_validate(values)


def test_a_model_of_a_run_knows_recordings_as_a_data_set_where_it_learned_from_any():
    assert RunConfig().recording_number == 0
    assert RunConfig(robot={}).recording_number == 1
    assert RunConfig(collect={"recordings": ["monday"]}).recording_number == 1


UNHEARD = {
    "task.course=maze": "task.name=obstacle_course",
    "task.stops=4": "task.name=tour",
    "task.boxes=3": "task.name=reach_among_boxes",
    "task.obstacles=[{center: [1, 1, 1], half_size: [1, 1, 1]}]": "task.name=reach_among_boxes",
    "terrain.bump_height.0=0.03": "terrain.kinds=[flat, bumps]",
    "terrain.bump_height=[0.02, 0.06]": "terrain.kinds=[bumps]",
    "terrain.cell=0.05": "terrain.kinds=[slope]",
    "diagnose.unsure.cable_stiffness=0.1": "diagnose.on=true",
    "residual.training.steps=7": "residual.on=true",
}


@pytest.mark.parametrize(("setting", "needs"), UNHEARD.items())
def test_a_setting_without_an_effect_is_refused_with_what_it_needs(setting, needs):
    file = shipped_configs()["prism3"]
    more = ["robot.link=simulated"]
    with pytest.raises(ConfigError, match="has no effect: .* needs") as caught:
        load_config(file, [*more, setting])
    assert needs.split("=")[0] in str(caught.value)
    load_config(file, [*more, setting, needs])


def test_a_part_that_is_off_may_be_said_to_be():
    load_config(shipped_configs()["prism3"], ["diagnose.on=false", "residual.on=false"])


def test_distances_of_goals_are_heard_where_goals_are_drawn():
    load_config(shipped_configs()["prism3"], ["task.radius=[1, 2]"])
    with pytest.raises(ConfigError, match="task.radius needs"):
        load_config(shipped_configs()["prism3"], ["task.goal=[5, 0]", "task.radius=[1, 2]"])


def test_every_setting_that_needs_another_is_one():
    values = RunConfig(robot={}).model_dump()
    for setting in NEEDS:
        here = values
        for part in setting.split("."):
            here = here[part]
