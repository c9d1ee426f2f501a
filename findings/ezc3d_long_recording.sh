#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" ezc3d==1.7.2 numpy==2.3.5
echo "guess:     a recording of 12 minutes at 100 Hz, which ezc3d wrote, is read by it as it was, or refused by either"
echo "behaviour: what it reads ends after 65535 frames, without a word; the others are in the file"
python - <<'PYTHON'
from pathlib import Path

import ezc3d
import numpy as np

FRAMES = 72_000
recording = ezc3d.c3d()
recording["parameters"]["POINT"]["RATE"]["value"] = [100]
recording["parameters"]["POINT"]["LABELS"]["value"] = ("marker",)
points = np.ones((4, 1, FRAMES))
points[0, 0] = np.arange(FRAMES)
recording["data"]["points"] = points
recording.write("long.c3d")
read = ezc3d.c3d("long.c3d")["data"]["points"]
content = Path("long.c3d").read_bytes()
rows = np.frombuffer(content[len(content) % 16 :], "<f4").reshape(-1, 4)
held = np.isin(np.arange(FRAMES), rows[:, 0]).sum()
print(f"seen:      {FRAMES} frames written, {read.shape[2]} read, the last one with x = {read[0, 0, -1]:.0f}; {held} in the file")
assert read.shape[2] == 65535 and read[0, 0, -1] == 65534 and held == FRAMES, "this has changed"
PYTHON
