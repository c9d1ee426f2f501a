#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" ahrs==0.4.0 numpy==2.4.6
echo "guess:     the filters of one library agree about the orientation of a sensor at rest"
echo "behaviour: AQUA returns the inverse rotation, and Mahony with a magnetometer turns the world by 90 degrees"
python -W ignore - <<'PYTHON'
import numpy as np
from ahrs import filters

ANGLE, ROWS = np.radians(30.0), 3000
cosine, sine = np.cos(ANGLE), np.sin(ANGLE)
pitched = np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])  # from the sensor's axes to the world's
up = np.tile(pitched.T @ [0, 0, 9.81], (ROWS, 1))
north = np.tile(pitched.T @ [20.0, 0, -40.0], (ROWS, 1))
rest = {"gyr": np.zeros((ROWS, 3)), "acc": up}

found = {
    "Tilt": filters.Tilt(acc=up).Q[-1],
    "Madgwick": filters.Madgwick(**rest).Q[-1],
    "Mahony": filters.Mahony(**rest).Q[-1],
    "AQUA": filters.AQUA(**rest).Q[-1],
    "Madgwick with mag": filters.Madgwick(**rest, mag=north).Q[-1],
    "Mahony with mag": filters.Mahony(**rest, mag=north).Q[-1],
}
truth = [np.cos(ANGLE / 2), 0, np.sin(ANGLE / 2), 0]
print(f"seen:      pitched by 30 degrees, w x y z {np.round(truth, 3).tolist()}:")
for name, found_one in found.items():
    print(f"           {name}: {np.round(found_one, 3).tolist()}")
    found[name] = found_one * np.sign(found_one[0])
for name in ("Tilt", "Madgwick", "Mahony", "Madgwick with mag"):
    assert np.allclose(found[name], truth, atol=0.01), f"{name} has changed"
assert np.allclose(found["AQUA"], [truth[0], 0, -truth[2], 0], atol=0.01), "this has changed"
half = np.sqrt(0.5)
turned = [half * truth[0], -half * truth[2], half * truth[2], half * truth[0]]  # 90 degrees about z, times the truth
assert np.allclose(found["Mahony with mag"], turned, atol=0.01), "this has changed"
PYTHON
