"""Which planes of a solve are doubtful: what its residuals say of each (planes/plane_tests.py), and what is said of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_core.errors import Refused
from calib_core.full.joint.estimation import MapPlane, Solved
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.residuals import plane_chi2
from calib_core.full.joint.settings import DOUBTING
from calib_core.full.joint.state import Estimate
from calib_core.full.planes.plane_tests import (
    WORDS,
    Fault,
    PlaneSamples,
    Standing,
    doubts,
    fault_of,
    standing_of,
)
from calib_core.full.run import Run
from calib_core.geometry import plane_axes
from calib_core.plane_kinds import kind_of
from calib_core.types import FloatArray, Level


def standings(problem: JointProblem, estimate: Estimate) -> list[Standing]:
    """How every plane stands under an estimate."""
    bins = problem.bins
    R, p = problem.lidar.bin_poses(estimate)
    scatter, points = plane_chi2(problem, estimate)
    weight = np.maximum(bins.scatter[:, 3, 3], 1e-30)
    distance_m = (
        problem.lidar.sums(estimate) / weight
    )  # as the lasers are known by now, not as when the points were laid out
    at_imu = (bins.scatter[:, 3, :3] / weight[:, None]) @ estimate.R_imu_lidar.T + estimate.p_imu_lidar
    place_m = np.einsum("bij,bj->bi", R, at_imu) + p
    time_s = problem.readings.knots_s[bins.knot]
    out = []
    for j, normal in enumerate(estimate.normals):
        mine = bins.plane == j
        cell = np.floor(place_m[mine] @ plane_axes(normal).T / DOUBTING.cell_m).astype(np.int64)
        _, index = np.unique(cell, axis=0, return_inverse=True)
        samples = PlaneSamples(
            time_s[mine],
            index.reshape(-1),
            distance_m[mine],
            1.0 / np.sqrt(weight[mine]),
            float(scatter[j]),
            float(points[j]),
        )
        out.append(standing_of(samples))
    return out


def plane_doubts(problem: JointProblem, estimate: Estimate, rough_m: float | None = None) -> FloatArray:
    """How doubtful each plane is, (P, 3): standing.doubts.

    rough_m: while motion and sensors are rough, nothing below it is a fault, and any plane may be as far off as most others.
    """
    found = standings(problem, estimate)
    return doubts(found) if rough_m is None else doubts(found, rough_m, np.inf)


def level_at_m(planes: Sequence[MapPlane], estimate: Estimate) -> FloatArray:
    """How far above the lidar each floor or ceiling was found [m], (P,); NaN of other planes, and of those found in the solve."""
    up = -estimate.gravity / np.linalg.norm(estimate.gravity)
    side = {"floor": -1.0, "ceiling": 1.0}
    return np.array(
        [
            side.get(kind_of(normal, up)[0], np.nan) * (np.nan if plane.found_m is None else plane.found_m)
            for plane, normal in zip(planes, estimate.normals, strict=True)
        ]
    )


def say_left_out(run: Run, planes: Sequence[MapPlane], doubt: FloatArray, level_m: FloatArray) -> None:
    """Name the planes that are left out, each with what is wrong with it. doubt: (P, 3), level_m: (P,) of `level_at_m`, theirs.

    What is called a floor is what a lidar sees from above: where a table's top is, somebody would think of the floor below.
    Somebody was shown those that were proposed, and is warned of them; of what came into view on the way a note will do.
    """
    for plane, row, height_m in zip(planes, doubt, level_m.tolist(), strict=True):
        fault = fault_of(row)
        side = "below" if height_m < 0.0 else "above"
        where = "" if np.isnan(height_m) else f" ({abs(height_m):.1f} m {side} the lidar)"
        level: Level = "info" if plane.late else "warning"
        what = WORDS[fault] if fault else "does not fit the motion of the other planes"
        run.say(level, f"planes.{fault or 'dropped'}", f"{plane.name} {what}{where}: left out")


def face_three_ways(normals: FloatArray) -> bool:
    """Whether planes of these normals (P, 3) hold a pose."""
    return len(normals) >= 3 and bool(np.linalg.svd(normals, compute_uv=False)[-1] >= DOUBTING.least_spread)


def require_three_ways(planes: Sequence[MapPlane], faults: Sequence[Fault], normals: FloatArray) -> None:
    """Raises Refused where some of the planes are faulty and the others do not face three ways. normals: (P, 3), unit length.

    What came into view is nobody's choice, and is not blamed on it; nor is any plane called faulty by a motion that all of them
    would not hold.
    """
    if not any(faults) or face_three_ways(normals[[not fault for fault in faults]]):
        return
    said = [
        f"{plane.name} {WORDS[fault]}" for plane, fault in zip(planes, faults, strict=True) if fault and not plane.late
    ]
    few = "do not face three different directions"
    why = f"{', '.join(said)}, and the others {few}" if said else f"they {few}"
    if not face_three_ways(normals):
        why = "those that count face two directions at most"
    raise Refused(
        "planes.doubtful",
        f"the chosen planes do not determine the motion: {why}; choose walls, floor and ceiling, or use the suggested planes",
    )


def require_sound_choice(solved: Solved) -> None:
    """Raises Refused where the planes of a choice that are beyond doubt do not hold three directions: the answer would be that of
    what moves or bends.
    """
    if not np.isfinite(solved.estimate.p_imu_lidar).all():  # a solve that came to nothing is told as that
        return
    faults = [fault_of(row) for row in plane_doubts(solved.problem, solved.estimate)]
    require_three_ways(solved.planes, faults, solved.estimate.normals)
