import pytest

from flywheel.cli.driving.hidden_effects import hidden_effects
from flywheel.effects import EFFECTS, AdoptedPlant, WrittenTerm
from flywheel.effects.libraries import with_laws
from flywheel.effects.own import LawFile, law_files
from flywheel.errors import ConfigError, UnknownNameError
from flywheel.robots import load_robot
from tests import own_laws

ROBOT = load_robot("prism3")


def test_sizes_are_multiples_of_the_typical_one():
    (one,), (twice,) = (hidden_effects((t,), ROBOT) for t in ("torque_speed", "torque_speed:2"))
    assert one.effect == twice.effect == "torque_speed"
    assert twice.parameters == {n: pytest.approx(2 * v) for n, v in one.parameters.items()}


def test_a_law_of_ones_own_can_be_hidden_where_its_file_is_given(tmp_path):
    library = with_laws([LawFile.read(own_laws.law_file(tmp_path))], EFFECTS)
    (effect,) = hidden_effects(("cogging:0.5",), ROBOT, library)
    assert effect.parameters["sine"] == 0.1
    plant = AdoptedPlant(
        robot="prism3",
        digest=ROBOT.digest,
        version=1,
        effects=(effect,),
        effects_from=[file.reference for file in law_files(library.values())],
    )
    path = str(plant.write(tmp_path, ROBOT))
    assert hidden_effects((path,), ROBOT, library) == (effect,)
    with pytest.raises(ConfigError, match="law file my_laws.py .* is missing"):
        hidden_effects((path,), ROBOT)


def test_places_and_adopted_plants(tmp_path):
    cable = ROBOT.cables[2].name
    effects = hidden_effects((f"weak_cable@{cable}:0.5", "slope"), ROBOT)
    assert [effect.label for effect in effects] == [f"weak_cable at {cable}", "slope"]
    plant = AdoptedPlant(robot="prism3", digest=ROBOT.digest, version=1, effects=effects)
    assert hidden_effects((str(plant.write(tmp_path, ROBOT)),), ROBOT) == effects
    with pytest.raises(ConfigError, match="adopted for prism3"):
        hidden_effects((str(tmp_path / "prism3-1"),), load_robot("icosa6"))


@pytest.mark.parametrize(
    ("wanted", "error", "said"),
    [
        ("torqe_speed", UnknownNameError, "torque_speed"),
        ("weak_cable@nowhere", UnknownNameError, "weak_cable@"),
        ("weak_cable", UnknownNameError, "weak_cable@"),
        ("torque_speed:much", ConfigError, "torque_speed:2"),
    ],
)
def test_what_cannot_be_is_refused_with_what_can(wanted, error, said):
    with pytest.raises(error, match=said):
        hidden_effects((wanted,), ROBOT)


def test_sizes_keep_their_sign_in_what_is_written():
    (effect,) = hidden_effects(("winch_gain:-1",), ROBOT)
    assert isinstance(effect, WrittenTerm)
    (share,) = effect.parameters.values()
    assert share < 0
