"""A sweep's points moved one by one, compiled: each by the pose at its own instant."""

from __future__ import annotations

import math

import numba

from calib_core.types import Float32Array, FloatArray


@numba.njit(cache=True, nogil=True, error_model="numpy")
def move_points_kernel(
    times_s: FloatArray,
    R: FloatArray,
    p: FloatArray,
    turn_rad: FloatArray,
    xyz_m: FloatArray,
    stamps_s: FloatArray,
    out_m: Float32Array,
) -> None:
    """Fills out_m (N, 3): points (N, 3) at instants (N,) by poses at knots times_s (K,), R (K, 3, 3), p (K, 3).

    Constant twist between knots, turn_rad (K - 1, 3) from each to the next; the ends held.
    """
    last = times_s.shape[0] - 2
    k = 0
    for i in range(stamps_s.shape[0]):
        t = stamps_s[i]
        # Points come by their time, or a dozen lasers at once: the next one's knot is this one's or its neighbour.
        while k < last and t >= times_s[k + 1]:
            k += 1
        while k > 0 and t < times_s[k]:
            k -= 1
        f = min(max((t - times_s[k]) / (times_s[k + 1] - times_s[k]), 0.0), 1.0)
        x, y, z = xyz_m[i, 0], xyz_m[i, 1], xyz_m[i, 2]
        wx, wy, wz = f * turn_rad[k, 0], f * turn_rad[k, 1], f * turn_rad[k, 2]
        square = wx * wx + wy * wy + wz * wz
        # Rodrigues: x + sin(theta) / theta w x x + (1 - cos(theta)) / theta^2 w x (w x x); beneath, their series to theta^4.
        if square < 1e-4:
            a = 1.0 - square / 6.0 * (1.0 - square / 20.0)
            b = 0.5 - square / 24.0 * (1.0 - square / 30.0)
        else:
            theta = math.sqrt(square)
            a = math.sin(theta) / theta
            b = (1.0 - math.cos(theta)) / square
        cx, cy, cz = wy * z - wz * y, wz * x - wx * z, wx * y - wy * x
        x += a * cx + b * (wy * cz - wz * cy)
        y += a * cy + b * (wz * cx - wx * cz)
        z += a * cz + b * (wx * cy - wy * cx)
        for c in range(3):
            there = (1.0 - f) * p[k, c] + f * p[k + 1, c]
            out_m[i, c] = R[k, c, 0] * x + R[k, c, 1] * y + R[k, c, 2] * z + there
