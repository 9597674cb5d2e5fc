"""Knots at about the IMU's rate, and the preintegrated measurement that links each to the next.

Knots are equally spaced on the IMU's clock, so that nothing here depends on the time offset: that enters only where a
lidar point asks for the pose at its own instant. A link integrates the Gaussian-process posterior mean of the readings,
queried at two Gauss points in each substep, by fourth-order rules (the Magnus expansion for the rotation):

    R' = R hat(omega),     v' = R f + g,     p' = v

    substep delta, readings w1, w2, f1, f2 at c = 1/2 -+ sqrt(3)/6:
    Omega = delta (w1 + w2) / 2 + sqrt(3)/12 delta^2 w1 x w2
    theta_i = delta (w_mean c_i + sqrt(3) (w2 - w1) (c_i^2 - c_i) / 2) + c_i^3 sqrt(3)/12 delta^2 w1 x w2
    Dv += R0 delta / 2 sum Exp(theta_i) f_i,     Dp += Dv delta + R0 delta^2 / 2 sum (1 - c_i) Exp(theta_i) f_i

Noise: readings carry independent errors of variance s^2 a sample, so their integral is a Wiener process of density
s sqrt(period). A posterior mean spreads each sample's error over its neighbourhood but keeps its integral; at knots no
denser than the samples, independent link errors with that density have the right variance over any longer span, which
is what matters: within a link the error is far below what a millisecond of lidar points can see. The posterior variance
in excess of the reading noise (missing samples) is added on top.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from calib_core.gp.regression import Hyper, windowed_posterior
from calib_core.imu.link_kernels import preintegrate_kernel, sqrt_info_kernel
from calib_core.imu.silence import longest_step_s
from calib_core.memoised import memoised
from calib_core.paged import heed_pages, paged
from calib_core.threads import in_parts
from calib_core.types import BoolArray, FloatArray

_GAUSS = 0.5 + np.array([-1.0, 1.0]) * np.sqrt(3.0) / 6.0
#: Where hands, legs and machines still move a sensor.
_BAND_HZ = 5.0
_SUBSTEP_S = 0.006
#: Links that a thread makes before their pages may be given back: two megabytes.
_LINKS_AT_ONCE = 2048


@dataclass(frozen=True, slots=True)
class NoiseDensity:
    """Continuous-time white noise of the readings: gyro_rad_s_sqrt_hz (3,), accel_m_s2_sqrt_hz (3,)."""

    gyro_rad_s_sqrt_hz: FloatArray
    accel_m_s2_sqrt_hz: FloatArray


@dataclass(frozen=True)
class UpsampledImu:
    """Readings where the integration wants them. K knots, L = K - 1 links, G Gauss points a link.

    knots_s: (K,) IMU clock.   gyro, accel: (L, G, 3).   knot_gyro, knot_accel: (K, 3).
    excess_density2: (L, 6) posterior variance beyond the reading noise, as an extra white density (times seconds).
    linked: (L,) False where the IMU was silent for too long to bridge.   accel_delay_s: with which it was asked.
    """

    knots_s: FloatArray
    spacing_s: float
    gyro: FloatArray
    accel: FloatArray
    knot_gyro: FloatArray
    knot_accel: FloatArray
    excess_density2: FloatArray
    linked: BoolArray
    accel_delay_s: float = 0.0

    @property
    def gauss_s(self) -> FloatArray:
        """(L, G) when the Gauss points of every link are, IMU clock."""
        nodes = gauss_nodes(self.gyro.shape[1] // 2)
        return np.asarray(self.knots_s[:-1, None] + nodes * self.spacing_s)

    @property
    def middles_s(self) -> FloatArray:
        """(L,) the middle of every link, IMU clock."""
        return np.asarray(self.knots_s[:-1] + 0.5 * self.spacing_s)

    def part(self, first: int, last: int) -> UpsampledImu:
        """The knots first..last (exclusive) and the links among them."""
        knots, links = slice(first, last), slice(first, last - 1)
        return UpsampledImu(
            self.knots_s[knots],
            self.spacing_s,
            self.gyro[links],
            self.accel[links],
            self.knot_gyro[knots],
            self.knot_accel[knots],
            self.excess_density2[links],
            self.linked[links],
            self.accel_delay_s,
        )


@dataclass(frozen=True)
class Links:
    """Preintegrated measurements, eq. (3), about the given biases, with first-order bias dependence, eq. (12).

    DR: (L, 3, 3), Dv: (L, 3) [m/s], Dp: (L, 3) [m].   DR_D_bg etc.: (L, 3, 3).   sqrt_info: (L, 9, 9) of [r_R, r_v, r_p];
    zero where not linked.
    """

    h_s: float
    DR: FloatArray
    Dv: FloatArray
    Dp: FloatArray
    DR_D_bg: FloatArray
    Dv_D_bg: FloatArray
    Dv_D_ba: FloatArray
    Dp_D_bg: FloatArray
    Dp_D_ba: FloatArray
    sqrt_info: FloatArray

    def part(self, first: int, last: int) -> Links:
        """Those from first to last (exclusive)."""
        arrays = [getattr(self, each.name)[first:last] for each in fields(self) if each.name != "h_s"]
        heed_pages(sum(array.nbytes for array in arrays))
        return Links(self.h_s, *arrays)


def knot_spacing_s(stamps_s: FloatArray) -> float:
    """A whole number of sample periods, near 10 ms and never below one period."""
    period = float(np.median(np.diff(stamps_s)))
    return period * max(1, round(0.01 / period))


def interpolating(hyper: Hyper, period_s: float) -> Hyper:
    """The same process, taken to be less noisy and less rough where it would otherwise lose some of the motion.

    A posterior mean follows a sine of frequency f with the gain S(f) / (S(f) + noise^2 period), S the kernel's spectral
    density: with a noisy or shaken IMU that is well below 1 within the motion's own band, and the integral of the mean is
    then not that of the readings. The links carry the readings' white noise in their covariance; nothing is gained by
    taking it out of their mean. So the noise is capped where the gain at the band's end would be below 0.9999, and a
    length scale shorter than the samples are apart is no statement about the motion.
    """
    length = np.maximum(hyper.length_scale_s, 2.5 * period_s)
    band_hz = min(_BAND_HZ, 0.1 / period_s)
    # Matern 5/2: S(f) = s^2 16 l / (3 sqrt(5)) (1 + (2 pi f l)^2 / 5)^-3.
    density = (
        hyper.signal_std**2
        * 16.0
        * length
        / (3.0 * np.sqrt(5.0))
        / (1.0 + (2 * np.pi * band_hz * length) ** 2 / 5) ** 3
    )
    return Hyper(
        length, hyper.signal_std, np.minimum(hyper.noise_std, np.sqrt(1e-4 * density / period_s)), hyper.smoothness
    )


def gauss_nodes(substeps: int) -> FloatArray:
    """(2 substeps,) where in a link its Gauss points are, from 0 to 1."""
    return np.asarray((np.arange(substeps)[:, None] + _GAUSS).ravel() / substeps)


@memoised
def upsample(
    stamps_s: FloatArray, gyro_rad_s: FloatArray, accel_m_s2: FloatArray, knots_s: FloatArray, hyper: Hyper
) -> UpsampledImu:
    """The readings at every knot and at every link's Gauss points.

    stamps_s: (Q,) increasing.   gyro_rad_s, accel_m_s2: (Q, 3).   knots_s: (K,) equally spaced within the stamps.
    hyper: of the six channels, gyro first.
    """
    h = float(knots_s[1] - knots_s[0])
    substeps = max(1, int(np.ceil(h / _SUBSTEP_S)))
    period = float(np.median(np.diff(stamps_s)))
    at_gauss, at_knots, var = _asked(stamps_s, np.hstack([gyro_rad_s, accel_m_s2]), knots_s, substeps, hyper)
    excess = np.maximum(var - hyper.noise_std**2, 0.0).mean(axis=1)
    gap = _silence_s(stamps_s, knots_s)
    return UpsampledImu(
        knots_s=knots_s,
        spacing_s=h,
        gyro=at_gauss[..., :3],
        accel=at_gauss[..., 3:],
        knot_gyro=at_knots[:, :3],
        knot_accel=at_knots[:, 3:],
        # The interpolation's error is one and the same throughout a gap: its integral grows with the gap's length.
        excess_density2=excess * np.maximum(gap, period)[:, None],
        linked=gap < longest_step_s(stamps_s),
    )


def asked_later(
    up: UpsampledImu, stamps_s: FloatArray, accel_m_s2: FloatArray, hyper: Hyper, delay_s: float
) -> UpsampledImu:
    """The same with the accelerometer's readings taken later: what it says of an instant is stamped by delay_s later.

    stamps_s: (Q,), accel_m_s2: (Q, 3), hyper: as `upsample` was given them.
    """
    own = Hyper(hyper.length_scale_s[3:], hyper.signal_std[3:], hyper.noise_std[3:], hyper.smoothness)
    at_gauss, at_knots, _ = _asked(stamps_s, accel_m_s2, up.knots_s, up.gyro.shape[1] // 2, own, delay_s)
    return replace(up, accel=at_gauss, knot_accel=at_knots, accel_delay_s=delay_s)


def _asked(
    stamps_s: FloatArray,
    values: FloatArray,
    knots_s: FloatArray,
    substeps: int,
    hyper: Hyper,
    later_s: float = 0.0,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Channels (Q, C) at links' Gauss points (L, G, C) and at knots (K, C), and their variance at the former (L, G, C)."""
    links = len(knots_s) - 1
    gauss = knots_s[:-1, None] + gauss_nodes(substeps) * float(knots_s[1] - knots_s[0])
    query = np.concatenate([gauss.ravel(), knots_s])
    order = np.argsort(query, kind="stable")
    hyper = interpolating(hyper, float(np.median(np.diff(stamps_s))))
    sorted_mean, sorted_var = windowed_posterior(stamps_s, values, query[order] + later_s, hyper)
    mean, var = paged(sorted_mean.shape, sorted_var.shape)
    mean[order], var[order] = sorted_mean, sorted_var
    heed_pages(mean.nbytes + var.nbytes)
    shape = (links, -1, values.shape[1])
    return mean[: gauss.size].reshape(shape), mean[gauss.size :], var[: gauss.size].reshape(shape)


