"""What another round of a fit is worth."""

from __future__ import annotations

from flywheel.diagnosis.fit import Fit, Fitter

# Times the noise, above which a model is wrong and not just badly fitted; and of what it leaves above that,
# what a round of its fit must explain to be followed by another.
WRONG, FRUITLESS = 1.1, 0.05


def worth_a_round(fitter: Fitter, fit: Fit) -> float:
    """What a round must make the cost fall by to be followed by another; 0 for a model that may be right."""
    return FRUITLESS * max(0.0, fit.cost - WRONG * fitter.freedom(fit))
