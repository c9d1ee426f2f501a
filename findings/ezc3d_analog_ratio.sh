#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" ezc3d==1.7.2 numpy==2.4.6
echo "guess:     markers at 119.88 Hz with a force plate at 7 times that rate, which it wrote, are read by it"
echo "behaviour: the ratio of the two rates is rounded down to 6: from the second frame on places are mixed with forces, without a word"
python - <<'PYTHON'
import ezc3d
import numpy as np

FRAMES = 20


def read_again(rate, ratio):
    """Places (3, 2, frames) [mm] and number of forces, written and read; the markers move by 1 mm a frame."""
    places = np.empty((4, 2, FRAMES))
    places[:3] = np.arange(FRAMES) + np.array([[[100.0], [200.0]], [[300.0], [400.0]], [[500.0], [600.0]]])
    places[3] = 1.0
    take = ezc3d.c3d()
    point, analog = take["parameters"]["POINT"], take["parameters"]["ANALOG"]
    point["RATE"]["value"], point["LABELS"]["value"], point["UNITS"]["value"] = [rate], ["rod", "node"], ["mm"]
    analog["RATE"]["value"], analog["LABELS"]["value"] = [rate * ratio], ["force"]
    take["data"]["points"], take["data"]["analogs"] = places, np.arange(FRAMES * ratio, dtype=float)[None, None]
    take.write("take.c3d")
    found = ezc3d.c3d("take.c3d")["data"]
    return found["points"][:3], float(abs(found["points"] - places).max()), found["analogs"].shape[2]


for rate, ratio in ((119.88, 7), (29.97, 30), (119.88, 10), (240.0, 7)):
    places, error, forces = read_again(rate, ratio)
    print(f"seen:      {rate} Hz and {ratio} times that: markers up to {error:.0f} mm off, {forces} of {FRAMES * ratio} forces; first places {places[0, 0, :4].tolist()}")
    if rate * 1e9 % 1e9 and ratio != 10:
        assert error > 100 and forces == FRAMES * (ratio - 1), "this has changed"
    else:
        assert error == 0 and forces == FRAMES * ratio, "this has changed"
PYTHON
