"""Records that travel through the estimator: what one recording is made of, in the order it is read.

Frames, signs and units are those of CONVENTIONS.md. Stamps are integer nanoseconds; float seconds appear after
one subtraction (`relative_s`) of the recording's own epoch.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, overload

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
CountArray = NDArray[np.int32]
BoolArray = NDArray[np.bool_]
ComplexArray = NDArray[np.complex128]
LaserArray = NDArray[np.uint16]

#: One valid lidar return. `xyz` metres in the lidar frame; `offset_ns` after the scan's `stamp_ns` (>= 0).
POINT_DTYPE = np.dtype(
    [("xyz", "<f4", (3,)), ("intensity", "<f4"), ("offset_ns", "<i4"), ("ring", "<u2"), ("reserved", "<u2")]
)
PointArray = NDArray[np.void]

Level = Literal["info", "warning", "error"]


@dataclass(frozen=True, slots=True)
class Clue:
    """One number behind a finding."""

    name: str
    value: float | int | str
    unit: str = ""


#: What is said of accelerations in g whose norm is beyond doubt; of doubtful ones it is said otherwise.
ARE_IN_G = " are in g: "


@dataclass(frozen=True, slots=True)
class Finding:
    """Something detected about a recording: what, how sure, what follows, how to override it.

    code: stable and dotted, e.g. "points.time_field".   confidence: 0..1.
    override: the `calibrate` flag that replaces the detection, e.g. "--point-time-unit ns"; "" if none.
    """

    code: str
    level: Level
    text: str
    evidence: tuple[Clue, ...] = ()
    confidence: float = 1.0
    consequence: str = ""
    override: str = ""


@dataclass(frozen=True, slots=True)
class ImuData:
    """Readings of one IMU in SI units, sorted by stamp, duplicates removed.

    stamps_ns: (Q,) int64, IMU clock.   gyro_rad_s, accel_m_s2: (Q, 3), IMU frame; specific force, +g up at rest.
    stamp_step_ns: the stamps' tick, where several readings bore one stamp and were spread over it; 0 where each had its own.
    """

    stamps_ns: IntArray
    gyro_rad_s: FloatArray
    accel_m_s2: FloatArray
    topic: str = ""
    frame_id: str = ""
    stamp_step_ns: int = 0

    def __post_init__(self) -> None:
        n = self.stamps_ns.shape[0]
        if self.gyro_rad_s.shape != (n, 3) or self.accel_m_s2.shape != (n, 3):
            raise ValueError(f"IMU arrays disagree: {n} stamps, {self.gyro_rad_s.shape}, {self.accel_m_s2.shape}")


@dataclass(frozen=True, slots=True)
class Scan:
    """One sweep: only valid returns, each with its own time.

    index: the message's place in its topic.   stamp_ns: time of the first point, lidar clock.
    points: (N,) POINT_DTYPE, not to be written to.
    """

    index: int
    stamp_ns: int
    points: PointArray

    def __post_init__(self) -> None:
        # A map of a file can only be read. What is in memory is like it, or each compiled loop would be compiled twice, once for
        # either: the second time in somebody's first solve.
        if self.points.flags.writeable:
            points = self.points.view()
            points.flags.writeable = False
            object.__setattr__(self, "points", points)


class KeptScans(Sequence[Scan]):
    """A sequence of scans that lie on disk and are read when they are asked for, by index or slice as those of a list."""

    @overload
    def __getitem__(self, item: int) -> Scan: ...
    @overload
    def __getitem__(self, item: slice) -> list[Scan]: ...
    def __getitem__(self, item: int | slice) -> Scan | list[Scan]:
        if isinstance(item, slice):
            return [self.scan_at(place) for place in range(*item.indices(len(self)))]
        place = item + len(self) if item < 0 else item
        if not 0 <= place < len(self):
            raise IndexError(f"scan {item} of {len(self)}")
        return self.scan_at(place)

    @abstractmethod
    def scan_at(self, place: int) -> Scan:
        """The scan at a place, 0 to len - 1."""


@dataclass(frozen=True, slots=True)
class LidarInfo:
    """What is known of the lidar. `model` is a preset's name or "" where the sensor was not identified."""

    topic: str = ""
    frame_id: str = ""
    layout: str = ""
    model: str = ""
    period_s: float = 0.1


