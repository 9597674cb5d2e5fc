"""The answer in the forms that the exporters share: both directions, quaternion, angles, exact decimals.

Frames: `T_imu_lidar` takes lidar coordinates to IMU coordinates. `tau_ns` is the IMU's stamp minus the lidar's for one
instant, that is minus the contract's time offset.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import sqrt

import numpy as np

from calib_core.errors import InputError
from calib_core.intrinsics import STANDARD_GRAVITY_M_S2
from calib_core.result import CalibrationResult
from calib_core.types import FloatArray

#: A point whose image tells rows from columns, one direction from the other, and every sign.
CHECK_POINT_M = (1.0, 2.0, 3.0)
DECIMALS = 12
#: R R^T may miss the identity by this: entries written with five decimals do, by 2e-5; 0.006 deg is nobody's edit.
ORTHONORMAL = 1e-4
#: Of sensors' parameters that a result only considers.
FOUND_BESIDE = "These were found beside the calibration and not applied to it (`--intrinsics consider`)."


@dataclass(frozen=True, slots=True)
class Extrinsic:
    """What every exporter starts from.

    R_imu_lidar: (3, 3).   p_imu_lidar: (3,) [m], the lidar's origin seen from the IMU.
    time_offset_ns: added to IMU stamps, exact.   notes: what a user of the numbers must know, a sentence each.
    """

    R_imu_lidar: FloatArray
    p_imu_lidar: FloatArray
    time_offset_ns: int
    gyroscope_bias_rad_s: tuple[float, ...]
    accelerometer_bias_m_s2: tuple[float, ...]
    gravity_m_s2: float
    lidar_frame: str
    imu_frame: str
    source: str
    notes: tuple[str, ...]

    @property
    def R_lidar_imu(self) -> FloatArray:
        """(3, 3)."""
        return np.ascontiguousarray(self.R_imu_lidar.T)

    @property
    def p_lidar_imu(self) -> FloatArray:
        """(3,) [m]: the IMU's origin seen from the lidar."""
        return -self.R_imu_lidar.T @ self.p_imu_lidar

    @property
    def tau_ns(self) -> int:
        """The IMU's stamp minus the lidar's, for one instant."""
        return -self.time_offset_ns

    def comments(self) -> list[str]:
        """Lines to put before the numbers: whence they are, the direction, the self-check, the time."""
        point_m = np.array(CHECK_POINT_M)
        image_m = self.R_imu_lidar @ point_m + self.p_imu_lidar
        return [
            f"unsweep: {self.source}",
            f"A point at the lidar's origin is at {_place(self.p_imu_lidar)} m in the IMU frame ({self.imu_frame}).",
            f"Self-check: the lidar's point {_place(point_m)} m is at {_place(image_m)} m in the IMU frame.",
            f"Time: t_lidar = t_imu + ({exact_seconds(self.time_offset_ns)} s).",
            *self.notes,
        ]

    def hash_comments(self, *more: str) -> str:
        """`comments` and what an exporter adds, as lines that begin with a hash sign."""
        return "".join(f"# {line}\n" for line in (*self.comments(), *more))

    def shift_remark(self) -> str:
        """What to do for a program that knows no time offset."""
        return (
            "This program takes no time offset: "
            f"add {exact_seconds(self.time_offset_ns)} s to every IMU stamp of the recording instead."
        )


def extrinsic_of(result: CalibrationResult) -> Extrinsic:
    """The shared forms of a result. Raises InputError where it was refused, for then there is nothing to export."""
    if result.T_imu_lidar is None or result.time_offset_ns is None:
        raise InputError(
            f"Expected a calibration to export, but this result of {result.provenance.recording.name} has the status "
            f"`{result.status}` and holds none; calibrate a recording with more motion first.",
            code="export.refused",
        )
    check_numbers(result)
    recording = result.provenance.recording
    lidar_frame, imu_frame, frame_notes = _frames(recording.lidar_frame_id, recording.imu_frame_id)
    matrix = np.array(result.T_imu_lidar.matrix, dtype=np.float64)
    topics = f"{printable(recording.lidar_topic)} and {printable(recording.imu_topic)}"
    return Extrinsic(
        R_imu_lidar=matrix[:3, :3].copy(),
        p_imu_lidar=matrix[:3, 3].copy(),
        time_offset_ns=result.time_offset_ns,
        gyroscope_bias_rad_s=tuple(result.gyroscope_bias_rad_s or (0.0, 0.0, 0.0)),
        accelerometer_bias_m_s2=tuple(result.accelerometer_bias_m_s2 or (0.0, 0.0, 0.0)),
        gravity_m_s2=STANDARD_GRAVITY_M_S2 if result.gravity_m_s2 is None else result.gravity_m_s2,
        lidar_frame=lidar_frame,
        imu_frame=imu_frame,
        source=f"{printable(recording.name)}, topics {topics}, status {result.status}.",
        notes=(*_drift_notes(result), *frame_notes, *_weak_notes(result)),
    )


