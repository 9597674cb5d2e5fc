"""Which of a track's planes are those that were proposed: found anew in the straightened scan, they are in another order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.full.initialise.proposed_planes import late_and_dropped, lost, matched, named, own_and_merged, tracked
from calib_core.full.odometry.reference import Followed
from calib_core.types import Plane


def plane(number: int, x: float, y: float, z: float, offset_m: float) -> Plane:
    normal = np.array([x, y, z])
    return Plane(f"plane {number}", normal / np.linalg.norm(normal), offset_m, suggested=True)


#: Of an attic, in the scan as it was taken on the move, and in the straightened one: its slope is there twice, a wall is new.
PROPOSALS = (
    plane(1, 0.612, 0.459, -0.644, 1.314),
    plane(2, 0.627, -0.778, -0.028, 2.765),
    plane(3, -0.191, -0.189, 0.963, 0.96),
    plane(4, -0.269, -0.126, -0.955, 1.543),
)
STRAIGHT = [
    plane(1, 0.566, 0.459, -0.684, 1.378),
    plane(2, -0.189, -0.188, 0.964, 0.963),
    plane(3, 0.601, 0.471, -0.645, 1.332),
    plane(4, 0.632, -0.774, -0.027, 2.769),
    plane(5, -0.782, -0.557, -0.281, 3.27),
]
UP = STRAIGHT[1].normal
FOLLOWED = Followed(
    0, STRAIGHT, [], proposals=PROPOSALS, of_proposal=tuple(matched(STRAIGHT, PROPOSALS).tolist())
)  # fmt: skip


def test_a_straightened_scan_s_planes_are_the_proposals_that_they_lie_on() -> None:
    """Seen: the first seven of eight taken for seven proposals. Mutations: by their order; the first that it may be; across."""
    assert FOLLOWED.of_proposal == (0, 2, 0, 1, -1)
    steep = [replace(PROPOSALS[0], offset_m=1.1), PROPOSALS[0]]
    assert matched([STRAIGHT[2]], steep).tolist() == [1]
    assert matched([STRAIGHT[1]], []).tolist() == [-1]


def test_no_two_planes_have_one_name_and_each_has_its_proposal_s() -> None:
    """Seen: two slopes called "slope 1", a wall "slope 2". Mutations: both by the name given; numbered by their order."""
    assert [p.name for p in named(FOLLOWED, (), UP).planes] == ["slope 1", "floor", "slope 3", "wall", "wall 2"]
    given = [replace(PROPOSALS[0], name="roof"), replace(PROPOSALS[3], name="slope 2")]
    assert [p.name for p in named(FOLLOWED, given, UP).planes] == ["roof", "floor", "slope", "wall", "wall 2"]
    away = replace(FOLLOWED, proposals=(), of_proposal=())
    assert [p.name for p in named(away, given, UP).planes] == ["slope", "floor", "slope 2", "wall", "wall 2"]


def test_what_was_dropped_is_dropped_as_often_as_it_is_seen() -> None:
    """And as it was proposed, where the track has lost it. Mutations: by their order; the second slope comes back; a chosen one
    that nobody proposed counted twice; the lost one without its name.
    """
    track = named(FOLLOWED, (), UP)
    late, dropped = late_and_dropped(track, PROPOSALS[1:3])
    assert [p.name for p in late] == ["wall 2"]
    assert [p.name for p in dropped] == ["slope 1", "slope 3", "slope 2"]
    late, dropped = late_and_dropped(track, [*PROPOSALS, STRAIGHT[4]])
    assert (late, dropped) == ([], [])
    assert [p.name for p in lost(track)] == ["slope 2"]


def test_what_is_chosen_is_the_track_s_plane_of_that_proposal() -> None:
    """However far the motion has turned it. Seen: a slope turned by 21 deg counted twice, once as a choice of nobody's.

    Mutations: by where it lies alone; by the proposal alone; the first that it may be; one for which there is none.
    """
    track = named(FOLLOWED, (), UP)
    wall_2 = track.planes[4]
    hand = Plane("by hand", np.array([0.0, 0.6, 0.8]), 5.0)
    chosen = [PROPOSALS[3], PROPOSALS[1], PROPOSALS[2], wall_2, hand]
    assert tracked(track, chosen).tolist() == [-1, 3, 1, 4, -1]
    assert tracked(track, [PROPOSALS[0]]).tolist() == [2]  # of two that are this slope, the nearer
    away = replace(track, proposals=(), of_proposal=())
    assert tracked(away, chosen).tolist() == [-1, 3, 1, 4, -1]
    turned = replace(track, planes=[replace(p, normal=p.normal[[1, 2, 0]]) for p in track.planes])
    assert tracked(turned, [PROPOSALS[1], wall_2]).tolist() == [3, -1]


def test_proposals_that_the_straightened_sweep_does_not_have_are_merged() -> None:
    """Seen: a floor proposed twice, and a bent sweep's wall beside the true one, which then did not fit. Mutations: those
    insisted on too; one that is there twice kept; the first of two goes.
    """
    track = named(FOLLOWED, (), UP)
    again = replace(PROPOSALS[2], name="floor again", offset_m=1.0)
    choice = [PROPOSALS[2], again, PROPOSALS[3], PROPOSALS[1], track.planes[4]]
    own, merged = own_and_merged(track, choice)
    assert [p.name for p in own] == ["plane 3", "plane 2", "wall 2"]
    assert [p.name for p in merged] == ["floor again", "plane 4"]
    insisted = [replace(p, suggested=False) for p in choice]
    assert own_and_merged(track, insisted)[1] == []
    assert own_and_merged(replace(track, proposals=(), of_proposal=()), choice)[1] == []
