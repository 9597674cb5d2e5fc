"""A decoded recording as one array file: any scan is a slice of a memory map, shown at once and never copied."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, TypeAdapter

from app.arrays.folder import is_whole, verify, whole_folder
from calib_core.types import (
    POINT_DTYPE,
    Clue,
    Finding,
    FloatArray,
    ImuData,
    IntArray,
    KeptScans,
    LidarInfo,
    PointArray,
    Recording,
    Scan,
)


class _EvidenceText(BaseModel):
    model_config = ConfigDict(from_attributes=True, allow_inf_nan=False)
    name: str
    value: float | int | str
    unit: str


class _FindingText(BaseModel):
    model_config = ConfigDict(from_attributes=True, allow_inf_nan=False)
    code: str
    level: Literal["info", "warning", "error"]
    text: str
    evidence: list[_EvidenceText]
    confidence: float
    consequence: str
    override: str


class _LidarText(BaseModel):
    model_config = ConfigDict(from_attributes=True, allow_inf_nan=False)
    topic: str
    frame_id: str
    layout: str
    model: str
    period_s: float


class _RecordingText(BaseModel):
    """Everything of a recording that is no array."""

    model_config = ConfigDict(from_attributes=True, allow_inf_nan=False)
    name: str
    lidar: _LidarText
    imu_topic: str
    imu_frame_id: str
    sha256: str
    duration_s: float
    coarse_offset_ns: int
    scans_total: int
    skipped_s: float = 0.0
    findings: list[_FindingText]
    imu_model: str


class CachedScans(KeptScans):
    """Scans as slices of one memory-mapped array.

    points: (P,) POINT_DTYPE of all scans in order.   starts: (M + 1,) first point of each scan, then P.
    index, stamps_ns: (M,).
    """

    def __init__(self, points: PointArray, starts: IntArray, index: IntArray, stamps_ns: IntArray) -> None:
        self.points = points
        self.starts = starts
        self.message_index = index
        self.stamps_ns = stamps_ns

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def scan_at(self, place: int) -> Scan:
        """The scan at a place from 0 on."""
        points = self.points[self.starts[place] : self.starts[place + 1]]
        return Scan(index=int(self.message_index[place]), stamp_ns=int(self.stamps_ns[place]), points=points)


def write_recording(folder: Path, recording: Recording) -> None:
    """Write a decoded recording to `folder`, whole or not at all."""
    scans = recording.scans
    sizes = np.array([len(scan.points) for scan in scans], dtype=np.int64)
    starts = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(sizes)])
    with whole_folder(folder) as fresh:
        # Written, not mapped: a map of a file for which the disk has no room ends the process instead of failing.
        with (fresh / "points.npy").open("wb") as file:
            header = {"descr": np.lib.format.dtype_to_descr(POINT_DTYPE), "fortran_order": False}
            np.lib.format.write_array_header_1_0(file, header | {"shape": (int(starts[-1]),)})
            for scan in scans:
                file.write(np.ascontiguousarray(scan.points, dtype=POINT_DTYPE).view(np.uint8).data)
        np.savez(
            fresh / "stamps.npz",
            starts=starts,
            index=np.array([scan.index for scan in scans], dtype=np.int64),
            stamps_ns=np.array([scan.stamp_ns for scan in scans], dtype=np.int64),
            imu_stamps_ns=recording.imu.stamps_ns,
            gyro_rad_s=recording.imu.gyro_rad_s,
            accel_m_s2=recording.imu.accel_m_s2,
        )
        text = _RecordingText(
            name=recording.name,
            lidar=_LidarText.model_validate(recording.lidar),
            imu_topic=recording.imu.topic,
            imu_frame_id=recording.imu.frame_id,
            sha256=recording.sha256,
            duration_s=recording.duration_s,
            coarse_offset_ns=recording.coarse_offset_ns,
            scans_total=recording.scans_total,
            skipped_s=recording.skipped_s,
            findings=TypeAdapter(list[_FindingText]).validate_python(list(recording.findings), from_attributes=True),
            imu_model=recording.imu_model,
        )
        (fresh / "recording.json").write_text(text.model_dump_json(), encoding="utf-8")


def recording_arrays(cache: Path) -> Path:
    """Where the decoded recording is kept."""
    return cache / "recording"


def has_recording(folder: Path) -> bool:
    """Whether a decoded recording is there."""
    return is_whole(folder)


def read_recording(folder: Path) -> Recording:
    """The recording as it was written, or DamagedArrays; its points stay on disk until they are touched."""
    verify(folder)
    text = _RecordingText.model_validate_json((folder / "recording.json").read_text(encoding="utf-8"))
    with np.load(folder / "stamps.npz", allow_pickle=False) as arrays:
        imu = ImuData(
            stamps_ns=arrays["imu_stamps_ns"],
            gyro_rad_s=arrays["gyro_rad_s"],
            accel_m_s2=arrays["accel_m_s2"],
            topic=text.imu_topic,
            frame_id=text.imu_frame_id,
        )
        starts, index, stamps_ns = arrays["starts"], arrays["index"], arrays["stamps_ns"]
    return Recording(
        name=text.name,
        imu=imu,
        scans=CachedScans(_points(folder / "points.npy"), starts, index, stamps_ns),
        lidar=LidarInfo(**text.lidar.model_dump()),
        sha256=text.sha256,
        duration_s=text.duration_s,
        coarse_offset_ns=text.coarse_offset_ns,
        scans_total=text.scans_total,
        skipped_s=text.skipped_s,
        findings=tuple(_finding(found) for found in text.findings),
        imu_model=text.imu_model,
    )


def _points(path: Path) -> PointArray:
    try:
        points: PointArray = np.load(path, mmap_mode="r", allow_pickle=False)
    except ValueError:  # a memory map of nothing is refused
        points = np.zeros(0, dtype=POINT_DTYPE)
    return points


def _finding(found: _FindingText) -> Finding:
    return Finding(
        code=found.code,
        level=found.level,
        text=found.text,
        evidence=tuple(Clue(name=e.name, value=e.value, unit=e.unit) for e in found.evidence),
        confidence=found.confidence,
        consequence=found.consequence,
        override=found.override,
    )


def relative_s(stamps_ns: IntArray, epoch_ns: int) -> FloatArray:
    """(N,) seconds after the epoch: one subtraction of integers, then floats."""
    seconds: NDArray[np.float64] = (stamps_ns - epoch_ns).astype(np.float64) * 1e-9
    return seconds
