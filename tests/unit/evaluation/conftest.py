import numpy as np
import pytest

from flywheel.records import Episode, Observation, Provenance, State, Trajectory
from flywheel.robots import Attachment, Body, Cable, Robot, TrackedPoint, Winch


def _body(name: str, points: tuple[int, ...], com=(0.0, 0.0, 0.0)) -> Body:
    return Body(name, 1.0, np.ones(3), np.array(com), (), points)


@pytest.fixture(scope="session")
def robot() -> Robot:
    """A rod of length 2 m (points 0, 1) and a platform with three corners (points 2, 3, 4)."""
    offsets = [(0, 0, -1), (0, 0, 1), (1, 0, 0), (-1, 1, 0), (-1, -1, 0)]
    owners = [0, 0, 1, 1, 1]
    ends = (Attachment(0, np.zeros(3), 0), Attachment(1, np.zeros(3), 2))
    cable = Cable("cable", ends, 100.0, 1.0, 0.7, 0)
    return Robot(
        name="two",
        xml="",
        digest="0" * 64,
        bodies=(_body("rod", (0, 1)), _body("platform", (2, 3, 4), com=(-0.2, 0.1, 0.0))),
        points=tuple(
            TrackedPoint(f"p{i}", owner, np.array(offset, float), 0.1)
            for i, (offset, owner) in enumerate(zip(offsets, owners, strict=True))
        ),
        cables=(cable,),
        winches=(Winch("winch", "rate", (0,), (0,), (-0.5, 0.5), (0.2, 1.5), 0.0, False, 0),),
        keyframe=State(np.zeros(14), np.zeros(12), np.array([0.7])),
        timestep=0.005,
        integrator="Euler",
        length=2.0,
        grounded=True,
        free=True,
    )


@pytest.fixture(scope="session")
def resting(robot) -> np.ndarray:
    """(P, 3) points of the robot with both body frames at the world's origin."""
    return np.stack([point.offset for point in robot.points])


@pytest.fixture
def make_episode(robot, resting):
    """Episodes of a robot that drifts along x at 1 m/s."""

    def make(name: str, steps: int, *, seed: int = 0, dataset: str = "nominal") -> Episode:
        rng = np.random.default_rng(seed)
        drift = 0.01 * np.arange(steps + 1)[:, None, None] * np.array([1.0, 0.0, 0.0])
        trajectory = Trajectory(
            Observation(resting + drift, np.full((steps + 1, 1), np.nan)),
            rng.uniform(-0.3, 0.3, (steps, 1)),
            0.01,
        )
        provenance = Provenance(robot=robot.digest, dataset=dataset, seed=seed)
        return Episode(name, trajectory, provenance, "test")

    return make