@dataclass(frozen=True)
class Recording:
    """One lidar and one IMU over one time span, decoded.

    scans: in order of their stamps, any sequence (a list, or one backed by a file on disk).
    sha256: of the whole file; "" where it was not hashed.   duration_s: of the whole recording.   scans_total: how many scans the
    lidar sent; 0 where nobody has counted.   findings: what was detected about it.   imu_model: a preset's name, or "".
    coarse_offset_ns: seconds-scale guess of the contract's time offset from receive times where the two header clocks
    have different epochs; 0 where they share one. To be ADDED to IMU stamps to express them in the lidar clock.
    skipped_s: time from the first scan that the whole recording has to the first of these: what counts from here is told with it
    added, as the result's times are.
    """

    name: str
    imu: ImuData
    scans: Sequence[Scan]
    lidar: LidarInfo = field(default_factory=LidarInfo)
    sha256: str = ""
    duration_s: float = 0.0
    coarse_offset_ns: int = 0
    scans_total: int = 0
    findings: tuple[Finding, ...] = ()
    imu_model: str = ""
    skipped_s: float = 0.0

    @property
    def middle_s(self) -> float:
        """Time half way from the first to the last of its scans, counted from the first scan of the whole recording."""
        return self.skipped_s + 0.5e-9 * (self.scans[-1].stamp_ns - self.scans[0].stamp_ns)


@dataclass(frozen=True, slots=True)
class Plane:
    """A plane n . x + w = 0 in the map frame. normal: (3,) unit.

    outline_m: (K, 3) corners of a convex polygon in the plane, map frame, in order: only what lies within it counts.
    None: the plane counts as far as it is seen to reach.   suggested: it was proposed, and nobody has chosen it: it
    is left out of the answer where it turns out to be doubtful.
    """

    name: str
    normal: FloatArray
    offset_m: float
    outline_m: FloatArray | None = None
    suggested: bool = False


@dataclass(frozen=True, slots=True)
class Narrowed:
    """A plane of which only a part is left. whole, left: (K, 3) [m] corners of convex outlines with an area, map frame."""

    whole: FloatArray
    left: FloatArray


@dataclass(frozen=True, slots=True)
class PlanePatch:
    """A detected plane with what a person needs to judge it.

    outline_m: (K, 3) corners of its seen extent, map frame, in order.   rms_m: of its points' distances.
    n_points: inliers.   area_m2: of the cells that they fill.   confirmed: part of the set that the solve will use.
    """

    plane: Plane
    outline_m: FloatArray
    n_points: int
    rms_m: float
    area_m2: float
    confirmed: bool = True


@dataclass(frozen=True)
class PlaneProposals:
    """Planes detected in the reference cloud, and that cloud.

    cloud_m: (N, 3) float32, map frame.   cloud_patch: (N,) int16, index into patches, -1 for none.
    cloud_intensity: (N,) float32.   reference_scans: the scans (positions in Recording.scans) merged into the cloud;
    the map frame is the lidar frame at the first of them, and the platform stood still during all of them where `static`.
    determined: whether that scan's own planes determine a pose; otherwise a later scan's may, and would be the reference.
    """

    patches: tuple[PlanePatch, ...]
    cloud_m: Float32Array
    cloud_patch: NDArray[np.int16]
    cloud_intensity: Float32Array
    reference_scans: tuple[int, ...]
    static: bool
    determined: bool = True


@dataclass(frozen=True, slots=True)
class InitialGuess:
    """Where a solve starts; what is left out (None) is found from the recording.

    R_imu_lidar: (3, 3).   p_imu_lidar: (3,) [m].   time_offset_ns: added to IMU stamps, exact across clock epochs.
    """

    R_imu_lidar: FloatArray | None = None
    p_imu_lidar: FloatArray | None = None
    time_offset_ns: int | None = None


@dataclass(frozen=True)
class Trajectory:
    """The solved motion, dense enough to interpolate (constant twist between knots).

    epoch_ns: subtracted from lidar stamps to get times_s.   times_s: (K,) lidar clock.
    R_map_lidar: (K, 3, 3), p_map_lidar: (K, 3) [m].   valid: (K,) False where nothing supports the pose (bridged gap).
    late_ns: by stamp_ns of a scan, how late that stamp is where a host stamped it; times_s are those at which points were taken.
    """

    epoch_ns: int
    times_s: FloatArray
    R_map_lidar: FloatArray
    p_map_lidar: FloatArray
    valid: BoolArray
    late_ns: Mapping[int, int] = field(default_factory=dict)

    def begin_s(self, scan: Scan) -> float:
        """When the scan's first point was taken, on the clock of times_s."""
        return (scan.stamp_ns - self.late_ns.get(scan.stamp_ns, 0) - self.epoch_ns) * 1e-9
