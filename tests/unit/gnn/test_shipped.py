"""The networks that come with Flywheel are what their cards say."""

import pytest

from benchmarks.networks import CONFIGS, DRAWN, PLANTS, Measurement, drawn_plants
from flywheel.dynamics.gnn import load_weights, weights_digest
from flywheel.dynamics.gnn.shipped import (
    MJCF,
    NETWORK,
    ModelCard,
    PredictionError,
    shipped_networks,
    shipped_weights,
)
from flywheel.errors import ModelError
from flywheel.robots import load_robot
from flywheel.runtime.config.run_config import RunConfig, load_config

NAMES = tuple(shipped_networks())
ROUNDING = 0.02  # of an error: other processors round otherwise


def config(name: str) -> RunConfig:
    return load_config(CONFIGS / f"{name}.yaml")


def noted(card: ModelCard, plants: str) -> dict[str, PredictionError]:
    return {error.model: error for error in card.errors if error.plants == plants}


def test_there_is_one_for_prism3() -> None:
    assert "prism3" in NAMES


@pytest.mark.parametrize("name", NAMES)
def test_a_card_belongs_to_its_weights_and_to_the_configuration_that_makes_them(name: str) -> None:
    path, robot = shipped_networks()[name], load_robot(name)
    card, network = ModelCard.read(path), load_weights(path, robot)
    assert shipped_weights(robot) == path
    assert card.digest == weights_digest(network)
    assert network.config == config(name).network
    assert path.stat().st_size < 2e6


@pytest.mark.parametrize("name", NAMES)
def test_the_errors_of_the_card_are_found_again(name: str) -> None:
    path = shipped_networks()[name]
    [found] = Measurement(config(name)).errors(path, MJCF, floors=False)
    said = noted(ModelCard.read(path), MJCF)[NETWORK]
    assert found.e_pos == pytest.approx(said.e_pos, rel=ROUNDING)
    assert found.e_rot == pytest.approx(said.e_rot, rel=ROUNDING)


@pytest.mark.parametrize("name", NAMES)
def test_a_network_that_is_shipped_beats_physics_that_must_guess_the_roll(name: str) -> None:
    card = ModelCard.read(shipped_networks()[name])
    for plants in {error.plants for error in card.errors}:
        of = noted(card, plants)
        assert of[NETWORK].e_pos < of["the very plant, rods' roll random"].e_pos


@pytest.mark.parametrize("name", sorted(path.stem for path in CONFIGS.glob("*[0-9].yaml")))
def test_the_plants_of_a_configuration_are_those_that_are_drawn(name: str) -> None:
    plants = tuple(data.plant for data in config(name).datasets[1:])
    assert plants == drawn_plants(PLANTS, DRAWN)


def test_a_robot_without_one_is_told_so() -> None:
    with pytest.raises(ModelError, match="No network for platform4 .*only for .*prism3"):
        shipped_weights(load_robot("platform4"))
