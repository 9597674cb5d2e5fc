"""The rotation into the gyroscope's own axes, against gyroscopes whose axes the simulator knows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from calib_core.calibrate import calibrate
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth, generate, parse_faults
from tests.core.full.conftest import SHORT

SEEDS = range(31, 35)
#: A motion of more attitudes tells the accelerometer's axes better: 8 s do for both.
RIG = replace(SHORT, duration_s=8.0)


def gyroscope_of(truth: Truth) -> np.ndarray:
    """(3, 3) the matrix of the gyroscope that was simulated, by the signs of the simulator's own document."""
    own = {(each.block, each.name): each.value for each in truth.intrinsics}
    matrix = np.eye(3)
    for k, axis in enumerate("xyz"):
        matrix[k, k] += own.get(("gyroscope_scale", axis), 0.0)
    for name, place in (("yx", (1, 0)), ("zx", (2, 0)), ("zy", (2, 1))):
        matrix[place] = own.get(("gyroscope_axes", name), 0.0)
    turn = [own.get(("gyroscope_rotation", axis), 0.0) for axis in "xyz"]
    return matrix @ Rotation.from_rotvec(turn).as_matrix()


@pytest.fixture(scope="module")
def errors() -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Of each seed: the error about the lidar's axes, its stated sigmas, and those of the IMU's frame [deg]."""
    found = []
    for seed in SEEDS:
        recording, truth = generate(RIG, seed=seed, faults=parse_faults("imu-axes,gyro-rotation"))
        result = calibrate(recording, CalibrateSettings(crispness=False)).result
        assert result.gyroscope_axes is not None
        assert result.uncertainty is not None
        left, _, right = np.linalg.svd(gyroscope_of(truth))  # the nearest rotation
        true = left @ right @ truth.R_imu_lidar
        seen = Rotation.from_quat(result.gyroscope_axes.quaternion_xyzw).as_matrix()
        error = np.degrees(Rotation.from_matrix(true.T @ seen).as_rotvec())
        stds = np.array(result.gyroscope_axes.rotation_std_deg)
        found.append((error, stds, np.array(result.uncertainty.rotation_std_deg)))
    return found


def test_it_is_where_it_is_said_to_be(errors: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> None:
    """Mutations: the IMU's frame itself, 3 sigmas off in the mean; the inverse of the gyroscope's matrix; R for its transpose."""
    squares = sum(float(np.sum((error / std) ** 2)) for error, std, _ in errors)
    low, high = chi2.ppf([0.005, 0.995], 3 * len(errors))
    assert low < squares < high


def test_it_is_known_better_than_the_accelerometers_axes(
    errors: list[tuple[np.ndarray, np.ndarray, np.ndarray]],
) -> None:
    """About the lidar's x and y: where its zero of azimuth is nobody tells from within. Oracle: what sensors without errors of
    their own leave of the rotation. Mutation: the accelerometer's sigmas.
    """
    off = calibrate(generate(RIG, seed=31)[0], CalibrateSettings(intrinsics="off", crispness=False)).result
    assert off.uncertainty is not None
    assert off.gyroscope_axes is None
    exact = np.array(off.uncertainty.rotation_std_deg)[:2]
    for _, std, wide in errors:
        assert (wide[:2] > 3.0 * exact).all()
        assert (std[:2] < 1.5 * exact).all()
