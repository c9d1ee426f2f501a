#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" torch==2.13.0 numpy==2.4.6
echo "guess:     torch.distributed.reduce changes the tensor of the receiving process only"
echo "behaviour: with gloo the others hold sums over some of the processes afterwards, different ones within one tensor"
cat > try.py <<'PYTHON'
from pathlib import Path

import torch
import torch.distributed as dist
import torch.multiprocessing as mp


def work(rank, folder):
    dist.init_process_group("gloo", init_method=f"file://{folder}/group", rank=rank, world_size=4)
    loss = torch.full((4,), 10.0**rank)
    dist.reduce(loss, dst=0)
    torch.save(loss, f"{folder}/{rank}")
    dist.destroy_process_group()


if __name__ == "__main__":
    mp.spawn(work, (str(Path.cwd()),), 4)
    losses = [torch.load(str(rank)).tolist() for rank in range(4)]
    print(f"seen:      each process gave 10^rank, four times; after reduce to process 0: {losses}")
    assert losses[0] == [1111.0] * 4, "this has changed"
    assert any(losses[rank] != [10.0**rank] * 4 for rank in (1, 2, 3)), "this has changed"
PYTHON
python try.py
