"""Which planes count is told once the motion is known: from numbers made by hand, and of a joint estimation that has begun."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.full.joint.estimation import Estimation, JointData, MapPlane
from calib_core.full.joint.plane_choice import with_choice
from calib_core.full.joint.schedule import CHOSEN, PARTLY, Schedule
from calib_core.full.joint.state_views import map_pose
from calib_core.full.odometry.reference import Followed
from calib_core.geometry import exp
from calib_core.types import FloatArray, Plane
from tests.core.full.joint.conftest import Half


def in_solve(data: JointData, state: Estimation, plane: Plane) -> tuple[FloatArray, float]:
    """A plane of the map in the frame of the solve, by three points of it."""
    R, p = map_pose(data, state)
    across = np.linalg.svd(plane.normal[None])[2][1:]
    foot = -plane.offset_m * plane.normal
    a, b, c = (R @ x + p for x in (foot, foot + across[0], foot + across[1]))
    normal = np.cross(b - a, c - a)
    normal *= np.sign(normal @ (R @ plane.normal)) / np.linalg.norm(normal)
    return normal, float(-normal @ a)


def drifted(half: Half) -> Estimation:
    """The half with a calibration that has turned, so that the solve's frame is not the map's, and a plane that joined."""
    e = half.state.estimate
    turned = replace(e, R_imu_lidar=e.R_imu_lidar @ exp(np.array([0.03, -0.02, 0.01])))
    came = np.array([0.6, 0.0, 0.8])
    turned = replace(turned, normals=np.vstack([e.normals, came]), offsets_m=np.append(e.offsets_m, 9.0))
    return replace(half.state, estimate=turned, planes=(*half.state.planes, MapPlane("came", late=True)))


@pytest.mark.parametrize("schedule", [PARTLY, CHOSEN], ids=["partly", "chosen"])
def test_what_is_chosen_counts_and_the_rest_is_put_aside(half: Half, schedule: Schedule) -> None:
    """Planes that the motion was told by are where it has found them; one drawn by hand is where it was drawn, in the map. What
    came into view counts beside a suggestion, and is put aside by a choice of all. What lies on a plane that counts is not
    put aside: it would claim that one's points.

    Mutations: all planes count still; what came counts always, or never; none is put aside, or also those that count, or what was
    dropped and is lost not, or what is known twice; a drawn plane taken over without the frame's turn; the estimate of a chosen
    plane thrown away; two drawn on one surface become one; what strayed in that motion is forgotten; all that is drawn
    on it strayed.
    """
    state, data = drifted(half), half.data
    truth = half.truth.planes
    floor, wall = (Plane(p.name, p.normal, p.offset_m) for p in truth[:2])
    # By hand: one slanting across the room, one beside the wall, which is the nearest that is known.
    drawn = Plane("drawn", np.array([0.6, 0.64, 0.48]), 4.0)
    beside = Plane("beside", wall.normal, wall.offset_m + 0.1)
    lost = Plane("lost", np.array([0.0, 0.8, -0.6]), 3.0)
    outline_m = np.ones((3, 3))
    track = Followed(
        0, [floor, replace(wall, suggested=True, outline_m=outline_m), drawn, beside], [], dropped=[truth[2], lost]
    )
    state = replace(state, planes=tuple(replace(q, strayed=k in {1, 2}) for k, q in enumerate(state.planes)))
    data, chosen = with_choice(data.run, (data, state, [0, 1, -1, 1]), track, schedule)
    assert [p.strayed for p in chosen.planes][:4] == [False, True, False, False]
    assert data.dropped == [truth[2], lost]
    counting = ["came"] if schedule is PARTLY else []
    assert [p.name for p in chosen.planes] == [floor.name, wall.name, "drawn", "beside", *counting]
    assert [p.chosen for p in chosen.planes][:3] == [True, False, True]
    assert chosen.planes[1].outline_m is outline_m
    assert (chosen.support, chosen.observations, chosen.minimum) == (None, None, None)
    e, before = chosen.estimate, state.estimate
    assert len(e.normals) == len(chosen.planes)
    np.testing.assert_array_equal(e.normals[:2], before.normals[:2])
    np.testing.assert_array_equal(e.offsets_m[:2], before.offsets_m[:2])
    for at, plane in ((2, drawn), (3, beside)):
        normal, offset_m = in_solve(data, state, plane)
        np.testing.assert_allclose(e.normals[at], normal, atol=1e-9)
        assert e.offsets_m[at] == pytest.approx(offset_m, abs=1e-9)
    others = [*before.normals[2 : len(truth)], *([] if counting else [before.normals[-1]])]
    others.append(in_solve(data, state, lost)[0])
    np.testing.assert_allclose(e.aside_normals, others, atol=1e-9)
    assert e.states is before.states


def test_planes_that_are_held_stay_where_they_are_given(half: Half) -> None:
    """Mutations: the motion's own estimate of them; the frame of the solve, which has drifted."""
    run = replace(half.data.run, settings=half.data.run.settings.model_copy(update={"estimate_planes": False}))
    given = [Plane(p.name, p.normal, p.offset_m + 0.01) for p in half.truth.planes[:3]]
    data, chosen = with_choice(run, (half.data, drifted(half), range(3)), Followed(0, given, []), CHOSEN)
    np.testing.assert_array_equal(chosen.estimate.normals, [p.normal for p in given])
    np.testing.assert_array_equal(chosen.estimate.offsets_m, [p.offset_m for p in given])
    R, p = map_pose(data, chosen)
    np.testing.assert_allclose(R, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(p, 0.0, atol=1e-9)
