#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" opencv-python-headless==5.0.0.93 numpy==2.4.6
echo "guess:     recoverPose finds the rotation between two exact views of a scene, however far it is"
echo "behaviour: points beyond 50 distances of the cameras do not count: all four answers get 0 votes, and the first is taken, of which many are half a turn off"
python - <<'PYTHON'
import cv2
import numpy as np

camera = np.array([[800, 0, 640], [0, 800, 480], [0, 0, 1.0]])
turn, _ = cv2.Rodrigues(np.array([0, 0.04, 0.02]))
move = np.array([0.1, 0.02, 0.01])  # m


def pixels(points):
    image = points @ camera.T
    return image[:, :2] / image[:, 2:]


found = {}
for far in (2.0, 4.0, 8.0):  # m
    for limit in (None, 1e6):
        wrong, votes = 0, []
        for seed in range(20):
            points = far * np.random.default_rng(seed).uniform([-0.4, -0.4, 0.9], [0.4, 0.4, 1.1], (100, 3))
            first, second = pixels(points), pixels(points @ turn.T + move)
            essential, _ = cv2.findEssentialMat(first, second, camera, method=cv2.RANSAC, prob=0.9999, threshold=0.01)
            options = {} if limit is None else {"distanceThresh": limit}
            count, rotation, *_ = cv2.recoverPose(essential, first, second, camera, **options)
            wrong += np.arccos(np.clip((np.trace(rotation.T @ turn) - 1) / 2, -1, 1)) > np.radians(90)
            votes.append(count)
        found[far, limit] = (int(wrong), min(votes), max(votes))
print(f"seen:      by distance of the scene [m], of cameras 10 cm apart, and distanceThresh: scenes of 20 with a rotation more than 90 degrees off, least and most votes of 100 points: {found}")
assert found[2, None] == (0, 100, 100) and found[8, None][0] >= 3 and found[8, None][2] == 0, "this has changed"
assert found[8, 1e6][0] == 0 and found[8, 1e6][1] > 90, "this has changed"
PYTHON
