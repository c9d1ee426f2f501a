"""The tuned numbers of a diagnosis, as a user sees and changes them."""

from dataclasses import fields, is_dataclass
from typing import Any

import pytest
from typer.testing import CliRunner

from flywheel.cli.main import app
from flywheel.diagnosis.settings import Settings, changed, described, numbers, unusual
from flywheel.errors import ConfigError, UnknownNameError


def records(settings: Any) -> list[Any]:
    parts = [getattr(settings, field.name) for field in fields(settings)]
    return [settings, *(r for part in parts if is_dataclass(part) for r in records(part))]


def test_every_setting_is_said_to_be_something() -> None:
    """In the docstring of its record, whose parts are named by their own."""
    for record in records(Settings()):
        for field in fields(record):
            if not is_dataclass(getattr(record, field.name)):
                assert f"{field.name}" in (type(record).__doc__ or ""), (type(record), field.name)


def test_each_number_is_listed_with_what_its_docstring_says() -> None:
    said = {path: described(path) for path in numbers(Settings())}
    assert all(said.values())
    assert said["windows.remnant"] == (
        "fraction of that length below which a recording gives no window if others do."
    )
    assert said["fitting.refinement.tolerated"].startswith("root mean square change of a window")


def test_a_number_is_changed_and_all_others_stay() -> None:
    before = Settings()
    after = changed(before, {"selection.shortlist": 2.0, "limits.threshold": 36.0})
    was, now = numbers(before), numbers(after)
    different = {path: now[path] for path in was if was[path] != now[path]}
    assert different == {"selection.shortlist": 2, "limits.threshold": 36.0}
    assert isinstance(after.selection.shortlist, int)
    assert before == Settings()
    assert unusual(after) == different and unusual(before) == {}


@pytest.mark.parametrize(
    ("path", "number", "message"),
    [
        ("limits.treshold", 3.0, "no setting 'limits.treshold'.*'limits.threshold'"),
        ("limits", 3.0, "no setting 'limits'"),
        ("selection.shortlist", 2.5, "must be a whole number from 1 to 1,000; got 2.5"),
        ("selection.shortlist", 0.0, "must be a whole number from 1 to 1,000; got 0"),
        ("limits.threshold", float("nan"), "must be a number above 0"),
        ("limits.threshold", -1.0, "must be a number above 0"),
    ],
)
def test_what_a_setting_cannot_be_is_refused(path: str, number: float, message: str) -> None:
    with pytest.raises((ConfigError, UnknownNameError), match=message):
        changed(Settings(), {path: number})


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ("limits.threshold", "--set takes SETTING=NUMBER"),
        ("limits.threshold=many", "limits.threshold must be a number"),
        ("limits.treshold=3", "There is no setting"),
    ],
)
def test_the_command_refuses_them_before_it_reads_a_log(statement: str, message: str) -> None:
    asked = ["diagnose", "no-such-log.csv", "--robot", "prism3", "--set", statement]
    answer = CliRunner().invoke(app, asked)
    assert answer.exit_code == 2
    assert message in " ".join(answer.output.split())


def test_all_of_them_are_listed() -> None:
    printed = CliRunner().invoke(app, ["list", "settings"], env={"COLUMNS": "200"})
    assert printed.exit_code == 0
    assert all(path in printed.output for path in numbers(Settings()))
