#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" gpytorch==1.15.2 torch==2.13.0 numpy==2.4.6
echo "guess:     a Gaussian process of the class ExactGP is as exact with 801 points as with 800"
echo "behaviour: from 801 on it iterates, with at most a warning: the mean is some deviations off, and some deviations are ten times too large"
python -W ignore - <<'PYTHON'
import gpytorch
import numpy as np
import torch

LENGTH, NOISE = 0.1, 1e-4
torch.manual_seed(0)

class Process(gpytorch.models.ExactGP):
    def __init__(self, places, values, likelihood):
        super().__init__(places, values, likelihood)
        self.mean, self.kernel = gpytorch.means.ZeroMean(), gpytorch.kernels.RBFKernel()

    def forward(self, places):
        return gpytorch.distributions.MultivariateNormal(self.mean(places), self.kernel(places))


def kernel(some, others):
    return np.exp(-0.5 * ((some[:, None] - others) / LENGTH) ** 2)


def off(count):
    """How far the mean is off, in true standard deviations, and the range of given by true standard deviations."""
    places, asked = np.linspace(0, 1, count), np.linspace(0, 1, 101)
    values = np.sin(12 * places)
    likelihood = gpytorch.likelihoods.GaussianLikelihood()
    process = Process(torch.tensor(places), torch.tensor(values), likelihood).double()
    process.kernel.lengthscale, likelihood.noise = LENGTH, NOISE
    process.eval()
    with torch.no_grad():
        given = process(torch.tensor(asked))
        mean, deviation = given.mean.numpy(), given.stddev.numpy()
    across = kernel(asked, places)
    solved = np.linalg.solve(kernel(places, places) + NOISE * np.eye(count), np.c_[values, across.T])
    exact = np.sqrt(1 - np.einsum("ij,ji->i", across, solved[:, 1:]))
    return (abs(mean - across @ solved[:, 0]) / exact).max(), (deviation / exact).min(), (deviation / exact).max()


for count in (800, 801):
    error, low, high = off(count)
    print(f"seen:      {count} points: the mean is up to {error:.1g} deviations off, deviations are {low:.2f} to {high:.2f} of the exact ones")
    assert (error < 1e-6 and abs(high - 1) < 1e-6) if count == 800 else (error > 1 and high > 3), "this has changed"
PYTHON
