"""What the truth simulator can hide, beside what the library can name."""

from flywheel.effects import EFFECTS, PROBES
from flywheel.truth_simulator import HIDDEN, OUTSIDE

# Effects of the library that the truth simulator does not hide: name -> why not.
NOT_HIDDEN: dict[str, str] = {}


def test_every_effect_can_be_hidden_or_it_is_said_why_not() -> None:
    assert set(EFFECTS) - set(HIDDEN) == set(NOT_HIDDEN)
    assert all(NOT_HIDDEN.values())


def test_what_a_diagnosis_should_name_it_has_a_name_for() -> None:
    assert set(HIDDEN) <= set(EFFECTS)


def test_no_law_without_a_name_bears_the_name_of_an_effect() -> None:
    """An effect that was a probe, or was outside the library, is no longer one."""
    assert not EFFECTS.keys() & PROBES.keys()
    assert not EFFECTS.keys() & OUTSIDE.keys()
