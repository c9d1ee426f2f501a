"""The one number by which models are compared."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import block_diag

from flywheel.diagnosis.fitting.model import fitted
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.criterion import promised
from flywheel.diagnosis.selection.search import Search
from flywheel.effects import EFFECTS, Term, alike, at_same_size, per_part_term

ROBOT = "platform4"


def test_a_model_pays_for_its_values_and_for_what_is_known_of_the_others(fitter):
    inf = np.inf
    terms = (
        Term(EFFECTS["winch_gain"], None, (0.1,)),
        Term(EFFECTS["creep"], None, (0.0, 0.3), (inf, 0.1), price=3.0),
        Term(EFFECTS["capstan"], None, (0.0,), (0.1,), price=4.0),
    )
    fit = replace(fitter.first_estimate(), terms=terms, cost=100.0)
    noisy = np.zeros_like(fitter.windows.measured, bool)
    noisy.flat[:500] = True
    search = Search(SimpleNamespace(windows=SimpleNamespace(noisy=noisy)), ())
    assert search.criterion(fit) == pytest.approx(100.0 + 2 * np.log(500) + 3.0 + 4.0)


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_sizes_of_parts_promise_what_is_explained_minus_their_determinant(robot, fitter, share):
    """As computed from whole covariances of the measurements; the price stays with the term."""
    (candidate,) = candidates(robot, {"cable_friction": EFFECTS["cable_friction"]})
    search = Search(fitter, (candidate,))
    model = search.score_all(fitted(fitter, rounds=1))
    term = per_part_term(candidate.term((5.0,)), robot, 0.5)
    assert term is not None
    begun = replace(fitter.with_terms(model.fit, (term,)), cache=model.fit.cache)
    found = promised(fitter, model, begun, (share,))

    columns, residual = fitter.by_value(begun, fitter.free(begun.terms)), model.fit.residual
    known, shared = (
        each.reshape(residual.size, -1) for each in (columns[..., 1:], columns[..., :1])
    )
    winches = fitter.by_shared(model.jacobian, None).reshape(residual.size, -1)
    own = [j * fitter.local_prior for j in model.jacobian.by_local]
    precision = np.linalg.inv(np.eye(residual.size) + block_diag(*(j @ j.T for j in own)))

    def left(unknown):
        weighted = precision @ unknown
        return precision - weighted @ np.linalg.pinv(unknown.T @ weighted) @ weighted.T

    spread, r = share * 0.5 * known, residual.ravel()
    alone = left(np.hstack([winches, shared]))
    information = np.eye(known.shape[1]) + spread.T @ alone @ spread
    towards = spread.T @ alone @ r
    more = r @ alone @ r - towards @ np.linalg.solve(information, towards)
    price = np.linalg.slogdet(information)[1]
    assert found.explained == pytest.approx(r @ left(winches) @ r - more - price, rel=1e-6)
    (priced,) = found.fit.terms
    assert priced.price == pytest.approx(price) and priced.known[1:] == (share * 0.5,) * 4
    assert search.criterion(found.fit) == pytest.approx(search.criterion(begun) + price)


def test_another_effect_with_the_same_sizes_of_parts_has_their_price_and_one_size_has_none(robot):
    friction, capstan = (Term(EFFECTS[n], None, (2.0,)) for n in ("cable_friction", "capstan"))
    term = per_part_term(friction, robot, 0.5)
    assert term is not None
    priced = replace(term, price=7.0)
    assert alike(capstan, priced, robot).price == 7.0
    assert at_same_size(priced).price == 0.0
