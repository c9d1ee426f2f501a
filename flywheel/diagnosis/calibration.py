"""Numbers of the MJCF that are known only so well: fitted beside everything else, and not asked about."""

from __future__ import annotations

import math
from collections.abc import Mapping

from flywheel.diagnosis.fit import Fit, Fitter
from flywheel.diagnosis.free import free_values
from flywheel.effects import NAMED, Effect, Scales, Term, Terms
from flywheel.errors import DataError
from flywheel.registry import lookup


def unsure_terms(
    unsure: Mapping[str, float], present: Terms = (), library: Mapping[str, Effect] = NAMED
) -> Terms:
    """What is not known exactly, as effects of no size.

    Args:
      unsure: name of an effect of the whole robot with one parameter -> standard deviation of what is
        known of that, in its unit.
      present: effects that the plant has, which are fitted anyway.
      library: that the names are from.

    Raises:
      UnknownNameError: no such effect.
      DataError: of a place, of several parameters, there already, or not a positive number.
    """
    terms = []
    for name, deviation in unsure.items():
        effect = lookup(library, name, "effect")
        if effect.where != "robot" or len(effect.parameters) != 1:
            able = [n for n, e in library.items() if e.where == "robot" and len(e.parameters) == 1]
            raise DataError(
                f"{name} is no single number of the whole robot, which one can be unsure of: "
                f"{', '.join(able)}."
            )
        if any(term.effect.name == name for term in present):
            raise DataError(f"The plant has {name} already; it is fitted anew with what is found.")
        if not 0.0 < deviation < math.inf:
            unit = effect.parameters[0].unit
            raise DataError(f"{name} is known to a positive number [{unit}], got {deviation!r}.")
        terms.append(Term(effect, None, (0.0,), (deviation,)))
    return tuple(terms)


def calibrated(fitter: Fitter, fit: Fit, terms: Terms) -> Fit:
    """A fit with what is not known exactly fitted, too."""
    if not terms:
        return fit
    begun = fitter.under(fit, (*fit.terms, *terms))
    last = range(len(fit.terms), len(begun.terms))
    free = free_values(begun.terms, Scales.of(fitter.windows.robot))
    unknown = [value for value in free if value.term in last]
    return fitter.fit(fitter.elsewhere(fitter.fit(begun, unknown)), unknown)
