"""Links of simulated motion against its exact differences, and their covariance against noise that was really drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.geometry import log
from calib_core.gp.regression import Hyper
from calib_core.gp.training import fit_hyper
from calib_core.imu.preintegration import Links, NoiseDensity, UpsampledImu, knot_spacing_s, preintegrate, upsample
from calib_core.simulate.motion import Kinematics
from calib_core.simulate.motions import PAPER_FAST
from calib_core.types import FloatArray

GRAVITY = np.array([0.0, 0.0, -9.80665])
DENSITY = NoiseDensity(np.array([1e-3, 2e-3, 3e-3]), np.array([0.02, 0.03, 0.01]))
_GAUSS = 0.5 + np.array([-1.0, 1.0]) * np.sqrt(3.0) / 6.0


def _readings(at: Kinematics) -> FloatArray:
    """What an ideal IMU reads, (N, 6)."""
    force = np.einsum("nji,nj->ni", at.R_world, at.a_m_s2 - GRAVITY)
    return np.hstack([at.omega_rad_s, force])


def _ideal(h_s: float, links: int, substeps: int) -> tuple[UpsampledImu, Kinematics]:
    """Exact readings of fast hand-held motion at every Gauss point, and the motion at the knots."""
    knots = 3.0 + h_s * np.arange(links + 1)
    nodes = (np.arange(substeps)[:, None] + _GAUSS).ravel() / substeps * h_s
    gauss = _readings(PAPER_FAST.kinematics((knots[:-1, None] + nodes).ravel())).reshape(links, -1, 6)
    at = PAPER_FAST.kinematics(knots)
    here = _readings(at)
    up = UpsampledImu(
        knots, h_s, gauss[..., :3], gauss[..., 3:], here[:, :3], here[:, 3:], np.zeros((links, 6)), np.ones(links, bool)
    )
    return up, at


def _differences(at: Kinematics, h_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The exact DR, Dv, Dp between neighbouring knots, eq. (3) with the half."""
    Rt = np.swapaxes(at.R_world[:-1], 1, 2)
    dv = at.v_m_s[1:] - at.v_m_s[:-1] - GRAVITY * h_s
    dp = at.p_m[1:] - at.p_m[:-1] - at.v_m_s[:-1] * h_s - 0.5 * h_s**2 * GRAVITY
    return Rt @ at.R_world[1:], np.einsum("nij,nj->ni", Rt, dv), np.einsum("nij,nj->ni", Rt, dp)


def _errors(links: Links, at: Kinematics) -> FloatArray:
    """(L, 9) [rad, m/s, m] of the links against the truth."""
    DR, Dv, Dp = _differences(at, links.h_s)
    return np.hstack([log(np.swapaxes(DR, 1, 2) @ links.DR), links.Dv - Dv, links.Dp - Dp])


def test_preintegration_converges_at_its_order() -> None:
    """Fails when the Magnus term w1 x w2 is dropped, or Dp's weights are 1/2 each instead of 1 - c.

    Exact readings, substeps of 50 and 25 ms: the rotation's error falls to a sixteenth (fourth order), that of velocity
    and position to an eighth at least, and at 25 ms all are tiny. The tool's own substeps are 5 ms.
    """
    coarse, fine = (np.abs(_errors(preintegrate(u, z, z, DENSITY), a)) for u, a, z in (_case(2), _case(4)))
    for block, ratio in ((slice(0, 3), 14.0), (slice(3, 6), 6.5), (slice(6, 9), 6.5)):
        assert coarse[:, block].max() / fine[:, block].max() > ratio
    assert fine.max() < 2e-5


def _case(substeps: int) -> tuple[UpsampledImu, Kinematics, FloatArray]:
    up, at = _ideal(0.1, 20, substeps)
    return up, at, np.zeros((20, 3))


