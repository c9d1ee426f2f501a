#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" opencv-python-headless==5.0.0.93 numpy==2.4.6
echo "guess:     undistortPoints undoes what projectPoints did, to a hundredth of a pixel"
echo "behaviour: it takes five steps of an iteration, and says nothing: towards the corners of a wide lens it is several pixels off; with 100 steps it is right"
python - <<'PYTHON'
import cv2
import numpy as np

camera = np.array([[500, 0, 640], [0, 500, 480], [0, 0, 1.0]])
places = np.array([[x, 0.75 * x, 1.0] for x in (0.3, 0.6, 0.9, 1.1)])  # towards the corner of 1280 x 960 pixels
radius = np.linspace(0, 1.4, 1000)
found = {}
for name, lens in (("k1 0.2", np.array([0.2, 0, 0, 0, 0])), ("k1 -0.3, k2 0.08, k3 -0.01", np.array([-0.3, 0.08, 0, 0, -0.01]))):
    seen = radius * (1 + lens[0] * radius**2 + lens[1] * radius**4 + lens[4] * radius**6)
    assert np.all(np.diff(seen) > 0)  # the lens folds nothing: each point has one pixel, and can be found again
    pixels, _ = cv2.projectPoints(places, np.zeros(3), np.zeros(3), camera, lens)
    for steps in (None, 100):
        options = {} if steps is None else {"criteria": (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, steps, 1e-9)}
        again = cv2.undistortPoints(pixels, camera, lens, **options)[:, 0]
        found[name, steps] = [round(float(500 * np.abs(each).max()), 2) for each in again - places[:, :2]]
print(f"seen:      errors [pixels] of four points from the middle to a corner, by lens and number of steps: {found}")
for (_, steps), errors in found.items():
    assert errors[0] < 0.01 and (errors[-1] > 2 if steps is None else max(errors) < 0.01), "this has changed"
PYTHON
