"""The lidar's motion carried by the IMU alone for three seconds at a time, with a given extrinsic.

A solved trajectory follows the lidar wherever planes are seen, and hardly shows that it was solved with a wrong
extrinsic. Carried by the IMU, as odometry programs do between two corrections, it shows: over a piece of 3 s

    R(t) = R_0 Exp(gyroscope - b_g),      p(t) = p_0 + v_0 t + g t^2 / 2 + D(t) - B(t) b_a
    D = double integral of R(t) accelerometer,   B = double integral of R(t)

R_0, p_0 and v_0 are fitted to the solved motion in every piece, g and b_a once for all of them. What a wrong rotation,
lever arm or time offset does to the pieces' shape is left in, and smears the room.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from calib_core.deskew import lidar_poses
from calib_core.geometry import exp, log
from calib_core.types import BoolArray, FloatArray, ImuData, Trajectory

#: Long enough that a lever arm 20 mm off bends a piece by millimetres: on paper-normal, attic and ouster the room's entropy
#: then tells it apart from the right one, with a third of this it does not.
PIECE_S = 3.0
#: How well the accelerometer's bias is known before: keeps it apart from gravity where the rig hardly turns.
_BIAS_STD_M_S2 = 0.1
#: What the fit of the pieces is trusted to, in the same weighting.
_PLACE_STD_M = 0.005
_FEWEST_READINGS = 10


@dataclass(frozen=True, slots=True)
class Mounting:
    """An extrinsic to carry with. R_imu_lidar: (3, 3).   p_imu_lidar: (3,) [m].   time_offset_ns: added to IMU stamps."""

    R_imu_lidar: FloatArray
    p_imu_lidar: FloatArray
    time_offset_ns: int


@dataclass(frozen=True, slots=True)
class _Piece:
    """Readings first..last of the IMU, and the solved motion of the IMU there. t_s: (Q,) from the piece's middle."""

    first: int
    t_s: FloatArray
    R_map_imu: FloatArray
    solved_p_m: FloatArray
    force_m: FloatArray
    turned_m: FloatArray


def carried(
    trajectory: Trajectory, imu: ImuData, mounting: Mounting, gyro_bias_rad_s: FloatArray, *, piece_s: float = PIECE_S
) -> Trajectory | None:
    """The motion of `trajectory`, carried by the IMU within pieces; None where the two share no whole piece."""
    lidar_ns = imu.stamps_ns + (mounting.time_offset_ns - trajectory.epoch_ns)
    times_s: FloatArray = lidar_ns.astype(np.float64) * 1e-9
    inside = (times_s >= trajectory.times_s[0]) & (times_s <= trajectory.times_s[-1])
    pieces = [
        _piece(trajectory, imu, mounting, gyro_bias_rad_s, times_s, chosen)
        for chosen in _spans(times_s, inside, piece_s)
    ]
    if not pieces:
        return None
    gravity, bias = _gravity_and_bias(pieces)
    rows = [np.arange(piece.first, piece.first + piece.t_s.size) for piece in pieces]
    R_map_imu = np.concatenate([piece.R_map_imu for piece in pieces])
    p_map_imu = np.concatenate([_places_m(piece, gravity, bias) for piece in pieces])
    at_s = times_s[np.concatenate(rows)]
    return replace(
        trajectory,
        times_s=at_s,
        R_map_lidar=R_map_imu @ mounting.R_imu_lidar,
        p_map_lidar=p_map_imu + R_map_imu @ mounting.p_imu_lidar,
        valid=_valid_at(trajectory, at_s),
    )


def _spans(times_s: FloatArray, inside: BoolArray, piece_s: float) -> list[slice]:
    """Readings of each piece, pieces side by side from the first reading inside on."""
    at = np.flatnonzero(inside)
    if at.size < _FEWEST_READINGS:
        return []
    number = np.floor((times_s[at] - times_s[at[0]]) / piece_s).astype(np.int64)
    starts = np.searchsorted(number, np.arange(number[-1] + 2))
    spans = [slice(int(at[a]), int(at[b - 1]) + 1) for a, b in itertools.pairwise(starts) if b > a]
    return [span for span in spans if span.stop - span.start >= _FEWEST_READINGS]


