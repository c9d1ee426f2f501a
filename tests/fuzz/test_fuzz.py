"""Spoilt inputs of every kind are taken or refused in a sentence; the same ones every time.

Others, and more: `python -m tests.fuzz --seed fresh`.
"""

import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from flywheel.errors import DataError
from tests.fuzz.asking import Kind, Spoilt, command, refusal
from tests.fuzz.judging import Limits, judged
from tests.fuzz.kinds import KINDS

INPUTS = 8  # of each kind
SLOW = ("csv", "map", "formats", "answer", "run")
NAMES = [pytest.param(n, marks=pytest.mark.slow) if n in SLOW else n for n in KINDS]


@pytest.fixture(scope="module")
def work(tmp_path_factory) -> Path:
    """Where the samples of all kinds are, each made once."""
    return tmp_path_factory.mktemp("samples")


@pytest.mark.parametrize("name", NAMES)
def test_good_inputs_are_taken(name, work, tmp_path, monkeypatch):
    kind = KINDS[name](work)
    for number, good in enumerate(kind.good):
        inside = tmp_path / f"inside{number}"
        inside.mkdir()
        monkeypatch.chdir(inside)
        assert kind.ask(good, inside) is None


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_spoilt_inputs_do_no_harm(name: str, work: Path) -> None:
    verdicts = list(judged(KINDS[name], work, INPUTS, seed=0))
    assert len(verdicts) == INPUTS
    assert [v for v in verdicts if not v.right] == []
    assert any(v.outcome == "refused" for v in verdicts)


def wrong(spoilt: Spoilt, inside: Path) -> str | None:
    raise KeyError("x")


def outside(spoilt: Spoilt, inside: Path) -> str | None:
    (inside.parent / "escaped").touch()
    return None


def large(spoilt: Spoilt, inside: Path) -> str | None:
    return str(len(bytearray(300_000_000)))


def endless(spoilt: Spoilt, inside: Path) -> str | None:
    time.sleep(60)
    return None


def deadly(spoilt: Spoilt, inside: Path) -> str | None:
    os.abort()


def wordy(spoilt: Spoilt, inside: Path) -> str | None:
    return "x" * 10**5


def content(spoilt: Spoilt, inside: Path) -> str | None:
    return None


def sensible(spoilt: Spoilt, inside: Path) -> str | None:
    return "why"


OUTCOMES = {
    wrong: "traceback",
    outside: "escape",
    large: "memory",
    endless: "hang",
    deadly: "crash",
    wordy: "wordy",
    content: "accepted",
    sensible: "refused",
}


def acting(act: Callable[[Spoilt, Path], str | None], work: Path) -> Kind:
    return Kind("acting", (), lambda rng: Spoilt(b"x"), act)


@pytest.mark.slow
@pytest.mark.parametrize("act", OUTCOMES)
def test_every_harm_is_seen(act: Callable[[Spoilt, Path], str | None], tmp_path: Path) -> None:
    limits = Limits(seconds=0.5 if act is endless else 10.0, memory=200.0)
    verdicts = judged(partial(acting, act), tmp_path, 2, 0, limits)
    assert [v.outcome for v in verdicts] == [OUTCOMES[act]] * 2


def test_a_refusal_is_told_from_a_mistake_of_ours() -> None:
    def refuses() -> None:
        raise DataError("why")

    assert refusal(refuses) == "why"
    assert command("list", "robots") is None
    assert "no/such/run" in (command("report", "no/such/run") or "")
