"""What goes into and comes out of the paper's method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from calib_core.gp import Smoothness
from calib_core.types import Finding, FloatArray, IntArray, Plane, Trajectory


@dataclass(frozen=True, slots=True)
class ImuStates:
    """IMU states at scans' first points, world z up. R (M, 3, 3) world <- imu, p [m], v [m/s] (M, 3)."""

    R: FloatArray
    p: FloatArray
    v: FloatArray


@dataclass(frozen=True, slots=True)
class PaperOptions:
    """What the paper fixes, and what its experiments change. The defaults are the published method.

    fixed_states: the IMU states of all scans, by position in the recording, taken as known (IV-A.3, IV-A.4).
    motion_in_sweep: "upsampled" as published; "held": preintegration of raw readings, each held until the next;
    "none": a scan's points all seen from the pose of its first one. The last two are models for table I (ii).
    eq_3: "midpoint" with the 1/2 that it lacks, reading and attitude taken in mid-step; "printed" to the letter, without it,
    and with both taken at the step's start.
    relinearise: preintegrate again about the estimate before each refinement round; the paper expands about the prior
    only.
    """

    fixed_states: ImuStates | None = None
    motion_in_sweep: Literal["upsampled", "held", "none"] = "upsampled"
    eq_3: Literal["midpoint", "printed"] = "midpoint"
    relinearise: bool = False
    refinement_rounds: int = 3
    iterations_per_round: int = 20
    upsampling_hz: float = 1000.0
    smoothness: Smoothness = "5/2"


@dataclass(frozen=True, slots=True)
class TrackedScan:
    """One scan whose planes were all found: its rough pose, and the points on its planes that the solve will use.

    position: in Recording.scans.   start_s: its first point [s, lidar clock].   points_lidar: (n, 3) [m].
    elapsed_s: (n,) since start_s.   plane: (n,) index into the map's planes.   R_map_lidar (3, 3), p_map_lidar (3,)
    [m]: eq. (13), of all its points, which holds at pose_s, their mean time.
    """

    position: int
    start_s: float
    points_lidar: FloatArray
    elapsed_s: FloatArray
    plane: IntArray
    R_map_lidar: FloatArray
    p_map_lidar: FloatArray
    pose_s: float


@dataclass(frozen=True, slots=True)
class FrontEnd:
    """Everything the solve needs from the lidar.

    epoch_ns: the first scan's stamp, subtracted from all.
    planes: the map, fixed from the first scan.   scans: the tracked ones in order, the first included.
    dropped: positions of scans whose planes were lost.   range_std_m: along the beam, from the first scan's points.
    """

    epoch_ns: int
    planes: tuple[Plane, ...]
    scans: tuple[TrackedScan, ...]
    dropped: tuple[int, ...]
    range_std_m: float


@dataclass(frozen=True, slots=True)
class PlaneFitQuality:
    """How well one plane's points fit at the end. rms_m: of their distances. n_points: used in the solve."""

    plane: Plane
    n_points: int
    rms_m: float


@dataclass(frozen=True)
class PaperSolution:
    """The paper's answer.

    R_imu_lidar: (3, 3).   p_imu_lidar: (3,) [m].   time_offset_s, time_offset_ns: the contract's, added to IMU stamps.
    gyro_bias_rad_s, accel_bias_m_s2: (3,).   gravity_m_s2: assumed, not estimated.   covariance: (7, 7) in the
    contract's order, from the cost's own weights: with eq. (14)'s lambda it is not the errors' covariance, and is
    reported as is.
    planes: the fixed map with its residuals.   rms_m: over all points.   converged: the last round's.
    """

    R_imu_lidar: FloatArray
    p_imu_lidar: FloatArray
    time_offset_s: float
    time_offset_ns: int
    gyro_bias_rad_s: FloatArray
    accel_bias_m_s2: FloatArray
    gravity_m_s2: float
    covariance: FloatArray
    planes: tuple[PlaneFitQuality, ...]
    rms_m: float
    points_used: int
    scans_used: int
    scans_dropped: int
    scans_total: int
    iterations: int
    converged: bool
    cost: float
    trajectory: Trajectory
    messages: tuple[Finding, ...]
