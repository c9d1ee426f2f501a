#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" torch==2.13.0 numpy==2.4.6
echo "guess:     with one seed, a longer draw begins with the numbers of a shorter one, as in numpy"
echo "behaviour: uniform ones do; normal ones are all others from 16 on, and then the last 16 depend on the length"
python - <<'PYTHON'
import numpy as np
import torch


def kept(draw, short, long):
    """How many of the numbers of a draw of length `short` are at their places in one of length `long`."""
    first, second = (draw(length) for length in (short, long))
    return int((first == second[:short]).sum())


def torch_normal(length):
    return torch.randn(length, generator=torch.Generator().manual_seed(0))


def torch_uniform(length):
    return torch.rand(length, generator=torch.Generator().manual_seed(0))


def numpy_normal(length):
    return np.random.default_rng(0).normal(size=length)


pairs = [(14, 15), (15, 16), (16, 17), (37, 40), (32, 48)]
seen = {draw.__name__: [f"{kept(draw, *pair)} of {pair[0]}" for pair in pairs] for draw in (torch_normal, torch_uniform, numpy_normal)}
print(f"seen:      numbers kept from lengths {pairs}: {seen}")
assert [kept(torch_normal, *pair) for pair in pairs][:2] == [14, 0] and kept(torch_normal, 16, 17) < 3, "this has changed"
assert kept(torch_normal, 32, 48) == 32, "this has changed"
for draw in (torch_uniform, numpy_normal):
    assert all(kept(draw, *pair) == pair[0] for pair in pairs), "this has changed"
PYTHON
