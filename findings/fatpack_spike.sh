#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" fatpack==0.7.8 numpy==2.4.6
echo "guess:     a spike in a log of tensions adds one cycle to a rainflow count, and leaves the others"
echo "behaviour: tensions are rounded to 1/64 of the range of the whole log: swings of 4 N become 8 N by a spike of 500 N, and none by 1000 N; with k=65536 they stay"
python - <<'PYTHON'
import fatpack
import numpy as np

random = np.random.default_rng(0)
tensions = 50 + 2 * np.sin(0.3 * np.arange(20000)) + random.normal(0, 0.2, 20000)  # N
found = {}
for spike in (0, 500, 1000):  # N, one sample
    log = tensions.copy()
    log[7777] += spike
    for classes in (None, 65536):
        ranges = fatpack.find_rainflow_ranges(log, **({} if classes is None else {"k": classes}))
        swings = ranges[(ranges > 2) & (ranges < 20)]
        found[spike, classes] = len(swings), round(float(swings.mean()), 2) if len(swings) else None
print(f"seen:      cycles of 2 to 20 N and their mean range [N], among 955 swings, by spike [N] and k: {found}")
assert found[0, None] == found[0, 65536] and found[500, None][1] > 7 and found[1000, None] == (0, None), "this has changed"
assert found[1000, 65536][0] > 950 and abs(found[1000, 65536][1] - found[0, None][1]) < 0.02, "this has changed"
PYTHON
