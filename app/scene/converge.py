"""What a running solve believes, as a cloud: a dozen sweeps where the estimate of the moment puts them.

Every step of the solve says where the lidar was at a few instants of these sweeps, and where the planes are. The walls
are as thick as that estimate is wrong; they thin out as it converges, and more sweeps come in as it is carried through
the recording.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from app.planes import palette
from app.results.imu_pose import imu_pose
from app.results.plane_table import PlaneTable
from app.results.thinning import thinned_scan
from app.scene.aim import stage_of
from app.scene.build import ground
from app.scene.inspect import RESIDUAL_GATE_M, RESIDUAL_HALF_M
from app.scene.items import Axes, Cloud, Content, breadth_m, frame_names, point_size_m
from app.schemas.results import Thickness
from calib_core import api
from calib_core.events import IterationEvent, SweepMotion
from calib_core.phrasing import counted
from calib_core.types import Float32Array, FloatArray, Recording, Trajectory

#: Walls are taken as what lies this near to a plane when the thickness in the caption is worked out.
WALL_GATE_M = 0.10
#: Verticals nearer to each other than this are one: a camera that somebody has turned is not turned back for less.
SAME_UP_COS = float(np.cos(np.radians(3.0)))


def build_converging(
    recording: Recording,
    step: IterationEvent,
    *,
    limit: int,
    up: FloatArray | None = None,
    straight: float = 1.0,
    dark: bool = True,
    measured: Thickness | None = None,
) -> Content:
    """The sweeps of a step, coloured by their distance to the nearest plane, and both sensors' frames.

    up: (3,) map frame, where it is known.   straight: how much of the motion is taken out, 0..1.   dark: the background is.
    measured: of all walls, once the run has an answer: from then on no number of these few sweeps stands beside it.
    """
    by_stamp = {scan.stamp_ns: scan for scan in recording.scans}
    seen = [(by_stamp[sweep.stamp_ns], sweep) for sweep in step.sweeps if sweep.stamp_ns in by_stamp]
    each = max(1, limit // max(1, len(seen)))
    pairs = [(thinned_scan(scan, each), motion_of(sweep)) for scan, sweep in seen if len(scan.points) > 0]
    if not pairs:
        return Content(items=(), legend="", note="This step says nothing of the sweeps yet.")
    moved = np.concatenate([api.map_points(scan, motion) for scan, motion in pairs])
    rigid = np.concatenate([api.raw_map_points(scan, motion) for scan, motion in pairs])
    table = PlaneTable(
        np.array([(*plane.normal, plane.offset_m) for plane in step.planes], dtype=np.float64).reshape(-1, 4)
    )
    shown: Float32Array = rigid + np.float32(straight) * (moved - rigid)
    _, dist_m = table.nearest(shown, gate_m=RESIDUAL_GATE_M)
    stage = stage_of(up, table.equations)
    first = pairs[0][1]
    R_lidar, p_lidar = first.R_map_lidar[0], first.p_map_lidar[0]
    R_imu, p_imu = imu_pose(R_lidar, p_lidar, np.array(step.matrix))
    return Content(
        items=(
            Cloud("/sweeps", shown, palette.diverging(dist_m, RESIDUAL_HALF_M, dark=dark), point_size_m(moved)),
            Axes("/lidar", R_lidar, p_lidar, 0.45),
            Axes("/imu", R_imu, p_imu, 0.3),
            *frame_names(p_lidar, p_imu, breadth_m([moved]), up=stage.up),
            *ground(moved, stage),
        ),
        stage=stage,
        legend=f"{_told(len(pairs), measured, lambda: _thickness(moved, rigid, table))} "
        f"Colour: distance to plane, blue \N{MINUS SIGN}50, {palette.ZERO[dark]} 0, orange +50 mm.",
    )


def _told(sweeps: int, measured: Thickness | None, estimate: Callable[[], tuple[float, float]]) -> str:
    """How thick the walls are: as measured of the answer, or in the sweeps that are shown, as the estimate has them."""
    if measured is not None:
        after_m, before_m = measured.after_rms_m, measured.before_rms_m
        lead = f"{counted(sweeps, 'sweep')} as solved. All walls of the recording:"
    else:
        after_m, before_m = estimate()
        lead = f"{counted(sweeps, 'sweep')} as this estimate has {'it' if sweeps == 1 else 'them'}: walls"
    return f"{lead} {after_m * 1e3:.1f} mm thick ({before_m * 1e3:.1f} mm with the motion left in)."


def steady_up(first: IterationEvent, up_of_planes: FloatArray | None) -> FloatArray | None:
    """(3,) against gravity in the frame of a run's sweeps, the same for all of its steps; None where it is not known.

    first: step of the run.   up_of_planes: in the frame of the planes that were proposed. The two frames are one but where the
    IMU was not yet recorded when the planes were seen: such a run is told from a later scan.
    """
    if not first.gravity_m_s2:
        return up_of_planes
    felt = np.array(first.gravity_m_s2)
    up: FloatArray = -felt / np.linalg.norm(felt)
    return up_of_planes if up_of_planes is not None and float(up @ up_of_planes) > SAME_UP_COS else up


def motion_of(sweep: SweepMotion) -> Trajectory:
    """The lidar's motion through one sweep, constant twist between the instants that are told."""
    from scipy.spatial.transform import Rotation

    return Trajectory(
        epoch_ns=sweep.stamp_ns,
        times_s=np.array(sweep.offset_s, dtype=np.float64),
        R_map_lidar=np.asarray(Rotation.from_quat(np.array(sweep.quaternion_xyzw)).as_matrix(), dtype=np.float64),
        p_map_lidar=np.array(sweep.position_m, dtype=np.float64),
        valid=np.ones(len(sweep.offset_s), dtype=np.bool_),
    )


def _thickness(moved: Float32Array, rigid: Float32Array, table: PlaneTable) -> tuple[float, float]:
    """Spread [m] of the same points about their planes: straightened, and with each sweep as one rigid body."""
    owner, after_m = table.nearest(moved, gate_m=WALL_GATE_M)
    chosen = owner >= 0
    if not chosen.any():
        return 0.0, 0.0
    before_m = table.distances_m(rigid[chosen], owner[chosen])
    return float(np.sqrt(np.mean(after_m[chosen] ** 2))), float(np.sqrt(np.mean(before_m**2)))
