"""Each step of the propagation by itself, from an estimate of half a recording whose other half is known."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core.errors import Refused
from calib_core.factors.lidar_plane import Gate
from calib_core.full.joint import association
from calib_core.full.joint import propagate as steps
from calib_core.full.joint.drift import Drift
from calib_core.full.joint.estimation import Estimation, JointData, lidar_pose
from calib_core.full.joint.plane_reacquisition import regain, same_lost_plane
from calib_core.full.joint.policies import Propagation
from calib_core.full.joint.propagate import Propagated, advance, begin, bridge, gates_m, let_go, look_again, propagate
from calib_core.full.joint.propagation_window import Window, predict
from calib_core.full.joint.round import anchored, one_round
from calib_core.full.joint.schedule import CHOSEN, FULL
from calib_core.full.joint.state_views import motion_of, outlined_cells
from calib_core.geometry import exp, log
from calib_core.planes.segment import PlaneFit
from tests.core.full.joint.conftest import Half

POLICY = Propagation()
SECOND = 100  # knots


def lidar_error(half: Half, estimation: Estimation | Window, at_knot: int) -> tuple[float, float]:
    """How far the lidar is from the truth at a knot: turn [rad], place [m]."""
    e = estimation.estimate
    first = estimation.start if isinstance(estimation, Window) else 0
    when = float(half.data.readings.knots_s[at_knot]) + e.time_offset_s
    k = at_knot - first
    R, p = e.states.R[k] @ e.R_imu_lidar, e.states.p[k] + e.states.R[k] @ e.p_imu_lidar
    # The solve's frame is not quite that of the map any more: seen from the reference scan's own pose.
    R0, p0 = reference_pose(half)
    true_R, true_p = half.true_lidar(np.array([when]))
    turn = float(np.linalg.norm(log((R0.T @ R).T @ true_R[0])))
    return turn, float(np.linalg.norm((p - p0) @ R0 - true_p[0]))


def reference_pose(half: Half) -> tuple[np.ndarray, np.ndarray]:
    """The map frame in that of the solve."""
    return lidar_pose(motion_of(half.data, half.state), half.state.estimate, 0.0)


def test_knots_are_predicted_by_the_imu_as_the_lidar_moves(half: Half) -> None:
    """Oracle: the simulator's exact motion, 0.3 s ahead at 2 rad/s: within a millimetre and a milliradian.

    Mutations: leave gravity out of `predicted`; half of h^2 taken for h^2; start from the knot before the last.
    """
    last = half.state.knots
    window = predict(half.data, half.state, last - SECOND, last + 30)
    assert window.start == last - SECOND
    assert len(window.estimate.states.p) == SECOND + 30
    before, after = (lidar_error(half, window, knot) for knot in (last - 1, last + 29))
    assert after[0] < before[0] + 1e-3
    assert after[1] < before[1] + 2e-3
    assert predict(half.data, half.state, -50, last + 1).start == 0


def test_where_the_imu_was_silent_a_body_goes_on_as_it_did(half: Half) -> None:
    """Constant velocity and rate, and no free fall. Mutation: integrate the readings that are not there."""
    last = half.state.knots
    silent = half.data.readings.linked.copy()
    silent[last - 1 :] = False
    data = replace(half.data, readings=replace(half.data.readings, linked=silent))
    window = predict(data, half.state, last - SECOND, last + 30)
    s, h = window.estimate.states, data.readings.spacing_s
    np.testing.assert_allclose(s.v[-1], s.v[SECOND - 1], atol=1e-9)
    np.testing.assert_allclose(s.p[-1] - s.p[SECOND - 1], 30 * h * s.v[SECOND - 1], atol=1e-9)


def test_gates_are_as_wide_as_the_motion_may_have_strayed_and_closed_beyond() -> None:
    """By hand. Mutations: one sigma for three; gates for lost planes as for others; judge by the second pass's room."""
    straying_m = np.array([0.0, 0.01, 0.049, 0.051])
    assert gates_m(straying_m, 0.05, POLICY) == pytest.approx([0.05, 0.08, 0.197, -1.0])
    assert gates_m(straying_m, 0.04, POLICY) == pytest.approx([0.04, 0.07, 0.187, -1.0])


