"""Planes followed by their normals, figure 4 of the paper."""

import numpy as np
from scipy.spatial.transform import Rotation

from calib_core.paper.plane_tracking import match_normals

#: A corner's three faces, seen from inside.
CORNER = np.eye(3)


def turned(rotvec_deg, normals=CORNER):
    """The normals in a frame turned by a rotation vector."""
    return normals @ Rotation.from_rotvec(rotvec_deg, degrees=True).as_matrix()


def test_order_of_detection_does_not_matter():
    """Each plane is found wherever it is in the list.

    Mutation: returning positions within the choice, not in the list.
    """
    order = np.array([2, 0, 1])
    match = match_normals(CORNER, turned([5.0, -8.0, 4.0])[order])
    np.testing.assert_array_equal(order[match], [0, 1, 2])


def test_centroid_makes_the_match_more_robust():
    """A turn at which plain nearest neighbours confuse two planes. Mutation: no subtraction of the centroids."""
    rng = np.random.default_rng(70)
    plain_fails, ours_fails = 0, 0
    for _ in range(300):
        axis = rng.normal(size=3)
        now = turned(52.0 * axis / np.linalg.norm(axis))
        plain = np.argmin(np.linalg.norm(CORNER[:, None] - now[None], axis=2), axis=1)
        ours = match_normals(CORNER, now, max_turn_rad=2.0)
        plain_fails += not np.array_equal(plain, [0, 1, 2])
        ours_fails += ours is None or not np.array_equal(ours, [0, 1, 2])
    assert plain_fails > 40
    assert ours_fails < plain_fails / 2


def test_furniture_is_left_out():
    """More planes than are followed: the ones that fit best are taken. Mutation: only the first P are looked at."""
    table, cupboard = np.array([0.0, 0.6, 0.8]), np.array([-0.8, 0.6, 0.0])
    now = turned([3.0, 2.0, -6.0])
    seen = np.stack([table, now[1], cupboard, now[0], now[2]])
    np.testing.assert_array_equal(match_normals(CORNER, seen), [3, 1, 4])


def test_a_lost_plane_is_said_to_be_lost():
    """Two of three planes, or none, or a turn beyond belief: None. Mutation: no limit on the turn."""
    now = turned([2.0, 2.0, 2.0])
    assert match_normals(CORNER, now[:2]) is None
    assert match_normals(CORNER, np.zeros((0, 3))) is None
    assert match_normals(CORNER, np.stack([now[0], now[1], -now[2]])) is None
    far = turned([33.0, 0.0, 0.0])
    assert match_normals(CORNER, far, max_turn_rad=0.5) is None
    np.testing.assert_array_equal(match_normals(CORNER, far, max_turn_rad=0.6), [0, 1, 2])
