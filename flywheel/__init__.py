"""Flywheel: a controller-in-the-loop data flywheel for cable-driven robots."""

import os
import sys

__version__ = "0.1.0"

if sys.platform == "linux" and not os.environ.get("DISPLAY"):
    os.environ.setdefault("MUJOCO_GL", "egl")  # MuJoCo reads it when it is first imported