def _silence_s(stamps_s: FloatArray, knots_s: FloatArray) -> FloatArray:
    """The longest interval between samples that overlaps each link. (L,) [s]."""
    first = np.clip(np.searchsorted(stamps_s, knots_s[:-1], side="right") - 1, 0, len(stamps_s) - 2)
    last = np.clip(np.searchsorted(stamps_s, knots_s[1:], side="left") - 1, first, len(stamps_s) - 2)
    steps = np.diff(stamps_s)
    longest = np.maximum(steps[first], steps[last])
    for extra in range(1, int((last - first).max(initial=0))):
        longest = np.maximum(longest, steps[np.minimum(first + extra, last)])
    return longest


def preintegrate(up: UpsampledImu, gyro_bias: FloatArray, accel_bias: FloatArray, noise: NoiseDensity) -> Links:
    """The links about the given biases. gyro_bias, accel_bias: (L, 3), one a link."""
    count = len(up.linked)
    shapes = (count, 3, 3), (count, 3), (count, 3), *([(count, 3, 3)] * 5), (count, 9, 9)
    filled = paged(*shapes)
    force = up.accel.mean(axis=1) - accel_bias
    gyro_density2 = noise.gyro_rad_s_sqrt_hz**2 + up.excess_density2[:, :3]
    accel_density2 = noise.accel_m_s2_sqrt_hz**2 + up.excess_density2[:, 3:]

    def one(first: int, last: int) -> None:
        some = slice(first, last)
        own = [array[some] for array in filled]
        gyro, accel = np.ascontiguousarray(up.gyro[some]), np.ascontiguousarray(up.accel[some])
        preintegrate_kernel(up.spacing_s, gyro, accel, gyro_bias[some], accel_bias[some], *own[:-1])
        sqrt_info_kernel(up.spacing_s, gyro_density2[some], accel_density2[some], force[some], own[-1])
        heed_pages(sum(array.nbytes for array in own))

    in_parts(count, one, _LINKS_AT_ONCE)
    links = Links(up.spacing_s, *filled)
    links.sqrt_info[~up.linked] = 0.0
    return links
