from collections.abc import Callable

import numpy as np
import pytest

from flywheel.records import Episode, Observation, Provenance, State, Trajectory
from flywheel.robots import Robot, load_robot


@pytest.fixture(scope="session")
def prism3() -> Robot:
    return load_robot("prism3")


@pytest.fixture
def make_episode(prism3: Robot) -> Callable[..., Episode]:
    return lambda name, **kwargs: episode_of(prism3, name, **kwargs)


def episode_of(
    robot: Robot,
    name: str,
    *,
    steps: int = 40,
    seed: int | None = None,
    split: str = "train",
    dataset: str = "nominal",
    recording: bool = False,
    timing: float = 0.1,
) -> Episode:
    """An episode of random numbers with the robot's shapes."""
    rng = np.random.default_rng(seed)
    key, winches = robot.keyframe, len(robot.winches)
    points = rng.standard_normal((steps + 1, len(robot.points), 3))
    points[rng.random(points.shape[:2]) < 0.1] = np.nan
    rows = [rng.standard_normal((steps + 1, a.shape[-1])) for a in (key.qpos, key.qvel, key.act)]
    return Episode(
        id=name,
        trajectory=Trajectory(
            Observation(points, np.full((steps + 1, winches), np.nan)),
            rng.uniform(-0.3, 0.3, (steps, winches)),
            0.01,
            None if recording else State(*rows),
        ),
        provenance=Provenance(
            robot=robot.digest,
            source="recording" if recording else "sim",
            dataset="recording" if recording else dataset,
            plant={"friction": 0.6},
        ),
        split=split,  # type: ignore[arg-type]
        telemetry={"plan_seconds": np.array([timing, timing])},
    )
