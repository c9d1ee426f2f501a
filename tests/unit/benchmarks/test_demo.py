"""Stories are counted by how they end."""

import sys

import pytest

from benchmarks import demo
from benchmarks.demo import FAILED, DemoResult, row_of, table, tell
from flywheel.demo.assessment import Naming
from flywheel.demo.demonstration import DemoConfig
from flywheel.errors import LinkError
from flywheel.robots import load_robot
from flywheel.runtime.pool.progress import Quiet


def result(effect: str, seed: int, outcome: str) -> DemoResult:
    return DemoResult(
        name=f"prism3.{effect}.s{seed}", hidden=effect, seed=seed, outcome=outcome, sentence="Said.",
        verdict="EFFECT", answers=(effect,), adopted=(effect,), before=3.0, after=2.0, more_before=True,
        held_out_before=1.5, held_out=1.0, seconds=60.0, cpu_seconds=90.0,
    )  # fmt: skip


def test_the_table_counts_every_ending() -> None:
    ended = [
        result("slope", 0, Naming.NAMED),
        result("slope", 1, Naming.AMONG),
        result("slope", 2, Naming.BESIDE),
        result("creep", 0, Naming.NOT_NAMED),
        result("creep", 1, FAILED),
        result("none", 0, Naming.NOTHING),
        result("none", 1, Naming.FALSE_ALARM),
    ]
    lines = "\n".join(table([row_of(each) for each in ended])).splitlines()
    assert "| creep | 2 | 0 | 0 | 0 | 2 | 3.00 | 2.00 | 1.50 to 1.00 | 90 |" in lines
    assert any(line.startswith("| slope | 3 | 1 | 1 | 1 | 0 |") for line in lines)
    assert any(line.startswith("| nothing | 2 | 1 | 0 | 0 | 1 |") for line in lines)
    assert any(line.startswith("| all effects | 5 | 1 | 1 | 1 | 2 |") for line in lines)
    assert any("| 2 of 5 | 40% (" in line for line in lines)
    assert {line.count("|") for line in lines} == {11}


def test_a_story_that_fails_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    def lost(*arguments: object) -> None:
        raise LinkError("The robot is lost.")

    monkeypatch.setattr(demo, "demonstrate", lost)
    told = tell(load_robot("prism3"), "payload", 1, Quiet(), DemoConfig())
    assert (told.outcome, told.sentence) == (FAILED, "The robot is lost.")
    assert told.hidden.startswith("payload@s")


def test_stories_that_are_there_are_not_told_again(tmp_path, monkeypatch, capsys):
    asked: list[tuple[str, int]] = []

    def told(robot: object, effect: str, seed: int, *more: object) -> DemoResult:
        asked.append((effect, seed))
        return result(effect, seed, Naming.NAMED)

    monkeypatch.setattr(demo, "tell", told)
    command = ["benchmarks.demo", str(tmp_path), "--hidden", "slope", "creep", "--seeds"]
    for seeds in (["0"], ["0", "1"]):
        monkeypatch.setattr(sys, "argv", [*command, *seeds])
        demo.main()
    assert asked == [("slope", 0), ("creep", 0), ("slope", 1), ("creep", 1)]
    assert "| all effects | 4 | 4 |" in capsys.readouterr().out