def strayed(half: Half, window: Window, by_m: np.ndarray) -> Window:
    """The window with all its states moved by so much: what seconds without a plane do to positions."""
    s = window.estimate.states
    return replace(window, estimate=replace(window.estimate, states=replace(s, p=s.p + by_m)))


def seen(half: Half) -> tuple[Window, list[int], np.ndarray]:
    """A window a piece ahead, its new scans, and which of them are beyond those in play."""
    last = half.state.knots
    window = predict(half.data, half.state, last - SECOND, last + 30)
    fresh = [i for i in window.scans_over(half.data) if i > max(half.state.positions)]
    assert fresh
    return window, fresh, np.full(len(half.state.planes), True)


def test_lost_planes_are_known_again_by_their_normals(half: Half) -> None:
    """The motion is off by 0.25 m, more than any gate allows; the planes are found and each gets its own points.

    Oracle: every plane's points lie as far from it as the shift says. Mutations: give the points to the first plane; a plane
    without any within its outline is known again, which ended in a defect.
    """
    window, fresh, lost = seen(half)
    away_m = np.full(len(lost), 0.06)
    shift_m = np.array([0.15, -0.15, 0.12])
    reach = begin(half.data, half.state, half.schedule, POLICY).reach
    found = regain(
        half.data, half.state, strayed(half, window, shift_m), fresh,
        lost=lost, straying_m=away_m, reach=reach, outlined=None, policy=POLICY,
    )  # fmt: skip
    assert found is not None
    assert len(np.unique(found.plane)) >= 4
    # Packed scatter of [point, 1, residual]: sums of weights, and of weights times distances from the plane.
    distance_m = found.scatter[:, 13] / found.scatter[:, 12]
    for plane in np.unique(found.plane):
        expected_m = float(half.state.estimate.normals[plane] @ shift_m)
        assert np.median(distance_m[found.plane == plane]) == pytest.approx(expected_m, abs=0.01)
    none_lost = regain(
        half.data, half.state, window, fresh,
        lost=~lost, straying_m=away_m, reach=reach, outlined=None, policy=POLICY,
    )  # fmt: skip
    assert none_lost is None
    elsewhere = np.zeros_like(reach.inside)
    nothing_there = regain(
        half.data, half.state, strayed(half, window, shift_m), fresh,
        lost=lost, straying_m=away_m, reach=reach, outlined=elsewhere, policy=POLICY,
    )  # fmt: skip
    assert nothing_there is None


def test_a_wall_that_faces_the_other_way_is_not_the_lost_one(half: Half) -> None:
    """Mutations: take the normal's agreement without its sign, or leave it out; leave the distance out; ask planes that are
    not lost.
    """
    e = half.state.estimate
    normal, cloud = e.normals[0], -e.offsets_m[0] * e.normals[:1]
    every = np.ones(1, dtype=bool)
    lost, away_m = np.ones(len(e.normals), bool), np.full(len(e.normals), 0.05)

    def told(fit_normal: np.ndarray, at: np.ndarray, which: np.ndarray = lost) -> int | None:
        fit = PlaneFit(fit_normal, 0.0, every, 0.0)
        return same_lost_plane(e, fit, at, lost=which, straying_m=away_m, policy=POLICY)

    assert told(normal, cloud) == 0
    assert told(-normal, cloud) != 0
    assert told(normal, cloud + 0.26 * normal) is None
    assert told(normal, cloud + 0.24 * normal) == 0
    assert told(normal, cloud, lost & (np.arange(len(lost)) != 0)) is None
    across = np.cross(normal, [0.3, 0.4, 0.5])
    turned = exp(np.radians(5.0) * across / np.linalg.norm(across)) @ normal
    assert told(turned, cloud) is None


def sped_up(half: Half) -> Estimation:
    """The state with a last velocity that is off by 10 cm/s."""
    s = half.state.estimate.states
    v = s.v.copy()
    v[-1] += np.array([0.06, -0.06, 0.05])
    return replace(half.state, estimate=replace(half.state.estimate, states=replace(s, v=v)))


