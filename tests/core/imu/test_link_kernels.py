"""Compiled links against the same equations written for all links at once, and their information against its definition."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.geometry import cross, exp, hat, right_jacobian
from calib_core.imu.preintegration import NoiseDensity, UpsampledImu, preintegrate
from calib_core.types import FloatArray

LINKS = 11
DENSITY = NoiseDensity(np.array([1e-3, 2e-3, 3e-3]), np.array([0.02, 0.03, 0.01]))
_GAUSS = 0.5 + np.array([-1.0, 1.0]) * np.sqrt(3.0) / 6.0


def _readings(substeps: int, h_s: float) -> UpsampledImu:
    """Wild ones, cut out of wider arrays as they are in a recording; some links are silent, some have a density of their own."""
    rng = np.random.default_rng(substeps)
    channels = rng.normal(size=(LINKS, 2 * substeps, 6)) * [3.0, 2.0, 4.0, 9.0, 8.0, 12.0]
    excess = np.where(rng.random((LINKS, 6)) < 0.5, 0.0, 1e-5)
    linked = np.arange(LINKS) % 4 != 2
    knots = np.zeros((LINKS + 1, 3))
    return UpsampledImu(
        h_s * np.arange(LINKS + 1), h_s, channels[..., :3], channels[..., 3:], knots, knots, excess, linked
    )


def _slowly(up: UpsampledImu, gyro_bias: FloatArray, accel_bias: FloatArray) -> dict[str, FloatArray]:
    """The equations of preintegration.py, link by link in arrays."""
    substeps, h = up.gyro.shape[1] // 2, up.spacing_s
    delta = h / substeps
    DR, Dv, Dp = np.tile(np.eye(3), (LINKS, 1, 1)), np.zeros((LINKS, 3)), np.zeros((LINKS, 3))
    JR, Jvg, Jva, Jpg, Jpa = np.zeros((5, LINKS, 3, 3))
    for k in range(substeps):
        w1, w2 = (up.gyro[:, 2 * k + i] - gyro_bias for i in (0, 1))
        f1, f2 = (up.accel[:, 2 * k + i] - accel_bias for i in (0, 1))
        mean, slope = 0.5 * (w1 + w2), np.sqrt(3.0) * (w2 - w1)
        bend = np.sqrt(3.0) / 12.0 * delta**2 * cross(w1, w2)
        R1, R2 = (DR @ exp(delta * (mean * c + slope * (c**2 - c) / 2) + c**3 * bend) for c in _GAUSS)
        omega = delta * mean + bend
        a1, a2 = (R1 @ f1[..., None])[..., 0], (R2 @ f2[..., None])[..., 0]
        step = exp(omega)
        JR_next = np.swapaxes(step, -1, -2) @ JR - delta * right_jacobian(omega)
        J1, J2 = (JR + c * (JR_next - JR) for c in _GAUSS)
        g1, g2 = -R1 @ hat(f1) @ J1, -R2 @ hat(f2) @ J2
        early, late = (0.5 * delta**2 * (1 - c) for c in _GAUSS)
        Dp += Dv * delta + early * a1 + late * a2
        Jpg += Jvg * delta + early * g1 + late * g2
        Jpa += Jva * delta - early * R1 - late * R2
        Dv += 0.5 * delta * (a1 + a2)
        Jvg += 0.5 * delta * (g1 + g2)
        Jva -= 0.5 * delta * (R1 + R2)
        DR, JR = DR @ step, JR_next
    names = ("DR", "Dv", "Dp", "DR_D_bg", "Dv_D_bg", "Dv_D_ba", "Dp_D_bg", "Dp_D_ba")
    return dict(zip(names, (DR, Dv, Dp, JR, Jvg, Jva, Jpg, Jpa), strict=True))


@pytest.mark.parametrize("substeps", [1, 2, 3])
def test_links_are_those_of_the_equations(substeps: int) -> None:
    """Mutations: Dp taken after Dv has grown; by_gyro not taken off; JR taken from the substep's end; the bend left out."""
    up, rng = _readings(substeps, 0.05), np.random.default_rng(7)
    bg, ba = 0.1 * rng.normal(size=(2, LINKS, 3))
    links = preintegrate(up, bg, ba, DENSITY)
    for name, expected in _slowly(up, bg, ba).items():
        np.testing.assert_allclose(
            getattr(links, name), expected, atol=1e-14 * np.abs(expected).max() + 1e-17, err_msg=name
        )


def test_information_is_that_of_white_noise_through_constant_readings() -> None:
    """Its inverse is the covariance of the integrals, here summed over a hundred thousand steps of the link each.

    With readings constant and the turn within the link small, theta = int n_w, v = int (-hat(f) theta + n_f), p = int v: the
    sums' own rounding into steps is 1e-5 of them. Mutations: A not transposed; h^4 / 6 for h^4 / 8; std of a row for the column.
    """
    up = _readings(2, 0.08)
    ba = 0.1 * np.random.default_rng(8).normal(size=(LINKS, 3))
    sqrt_info = preintegrate(up, np.zeros((LINKS, 3)), ba, DENSITY).sqrt_info
    steps = 100_000
    left_s = up.spacing_s * (1.0 - (np.arange(steps) + 0.5) / steps)  # from each step to the link's end
    by_power = {k: float((left_s**k).sum() * up.spacing_s / steps) for k in range(5)}
    for k in np.flatnonzero(up.linked):
        A = -hat(up.accel[k].mean(axis=0) - ba[k])
        gyro = np.diag(DENSITY.gyro_rad_s_sqrt_hz**2 + up.excess_density2[k, :3])
        accel = np.diag(DENSITY.accel_m_s2_sqrt_hz**2 + up.excess_density2[k, 3:])
        # What a step's noise has become at the end: theta at once, v and p through what is left of the link.
        of_gyro = {0: (np.eye(3), 0), 1: (A, 1), 2: (0.5 * A, 2)}
        of_accel = {1: (np.eye(3), 0), 2: (np.eye(3), 1)}
        cov = np.zeros((9, 9))
        for density, parts in ((gyro, of_gyro), (accel, of_accel)):
            for i, (B, m) in parts.items():
                for j, (C, n) in parts.items():
                    cov[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] += by_power[m + n] * B @ density @ C.T
        whitened = sqrt_info[k] @ cov @ sqrt_info[k].T
        np.testing.assert_allclose(whitened, np.eye(9), atol=1e-6)
        assert np.array_equal(sqrt_info[k], np.tril(sqrt_info[k]))
    assert not sqrt_info[~up.linked].any()
