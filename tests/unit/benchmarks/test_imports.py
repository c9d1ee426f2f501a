"""A small slice of the count of spoilt logs: none is silent, and no clean one gives an alarm."""

import pytest

from benchmarks import imports


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(imports, "ROBOTS", {"beam": imports.ROBOTS["beam"]})
    monkeypatch.setattr(imports, "MOTIONS", 2)


@pytest.mark.parametrize("kind", [*imports.FAULTS, ""])
def test_no_fault_of_a_log_is_silent_and_no_clean_log_gives_an_alarm(kind: str, few: None) -> None:
    for number in range(3):
        _, outcome, words = imports.draw(kind, number, seed=1)
        assert outcome not in ("SILENT", "FALSE ALARM"), f"{number}: {words}"


def test_what_is_silent_is_counted(few, monkeypatch, capsys):
    monkeypatch.setattr("flywheel.data.recordings.reading.mask_repeats", lambda log, robot: [])
    assert imports.main(["--logs", "1", "--kinds", "frozen"]) == 1
    told = capsys.readouterr().out
    assert "| frozen | 1 | 0 | 0 | 0 | 0 | 1 |" in told
    assert "Clean logs: 1, false alarms: 0." in told
