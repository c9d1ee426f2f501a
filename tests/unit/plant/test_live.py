"""The live view shows what it is told, with a window that only notes what it is shown."""

import contextlib
import types

import numpy as np
import pytest

from flywheel.dynamics.plant import LiveView, Plant, Scenery, live
from flywheel.errors import ConfigError
from flywheel.records import State
from flywheel.robots import Robot

DT = 0.01


class Window:
    """Stands in for MuJoCo's window; closed by hand after so many frames."""

    def __init__(self, data, patience: int) -> None:
        self._data, self._patience = data, patience
        self.seen: list[np.ndarray] = []
        self.shapes: list[int] = []
        self.closed = False
        self.cam = types.SimpleNamespace(lookat=np.zeros(3))
        self.user_scn = types.SimpleNamespace(ngeom=0, maxgeom=0)

    def is_running(self) -> bool:
        return len(self.seen) < self._patience

    def lock(self):
        return contextlib.nullcontext()

    def sync(self) -> None:
        self.seen.append(self._data.qpos.copy())

    def close(self) -> None:
        self.closed = True


@pytest.fixture(scope="module")
def states(robot: Robot) -> State:
    plant = Plant(robot, DT)
    return plant.simulate(plant.rest(), np.full((1, 40, 6), -0.3)).states[0]


@pytest.mark.parametrize("patience", [1000, 3])
def test_every_piece_is_played_before_the_window_closes(monkeypatch, robot, states, patience):
    windows: list[Window] = []

    def opened(model, data):
        windows.append(Window(data, patience))
        return windows[0]

    monkeypatch.setattr(live, "_check_display", lambda: None)
    monkeypatch.setattr(live, "_open_window", opened)
    with contextlib.closing(LiveView(robot, Scenery(goal=np.zeros(2)))) as view:
        view.show(states[:20], DT, np.zeros((2, 3, 2)))
        view.show(states[20:40], DT)
    shown = states.qpos[[*range(0, 20, 3), *range(20, 40, 3)]][:patience]
    np.testing.assert_array_equal(windows[0].seen, shown)
    assert windows[0].closed


def test_without_a_display_it_is_said_at_once(monkeypatch, robot):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(ConfigError, match="no display"):
        LiveView(robot, Scenery())
