"""Numbers on the command line: none is taken that no command could do."""

from collections.abc import Iterator
from inspect import Parameter, signature
from typing import get_args

import pytest
import typer
from click.testing import CliRunner as Plain
from typer.testing import CliRunner

from flywheel.cli.driving.hidden_effects import hidden_effects
from flywheel.cli.logs.diagnose import unsure_of
from flywheel.cli.main import app
from flywheel.cli.options import channels_of, length_of, number
from flywheel.errors import ConfigError, UnknownNameError
from flywheel.quantities import Bounds
from flywheel.robots import load_robot

# Checked against the robot, and by what reads logs; an argument, checked against the run.
ELSEWHERE = {"--dt", "--iteration"}
PRISM = load_robot("prism3")
WRONG = ("nan", "inf", "-inf", "1e300", "-1", "0", "5%", "", "x" * 5000, "1" * 5000)


def declared(
    commands: typer.Typer, path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Parameter]]:
    """The words up to each option, of some commands and those below them, and its declaration."""
    for group in commands.registered_groups:
        assert group.typer_instance is not None
        below = (*path, group.name) if isinstance(group.name, str) else path
        yield from declared(group.typer_instance, below)
    for command in commands.registered_commands:
        assert command.callback is not None
        name = command.name or command.callback.__name__
        for option, parameter in signature(command.callback).parameters.items():
            yield (*path, name, f"--{option.replace('_', '-')}"), parameter


def is_numeric(parameter: Parameter) -> bool:
    hint, _ = get_args(parameter.annotation)
    return bool({int, float} & {hint, *get_args(hint)})


COMMANDS = typer.main.get_command(app)  # made once, not for each of hundreds
ALL = tuple(declared(app))
OPTIONS = [words for words, one in ALL if is_numeric(one) and words[-1] not in ELSEWHERE]


def test_there_are_such_options() -> None:
    assert ("evaluate", "--horizon") in OPTIONS
    assert ("adopt", "--answer") in OPTIONS
    assert ("design", "--candidates") in OPTIONS  # a field of a record that the library takes
    assert len(OPTIONS) > 30


def test_every_option_is_explained() -> None:
    assert [words for words, one in ALL if not get_args(one.annotation)[1].help] == []


@pytest.mark.parametrize("words", OPTIONS, ids=" ".join)
@pytest.mark.parametrize("value", ["nan", "inf", "1e300", "-1e300", "-1", "9" * 40])
def test_an_option_takes_no_number_without_bounds(words: tuple[str, ...], value: str) -> None:
    result = Plain().invoke(COMMANDS, [*words, value])
    said = " ".join(result.output.replace("│", " ").split())
    assert result.exit_code == 2, said
    assert f"Invalid value for '{words[-1]}'" in said, said


def test_numbers_within_bounds_pass() -> None:
    assert number("0.5", "A share", Bounds(0, 1)) == 0.5
    with pytest.raises(ConfigError, match=r"A share must be a number from 0 to 1; got 'nan'"):
        number("nan", "A share", Bounds(0, 1))


@pytest.mark.parametrize("text", WRONG)
def test_numbers_within_texts_have_bounds_too(text: str) -> None:
    for read in (
        lambda: length_of(f"{text}mm", PRISM),
        lambda: unsure_of([f"cable_stiffness={text}%"]),
    ):
        with pytest.raises(ConfigError, match="number.*; got|number.*Got") as caught:
            read()
        assert len(str(caught.value)) < 500


def test_a_wrong_length_is_shown_as_it_was_given() -> None:
    with pytest.raises(ConfigError, match="got '9km'"):
        length_of("9km", PRISM)
    with pytest.raises(ConfigError, match="got '-1N'"):
        channels_of(["tension=-1N"], PRISM)


def test_two_values_of_one_name_are_refused() -> None:
    with pytest.raises(ConfigError, match="got 'body_mass=2%' after another value of 'body_mass'"):
        unsure_of(["body_mass=1%", "cable_stiffness=5%", "body_mass=2%"])


@pytest.mark.parametrize(
    ("said", "kind", "sigma"),
    [
        ("tension=0.5N", "tension", 0.5),
        ("tension=2 kN", "tension", 2000.0),
        ("length=0.3mm", "length", 0.0003),
        ("winch=1e-4m", "winch", 0.0001),
    ],
)
def test_a_channel_is_of_all_cables_or_winches_or_of_one(
    said: str, kind: str, sigma: float
) -> None:
    names = [each.name for each in (PRISM.winches if kind == "winch" else PRISM.cables)]
    everywhere = channels_of([said], PRISM)
    assert [channel.key for channel in everywhere] == [(kind, name) for name in names]
    assert [channel.sigma for channel in everywhere] == pytest.approx([sigma] * len(names))
    assert channels_of([said.replace("=", f"@{names[1]}=")], PRISM) == everywhere[1:2]


def test_of_two_noises_of_a_channel_the_last_counts() -> None:
    found = channels_of(["tension=2N", f"tension@{PRISM.cables[1].name}=1N"], PRISM)
    assert [channel.sigma for channel in found[:3]] == [2.0, 1.0, 2.0]


@pytest.mark.parametrize(
    "said",
    ["", "tension", "tension=0.5", "tension=5mm", "length=-1mm", "length=1e300m", "winch=nanmm"],
)
def test_a_channel_without_a_sensible_noise_is_refused(said: str) -> None:
    with pytest.raises((ConfigError, UnknownNameError), match="got|Known: length, tension, winch"):
        channels_of([said], PRISM)


@pytest.mark.parametrize(
    ("said", "meant"), [("tnsion=1N", "tension"), ("winch@winch_36=1mm", "winch_35")]
)
def test_channels_that_are_not_there_are_named(said: str, meant: str) -> None:
    with pytest.raises(UnknownNameError, match=f"Did you mean '{meant}"):
        channels_of([said], PRISM)


@pytest.mark.parametrize("text", ["nan", "inf", "1e300", "", "x"])
def test_hidden_effects_have_sizes_that_can_be(text: str) -> None:
    with pytest.raises(ConfigError, match="multiple of the typical size.* must be a number"):
        hidden_effects((f"torque_speed:{text}",), PRISM)


@pytest.mark.parametrize(
    "words",
    [
        "compare log.csv --robot prism3 --draws 10000 --horizon 600",
        "design capstan creep --robot prism3 --candidates 10000 --seconds 600",
    ],
)
def test_numbers_that_are_too_large_together_are_refused_with_what_they_would_take(words):
    result = CliRunner().invoke(app, words.split())
    assert result.exit_code == 2
    assert "at most 16 GB are allowed" in result.output