def test_a_gap_is_bent_to_meet_its_far_end(half: Half) -> None:
    """A start that is off by 10 cm/s leads 12 cm astray in 1.2 s; the regained planes bring the end back.

    Oracle: the true motion. Mutations: leave the descent out; forget that drift has been corrected.
    """
    last, wrong = half.state.knots, sped_up(half)
    window, fresh, lost = seen(replace(half, state=wrong))
    drift = Drift.begun(0.01 * np.eye(3), 0.01).after(1.0)
    reach = begin(half.data, half.state, half.schedule, POLICY).reach
    found = regain(
        half.data, wrong, window, fresh,
        lost=lost, straying_m=np.full(len(lost), 0.2), reach=reach, outlined=None, policy=POLICY,
    )  # fmt: skip
    assert found is not None
    bent, after = bridge(half.data, wrong, drift, found, last - SECOND, last + 30, POLICY)
    middle = last + 15
    assert lidar_error(half, window, middle)[1] > 0.012
    assert lidar_error(half, bent, middle)[1] < 0.006
    assert after.farthest_m() < 0.5 * drift.farthest_m()


def test_a_piece_is_predicted_corrected_and_joined_on(half: Half) -> None:
    """From a velocity that is off. Oracle: the true motion at the piece's end. The state that was given is as it was.

    Mutations: join the prediction instead of the corrected window; leave the drift as it was.
    """
    wrong = sped_up(half)
    way = replace(begin(half.data, half.state, half.schedule, POLICY), state=wrong)
    end = half.state.knots + 30
    predicted = predict(half.data, wrong, half.state.knots - SECOND, end)
    assert lidar_error(half, predicted, end - 5)[1] > 0.02
    further, share = advance(half.data, way, end, half.schedule, POLICY)
    assert further.state.knots == end
    assert way.state.knots == half.state.knots
    assert share > 0.3
    assert (further.seen_at == end).sum() >= 4
    assert lidar_error(half, further.state, end - 5)[1] < 0.006
    assert further.drift.farthest_m() < way.drift.after(0.3).farthest_m()
    kept = slice(0, half.state.knots - round(POLICY.window_s * 100) - 1)
    np.testing.assert_array_equal(further.state.estimate.states.p[kept], half.state.estimate.states.p[kept])


def test_a_piece_that_no_plane_corrects_is_predicted_alone(half: Half) -> None:
    """By hand. Mutations: the drift does not grow with time; planes without points count as seen."""
    way = begin(half.data, half.state, half.schedule, POLICY)
    out_of_reach = replace(way.reach, inside=np.zeros_like(way.reach.inside))
    end = half.state.knots + 30
    further, share = advance(half.data, replace(way, reach=out_of_reach), end, half.schedule, POLICY)
    alone = predict(half.data, half.state, half.state.knots - SECOND, end)
    np.testing.assert_array_equal(further.state.estimate.states.p[-SECOND:], alone.estimate.states.p[-SECOND:])
    np.testing.assert_array_equal(further.seen_at, way.seen_at)
    np.testing.assert_allclose(further.drift.covariance, way.drift.after(0.3).covariance, rtol=1e-9)
    assert share == 0.0


def test_where_the_lidar_told_nothing_for_a_while_the_imu_goes_on_alone(half: Half) -> None:
    """Seen: a car that left its hall ended in a defect. Mutation: points looked for among no scans at all."""
    way = begin(half.data, half.state, half.schedule, POLICY)
    clocks = half.data.run.clocks
    gone = replace(
        clocks, scan_s=np.where(np.arange(len(clocks.scan_s)) < 60, clocks.scan_s - 60.0, clocks.scan_s + 60.0)
    )
    silent = replace(half.data, run=replace(half.data.run, clocks=gone))
    end = half.state.knots + 30
    further, share = advance(silent, way, end, half.schedule, POLICY)
    alone = predict(half.data, half.state, half.state.knots - SECOND, end)
    np.testing.assert_array_equal(further.state.estimate.states.p[-SECOND:], alone.estimate.states.p[-SECOND:])
    np.testing.assert_array_equal(further.seen_at, way.seen_at)
    assert share == 0.0


