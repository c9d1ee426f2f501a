#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" roboticstoolbox-python==1.5.0 numpy==2.4.6
echo "guess:     jtraj with times from 10 to 12 s begins at its first configuration, as quintic does"
echo "behaviour: times count from zero: it begins at 96 % of the way, and spends the two seconds on the rest"
python - <<'PYTHON'
import numpy as np
from roboticstoolbox import jtraj, quintic

found = {}
for start in (0, 10):
    times = start + np.linspace(0, 2, 5)
    path = jtraj([0.0], [1.0], times)
    found[start] = {"jtraj": path.q[:, 0].round(3).tolist(), "its velocity": path.qd[:, 0].round(3).tolist(), "quintic": quintic(0, 1, times).q.round(3).tolist()}
print(f"seen:      from 0 to 1 rad in 2 s, by the first time [s]: {found}")
assert found[0]["quintic"] == found[10]["quintic"] == found[0]["jtraj"] and found[0]["jtraj"][0] == 0, "this has changed"
assert found[10]["jtraj"][0] > 0.9 and found[10]["jtraj"][-1] == 1, "this has changed"
PYTHON
