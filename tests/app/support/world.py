"""A tiny recording with known truth, made without the simulator and without the estimator.

A lidar in a box room 8 x 6 x 4 m (centre at the origin of `map`) turns about z at a constant rate while it moves at a
constant speed; every point is a room point seen from the lidar's exact pose at the point's own time.
"""

from __future__ import annotations

import numpy as np

from calib_core.result import (
    CalibrationResult,
    Evidence,
    Message,
    Observability,
    OffsetProfile,
    Parts,
    PlaneAnswer,
    PlaneQuality,
    Provenance,
    Quality,
    RangeAnswer,
    RecordingProvenance,
    TimeBlock,
    Transform,
    Uncertainty,
)
from calib_core.types import (
    POINT_DTYPE,
    ImuData,
    LidarInfo,
    Plane,
    PlanePatch,
    PlaneProposals,
    Recording,
    Scan,
    Trajectory,
)

EPOCH_NS = 1_700_000_000_000_000_000
PERIOD_S = 0.1
N_SCANS = 12
TURN_RAD_S = 0.9
SPEED_M_S = np.array([0.3, -0.2, 0.1])
HALF_M = np.array([4.0, 3.0, 2.0])
EULER_XYZ_DEG = (10.0, -20.0, 30.0)


def turn(axis, angle_rad):
    """(N, 3, 3) rotations about one coordinate axis by angles (N,)."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.tile(np.eye(3), (len(c), 1, 1))
    R[:, i, i], R[:, j, j], R[:, i, j], R[:, j, i] = c, c, -s, s
    return R


_ROLL, _PITCH, _YAW = (turn(axis, np.radians([angle]))[0] for axis, angle in enumerate(EULER_XYZ_DEG))
R_IMU_LIDAR = _YAW @ _PITCH @ _ROLL
#: From the same angles by the half-angle formulas.
QUAT_XYZW_IMU_LIDAR = [0.12767944, -0.14487813, 0.26853582, 0.94371436]
P_IMU_LIDAR = np.array([0.1, -0.05, 0.2])

#: name, normal, offset: n . x + w = 0, normals pointing inwards.
WALLS = (
    ("floor", (0.0, 0.0, 1.0), 2.0),
    ("ceiling", (0.0, 0.0, -1.0), 2.0),
    ("east", (-1.0, 0.0, 0.0), 4.0),
    ("west", (1.0, 0.0, 0.0), 4.0),
    ("north", (0.0, -1.0, 0.0), 3.0),
    ("south", (0.0, 1.0, 0.0), 3.0),
)


def poses(t_s):
    """R_map_lidar (N, 3, 3) and p_map_lidar (N, 3) at t_s (N,)."""
    t = np.asarray(t_s, dtype=np.float64)
    return turn(2, TURN_RAD_S * t), t[:, None] * SPEED_M_S


def room_points(count, seed):
    """(N, 3) points on the room's six walls and which wall each is on."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.0, 1.0, (count, 3)) * HALF_M * 0.95
    wall = rng.integers(0, 6, count)
    axis = np.array([2, 2, 0, 0, 1, 1])[wall]
    sign = np.array([-1.0, 1.0, 1.0, -1.0, 1.0, -1.0])[wall]
    points[np.arange(count), axis] = sign * HALF_M[axis]
    return points, wall


def make_scan(place, points_per_scan=1500):
    """Scan number `place`, seen while moving, and the room points it saw."""
    start_s = place * PERIOD_S
    offset_ns = np.linspace(0, PERIOD_S * 1e9 * 0.99, points_per_scan).astype(np.int32)
    seen, _ = room_points(points_per_scan, seed=100 + place)
    R, p = poses(start_s + offset_ns * 1e-9)
    points = np.zeros(points_per_scan, dtype=POINT_DTYPE)
    points["xyz"] = np.einsum("nji,nj->ni", R, seen - p)
    points["offset_ns"] = offset_ns
    points["intensity"] = np.arange(points_per_scan) % 100
    return Scan(index=place, stamp_ns=EPOCH_NS + round(start_s * 1e9), points=points), seen


def make_recording():
    """The recording."""
    t_s = np.arange(-50, 200) * 0.01
    gyro_lidar = np.tile([0.0, 0.0, TURN_RAD_S], (len(t_s), 1))
    gyro_lidar[t_s < 0] = 0.0
    imu = ImuData(
        stamps_ns=EPOCH_NS + np.round(t_s * 1e9).astype(np.int64),
        gyro_rad_s=gyro_lidar @ R_IMU_LIDAR.T,
        accel_m_s2=np.tile([0.0, 0.0, 9.81], (len(t_s), 1)),
        topic="/imu",
        frame_id="imu",
    )
    return Recording(
        name="room.bag",
        imu=imu,
        scans=[make_scan(place)[0] for place in range(N_SCANS)],
        lidar=LidarInfo(topic="/points", frame_id="lidar", period_s=PERIOD_S),
        sha256="0" * 64,
        duration_s=N_SCANS * PERIOD_S,
        scans_total=N_SCANS,
    )