def test_a_plane_that_the_motion_may_have_strayed_from_gets_no_points(
    half: Half, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The drift is half a metre along one wall, and millimetres across. Mutation: one gate for all planes."""
    monkeypatch.setattr(steps, "regain", lambda *_, **__: None)
    way = begin(half.data, half.state, half.schedule, POLICY)
    normals = half.state.estimate.normals
    covariance = way.drift.covariance.copy()
    covariance[:3, :3] += 0.25 * np.outer(normals[0], normals[0])
    end = half.state.knots + 30
    strayed_far = replace(way, drift=Drift(covariance, way.drift.noise_m_s2_sqrt_hz))
    further, _ = advance(half.data, strayed_far, end, half.schedule, POLICY)
    across = np.abs(normals @ normals[0]) < 0.1
    assert 2 <= across.sum() < len(normals)
    assert further.seen_at[0] == half.state.knots
    assert (further.seen_at[across] == end).sum() >= 2


def test_a_piece_that_brings_lost_planes_back_is_bent_to_them(half: Half) -> None:
    """No gate may look for any of them, and they were last in view 0.4 s before. Oracle: the true motion.

    Mutations: do not ask for lost planes; bend the last window alone, not the way back to where they were in view.
    """
    drift = Drift.begun(0.01 * np.eye(3), 0.01).after(1.0)
    assert (gates_m(drift.along(half.state.estimate.normals), POLICY.gate_m, POLICY) == -1.0).all()
    last, wrong = half.state.knots, sped_up(half)
    in_view = np.full(len(half.state.planes), last - 40)
    way = replace(begin(half.data, half.state, half.schedule, POLICY), state=wrong, drift=drift, seen_at=in_view)
    further, _ = advance(half.data, way, last + 30, half.schedule, POLICY)
    window = round(POLICY.window_s * SECOND)
    moved = np.linalg.norm(further.state.estimate.states.p[:last] - wrong.estimate.states.p, axis=1)
    assert (moved[last - 40 - window + 1 : last - window] > 0.0).all()
    assert (moved[: last - 40 - window] == 0.0).all()
    assert lidar_error(half, further.state, last + 25)[1] < 0.006
    assert further.drift.farthest_m() < 0.5 * drift.farthest_m()
    assert (further.seen_at == last + 30).sum() >= 4


def test_the_whole_recording_is_covered_and_its_end_is_right(half: Half) -> None:
    """Oracle: the true motion at the recording's end. Mutations: stop a piece before the end; leave scans out of play."""
    rest = half.data.knots - half.state.knots
    piece = next(n for n in range(28, 60) if rest % n > n // 2)  # the last piece stands for itself
    schedule = replace(half.schedule, propagation=replace(POLICY, piece_s=piece / SECOND))
    state = propagate(half.data, half.state, schedule)
    assert state.knots == half.data.knots
    assert lidar_error(half, state, half.data.knots - 20)[1] < 0.01
    assert list(state.positions) == list(range(len(state.positions)))
    assert max(state.positions) >= len(half.data.run.recording.scans) - 2
    assert state.rounds > half.state.rounds
    alone = replace(half.schedule, propagation=None)
    assert propagate(half.data, half.state, alone) is half.state
    assert propagate(half.data, state, half.schedule) is state


def test_the_map_is_laid_on_the_reference_scan_again(half: Half) -> None:
    """Wherever the frame of the solve is, the planes' offsets come back. Mutation: leave the frame where it is."""
    there = half.state.estimate.seen_from(exp(np.array([0.2, -0.1, 0.3])), np.array([0.4, 0.5, -0.6]))
    drifted = replace(half.state, estimate=there)
    back = anchored(half.data, drifted)
    R, p = lidar_pose(motion_of(half.data, back), back.estimate, 0.0)
    np.testing.assert_allclose(R, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(p, 0.0, atol=1e-9)
    np.testing.assert_allclose(back.estimate.offsets_m, anchored(half.data, half.state).estimate.offsets_m, atol=1e-9)
    assert outlined_cells(half.data, back) is None


def test_what_was_carried_on_after_the_planes_were_lost_is_let_go(half: Half) -> None:
    """When is told from the recording's first scan, whatever was skipped.

    Mutations: keep all; keep the scans; keep nothing beyond the last plane; cut where planes were seen to the end; when, from
    the first scan used.
    """
    way = begin(half.data, half.state, half.schedule, POLICY)
    assert let_go(half.data, way, POLICY) is way.state
    gone = replace(way, seen_at=np.full_like(way.seen_at, half.state.knots - 200))
    said: list[str] = []
    recording = replace(half.data.run.recording, skipped_s=100.0)
    run: Any = replace(half.data.run, recording=recording, on_event=lambda event: said.append(event.text))
    left = let_go(replace(half.data, run=run), gone, POLICY)
    assert left.knots == half.state.knots - 150
    ends_s = half.data.readings.knots_s[left.knots - 1] + left.estimate.time_offset_s
    assert 0.0 < ends_s - half.data.run.clocks.scan_s[max(left.positions)] < 0.2
    assert len(said) == 1
    assert f"out of view {100.0 + ends_s:.0f} s after the recording's first scan" in said[0]


@pytest.mark.parametrize(
    ("share", "waited", "strayed_m", "looks"),
    [(0.5, 200, 0.01, True), (0.7, 200, 0.01, False), (0.5, 100, 0.01, False), (0.5, 200, 0.08, False)],
)
def test_new_planes_are_looked_for_where_known_ones_explain_little(
    monkeypatch: pytest.MonkeyPatch, share: float, waited: int, strayed_m: float, looks: bool
) -> None:
    """Not too often, only while the motion is certain, and not beside those that were chosen. Mutations: leave any of the
    four conditions out.
    """
    asked: list[int] = []

    def add(_: JointData, state: Estimation, positions: tuple[int, ...], __: object) -> Estimation:
        asked.append(len(positions))
        return state

    monkeypatch.setattr(steps, "add_planes", add)
    covariance = np.zeros((9, 9))
    covariance[0, 0] = strayed_m**2
    state: Any = SimpleNamespace(knots=1000, positions=tuple(range(80)))
    clocks = SimpleNamespace(scan_s=0.1 * np.arange(100))
    data: Any = SimpleNamespace(readings=SimpleNamespace(spacing_s=0.01), run=SimpleNamespace(clocks=clocks))
    unused: Any = None
    way = Propagated(state, Drift(covariance, 0.0), unused, None, np.array([1000]), 500, 1.0, 1000 - waited)
    after = look_again(data, way, share, FULL, POLICY)
    assert asked == ([15] if looks else [])
    assert after.looked_at == (1000 if looks else 1000 - waited)
    look_again(data, way, share, CHOSEN, POLICY)
    assert len(asked) == int(looks)
    assert look_again(data, way, 1.4, FULL, POLICY).share_at_first == 1.4


def test_rounds_are_bounded_by_what_there_is_to_propagate_to(half: Half) -> None:
    """By hand: 10 s tracked of 40: twice doubled, one at the end, 20 times a plane can have been away; two passes each.

    Mutations: count the tracked span too; leave the last solve out. A round too many is refused, and says what moved.
    """
    assert POLICY.most_rounds(10.0, 40.0) == 2 * (2 + 1 + 20)
    assert POLICY.most_rounds(40.0, 40.0) == 0
    # Twice ten until the motion is steady; eight tones and three turns at rest, settled thrice after each; settled once more for
    # them all, and for bent walls. Planes are left out on the way to rest, and at rest, in three turns each.
    tones = (8 + 3) * (2 + 3)
    assert FULL.most_rounds(40.0, 40.0, 12) == 1 + 2 + 1 + 1 + 2 * 10 + tones + (1 + 3 + 3 + 2) * 12 + (1 + 3) * (
        12 + 12
    )
    assert half.data.most_rounds > propagate(half.data, half.state, half.schedule).rounds
    with pytest.raises(Refused, match=r"did not converge in the 2 rounds .* moved by .* times its standard dev"):
        one_round(replace(half.data, most_rounds=2), half.state, FULL.coarse[0], FULL.sampling)


def test_a_gate_without_margin_is_the_forecasts(half: Half) -> None:
    """The forecast's rounds gate with a margin of their own. Mutation: take the noise's margin in both."""
    used: list[Gate] = []
    original = association.associate

    def watched(*args: Any, **kwargs: Any) -> Any:
        used.append(args[3])
        return original(*args, **kwargs)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(association, "associate", watched)
        for schedule in (FULL, replace(FULL, coarse=(replace(FULL.coarse[0], margin_by_noise=False),))):
            one_round(half.data, half.state, schedule.coarse[0], schedule.sampling)
    assert used[0].margin_m != Gate().margin_m
    assert used[1].margin_m == Gate().margin_m
