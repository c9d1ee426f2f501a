#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" vqf==2.1.2 numpy==2.4.6
echo "guess:     the filter follows a platform that turns steadily, without noise, for a minute, whatever its speed"
echo "behaviour: at 1.5 deg/s, 2.6 of 90 degrees are left: what is slower than 2 deg/s counts as rest, and becomes the bias of the gyroscope"
python - <<'PYTHON'
import numpy as np
from vqf import VQF

STEP, SECONDS = 0.01, 60
count = int(SECONDS / STEP)
gravity = np.tile([0.0, 0.0, 9.81], (count, 1))


def turned(rate, **settings):
    """Heading [deg] after a minute at `rate` [deg/s] about the vertical."""
    rates = np.zeros((count, 3))
    rates[:, 2] = np.deg2rad(rate)
    found = VQF(STEP, **settings).updateBatch(rates, gravity.copy())["quat6D"][-1]
    return round(float(np.rad2deg(2 * np.arctan2(found[3], found[0]))) % 360, 1)


headings = {rate: turned(rate) for rate in (0.5, 1.5, 2.5)}
without = turned(1.5, restBiasEstEnabled=False, motionBiasEstEnabled=False)
print(f"seen:      degrees after 60 s by deg/s: {headings}, expected 30, 90, 150; at 1.5 without estimates of the bias {without}")
assert headings[0.5] < 1.5 and headings[1.5] < 4 and headings[2.5] == 150 and without == 90, "this has changed"
PYTHON
