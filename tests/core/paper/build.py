"""Random but plausible measurements and states, and the one checker of Jacobians for all of the paper's factors."""

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from calib_core.paper.lidar_factor import CalibrationState, LidarMeasurements, ScanStates
from calib_core.paper.preintegration import Preintegrated

GRAVITY = np.array([0.0, 0.0, -9.81])


def rotations(rng: np.random.Generator, n: int) -> np.ndarray:
    return Rotation.random(n, random_state=rng).as_matrix()


def preintegrated(rng: np.random.Generator, n: int) -> Preintegrated:
    """Measurements of any size, with Jacobians that belong to nothing: factors must not assume more."""
    small = 0.1 * rng.normal(size=(n, 3))
    matrices = 0.2 * rng.normal(size=(5, n, 3, 3))
    vectors = rng.normal(size=(3, n, 3))
    roots = 0.01 * rng.normal(size=(3, n, 3, 3))
    covariances = roots @ np.swapaxes(roots, 2, 3)
    DR = rotations(rng, n)
    return Preintegrated(DR, rng.normal(size=(n, 3)), small, *matrices, *vectors, *covariances)


def states(rng: np.random.Generator, n: int) -> ScanStates:
    return ScanStates(rotations(rng, n), rng.normal(size=(n, 3)), rng.normal(size=(n, 3)))


def calibration(rng: np.random.Generator) -> CalibrationState:
    return CalibrationState(
        rotations(rng, 1)[0], rng.normal(size=3), 0.3 * rng.normal(size=3), 0.3 * rng.normal(size=3), 0.2
    )


def lidar(rng: np.random.Generator, n: int) -> LidarMeasurements:
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return LidarMeasurements(
        4.0 * rng.normal(size=(n, 3)), normals, rng.normal(size=n), rng.uniform(0.0, 0.1, n), preintegrated(rng, n)
    )


def turned(R: np.ndarray, axis: int, angle: float) -> np.ndarray:
    """R Exp(angle e_axis), by SciPy."""
    return R @ Rotation.from_rotvec(angle * np.eye(3)[axis]).as_matrix()


def slope(value: Callable[[float], np.ndarray], step: float = 1e-6) -> np.ndarray:
    """Central difference of a function of a small number."""
    return (value(step) - value(-step)) / (2.0 * step)


def check(analytic: np.ndarray, value: Callable[[float], np.ndarray]) -> None:
    """Raises where the analytic derivative is not that of the function."""
    np.testing.assert_allclose(analytic, slope(value), atol=3e-7 * max(1.0, float(np.abs(analytic).max())))
