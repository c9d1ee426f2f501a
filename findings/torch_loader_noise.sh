#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" torch==2.13.0 numpy==2.4.6
echo "guess:     noise by a data set's own numpy Generator is new in each epoch, also with workers"
echo "behaviour: with workers each of them draws the same numbers, and the same again in each epoch; torch's own are new"
python - <<'PYTHON'
import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset


class Noise(Dataset):
    def __init__(self):
        self.generator = np.random.default_rng(0)

    def __len__(self):
        return 6

    def __getitem__(self, index):
        return round(self.generator.normal(), 2), round(torch.randn(1).item(), 2)


def epochs(workers):
    """Two epochs of the noises of six samples, by numpy's Generator and by torch."""
    torch.manual_seed(0)
    loader = DataLoader(Noise(), batch_size=None, num_workers=workers)
    read = [list(loader) for _ in range(2)]
    return ([[noise[which] for noise in epoch] for epoch in read] for which in (0, 1))


if __name__ == "__main__":
    for workers in (0, 2):
        own, torchs = epochs(workers)
        print(f"seen:      {workers} workers: two epochs {own}")
        assert (own[0] == own[1]) == (workers > 0) and torchs[0] != torchs[1], "this has changed"
        assert len(set(own[0])) == (6 // workers if workers else 6) and len(set(torchs[0])) == 6, "this has changed"
PYTHON
