"""Rotations against SciPy's, on fresh random inputs."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flywheel import rotations
from flywheel.rotations import kabsch, multiply, rotate, shortest, unit
from tests.angles import angle_between


@pytest.fixture
def rng() -> np.random.Generator:
    seed = int(np.random.SeedSequence().generate_state(1)[0])
    print(f"seed {seed}")  # shown when a test fails
    return np.random.default_rng(seed)


def quaternions(rng: np.random.Generator, n: int = 200) -> tuple[np.ndarray, Rotation]:
    q = unit(rng.normal(size=(n, 4)))
    return q, Rotation.from_quat(q, scalar_first=True)


def same(p: np.ndarray, q: np.ndarray) -> None:
    """Equal up to sign."""
    np.testing.assert_allclose(np.abs((p * q).sum(axis=-1)), 1.0, atol=1e-12)


def test_rotating_multiplying_and_inverting_agree_with_scipy(rng: np.random.Generator) -> None:
    (p, other_p), (q, other_q) = quaternions(rng), quaternions(rng)
    v = rng.normal(size=(200, 3))
    np.testing.assert_allclose(rotate(q, v), other_q.apply(v), atol=1e-12)
    same(multiply(p, q), (other_p * other_q).as_quat(scalar_first=True))
    np.testing.assert_allclose(rotate(rotations.conjugate(q), rotate(q, v)), v, atol=1e-12)


def test_matrices_and_axes_agree_with_scipy(rng: np.random.Generator) -> None:
    q, other = quaternions(rng)
    same(rotations.from_matrix(other.as_matrix()), q)
    half_turns = Rotation.from_rotvec(np.pi * np.eye(3))
    same(rotations.from_matrix(half_turns.as_matrix()), half_turns.as_quat(scalar_first=True))
    turn = rng.normal(size=(200, 3))
    angle = np.linalg.norm(turn, axis=-1)
    expected = Rotation.from_rotvec(turn).as_quat(scalar_first=True)
    same(rotations.about_axis(unit(turn), angle), expected)


def test_the_shortest_rotation_turns_by_the_angle_between(rng: np.random.Generator) -> None:
    a, b = rng.normal(size=(2, 200, 3))
    q = shortest(a, b)
    np.testing.assert_allclose(angle_between(rotate(q, a), b), 0.0, atol=1e-7)
    np.testing.assert_allclose(2 * np.arccos(q[:, 0]), angle_between(a, b), atol=1e-7)
    np.testing.assert_allclose(shortest(a, a), np.tile([1.0, 0, 0, 0], (200, 1)), atol=1e-12)
    opposite = rotate(shortest(a, -a), a)
    np.testing.assert_allclose(opposite, -a, atol=1e-9)


@pytest.mark.parametrize("flat", [False, True])
def test_kabsch_finds_the_rotation_of_points_even_in_a_plane(flat, rng):
    q, _ = quaternions(rng)
    points = rng.normal(size=(200, 4, 3)) * [1.0, 1.0, 0.0 if flat else 1.0]
    points -= points.mean(axis=1, keepdims=True)
    same(kabsch(points, rotate(q[:, None], points)), q)
