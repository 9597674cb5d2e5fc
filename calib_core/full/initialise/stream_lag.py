r"""At which lag two streams of turns are one and the same but for a rotation.

Sizes of rates know no axis, and a swing there looks like the swing back. Where each turn is known by itself, in its own
axes and as well as it is, all three components speak. With a_i the lidar's rates, b_i(lag) the gyroscope's over the same
spans, both without their means, and the weights w_i,

    C = sum w_i b_i a_i^T,          likeness = (s1 + s2 + s3) / sqrt(sum w_i |a_i|^2  sum w_i |b_i|^2),

the sum of C's singular values: what the best orthogonal map between the two explains, 1 where it explains all.
"""

from __future__ import annotations

import numpy as np

from calib_core.full.initialise.settings import VECTORS
from calib_core.full.initialise.time_offset import LidarTurns, nearest_peaks
from calib_core.types import FloatArray


def lags_by_vectors(turns: LidarTurns, imu_s: FloatArray, gyro_rad_s: FloatArray) -> list[tuple[float, float]]:
    """The lags (seconds to add to IMU stamps) at which the turns are most alike, with their likeness, best first.

    Of a motion that repeats itself the ones nearest to the stamps' own that are nearly as good go with them.
    """
    if len(turns.start_s) < VECTORS.fewest_turns or len(imu_s) < 2:
        return []
    first_s = float(turns.start_s[0] - imu_s[-1])
    last_s = float(turns.end_s[-1] - imu_s[0])
    lags = np.arange(first_s, last_s, VECTORS.step_s)
    score = np.concatenate(
        [
            likeness(turns, imu_s, gyro_rad_s, lags[k : k + VECTORS.lags_at_once])
            for k in range(0, len(lags), VECTORS.lags_at_once)
        ]
    )
    nearest = nearest_peaks(lags, score)
    best: list[tuple[float, float]] = []
    while len(best) < VECTORS.candidates and np.isfinite(score.max()):
        k = int(np.argmax(score))
        best.append((float(lags[k]), float(score[k])))
        score[np.abs(lags - lags[k]) < VECTORS.apart_s] = -np.inf
    more = sorted((k for k in nearest if np.isfinite(score[k])), key=lambda k: -score[k])
    return best + [(float(lags[k]), float(score[k])) for k in more]


def likeness(turns: LidarTurns, imu_s: FloatArray, gyro_rad_s: FloatArray, lags_s: FloatArray) -> FloatArray:
    """How alike the turns are at each lag [s] (L,), -inf where too few are in common. imu_s: (Q,).   gyro_rad_s: (Q, 3)."""
    size = np.linalg.norm(turns.rate_rad_s, axis=1)
    a = turns.rate_rad_s * np.minimum(1.0, np.percentile(size, VECTORS.top_percent) / np.maximum(size, 1e-12))[:, None]
    total = np.vstack(
        [np.zeros(3), np.cumsum(np.diff(imu_s)[:, None] * 0.5 * (gyro_rad_s[1:] + gyro_rad_s[:-1]), axis=0)]
    )

    def turned(t_s: FloatArray) -> FloatArray:
        return np.stack([np.interp(t_s, imu_s, total[:, i]) for i in range(3)], axis=-1)

    start_s, end_s = turns.start_s - lags_s[:, None], turns.end_s - lags_s[:, None]
    b = (turned(end_s) - turned(start_s)) / (end_s - start_s)[..., None]
    shared = (start_s >= imu_s[0]) & (end_s <= imu_s[-1])
    w = shared * (np.ones(len(a)) if turns.worth is None else turns.worth)
    enough = shared.sum(axis=1) >= max(VECTORS.fewest_turns, VECTORS.least_share * len(a))
    w = w / np.maximum(w.sum(axis=1), 1e-30)[:, None]
    a = a - np.einsum("li,ij->lj", w, a)[:, None]
    b = b - np.einsum("li,lij->lj", w, b)[:, None]
    C = np.einsum("li,lij,lik->ljk", w, b, a)
    both = np.einsum("li,lij,lij->l", w, a, a) * np.einsum("li,lij,lij->l", w, b, b)
    out = np.linalg.svd(C, compute_uv=False).sum(axis=1) / np.sqrt(np.maximum(both, 1e-30))
    return np.where(enough, out, -np.inf)
