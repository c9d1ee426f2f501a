#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" torchrl==0.14.1 tensordict==0.14.3 torch==2.13.0 numpy==2.4.6
echo "guess:     a replay buffer whose first reward is the integer 0 takes a later 0.7 as 0.7, or refuses it"
echo "behaviour: add makes it 0, and -1.9 becomes -1, in memory and on disk; extend refuses the same"
python -W ignore - 2>/dev/null <<'PYTHON'
import torch
from tensordict import TensorDict
from torchrl.data import LazyMemmapStorage, LazyTensorStorage, ReplayBuffer


def kept(storage):
    """Rewards read after 0, 0.7 and -1.9 were added one after the other."""
    buffer = ReplayBuffer(storage=storage)
    for reward in (0, 0.7, -1.9):
        buffer.add(TensorDict({"reward": torch.tensor(reward)}))
    return buffer, buffer[:]["reward"].tolist()


buffer, memory = kept(LazyTensorStorage(10))
disk = kept(LazyMemmapStorage(10))[1]
try:
    buffer.extend(TensorDict({"reward": torch.tensor([0.7, -1.9])}, [2]))
    refused = ""
except RuntimeError as error:
    refused = str(error)[:64]
print(f"seen:      rewards 0, 0.7, -1.9 by add: {memory}, on disk {disk}; by extend: {refused}")
assert memory == disk == [0, 0, -1] and refused, "this has changed"
PYTHON