def _piece(
    trajectory: Trajectory,
    imu: ImuData,
    mounting: Mounting,
    gyro_bias_rad_s: FloatArray,
    times_s: FloatArray,
    chosen: slice,
) -> _Piece:
    t_s = times_s[chosen]
    R_solved, p_solved = lidar_poses(trajectory, t_s)
    R_solved = R_solved @ mounting.R_imu_lidar.T
    rate = imu.gyro_rad_s[chosen] - gyro_bias_rad_s
    steps = exp(0.5 * (rate[1:] + rate[:-1]) * np.diff(t_s)[:, None])
    R = np.empty((t_s.size, 3, 3))
    R[0] = np.eye(3)
    for k, step in enumerate(steps):
        R[k + 1] = R[k] @ step
    # The turn on the left that fits best: the middle of those that fit each instant.
    start = R_solved[t_s.size // 2] @ R[t_s.size // 2].T
    start = exp(log(R_solved @ np.swapaxes(start @ R, 1, 2)).mean(axis=0)[None])[0] @ start
    R = start @ R
    force = (R @ imu.accel_m_s2[chosen][..., None])[..., 0]
    middle_s = t_s - 0.5 * (t_s[0] + t_s[-1])
    force_m = _twice_integrated(force, middle_s)
    turned_m = _twice_integrated(R.reshape(-1, 9), middle_s).reshape(-1, 3, 3)
    p_imu = p_solved - (R_solved @ mounting.p_imu_lidar)
    return _Piece(chosen.start, middle_s, R, p_imu, force_m, turned_m)


def _twice_integrated(values: FloatArray, t_s: FloatArray) -> FloatArray:
    """(Q, C): the double integral from the first instant, values taken as straight between instants."""
    h = np.diff(t_s)[:, None]
    speed = np.vstack([np.zeros((1, values.shape[1])), np.cumsum(0.5 * h * (values[1:] + values[:-1]), axis=0)])
    steps = h * speed[:-1] + h**2 * (2.0 * values[:-1] + values[1:]) / 6.0
    return np.vstack([np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)])


def _gravity_and_bias(pieces: list[_Piece]) -> tuple[FloatArray, FloatArray]:
    """Gravity in the map frame and the accelerometer's bias, (3,) [m/s2] each; places and velocities are left free."""
    information = np.diag([0.0] * 3 + [1.0 / _BIAS_STD_M_S2**2] * 3)
    vector = np.zeros(6)
    for piece in pieces:
        columns = np.concatenate(
            [0.5 * piece.t_s[:, None, None] ** 2 * np.eye(3), -piece.turned_m], axis=2
        )  # (Q, 3, 6)
        rows = _without_line(columns.reshape(piece.t_s.size, 18), piece.t_s).reshape(-1, 6)
        wanted = _without_line(piece.solved_p_m - piece.force_m, piece.t_s).reshape(-1)
        information += rows.T @ rows / _PLACE_STD_M**2
        vector += rows.T @ wanted / _PLACE_STD_M**2
    solution = np.asarray(np.linalg.lstsq(information, vector, rcond=None)[0], dtype=np.float64)
    return solution[:3], solution[3:]


def _places_m(piece: _Piece, gravity: FloatArray, bias: FloatArray) -> FloatArray:
    """(Q, 3) [m]: the IMU's places, with the place and velocity that fit the solved motion best."""
    shape = piece.force_m + 0.5 * piece.t_s[:, None] ** 2 * gravity - piece.turned_m @ bias
    left = piece.solved_p_m - shape
    return shape + (left - _without_line(left, piece.t_s))


def _without_line(values: FloatArray, t_s: FloatArray) -> FloatArray:
    """(Q, C): what a straight line over time leaves of each column. t_s: from the middle, evenly enough."""
    line = np.stack([np.ones_like(t_s), t_s], axis=1)
    return values - line @ np.linalg.lstsq(line, values, rcond=None)[0]


def _valid_at(trajectory: Trajectory, at_s: FloatArray) -> BoolArray:
    """Whether the solved motion is known on both sides of an instant."""
    k = np.clip(np.searchsorted(trajectory.times_s, at_s, side="right") - 1, 0, trajectory.times_s.size - 2)
    return np.asarray(trajectory.valid[k] & trajectory.valid[k + 1], dtype=bool)
