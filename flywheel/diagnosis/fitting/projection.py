"""The part of residuals and sensitivities that nuisance parameters cannot explain."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fitter, Jacobian, local_bases
from flywheel.records import Floats

DEAD = 1e-6  # a sensitivity below this many sigmas means that the knob is not connected
SAME = 1e-8  # singular value of columns of length 1, below which a direction repeats others


@dataclass(frozen=True)
class Projection:
    """Removes from vectors the part explained by nuisance parameters; N = K (D + X) rows.

    Attributes:
      bases: (K, D + X, X) orthonormal, of the local parameters with their priors.
      shared: (N, S) orthonormal, of the shared parameters.
      shares: (S,) removed fraction of each: all of it, or less with a prior, so that products of
        the rest are those of the inverse covariance.
      weights: (K,) of the windows, at most 1; a bad window counts less.
    """

    bases: Floats
    shared: Floats
    shares: Floats
    weights: Floats

    @classmethod
    def of(
        cls,
        fitter: Fitter,
        jacobian: Jacobian,
        by_value: Floats | None = None,
        weights: Floats | None = None,
        prior: Floats | None = None,
    ) -> Projection:
        """Remove initial states, offsets, and values in the model.

        Args:
          fitter, jacobian: of the model.
          by_value: (K, D, n) sensitivities to the values; None without any.
          weights: (K,) of the windows; None for 1.
          prior: (n,) standard deviations of the values, infinite without a prior; None for that.
        """
        weights = np.ones(len(jacobian.by_local)) if weights is None else weights
        bases = local_bases(jacobian.by_local * weights[:, None, None], fitter.local_prior)
        rows = bases.shape[0] * bases.shape[1]
        alone = cls(bases, np.zeros((rows, 0)), np.zeros(0), weights)
        shared = fitter.by_shared(jacobian, None)
        values = np.zeros((*shared.shape[:2], 0)) if by_value is None else by_value
        prior = np.full(values.shape[2], np.inf) if prior is None else prior
        unknown = np.isinf(prior)
        flat = alone(np.concatenate([shared, values[..., unknown]], axis=2))
        norms = np.linalg.norm(flat, axis=0)
        flat = flat[:, norms > DEAD] / norms[norms > DEAD]
        vectors, spread, _ = np.linalg.svd(flat, full_matrices=False)
        kept = vectors[:, spread > SAME]
        known = alone(values[..., ~unknown] * prior[~unknown])
        vectors, spread, _ = np.linalg.svd(known - kept @ (kept.T @ known), full_matrices=False)
        shares = [np.ones(kept.shape[1]), 1.0 - 1.0 / np.sqrt(1.0 + spread**2)]
        return cls(bases, np.concatenate([kept, vectors], 1), np.concatenate(shares), weights)

    @property
    def taken(self) -> float:
        """Degrees of freedom taken by shared parameters from a fitted residual."""
        return float((1.0 - (1.0 - self.shares) ** 2).sum())

    @property
    def price(self) -> float:
        """Logarithm of the likelihood penalty, relative to a fit, for values with alternatives.

        For those with a prior: the counterpart of log n in the Bayesian information criterion.
        """
        return float(-2.0 * np.log(1.0 - self.shares[self.shares < 1.0]).sum())

    def with_priors_scaled(self, factor: float) -> Projection:
        """The same with priors whose standard deviation is multiplied by a factor."""
        known = self.shares < 1.0
        variance = 1.0 / (1.0 - self.shares[known]) ** 2 - 1.0  # see `of`
        shares = self.shares.copy()
        shares[known] = 1.0 - 1.0 / np.sqrt(1.0 + factor**2 * variance)
        return replace(self, shares=shares)

    @property
    def unknown(self) -> Projection:
        """The same without the quantities that have a prior."""
        everything = self.shares == 1.0
        return replace(self, shared=self.shared[:, everything], shares=self.shares[everything])

    def __call__(self, vectors: Floats) -> Floats:
        """(N, n) rest of vectors (K, D, n)."""
        left = self.without_local(vectors).reshape(len(self.shared), vectors.shape[2])
        return left - self.shared @ (self.shares[:, None] * (self.shared.T @ left))

    def without_local(self, vectors: Floats) -> Floats:
        """(K, D + X, n) rest of vectors (K, D, n) after the local parameters."""
        missing = self.bases.shape[1] - vectors.shape[1]
        weighted = vectors * self.weights[:, None, None]
        padded = np.pad(weighted, ((0, 0), (0, missing), (0, 0)))
        return padded - self.bases @ (self.bases.swapaxes(1, 2) @ padded)