def check_numbers(result: CalibrationResult) -> None:
    """Raise InputError unless the document's pose is one: finite, a rotation, its last row 0 0 0 1; and its biases too.

    A file may have been edited, or written half. Programs read a NaN in a URDF as zero, and a mirrored or stretched
    frame as it stands.
    """
    transform = result.T_imu_lidar
    rows = [] if transform is None else transform.matrix
    if [len(row) for row in rows] != [4, 4, 4, 4]:
        raise _no_pose("a matrix T_imu_lidar of 4 rows of 4 numbers", "another shape")
    matrix = np.array(rows, dtype=np.float64)
    if not np.isfinite(matrix).all():
        raise _no_pose("finite numbers in the matrix T_imu_lidar", "one that is not")
    if not np.array_equal(matrix[3], [0.0, 0.0, 0.0, 1.0]):
        raise _no_pose("0 0 0 1 in the last row of the matrix T_imu_lidar", " ".join(f"{each:g}" for each in matrix[3]))
    R = matrix[:3, :3]
    error = float(np.abs(R @ R.T - np.eye(3)).max())
    if error > ORTHONORMAL or float(np.linalg.det(R)) < 0.0:
        found = f"columns that miss that by {error:.2g}" if error > ORTHONORMAL else "a mirror"
        raise _no_pose("a rotation in the matrix T_imu_lidar, its columns at right angles and of length 1", found)
    for name, values in (
        ("gyroscope_bias_rad_s", result.gyroscope_bias_rad_s),
        ("accelerometer_bias_m_s2", result.accelerometer_bias_m_s2),
    ):
        if values is not None and (len(values) != 3 or not np.isfinite(values).all()):
            raise _no_pose(f"three finite numbers as {name}", "others")
    if result.gravity_m_s2 is not None and not 0.0 < result.gravity_m_s2 < np.inf:
        raise _no_pose("a positive gravity_m_s2", f"{result.gravity_m_s2:g}")


def _no_pose(expected: str, found: str) -> InputError:
    return InputError(
        f"Expected {expected}, but found {found} in this result; export the file that the calibration wrote, unchanged.",
        code="export.no_pose",
    )


def _frames(lidar_frame_id: str, imu_frame_id: str) -> tuple[str, str, tuple[str, ...]]:
    """Frame names that a transform tree accepts, and a note where they had to be changed."""
    lidar = _frame_name(lidar_frame_id) or "lidar"
    imu = _frame_name(imu_frame_id) or "imu"
    if lidar != imu:
        return lidar, imu, ()
    note = f"Both sensors name their frame {lidar}; the IMU's is called {imu}_imu here, for a frame has one pose."
    return lidar, f"{imu}_imu", (note,)


def _frame_name(text: str) -> str:
    """Without the leading slash of ROS 1 and without what would break a file or a command line."""
    return re.sub(r"[^\w./-]", "_", text.lstrip("/"))


def printable(text: str) -> str:
    """Text for a comment line: no line breaks and no signs that end a comment in XML or JSON."""
    return re.sub(r"[^\x20-\x7e]", "?", text).replace("--", "- -").replace("*/", "* /")


def _drift_notes(result: CalibrationResult) -> tuple[str, ...]:
    """When the time offset holds, where the clocks do not run alike: a program is given one number, which is soon another."""
    if result.clock_rate_ppm is None or result.time_offset_at_s is None:
        return ()
    holds = f"it holds {result.time_offset_at_s:.3f} s after the recording began"
    # Without rounding's -0.00 for clocks that were found to run alike.
    return (f"The offset changes by {round(result.clock_rate_ppm, 2) + 0.0:.2f} us a second; {holds}.",)


def _weak_notes(result: CalibrationResult) -> tuple[str, ...]:
    if result.status != "weak":
        return ()
    said = tuple(f"Weak: {printable(direction.text)}" for direction in result.observability.weak_directions)
    return said or ("Weak: some of these numbers are known only roughly; see the result's uncertainty.",)


def decimal(value: float) -> str:
    """A number that every parser of YAML, XML and JSON reads as a float: a point, no exponent."""
    text = f"{value:.{DECIMALS}f}".rstrip("0")
    text += "0" if text.endswith(".") else ""
    return "0.0" if text == "-0.0" else text


def exact_seconds(nanoseconds: int) -> str:
    """Integer nanoseconds as decimal seconds, to the last digit: 64-bit floats lose it between clock epochs."""
    whole, part = divmod(abs(nanoseconds), 1_000_000_000)
    text = f"{whole}.{part:09d}".rstrip("0")
    return ("-" if nanoseconds < 0 else "") + text + ("0" if text.endswith(".") else "")


def decimals(values: FloatArray, separator: str = ", ") -> str:
    """Numbers in one line."""
    return separator.join(decimal(float(value)) for value in values)


def quat_xyzw(R: FloatArray) -> FloatArray:
    """(4,) unit quaternion of a rotation, real part last and not negative.   R: (3, 3).

    The largest component is taken from the diagonal, so that no division is by a small number.
    """
    xx, yy, zz = (float(R[i, i]) for i in range(3))
    squares = np.array([1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz, 1 + xx + yy + zz])
    sums_xy, sums_xz, sums_yz = R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1]
    turns_x, turns_y, turns_z = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    products = np.array(
        [
            [squares[0], sums_xy, sums_xz, turns_x],
            [sums_xy, squares[1], sums_yz, turns_y],
            [sums_xz, sums_yz, squares[2], turns_z],
            [turns_x, turns_y, turns_z, squares[3]],
        ]
    )
    largest = int(np.argmax(squares))
    quat: FloatArray = products[largest] / (2.0 * sqrt(squares[largest]))
    quat /= np.linalg.norm(quat)
    return -quat if quat[3] < 0 else quat


def _place(point_m: FloatArray) -> str:
    return "[" + ", ".join(f"{float(value):.6f}" for value in point_m) + "]"
