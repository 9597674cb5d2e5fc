"""Where the rounds end depends on the recording, not on where they began."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from scipy.optimize import nnls

from calib_core.calibrate import Calibration, calibrate
from calib_core.events import Event, IterationEvent
from calib_core.factors.imu import KnotStates
from calib_core.full.joint.first_estimate import knots_over
from calib_core.full.joint.lidar_noise import least_squares_of_two, tapered_variance
from calib_core.full.joint.state import Estimate
from calib_core.full.prepare.clocks import clocks_of, look
from calib_core.geometry import exp, log
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import FloatArray, InitialGuess, Recording


def _solve(
    recording: Recording, guess: InitialGuess | None, intrinsics: Literal["auto", "off"]
) -> tuple[Calibration, float]:
    costs: list[float] = []

    def listen(event: Event) -> None:
        if isinstance(event, IterationEvent):
            costs.append(event.cost)

    found = calibrate(
        recording, CalibrateSettings(intrinsics=intrinsics, crispness=False), initial_guess=guess, on_event=listen
    )
    return found, costs[-1]


@pytest.mark.parametrize(("intrinsics", "alike"), [("off", 1e-6), ("auto", 1e-5)])
def test_two_starts_end_at_the_same_cost_and_the_same_answer(
    noisy: tuple[Recording, Truth], intrinsics: Literal["auto", "off"], alike: float
) -> None:
    """Fails when `settle` does not anchor the frame, or the knots' grid begins with the start value of the offset.

    alike: of the cost. Sixteen lasers beside the planes come to rest more slowly than planes alone.
    """
    recording, truth = noisy
    off = InitialGuess(
        truth.R_imu_lidar @ exp(np.radians([3.0, -2.0, 4.0])),
        truth.p_imu_lidar + np.array([0.05, -0.04, 0.03]),
        truth.time_offset_ns + 6_000_000,
    )
    one, cost = _solve(recording, None, intrinsics)
    other, other_cost = _solve(recording, off, intrinsics)
    assert other_cost == pytest.approx(cost, rel=alike)
    first, second = one.result, other.result
    assert first.T_imu_lidar is not None
    assert second.T_imu_lidar is not None
    assert first.uncertainty is not None
    A, B = np.array(first.T_imu_lidar.matrix), np.array(second.T_imu_lidar.matrix)
    apart = np.concatenate([log(A[:3, :3].T @ B[:3, :3]), B[:3, 3] - A[:3, 3]])
    stds = np.sqrt(np.diag(np.array(first.uncertainty.covariance)))[:6]
    assert np.max(np.abs(apart) / stds) < 0.02


def _estimate(rng: np.random.Generator) -> Estimate:
    normals = rng.standard_normal((4, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Estimate(
        states=KnotStates(exp(rng.standard_normal((5, 3))), rng.standard_normal((5, 3)), rng.standard_normal((5, 3))),
        R_imu_lidar=exp(rng.standard_normal(3)),
        p_imu_lidar=rng.standard_normal(3),
        time_offset_s=0.1,
        gravity=np.array([0.3, -0.2, -9.8]),
        gyro_bias=np.zeros((1, 3)),
        accel_bias=np.zeros((1, 3)),
        normals=normals,
        offsets_m=rng.standard_normal(4),
    )


def test_another_frame_changes_nothing_that_can_be_measured() -> None:
    """Fails when an offset is not carried along, or a velocity or gravity is left in the old axes."""
    rng = np.random.default_rng(2)
    e = _estimate(rng)
    there = e.seen_from(exp(np.array([0.4, -1.1, 0.7])), np.array([2.0, -1.0, 0.5]))

    def measured(x: Estimate) -> FloatArray:
        """Planes from the IMU, velocity and gravity in its axes, knots from one another."""
        R_t = np.swapaxes(x.states.R, 1, 2)
        return np.concatenate(
            [
                (R_t @ x.normals.T).ravel(),
                (x.states.p @ x.normals.T + x.offsets_m).ravel(),
                (R_t @ x.states.v[..., None]).ravel(),
                (R_t @ x.gravity).ravel(),
                (R_t[0] @ (x.states.p - x.states.p[0]).T).ravel(),
            ]
        )

    np.testing.assert_allclose(measured(there), measured(e), atol=1e-12)
    assert not np.allclose(there.states.p, e.states.p)


def test_knots_lie_on_one_grid_whatever_the_offset(noisy: tuple[Recording, Truth]) -> None:
    """Fails when the grid begins at the first scan, seen through the offset."""
    imu_s = clocks_of(noisy[0], look(noisy[0])).imu_s
    one, other = knots_over(imu_s, 1.0, 5.0, 0.0), knots_over(imu_s, 1.0, 5.0, 0.0037)
    shared = np.round((other[0] - one[0]) / (one[1] - one[0]), 6)
    assert shared == np.round(shared)


@pytest.mark.parametrize("wrong", [0.0, 0.02, 0.1])
def test_the_variance_of_the_middle_is_that_of_the_noise(wrong: float) -> None:
    """Fails when weights are cut off instead of tapered, or outliers count."""
    rng = np.random.default_rng(4)
    d = 0.02 * rng.standard_normal(20_000)
    d[: int(wrong * len(d))] = rng.uniform(-1.0, 1.0, int(wrong * len(d)))
    variance = tapered_variance(d)
    assert np.sqrt(variance) == pytest.approx(0.02, rel=0.025)
    # Smooth: no place where a point a fiftieth of the noise further off is worth a jump; a cut is one of 4e-4.
    before = None
    for place in np.linspace(0.0, 0.12, 301):
        d[-1] = place
        here = tapered_variance(d)
        assert before is None or here == pytest.approx(before, rel=3e-5)
        before = here


@pytest.mark.parametrize("seed", range(40))
def test_two_unknowns_that_are_not_below_zero(seed: int) -> None:
    """Against SciPy's: both above zero, either at it, both at it; rows that are alike but for a factor.

    Mutations: the other one taken alone; only the first asked whether it is below zero; what is below zero cut off.
    """
    rng = np.random.default_rng(seed)
    rows = (
        np.column_stack([rng.uniform(0.1, 1.0, 6), np.ones(6)])
        if seed % 8
        else np.outer(rng.uniform(1, 2, 6), [1.0, 2.0])
    )
    values = rows @ rng.normal(size=2) + 0.1 * rng.normal(size=6)
    cost = np.linalg.norm(rows @ np.array(least_squares_of_two(rows, values)) - values)
    expected, least = nnls(rows, values)
    assert cost == pytest.approx(least, rel=1e-9, abs=1e-12)
    if seed % 8:
        np.testing.assert_allclose(least_squares_of_two(rows, values), expected, atol=1e-9)
