r"""Whether a cloud is in its lidar's own frame: the rays of a rotor's lasers meet in one point, which is that frame's origin.

A driver, or a node behind it, may publish clouds in another frame of the rig (`base_link`). The motion of that frame is what a
calibration finds then, as asked; but lasers are off along and across their own rays, which no longer begin at the origin, and
errors that are corrected along others are not corrected. The points of laser k lie on a cone of its own,

    (x - o) . a = s_k |x - o|         o: where the rays meet, a: the rotor's axis, s_k: sine of the laser's elevation

which clouds of a few walls tell to centimetres, whatever ranges are off by.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.scans import RING_NAMES
from calib_core.types import Clue, Finding, FloatArray, IntArray

#: Clouds that are looked at, all over the sample, and points of them all.
_LOOKED_AT, _OF_ALL = 12, 8000
#: No lidar sees so far.
_FARTHEST_M = 2000.0
#: Lasers that tell a point, and points that tell a laser's cone.
_LASERS, _POINTS = 4, 30
_STEPS = 30
#: judged: beams begin 5 cm beside the middle at most, tall rotors' 10 (two blocks of lasers): clouds are moved by more than that.
_MOVED_M = 0.2
#: derived: of rays that meet at the origin, lasers' errors and rounding explain all; of others half of it at most.
_EXPLAINED = 0.5
#: derived: where points are within a fiftieth of a degree of cones about the origin, rays meet there: at 10 m a shift by what
#: counts shows as one degree.
_SHARP = 3e-4
#: judged: points off their cones by more of their range than that are no rotor's: a fifth of a degree.
_ON_CONES = 0.0035


def where_rays_meet(sample: Sequence[RawCloud], topic: str) -> tuple[Finding, ...]:
    """What is said of clouds that are not in their lidar's own frame; nothing of others, and where no lasers are told apart."""
    xyz, laser = _points(sample)
    if np.unique(laser).size < _LASERS:
        return ()
    here = _spread(_off_cones(xyz, laser, np.zeros(3), np.array([0.0, 0.0, 1.0]))[0])
    found = _fitted(xyz, laser) if here > _SHARP else None
    if found is None:
        return ()
    origin_m, axis, left = found
    away_m = float(np.linalg.norm(origin_m))
    if away_m < _MOVED_M or left > _EXPLAINED * here or left > _ON_CONES:
        return ()
    at = ", ".join(f"{value:.2f}" for value in origin_m)
    tilt_deg = float(np.degrees(np.arccos(min(abs(axis[2]), 1.0))))
    return (
        Finding(
            code="points.other_frame",
            level="warning",
            text=f"The clouds on {topic} are not in their lidar's own frame: the rays of its lasers meet at ({at}) m of"
            f" {sample[0].frame_id or 'theirs'}. The extrinsic then refers to the frame of the clouds, and laser corrections act "
            "along wrong rays: let the driver publish the clouds in the lidar's own frame.",
            evidence=(
                Clue("where the rays meet, from the frame's origin", round(away_m, 3), "m"),
                Clue("tilt of the rotor's axis", round(tilt_deg, 2), "deg"),
            ),
            consequence="errors of millimetres, if lasers read long or short",
        ),
    )


@np.errstate(invalid="ignore", over="ignore")  # damaged floats are masked, not warned of
def _points(sample: Sequence[RawCloud]) -> tuple[FloatArray, IntArray]:
    """Of some clouds, some of each laser: (N, 3) and (N,)."""
    xyz, laser, rng = [np.zeros((0, 3))], [np.zeros(0, dtype=np.int64)], np.random.default_rng(0)
    looked_at = np.unique(np.linspace(0, len(sample) - 1, _LOOKED_AT).astype(np.int64)).tolist() if sample else []
    for k in looked_at:
        points = sample[k].points
        name = next((each for each in RING_NAMES if each in sample[k].names and points.dtype[each].shape == ()), None)
        if name is None:
            continue
        at = np.stack([points[axis].astype(np.float64) for axis in "xyz"], axis=1)
        number = np.nan_to_num(points[name].astype(np.float64), nan=-1.0, posinf=-1.0, neginf=-1.0)
        farthest = np.abs(at).max(axis=1)  # of a damaged cloud anything may be there
        there = np.flatnonzero(
            np.isfinite(farthest) & (farthest > 0.0) & (farthest < _FARTHEST_M) & (np.abs(number) < 1e6)
        )
        some = rng.choice(there, min(_OF_ALL // len(looked_at), len(there)), replace=False)
        xyz.append(at[some])
        laser.append(number[some].astype(np.int64))
    at, of = np.concatenate(xyz), np.concatenate(laser)
    _, place, count = np.unique(of, return_inverse=True, return_counts=True)
    kept = count[place] >= _POINTS
    return at[kept], of[kept]


def _off_cones(
    xyz: FloatArray, laser: IntArray, origin_m: FloatArray, axis: FloatArray
) -> tuple[FloatArray, tuple[FloatArray, FloatArray]]:
    """(N,) sine of each point's elevation about its laser's median; points from there (N, 3) and how far they are (N,)."""
    away = xyz - origin_m
    range_m = np.maximum(np.linalg.norm(away, axis=1), 1e-6)
    sine = away @ axis / range_m
    off = np.empty(len(sine))
    for number in np.unique(laser).tolist():
        mine = laser == number
        off[mine] = sine[mine] - np.median(sine[mine])
    return off, (away, range_m)


def _fitted(xyz: FloatArray, laser: IntArray) -> tuple[FloatArray, FloatArray, float] | None:
    """Where rays meet, the axis, and how far points are off their cones then; None where that does not come to rest."""
    origin_m, axis = np.zeros(3), np.array([0.0, 0.0, 1.0])
    numbers, place = np.unique(laser, return_inverse=True)
    of_laser = np.eye(len(numbers))[place]
    for _ in range(_STEPS):
        off, (away, range_m) = _off_cones(xyz, laser, origin_m, axis)
        unit = away / range_m[:, None]
        # d sine / d origin = -(a - u (u . a)) / r; the axis turns within its plane.
        by_origin = -(axis - unit * (unit @ axis)[:, None]) / range_m[:, None]
        across = np.linalg.svd(axis[None])[2][1:]
        rows = np.concatenate([by_origin, unit @ across.T], axis=1)
        weight = 1.0 / (1.0 + (off / max(2.0 * _spread(off), 1e-6)) ** 2)
        of = of_laser * weight[:, None]
        rows = rows - of_laser @ ((of.T @ rows) / of.sum(axis=0)[:, None])
        middle = off - of_laser @ ((of.T @ off) / of.sum(axis=0))
        step, _, rank, _ = np.linalg.lstsq(rows * np.sqrt(weight)[:, None], -middle * np.sqrt(weight), rcond=1e-9)
        if rank < rows.shape[1] or not np.isfinite(step).all():
            return None
        origin_m, axis = origin_m + step[:3], axis + step[3:] @ across
        axis /= np.linalg.norm(axis)
        if np.abs(step).max() < 1e-5:
            return origin_m, axis, _spread(_off_cones(xyz, laser, origin_m, axis)[0])
    return None


def _spread(off: FloatArray) -> float:
    """Standard deviation by the median."""
    return float(1.4826 * np.median(np.abs(off)))
