#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" torch==2.13.0 numpy==2.4.6
echo "guess:     torch.load compares a file with the CRC-32 of its archive, as unzip does"
echo "behaviour: a weight of which one bit was flipped on disk is loaded as it is"
python - <<'PYTHON'
import zipfile
from pathlib import Path

import torch

file = Path("weights.pt")
torch.save({"w": torch.ones(1000)}, file)
raw = bytearray(file.read_bytes())
first = raw.index(torch.ones(10).numpy().tobytes())
raw[first + 3] ^= 0b10
file.write_bytes(raw)

loaded = torch.load(file, weights_only=True)["w"]
damaged = zipfile.ZipFile(file).testzip()
print(f"seen:      torch.load gives {loaded[:3].tolist()}; zipfile finds {damaged!r} damaged")
assert loaded[0] != 1.0 and damaged, "this has changed"
PYTHON
