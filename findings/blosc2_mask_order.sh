#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" blosc2==4.14.1 numpy==2.4.6
echo "guess:     array[array > limit] has its values row by row, as in numpy, however the array is cut into chunks"
echo "behaviour: it has them chunk by chunk: times and tensions that one mask selects no longer belong together; a mask that was computed selects row by row"
python - <<'PYTHON'
import blosc2
import numpy as np

steps, cables = 8, 5
tensions = np.arange(steps)[:, None] + np.arange(cables) / 10  # [N]; whole newtons are the step
times = np.repeat(np.arange(float(steps))[:, None], cables, axis=1)
stamps, wide, square = blosc2.asarray(times, chunks=(2, 5)), blosc2.asarray(tensions, chunks=(2, 5)), blosc2.asarray(tensions, chunks=(4, 2))
by_rows, by_squares = wide[wide > 1.25][:], square[square > 1.25][:]
computed = square[(square > 1.25).compute()[:]]
at = stamps[wide > 1.25][:]
wrong = int((np.floor(by_squares) != at).sum())
print(f"seen:      chunks of 2 steps and 5 cables {by_rows[:6].tolist()}, of 4 steps and 2 cables {by_squares[:6].tolist()}, by a computed mask {np.asarray(computed)[:6].tolist()}")
print(f"           of {at.size} tensions {wrong} are beside the time of another step")
right = tensions[tensions > 1.25]
assert np.array_equal(by_rows, right) and np.array_equal(computed, right) and wrong > 10 and np.array_equal(np.sort(by_squares), right), "this has changed"
PYTHON
