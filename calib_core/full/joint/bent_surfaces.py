"""Walls that are not flat: whether they are, and the heights of their patches as unknowns where so (factors/patches.py)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_core.factors.lidar_plane import select
from calib_core.factors.patches import SurfacePatches, patches_of
from calib_core.full.joint.alternation import Near
from calib_core.full.joint.doubtful_planes import plane_doubts
from calib_core.full.joint.estimation import Estimation, JointData
from calib_core.full.joint.many_scans import over_batches
from calib_core.full.joint.policies import Sampling, Settling, Surfaces
from calib_core.full.joint.round import coarse_stride, gate_of, gathered
from calib_core.full.joint.state import CALIBRATION
from calib_core.full.joint.state_views import present_view
from calib_core.full.prepare.nuisance import SURFACE
from calib_core.geometry import log
from calib_core.sigmas import two_digits
from calib_core.types import FloatArray


def admit_surface(data: JointData, state: Estimation, rules: Surfaces, sampling: Sampling) -> Estimation:
    """With the heights of patches as unknowns from here on; the same state where the planes are flat, or are given.

    One that is no plane beside the others, as somebody may choose, stays flat: heights would make a wall of what is a box before
    one, and nothing would be said of it any more. The others have theirs all the same: what it does not fit may be their shape.
    """
    if state.support is None or state.nuisance.patches or not data.run.settings.estimate_planes:
        return state
    lasers = max(data.sensors.lasers, 1)
    patches = patches_of(state.support)
    if patches.count < 2 or state.knots * lasers > rules.most_clusters:
        return state
    weight, off = patch_sums(data, state, patches, sampling)
    if not are_bent(weight, off, rules):
        return state
    is_doubtful = np.any(plane_doubts(gathered(data, state), state.estimate) > 1.0, axis=1)
    if is_doubtful.any():
        rest = np.flatnonzero(~is_doubtful[patches.planes])
        patches = patches.without(is_doubtful)
        if not are_bent(weight[rest], off[rest], rules):
            return state
    return state.with_nuisance(state.nuisance.with_surface(patches, rules.height_std_m, rules.alike_m))


def is_bent_wall(state: Estimation, rules: Surfaces) -> bool:
    """Whether the heights are those of walls: a patch that comes far off its plane follows another surface, of which its gate
    takes in more the farther it goes."""
    heights = state.estimate.sensors.of(SURFACE)
    return bool(np.abs(heights).max(initial=0.0) < rules.most_sigmas * rules.height_std_m)


def shape_shift(flat: Estimation, near: Near, settling: Settling, rules: Surfaces) -> FloatArray:
    """(7,) by how much the calibration has gone, from planes taken as flat to where heights came nearest to a rest that they did
    not find: turns about the lidar's axes [rad], metres, seconds. Zero where that is no wall's shape, or nowhere near rest.

    One plane of a few whose cells come and go leaves all shapes without rest, and the answer with what taking them for flat does.
    """
    if not is_bent_wall(near.state, rules) or near.moved >= settling.judged:
        return np.zeros(CALIBRATION)
    before, after = flat.estimate, near.state.estimate
    turn = log(before.R_imu_lidar.T @ after.R_imu_lidar)
    return np.array([*turn, *(after.p_imu_lidar - before.p_imu_lidar), after.time_offset_s - before.time_offset_s])


def unevenness_m(state: Estimation) -> float:
    """Root mean square of the heights."""
    return float(np.sqrt(np.mean(state.estimate.sensors.of(SURFACE) ** 2)))


def is_rough(state: Estimation, rules: Surfaces) -> bool:
    """Whether planes are off flat by far more than walls are: something before one passes for it."""
    return unevenness_m(state) > rules.rough * rules.height_std_m


def say_uneven(data: JointData, state: Estimation, rules: Surfaces) -> None:
    """That shapes are estimated, for a person: by how much planes are off flat, and in how many patches."""
    rough = is_rough(state, rules)
    why = ", more than walls usually are, as if a door stood ajar in front of one" if rough else ""
    data.run.say(
        "warning" if rough else "info",
        "planes.uneven",
        f"the planes deviate from flat by {two_digits(1e3 * unevenness_m(state))} mm from place to place{why}: their shape is "
        f"estimated too, in {state.nuisance.patches} patches",
    )


def patch_sums(
    data: JointData, state: Estimation, patches: SurfacePatches, sampling: Sampling
) -> tuple[FloatArray, FloatArray]:
    """Of each patch's points, thinned: sum of weights [1/m^2] and of weighted distances [1/m], (N,) each."""
    view, gate = present_view(data, state), gate_of(state, 0.0, sampling)
    stride = coarse_stride(data, state, sampling)

    def some(batch: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        hits = view.hits(batch, gate, stride)
        keep, weight = select(hits, state.lidar_noise, gate, state.support)
        patch, weight = patches.of(hits)[keep], weight[keep]
        return (
            np.bincount(patch, weight, patches.count + 1)[:-1].astype(np.float64),
            np.bincount(patch, weight * hits.d[keep], patches.count + 1)[:-1].astype(np.float64),
        )

    parts = list(over_batches(view, state.positions, stride, some))
    return np.sum([w for w, _ in parts], axis=0), np.sum([d for _, d in parts], axis=0)


def are_bent(weight: FloatArray, off: FloatArray, rules: Surfaces) -> bool:
    """Whether the means of patches differ from place to place by more than chance makes, however little.

    What motion and sensors have taken upon themselves of a wall's shape is not there any more, and is many times what is left.
    weight, off: (N,) sums of weights [1/m^2] and of weighted distances [1/m] of each.
    """
    seen = weight > 0
    count = int(np.count_nonzero(seen))
    beyond = float((off[seen] ** 2 / weight[seen]).sum()) - count
    return count >= 2 and beyond >= rules.sigmas * float(np.sqrt(2.0 * count))
