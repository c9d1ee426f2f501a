"""Nuisance parameters: uncertain numbers of the MJCF, fitted together with everything else, and not
tested.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.multistart import BEFORE, unstuck
from flywheel.diagnosis.fitting.parameters import FreeParameter
from flywheel.diagnosis.settings import AsBuiltSettings
from flywheel.effects import CALIBRATIONS, NAMED, Effect, Part, Term, Terms, together
from flywheel.errors import DataError
from flywheel.registry import lookup
from flywheel.robots import Robot

# Residual/noise ratio above which no other starts are tried: they are not the fault.
FAR_OFF = 2.0
STARTS = 2  # of an uncertain number that are fitted for more than a round
NEARBY = 4  # times, at most, that starts around a result are fitted

# A number -> a finer or a coarser one of the same, which whoever names the first has said something of.
PARTS_OF = {
    "cable_stiffness": "weak_cable",
    "body_mass": "mass_of_body",
    "inertia_by_axis": "inertia_of_body",
    "winch_gain": "drum_radius",
    "winch_gain_on_length": "drum_radius",
}


def unsure_terms(
    unsure: Mapping[str, float], present: Terms = (), library: Mapping[str, Effect] = NAMED
) -> Terms:
    """Uncertain numbers, as effects of size zero.

    Args:
      unsure: name of an effect of the whole robot with one parameter -> standard deviation of its
        prior, in its unit.
      present: effects of the plant, which are fitted anyway.
      library: of the names.

    Raises:
      UnknownNameError: no such effect.
      DataError: of a place, of several parameters, already present, or not a positive number.
    """
    terms = []
    for name, deviation in unsure.items():
        effect = lookup(library, name, "effect")
        if effect.where != "robot" or len(effect.parameters) != 1:
            able = [n for n, e in library.items() if e.where == "robot" and len(e.parameters) == 1]
            raise DataError(
                f"{name} is not a single number of the whole robot, which could be uncertain: "
                f"{', '.join(able)}."
            )
        if any(term.effect.name == name for term in present):
            raise DataError(
                f"The plant has {name} already; it is fitted again with the new effects."
            )
        if not 0.0 < deviation < math.inf:
            unit = effect.parameters[0].unit
            raise DataError(
                f"The uncertainty of {name} must be a positive number [{unit}], got {deviation!r}."
            )
        terms.append(Term(effect, None, (0.0,), (deviation,)))
    return tuple(terms)


def as_built_terms(
    robot: Robot,
    settings: AsBuiltSettings = AsBuiltSettings(),
    present: Terms = (),
    named: Collection[str] = (),
) -> Terms:
    """All numbers of a robot's MJCF with a tolerance, as effects of size zero.

    Args:
      robot: of the numbers.
      settings: their tolerances.
      present: fitted effects of the model.
      named: effects that are candidates by name. Those that are in every library are not only
        numbers.
    """
    length = robot.length
    deviations = {
        "weak_cable": settings.stiffness,
        "cable_loss": settings.damping,
        "cable_length": settings.cable_length * length,
        "cable_end": settings.cable_end * length,
        "drum_radius": settings.drum,
        "mass_of_body": settings.mass,
        "inertia_of_body": settings.inertia,
        "centre_of_mass": settings.centre_of_mass * length,
        "marker_offset": settings.marker * length,
        **({"ground_friction": settings.friction} if robot.grounded else {}),
        **({"contact_softness": settings.softness} if robot.grounded else {}),
    }
    # Where a winch was when a recording began is fitted anyway: that is the length of its first cable.
    wound = {winch.cables[0] for winch in robot.winches}
    had = {(term.effect.name, term.place) for term in present}
    had |= {("cable_length", cable) for cable in wound}
    told = {PARTS_OF[term.effect.name] for term in present if term.effect.name in PARTS_OF}
    parts = [
        Part(NAMED[name], place, deviation)
        for name, deviation in deviations.items()
        for place in NAMED[name].places(robot)
        if (name, place) not in had
        and name not in told
        and not (name in named and name in CALIBRATIONS)
    ]
    return together(robot, parts)


def as_said(terms: Terms) -> Terms:
    """Terms with uncertain numbers at their prior mean."""
    return tuple(
        replace(t, values=tuple(map(_said, t.values, t.known))) if t.known else t for t in terms
    )


def _said(value: float, known: float) -> float:
    return value if math.isinf(known) else 0.0


def shaken_terms(terms: Terms, share: float, rng: np.random.Generator) -> Terms:
    """Terms with uncertain numbers moved at random.

    Contacts make the cost rough: a fit ends at an edge of it, where sensitivities are those of the
    edge.

    Args:
      terms: of a fit.
      share: standard deviation, relative to the priors.
      rng: of the moves.
    """
    return tuple(
        replace(
            term,
            values=tuple(
                value if math.isinf(known) else value + share * known * float(rng.normal())
                for value, known in zip(term.values, term.known, strict=True)
            ),
        )
        if term.known
        else term
        for term in terms
    )


def asked(terms: Terms) -> Terms:
    """Candidate terms, without the nuisance parameters."""
    return tuple(term for term in terms if term.asked)


def calibrated(fitter: Fitter, fit: Fit, terms: Terms) -> Fit:
    """A fit that includes uncertain numbers.

    Each number starts at its prior mean, and a standard deviation to either side: a few contacts
    make local minima in the cost, and a fit stays in the one where it starts, with too much
    certainty. The first round of all of them uses the Jacobian at the fit; only the best continue.
    A model that lacks more than that is not fitted to the last digit, and starts nowhere else. One
    that may be right also starts from around the result, as long as that improves it.
    """
    if not terms:
        return fit
    said = (*fit.terms, *terms)
    last = range(len(fit.terms), len(said))
    unknown = [value for value in fitter.free(said) if value.term in last]
    fit = replace(fit, cache=fitter.renewed(fit))
    begun = sorted(_begun_beside(fitter, fit, said, unknown), key=lambda each: each.cost)
    ended = [fitter.fit(each, unknown, rounds=1) for each in begun[:STARTS]]
    best = min(ended, key=lambda each: each.cost)
    best = fitter.fit(best, unknown, enough=fitter.worthwhile(best))
    if best.cost > FAR_OFF * fitter.freedom:
        return best
    elsewhere = unstuck(fitter, best)
    if elsewhere is not best:
        best = fitter.fit(elsewhere, unknown, enough=fitter.worthwhile(best))
    return best if fitter.worthwhile(best) else _lowest_nearby(fitter, best, unknown)


def _lowest_nearby(fitter: Fitter, fit: Fit, unknown: Sequence[FreeParameter]) -> Fit:
    """The lowest minimum found from around a fit, and from around that.

    The depth of a minimum is unknown after one round: all starts continue. Then each window takes
    the best of all initial states found.
    """
    for _ in range(NEARBY):
        renewed = replace(fit, cache=fitter.renewed(fit))
        begun = _begun_beside(fitter, renewed, fit.terms, unknown)
        ended = [fitter.fit(each, unknown, rounds=BEFORE) for each in begun]
        best = min(ended, key=lambda each: each.cost)
        others = [each for each in ended if each is not best]
        for each in others:
            best = fitter.best_of(best, fitter.with_terms(each, best.terms))
        before, fit = fit, min(fit, fitter.fit(best, unknown), key=lambda each: each.cost)
        if before.cost - fit.cost < fitter.settings.stopping.slight_fall:
            break
    return fit


def _begun_beside(
    fitter: Fitter, fit: Fit, terms: Terms, unknown: Sequence[FreeParameter]
) -> list[Fit]:
    """A round from terms and from around them, by the fit's Jacobian."""
    moved = [value.moved(terms, side * value.prior) for value in unknown for side in (-1.0, 1.0)]
    return [fitter.fit(fitter.with_terms(fit, each), unknown, rounds=1) for each in (terms, *moved)]
