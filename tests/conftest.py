"""What every test relies on: one thread each, no usage reports, drawing only where it can be."""

import ctypes.util
import os

# Before anything imports torch, mujoco or ray; worker processes inherit it.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MUJOCO_GL", "egl")
os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")

import pytest

NO_EGL = "libEGL is not installed: apt-get install libegl1 libegl-mesa0 libgl1-mesa-dri"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip the tests that draw where there is nothing to draw with."""
    if ctypes.util.find_library("EGL"):
        return
    for item in items:
        if item.get_closest_marker("renders"):
            item.add_marker(pytest.mark.skip(reason=NO_EGL))