def test_constant_rate_and_force_in_closed_form() -> None:
    """Fails when eq. (3) lacks the half on the acceleration's square-time term.

    Constant body rate about the direction of a constant body force: DR = Exp(w h), Dv = f h, Dp = f h^2 / 2, exactly.
    """
    f = np.array([0.3, -0.9, 9.7])
    w = -0.8 * f / np.linalg.norm(f)
    one = np.ones((4, 6, 1))
    up = UpsampledImu(
        0.2 * np.arange(5),
        0.2,
        one * w,
        one * f,
        np.tile(w, (5, 1)),
        np.tile(f, (5, 1)),
        np.zeros((4, 6)),
        np.ones(4, bool),
    )
    links = preintegrate(up, np.zeros((4, 3)), np.zeros((4, 3)), DENSITY)
    np.testing.assert_allclose(links.DR, np.repeat(Rotation.from_rotvec(0.2 * w).as_matrix()[None], 4, 0), atol=1e-14)
    np.testing.assert_allclose(links.Dv, np.tile(0.2 * f, (4, 1)), atol=1e-13)
    np.testing.assert_allclose(links.Dp, np.tile(0.02 * f, (4, 1)), atol=1e-13)


def test_a_bias_in_the_readings_and_in_the_argument_cancel() -> None:
    """Fails when the accelerometer's bias is not taken off the second Gauss point."""
    up, _ = _ideal(0.01, 30, 2)
    rng = np.random.default_rng(1)
    bg, ba = rng.normal(size=(2, 30, 3))
    shifted = replace(up, gyro=up.gyro + bg[:, None], accel=up.accel + ba[:, None])
    zero = np.zeros((30, 3))
    plain, biased = preintegrate(up, zero, zero, DENSITY), preintegrate(shifted, bg, ba, DENSITY)
    for name in ("DR", "Dv", "Dp", "DR_D_bg", "Dv_D_ba", "Dp_D_bg", "sqrt_info"):
        np.testing.assert_allclose(getattr(biased, name), getattr(plain, name), rtol=1e-9, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("h_s", [0.01, 0.04])
def test_bias_derivatives_are_those_of_integrating_again(h_s: float) -> None:
    """Fails when Jvg leaves out the rotation's dependence on the bias, or Jpa the velocity's share.

    Central differences of the whole integration, eq. (12).
    """
    up, _ = _ideal(h_s, 8, 4)
    zero, step = np.zeros((8, 3)), 1e-3
    links = preintegrate(up, zero, zero, DENSITY)
    for axis in range(3):
        e = step * np.tile(np.eye(3)[axis], (8, 1))
        forth, back = preintegrate(up, e, zero, DENSITY), preintegrate(up, -e, zero, DENSITY)
        DRt = np.swapaxes(links.DR, 1, 2)
        turn = (log(DRt @ forth.DR) - log(DRt @ back.DR)) / (2 * step)
        # The rotation's derivative is carried linearly across a substep: good to a thousandth of itself.
        np.testing.assert_allclose(links.DR_D_bg[:, :, axis], turn, atol=3e-4 * h_s)
        np.testing.assert_allclose(links.Dv_D_bg[:, :, axis], (forth.Dv - back.Dv) / (2 * step), atol=5e-3 * h_s**2)
        np.testing.assert_allclose(links.Dp_D_bg[:, :, axis], (forth.Dp - back.Dp) / (2 * step), atol=3e-3 * h_s**3)
        forth, back = preintegrate(up, zero, e, DENSITY), preintegrate(up, zero, -e, DENSITY)
        np.testing.assert_allclose(links.Dv_D_ba[:, :, axis], (forth.Dv - back.Dv) / (2 * step), atol=1e-10)
        np.testing.assert_allclose(links.Dp_D_ba[:, :, axis], (forth.Dp - back.Dp) / (2 * step), atol=1e-10)


def test_weights_are_those_of_white_noise_really_drawn() -> None:
    """Fails when cov(theta, v) is G A^T h^2 / 3 instead of / 2, or A is + hat(f).

    Continuous white noise as independent noise at 48 points a link, 6000 links, integrated and whitened: unit
    covariance. An entry of the sample's is good to sqrt(2 / 6000) = 1.8 %; six sigmas, and 1 % for the points.
    """
    rng = np.random.default_rng(2)
    count, points, h = 6000, 48, 0.5
    f = np.array([2.0, -5.0, 8.0])
    # Turning and force matter alike: 10 m/s2 times 0.5 s times 0.01 rad is 0.05 m/s.
    density = NoiseDensity(np.array([0.01, 0.02, 0.015]), np.array([0.04, 0.05, 0.03]))
    sigma = np.concatenate([density.gyro_rad_s_sqrt_hz, density.accel_m_s2_sqrt_hz]) / np.sqrt(h / points)
    noise = rng.normal(size=(count, points, 6)) * sigma
    still = np.ones(count, bool)
    up = UpsampledImu(
        h * np.arange(count + 1), h, noise[..., :3], noise[..., 3:] + f, np.zeros((count + 1, 3)),
        np.zeros((count + 1, 3)), np.zeros((count, 6)), still,
    )  # fmt: skip
    zero = np.zeros((count, 3))
    links = preintegrate(up, zero, zero, density)
    errors = np.hstack([log(links.DR), links.Dv - f * h, links.Dp - 0.5 * f * h**2])
    white = np.einsum("lij,lj->li", links.sqrt_info, errors)
    np.testing.assert_allclose(white.T @ white / count, np.eye(9), atol=0.12)
    chi2 = np.sum(white**2, axis=1)
    assert abs(chi2.mean() - 9.0) < 6 * np.sqrt(18 / count) + 0.1


@pytest.mark.parametrize("rate_hz", [100.0, 400.0])
def test_errors_over_spans_of_many_links_have_the_readings_variance(rate_hz: float) -> None:
    """Fails when each link's density is that of one sample (s instead of s sqrt(period)), or of the posterior.

    100 s of white noise about standing still, interpolated, integrated: the heading errors and the velocity along the
    vertical, where no turning enters, added up over spans of links. Chi-square of the sums against the links' own
    variances; 4.5 sigmas of each mean. Within one link the posterior's mean is smoother than the readings: a link alone
    claims too much error, never too little, and less than a millisecond's worth of lidar could see.
    """
    rng = np.random.default_rng(3)
    period = 1.0 / rate_hz
    stamps = period * np.arange(int(100 * rate_hz))
    density = np.concatenate([DENSITY.gyro_rad_s_sqrt_hz, DENSITY.accel_m_s2_sqrt_hz])
    sample_std = density / np.sqrt(period)
    values = rng.normal(size=(len(stamps), 6)) * sample_std + np.array([0, 0, 0, 0, 0, 9.81])
    hyper = Hyper(np.full(6, 0.08), np.repeat([0.5, 2.0], 3), sample_std)
    spacing = knot_spacing_s(stamps)
    knots = stamps[0] + spacing * np.arange(int((stamps[-1] - stamps[0]) / spacing))
    up = upsample(stamps, values[:, :3], values[:, 3:], knots, hyper)
    zero = np.zeros((len(knots) - 1, 3))
    links = preintegrate(up, zero, zero, DENSITY)
    cov = np.linalg.inv(np.swapaxes(links.sqrt_info, 1, 2) @ links.sqrt_info)
    for errors, variance in ((log(links.DR)[:, 2], cov[:, 2, 2]), (links.Dv[:, 2] - 9.81 * spacing, cov[:, 5, 5])):
        for span in (20, 100):
            spans = len(errors) // span
            total = errors[: spans * span].reshape(spans, span).sum(axis=1)
            expected = variance[: spans * span].reshape(spans, span).sum(axis=1)
            chi2 = float(np.mean(total**2 / expected))
            assert abs(chi2 - 1.0) < 4.5 * np.sqrt(2.0 / spans)
        assert 0.1 < np.mean(errors**2 / variance) < 1.1


def _clean(rate_hz: float = 100.0, seconds: float = 4.0) -> tuple[FloatArray, FloatArray]:
    stamps = 2.8 + np.arange(int(seconds * rate_hz)) / rate_hz
    return stamps, _readings(PAPER_FAST.kinematics(stamps))


HYPER = Hyper(np.full(6, 0.15), np.repeat([1.0, 3.0], 3), np.repeat([1e-5, 1e-4], 3))


def test_links_of_sampled_readings_follow_the_true_motion() -> None:
    """Fails when readings are asked for at the wrong Gauss points (sqrt(3)/3 instead of sqrt(3)/6).

    100 Hz samples of 1.5 Hz motion without noise: what interpolation leaves over one link of 10 ms is below a
    thousandth of a typical MEMS gyro's own error, 1e-4 rad/s sqrt(s) over the same link.
    """
    stamps, values = _clean()
    knots = 3.0 + 0.01 * np.arange(301)
    up = upsample(stamps, values[:, :3], values[:, 3:], knots, HYPER)
    zero = np.zeros((300, 3))
    errors = np.abs(_errors(preintegrate(up, zero, zero, DENSITY), PAPER_FAST.kinematics(knots)))
    assert errors[:, :3].max() < 1e-7
    assert errors[:, 3:6].max() < 2e-6
    assert errors[:, 6:].max() < 2e-8
    here = _readings(PAPER_FAST.kinematics(knots))
    np.testing.assert_allclose(np.hstack([up.knot_gyro, up.knot_accel]), here, atol=2e-4)


def test_a_silence_is_bridged_with_doubt_or_not_at_all() -> None:
    """Fails when the excess variance is left out of the weights, or links across a long silence stay linked.

    30 ms without samples are bridged, with a larger variance there and the usual one elsewhere; 200 ms are not.
    """
    stamps, values = _clean()
    knots = 3.0 + 0.01 * np.arange(301)
    zero = np.zeros((300, 3))
    short = (stamps < 4.0 - 1e-6) | (stamps > 4.025)
    up = upsample(stamps[short], values[short, :3], values[short, 3:], knots, HYPER)
    assert up.linked.all()
    quiet = NoiseDensity(np.full(3, 1e-6), np.full(3, 1e-5))
    weight = np.linalg.norm(preintegrate(up, zero, zero, quiet).sqrt_info, axis=(1, 2))
    assert weight[100:102].max() < 0.2 * np.median(weight)
    assert np.abs(weight[:80] / np.median(weight) - 1).max() < 0.2
    long = (stamps < 4.0 - 1e-6) | (stamps > 4.195)
    up = upsample(stamps[long], values[long, :3], values[long, 3:], knots, HYPER)
    # The links that touch the silence with an end only may go either way.
    assert not up.linked[99:120].any()
    assert up.linked[:98].all()
    assert up.linked[121:].all()
    assert (preintegrate(up, zero, zero, quiet).sqrt_info[~up.linked] == 0.0).all()


@pytest.mark.parametrize(
    ("rate_hz", "expected_s"), [(100.0, 0.01), (400.0, 0.01), (200.0, 0.01), (50.0, 0.02), (125.0, 0.008)]
)
def test_knots_are_whole_samples_about_ten_milliseconds_apart(rate_hz: float, expected_s: float) -> None:
    """Fails when knots may be denser than the samples."""
    assert knot_spacing_s(np.arange(100) / rate_hz) == pytest.approx(expected_s)


@pytest.mark.parametrize(("white", "period_s"), [(0.12, 0.01), (1.0, 0.01), (1.0, 0.005)])
def test_a_noisy_imu_loses_nothing_of_the_motion_to_its_interpolation(white: float, period_s: float) -> None:
    """Fails when the posterior mean is taken with the noise as measured: half of a 0.9 Hz turn is then smoothed away.

    Oracle: the sine that least squares finds in the raw readings themselves, which no interpolation has touched.
    """
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 20.0, period_s)
    hz = np.array([0.4, 0.9, 0.25])
    readings = 0.5 * np.sin(2 * np.pi * hz * t[:, None]) + white * rng.normal(size=(len(t), 3))
    values = np.hstack([readings, readings])
    hyper = fit_hyper(t, values, noise_std=np.full(6, white))
    up = upsample(t, readings, readings, np.arange(0.5, 19.5, 0.01), hyper)
    middle = 0.5 * (up.knots_s[1:] + up.knots_s[:-1])

    def amplitude(when: FloatArray, values: FloatArray, f: float) -> float:
        sine = np.stack([np.sin(2 * np.pi * f * when), np.cos(2 * np.pi * f * when), np.ones_like(when)], axis=1)
        return float(np.hypot(*np.linalg.lstsq(sine, values, rcond=None)[0][:2]))

    inside = (t > 0.5) & (t < 19.5)
    for c in range(3):
        found = amplitude(middle, up.gyro[:, :, c].mean(axis=1), hz[c])
        # Both fits err by white sqrt(2 / n) of the same noise; what they do not share is the spans' ends.
        assert found == pytest.approx(amplitude(t[inside], readings[inside, c], hz[c]), rel=0.012)