def make_trajectory():
    """The exact motion, knots every 10 ms."""
    times_s = np.arange(0.0, N_SCANS * PERIOD_S + 0.02, 0.01)
    R, p = poses(times_s)
    return Trajectory(EPOCH_NS, times_s, R, p, np.ones(len(times_s), dtype=np.bool_))


def plane_quality():
    """The room's planes as a result lists them."""
    return [PlaneQuality(name=n, normal=list(normal), offset_m=w, points=100, rms_m=0.001) for n, normal, w in WALLS]


def make_proposals(seed=7):
    """The room's static cloud with its six patches; a ball of clutter belongs to none."""
    cloud, wall = room_points(6000, seed)
    clutter = np.random.default_rng(seed).normal(size=(200, 3)) * 0.2 + [1.0, 1.0, 0.0]
    patches = []
    for k, (name, normal, w) in enumerate(WALLS):
        n = np.array(normal)
        first = np.cross(n, [0.3, 0.5, 0.8])
        first /= np.linalg.norm(first)
        second = np.cross(n, first)
        mine = cloud[wall == k]
        u, v = mine @ first, mine @ second
        square = np.array([(u.min(), v.min()), (u.max(), v.min()), (u.max(), v.max()), (u.min(), v.max())])
        outline = square[:, :1] * first + square[:, 1:] * second - w * n
        patches.append(PlanePatch(Plane(name, n, w), outline, int((wall == k).sum()), 0.0, 10.0, confirmed=k < 5))
    return PlaneProposals(
        patches=tuple(patches),
        cloud_m=np.concatenate([cloud, clutter]).astype(np.float32),
        cloud_patch=np.concatenate([wall, np.full(200, -1)]).astype(np.int16),
        cloud_intensity=np.zeros(6200, dtype=np.float32),
        reference_scans=(0, 1),
        static=True,
    )


def transform_matrix():
    """T_imu_lidar."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R_IMU_LIDAR, P_IMU_LIDAR
    return T


def make_evidence():
    """Eight stretches about the truth, the third hardly turned; six planes, two halves, and a peak at the answer."""
    own = {
        "rotation_shift_deg": [0.01, -0.02, 0.0],
        "translation_shift_m": [0.001, -0.002, 0.0005],
        "time_offset_shift_s": -0.0002,
        "rotation_std_deg": [0.03, 0.02, 0.01],
        "translation_std_m": [0.002, 0.001, 0.003],
        "time_offset_std_s": 0.0003,
    }
    blocks = [TimeBlock(t_start_s=0.15 * k, t_end_s=0.15 * (k + 1), **own) for k in range(8)]
    blocks[2] = blocks[2].model_copy(update={"rotation_std_deg": [57.3] * 3})
    away_s = 0.01 * np.arange(-50, 51)
    return Evidence(
        parts=Parts(
            time_blocks=blocks,
            planes=[PlaneAnswer(name=name, **own) for name, _, _ in WALLS],
            ranges=[RangeAnswer(from_m=0.5, to_m=2.0, **own), RangeAnswer(from_m=2.0, to_m=7.0, **own)],
        ),
        time_offset_profile=OffsetProfile(
            first_s=-0.5,
            step_s=0.01,
            likeness=[None, *(float(value) for value in np.exp(-((away_s[1:] / 0.2) ** 2)))],
            best_s=0.0004,
            text="The highest, 1.000, is at +0.4 ms, which agrees with the answer.",
        ),
    )


def make_result(status="calibrated", name="room.bag"):
    """A result document around the truth."""
    answered = status != "refused"
    transform = Transform(
        matrix=transform_matrix().tolist(),
        translation_m=P_IMU_LIDAR.tolist(),
        quaternion_xyzw=QUAT_XYZW_IMU_LIDAR,
        euler_xyz_deg=list(EULER_XYZ_DEG),
    )
    uncertainty = Uncertainty(
        rotation_std_deg=[0.01, 0.02, 0.03],
        translation_std_m=[0.001, 0.002, 0.003],
        time_offset_std_s=0.0004,
        gravity_std_m_s2=0.01,
        covariance=np.eye(7).tolist(),
    )
    return CalibrationResult(
        status=status,
        messages=[] if answered else [Message(code="motion.none", level="error", text="Nothing moves; record motion.")],
        T_imu_lidar=transform if answered else None,
        time_offset_s=0.004 if answered else None,
        time_offset_ns=4_000_000 if answered else None,
        gyroscope_bias_rad_s=[0.0] * 3 if answered else None,
        accelerometer_bias_m_s2=[0.0] * 3 if answered else None,
        gravity_m_s2=9.81 if answered else None,
        uncertainty=uncertainty if answered else None,
        observability=Observability(),
        quality=Quality(
            point_to_plane_rms_m=0.001,
            points_used=1000,
            scans_used=N_SCANS,
            scans_total=N_SCANS,
            planes=plane_quality() if answered else [],
            iterations=5,
            duration_s=1.0,
        ),
        provenance=Provenance(
            recording=RecordingProvenance(
                name=name,
                sha256="0" * 64,
                duration_s=1.2,
                lidar_topic="/points",
                imu_topic="/imu",
                lidar_frame_id="lidar",
                imu_frame_id="imu",
            ),
            settings={},
            software={"unsweep": "test"},
        ),
        evidence=make_evidence() if answered else None,
    )
