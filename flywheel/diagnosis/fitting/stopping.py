"""What another round of a fit is worth, and whether there is hope in it."""

from __future__ import annotations

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter

# Times the noise, above which a model is wrong and not just badly fitted; and of what it leaves above that,
# what a round of its fit must explain to be followed by another.
WRONG, FRUITLESS = 1.1, 0.05
ROUNDS = 10  # of a fit, at most
HOPE = 2.0  # further rounds like the last one, after which a fit must have reached its target


def worth_a_round(fitter: Fitter, fit: Fit) -> float:
    """What a round must make the cost fall by to be followed by another; 0 for a model that may be right."""
    return FRUITLESS * max(0.0, fit.cost - WRONG * fitter.freedom(fit))


def hopeless(missing: float, fell: float, hope: float = HOPE) -> bool:
    """Whether a fit clearly stays above its target, or diverges.

    Args:
      missing: what is missing to the target after a round; NaN or infinite for one that diverges.
      fell: what the cost fell by in that round.
    """
    return not missing <= hope * fell
