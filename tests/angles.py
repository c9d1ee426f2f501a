"""Angles between vectors, to check rotations by."""

import numpy as np


def angle_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle (...) between vectors (..., 3) [rad], accurate for small angles too."""
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1))
