"""The least report the doctor can write."""

from __future__ import annotations

from calib_core.doctor.report import DoctorReport, Timeline


def make_report(name):
    """A report on nothing."""
    return DoctorReport(
        name=name,
        size_bytes=9,
        container="ros1",
        duration_s=1.2,
        start_ns=0,
        topics=(),
        lidar_candidates=(),
        imu_candidates=(),
        lidar=None,
        imu=None,
        clock_offset_s=0.0,
        timeline=Timeline(),
        findings=(),
        verdict="good",
        reasons=(),
        advice=(),
    )
