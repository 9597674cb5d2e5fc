"""A loop is compiled for one kind of array, whatever the caller has: each further kind is seconds of somebody's first solve.

Oracle: Numba's own account of what it has compiled, and of what it would tell apart.
"""

from __future__ import annotations

import numba
import numpy as np

from calib_core.factors.imu import KnotStates
from calib_core.factors.kernels import hits_kernel
from calib_core.factors.laser_features import LaserErrors
from calib_core.factors.laser_kernels import correct_kernel
from calib_core.factors.lidar_plane import Gate, find_hits
from calib_core.full.joint import motion
from calib_core.full.odometry.plane_map import PlaneMap
from calib_core.imu.preintegration import UpsampledImu
from calib_core.types import POINT_DTYPE, FloatArray, PointArray
from tests.core.factors import three_planes


def _kinds(xyz: FloatArray) -> list[PointArray]:
    """The same points: of records to be written to, of others that are not, and by themselves."""
    records = np.zeros(len(xyz), POINT_DTYPE)
    records["xyz"] = xyz
    kept = records.view()
    kept.flags.writeable = False
    return [kept["xyz"], records["xyz"], np.array(xyz, np.float32)]


def test_points_of_every_kind_meet_planes_and_are_corrected_by_one_loop() -> None:
    """Mutation: points passed on as they came."""
    scene = three_planes.scanned(3, n=50)
    off = LaserErrors(*(np.full(1, 0.01) for _ in range(5)))
    for kernel, called in (
        (
            hits_kernel,
            lambda xyz: find_hits(
                xyz, scene.offset_s, scene.poses, three_planes.NORMALS, three_planes.OFFSETS_M, Gate()
            ),
        ),
        (correct_kernel, lambda xyz: off.corrected(xyz, np.zeros(len(xyz), np.uint16))),
    ):
        first, *others = _kinds(scene.xyz)
        called(first)
        before = len(kernel.signatures)
        for xyz in others:
            called(xyz)
        assert len(kernel.signatures) == before, kernel


def _motion(R: FloatArray, p: FloatArray, knots_s: FloatArray) -> motion.Motion:
    n, none = len(knots_s), np.zeros((len(knots_s), 3))
    links = np.zeros((n - 1, 2, 3))
    readings = UpsampledImu(knots_s, 0.01, links, links, none, none, np.zeros((n - 1, 6)), np.ones(n - 1, bool))
    return motion.Motion(readings, KnotStates(R, p, none), none, none, np.zeros(3))


def test_poses_between_knots_come_of_one_loop_whatever_they_are_parts_of() -> None:
    """Mutation: states, knots or instants passed on as they are."""
    R, p = np.tile(np.eye(3), (9, 1, 1)), np.zeros((9, 3))
    knots_s, extrinsic = 0.01 * np.arange(9), np.eye(4)
    _motion(R, p, knots_s).lidar_at(knots_s, np.eye(3), np.zeros(3))
    before = len(motion._between_knots.signatures), len(motion._on_the_imu.signatures)
    for states in (KnotStates(R[::2], p[::2], p), KnotStates(R, p, p)):
        knots = 0.01 * np.arange(2 * len(states.R))[::2]
        _motion(states.R, states.p, knots).lidar_at(knots[::2], extrinsic[:3, :3], extrinsic[:3, 3])
    assert (len(motion._between_knots.signatures), len(motion._on_the_imu.signatures)) == before


def test_one_plane_is_looked_for_by_the_same_loop_as_several() -> None:
    """Mutation: the planes' axes passed on as they are made, of several in another order than of one."""
    some = (PlaneMap(np.eye(3)[:count], np.zeros(count)) for count in (1, 3))
    one, several = (numba.typeof(planes.surfaces(1.0)) for planes in some)
    assert one == several
