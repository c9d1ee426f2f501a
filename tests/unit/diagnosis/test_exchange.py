"""What effects of an answer are exchanged for others on."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flywheel.diagnosis import exchange
from flywheel.diagnosis.baseline import fitted
from flywheel.diagnosis.candidates import candidates
from flywheel.diagnosis.fit import Fit
from flywheel.diagnosis.selection import Selection
from flywheel.diagnosis.start_fit import StartFitter
from flywheel.effects import EFFECTS, Term
from flywheel.robots import Robot


def test_an_effect_is_exchanged_on_the_latest_step_without_it_or_on_a_fit_anew() -> None:
    had, moved = (Term(EFFECTS["winch_gain"], None, (share,)) for share in (0.1, 0.2))
    found = Term(EFFECTS["cable_damping"], None, (500.0,))
    steps: Any = [
        SimpleNamespace(fit=SimpleNamespace(terms=terms))
        for terms in ((had,), (moved,), (moved, found))
    ]
    selection: Any = SimpleNamespace(
        look=lambda fit: ("looked at", fit), dropped=lambda fit, term: term
    )
    assert exchange._without(selection, steps, found) is steps[1]
    assert exchange._without(selection, steps, moved) == ("looked at", moved)


def test_of_rivals_that_are_one_by_several_names_one_is_fitted(
    robot: Robot, fitter: StartFitter, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ("command_delay", "sensor_latency")
    library = candidates(robot, {name: EFFECTS[name] for name in (*names, "winch_gain")})
    selection = Selection(fitter, library, 25.0)
    found = Term(EFFECTS["winch_gain"], None, (0.05,))
    last = fitter.under(fitted(fitter, rounds=1), (found,))
    late = float(np.random.default_rng(seed).uniform(0.005, 0.03))
    scores: Any = [
        SimpleNamespace(candidate=each, sizes=(late / each.typical[0],), shape=0)
        for each in library
        if each.effect.name in names
    ]
    pursued: list[str] = []

    def pursue(fit: Fit, *_: float) -> Fit:
        pursued.append(fit.terms[-1].effect.name)
        return fit

    monkeypatch.setattr(selection, "pursued", pursue)
    as_good = exchange._in_place(selection, last, found, scores, margin=np.inf)
    assert pursued == [scores[0].candidate.effect.name], seed
    assert {fit.terms[-1].effect.name for fit in as_good} == {*names}, seed
    assert as_good[0].cost == pytest.approx(as_good[1].cost, rel=1e-6), seed
