"""Bare numbers, T_imu_lidar: a matrix of four rows, and a line of a TUM trajectory file."""

from __future__ import annotations

from calib_core.exporters.extrinsic import Extrinsic, decimal, decimals, quat_xyzw


def matrix(extrinsic: Extrinsic) -> str:
    """Four rows of four, as `numpy.loadtxt` reads them."""
    rows = [
        f"{decimals(row, ' ')} {decimal(float(p))}"
        for row, p in zip(extrinsic.R_imu_lidar, extrinsic.p_imu_lidar, strict=True)
    ]
    return extrinsic.hash_comments("T_imu_lidar, metres") + "\n".join(rows) + "\n0.0 0.0 0.0 1.0\n"


def tum(extrinsic: Extrinsic) -> str:
    """`timestamp x y z qx qy qz qw` with a timestamp of 0."""
    place, quat = decimals(extrinsic.p_imu_lidar, " "), decimals(quat_xyzw(extrinsic.R_imu_lidar), " ")
    return extrinsic.hash_comments("timestamp x y z qx qy qz qw of T_imu_lidar") + f"0.0 {place} {quat}\n"
