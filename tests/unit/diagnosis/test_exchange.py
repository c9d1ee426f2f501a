"""What effects of an answer are exchanged for others on."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from flywheel.diagnosis import exchange
from flywheel.effects import EFFECTS, Term


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
