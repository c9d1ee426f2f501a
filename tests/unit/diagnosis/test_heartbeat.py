from __future__ import annotations

import numpy as np
import pytest

from flywheel.diagnosis import diagnose
from flywheel.diagnosis.heartbeat import SECONDS, Heartbeat
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS
from flywheel.robots import load_robot
from tests import draws


def test_what_goes_on_is_said_again_but_not_all_the_time() -> None:
    now, told = [0.0], []
    heartbeat = Heartbeat(told.append, lambda: now[0])
    for _ in range(10):
        heartbeat.again()
        now[0] += SECONDS / 4
    assert told == ["beginning"] * 2
    heartbeat("fitting")
    heartbeat.again()
    now[0] += SECONDS
    heartbeat.again()
    assert told[2:] == ["fitting", "fitting"]


@pytest.mark.slow
def test_no_part_of_a_diagnosis_is_silent_for_long(monkeypatch) -> None:
    """Who waits for it takes silence for death. Counted in simulations, not in seconds."""
    steps: list[int] = []
    monkeypatch.setattr(Heartbeat, "again", lambda self: steps.append(len(told)))
    told: list[str] = []
    robot, rng = load_robot("prism3"), np.random.default_rng(draws.seed())
    plant = Plant(robot)
    controls = np.repeat(rng.uniform(-0.5, 0.5, (4, 6)), 25, axis=0)
    track = plant.simulate(plant.settle(1.0), controls[None])
    seen = track.observations.points[0] + rng.normal(size=track.observations.points[0].shape) * 0.01
    log = type(track)(type(track.observations)(seen, np.full((101, 6), np.nan)), controls, track.dt)
    few = {name: EFFECTS[name] for name in ("slope", "winch_gain")}
    diagnose(plant, [log], [log], few, progress=told.append)
    assert told
    assert len(steps) > 20
    assert steps[-1] == len(told)  # also after the last note: what is held out is simulated, too
    assert SECONDS < 60
