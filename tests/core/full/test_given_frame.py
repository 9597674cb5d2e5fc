"""Planes in the map, which is the first scan's frame, where the lidar is followed from another scan."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest

from calib_core.calibrate import calibrate
from calib_core.errors import SettingsError
from calib_core.events import ignore_event, never_cancel
from calib_core.full import calibrate as page
from calib_core.full.initialise import given_frame
from calib_core.full.initialise.given_frame import in_the_tracks_frame
from calib_core.full.initialise.kept_track import follow_or_recall
from calib_core.full.odometry.reference import Followed
from calib_core.full.odometry.reference_cloud import propose_planes
from calib_core.full.odometry.register import ScanMotion
from calib_core.full.planes.propose import find_reference
from calib_core.full.prepare.excluded_spans import without_spans
from calib_core.full.prepare.prepare import prepare
from calib_core.full.run import Run
from calib_core.geometry import log
from calib_core.result import CalibrationResult
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import Plane, PlanePatch, PlaneProposals, Recording, Scan

#: So many sweeps see what is ahead, up to so far aside: who stood around the rig has gone then, and it is on its way.
BLIND, ASIDE_DEG = 16, 20.0
SETTINGS = CalibrateSettings(intrinsics="off", crispness=False)


def _ahead(scan: Scan) -> Scan:
    azimuth = np.arctan2(scan.points["xyz"][:, 1], scan.points["xyz"][:, 0])
    return replace(scan, points=scan.points[np.abs(azimuth) < np.radians(ASIDE_DEG)])


@pytest.fixture(scope="module")
def blind(noisy: tuple[Recording, Truth]) -> tuple[Recording, Truth]:
    """The recording, of whose first sweeps a wall ahead is left; what it is followed from is taken on the move."""
    recording, truth = noisy
    scans = [_ahead(scan) if k < BLIND else scan for k, scan in enumerate(recording.scans)]
    return replace(recording, scans=scans), truth


def _off(planes: list[Plane], truth: Truth) -> list[tuple[float, float]]:
    """Of each plane by how much it is turned [rad] and away [m] from the true one that is nearest."""
    off = []
    for plane in planes:
        turned = [float(np.linalg.norm(np.cross(plane.normal, q.normal))) for q in truth.planes]
        sides = [1.0 if plane.normal @ q.normal > 0.0 else -1.0 for q in truth.planes]
        away = [abs(plane.offset_m - s * q.offset_m) for q, s in zip(truth.planes, sides, strict=True)]
        best = int(np.argmin(np.add(turned, away)))
        off.append((turned[best], away[best]))
    return off


def test_planes_are_told_and_taken_in_the_first_scans_frame(blind: tuple[Recording, Truth]) -> None:
    """Oracle: the simulator's planes, in the frame of its lidar's first place.

    Mutations: the map of the result that of the scan the lidar is followed from; planes of the map taken to be in that one's
    frame (refused then: none is there); moved the other way; that scan's time counted from the first one used.
    """
    recording, truth = blind
    reference, _ = find_reference(recording.scans, SETTINGS)
    assert reference >= BLIND
    found = calibrate(recording, SETTINGS).result
    planes = [Plane(p.name, np.array(p.normal), p.offset_m) for p in found.quality.planes]
    assert len(planes) >= 3
    for turned, away_m in _off(planes, truth):
        assert turned < 0.004
        assert away_m < 0.01
    given = [replace(plane, suggested=False) for plane in truth.planes]
    chosen = calibrate(replace(recording, skipped_s=100.0), SETTINGS, planes=given).result
    assert chosen.status in {"calibrated", "weak"}
    (told,) = (said.text for said in chosen.messages if said.code == "planes.frame")
    at_s = 100.0 + 1e-9 * (recording.scans[reference].stamp_ns - recording.scans[0].stamp_ns)
    assert f"not where the scan at {at_s:.1f} s does" in told
    assert {plane.name for plane in chosen.quality.planes} == {plane.name for plane in truth.planes}
    assert np.linalg.norm(np.array(chosen.T_imu_lidar.matrix)[:3, 3] - truth.p_imu_lidar) < 0.03


def _excluding(*spans_s: tuple[float, float]) -> CalibrateSettings:
    return SETTINGS.model_copy(update={"excluded_spans_s": spans_s})


def _error(result: CalibrationResult, truth: Truth) -> tuple[float, float]:
    """By how much the mounting is turned [rad] and away [m] from the true one."""
    assert result.T_imu_lidar is not None
    matrix = np.array(result.T_imu_lidar.matrix)
    turned = float(np.linalg.norm(log(truth.R_imu_lidar.T @ matrix[:3, :3])))
    return turned, float(np.linalg.norm(matrix[:3, 3] - truth.p_imu_lidar))


@pytest.mark.parametrize("span_s", [(0.0, 0.05), (2.04, 2.06)])
def test_untouched_proposals_are_no_choice_whatever_is_left_out(
    blind: tuple[Recording, Truth], span_s: tuple[float, float]
) -> None:
    """Seen: refused through HTTP, which gives the proposals along, while the scan that they are told in was not left out: without
    an earlier one each scan has another place, and the search ends at its neighbour. Nor are they a choice where it is left out.

    Oracle: the answer without planes, bit for bit. Mutations: the two searches compared; untouched proposals of another scan
    taken for a choice; both told apart only where the scan is kept.
    """
    recording, _ = blind
    whole, _ = find_reference(recording.scans, SETTINGS)
    kept = without_spans(recording, [span_s]).scans
    assert kept[find_reference(kept, SETTINGS)[0]].stamp_ns != recording.scans[whole].stamp_ns
    planes = [replace(patch.plane, suggested=True) for patch in propose_planes(recording, SETTINGS).patches]
    with_them = calibrate(recording, _excluding(span_s), planes=planes).result
    without = calibrate(recording, _excluding(span_s)).result
    assert with_them.status in {"calibrated", "weak"}
    assert with_them.T_imu_lidar == without.T_imu_lidar
    assert (with_them.uncertainty, with_them.messages) == (without.uncertainty, without.messages)


@pytest.mark.parametrize("suggested", [False, True])
def test_a_choice_stays_in_its_scan_where_another_one_is_left_out(
    blind: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch, suggested: bool
) -> None:
    """Some of the proposals, in the frame of a scan on the move that is kept, while the first one is not.

    Oracles: the scan that the track begins with, by its stamp; the truth, with which the answer by all planes agrees as well.
    Mutations: refused; the planes taken to be in the frame of the scan at which the search ends now.
    """
    recording, truth = blind
    told, _ = find_reference(recording.scans, SETTINGS)
    proposed = [patch.plane for patch in propose_planes(recording, SETTINGS).patches]
    assert len(proposed) >= 5
    chosen = [replace(plane, suggested=suggested) for plane in proposed[:-1]]
    begun = []

    def follow(run: Run, planes: object, folder: object, begins: int | None) -> Followed:
        begun.append(begins)
        return follow_or_recall(run, planes, folder, begins)

    monkeypatch.setattr(page, "follow_or_recall", follow)
    result = calibrate(recording, _excluding((0.0, 0.05)), planes=chosen).result
    assert result.status in {"calibrated", "weak"}
    assert begun == [told - 1]
    assert {message.code for message in result.messages}.isdisjoint({"planes.frame", "planes.instead"})
    turned, away_m = _error(result, truth)
    assert turned < 0.01
    assert away_m < 0.03


def test_planes_of_the_first_scan_outlive_the_scan_of_the_proposals(blind: tuple[Recording, Truth]) -> None:
    """They are in the map: that the scan is left out in which planes would be proposed does not matter to them; to the proposals
    that somebody chose from it does, and is said.

    Mutations: refused for the scan that they are not told in; the proposals taken without theirs.
    """
    recording, truth = blind
    told, _ = find_reference(recording.scans, SETTINGS)
    at_s = 1e-9 * (recording.scans[told].stamp_ns - recording.scans[0].stamp_ns)
    settings = _excluding((at_s + 0.04, at_s + 0.06))
    given = [replace(plane, suggested=False) for plane in truth.planes]
    result = calibrate(recording, settings, planes=given).result
    assert result.status in {"calibrated", "weak"}
    assert {plane.name for plane in result.quality.planes} == {plane.name for plane in truth.planes}
    assert _error(result, truth)[1] < 0.03
    for suggested in (False, True):
        proposed = propose_planes(recording, SETTINGS).patches[:-1]
        with pytest.raises(SettingsError, match=f"keep the scan at {at_s:.2f} s"):
            calibrate(recording, settings, planes=[replace(patch.plane, suggested=suggested) for patch in proposed])


def _run(recording: Recording) -> Run:
    return prepare(recording, SETTINGS, ignore_event, never_cancel)


def test_the_track_begins_where_the_planes_are_where_none_carries_them(blind: tuple[Recording, Truth]) -> None:
    """A second and a half without a point lies between the first scan and that of the proposals. The track coasts over it by the
    gyroscope, and comes out 13 deg and 1 m aside, where floor and ceiling hardly are. Oracle: the planes given, bit for bit, and
    the scan that they are in.

    Mutations: planes that nothing carries left as they are, in the other scan's frame; the track begun there all the same; one
    plane that fits enough.
    """
    recording, truth = blind
    dark = range(BLIND - 1, BLIND + 14)
    scans = [replace(s, points=s.points[:0]) if k in dark else s for k, s in enumerate(recording.scans)]
    run = _run(replace(recording, scans=scans))
    assert find_reference(scans, SETTINGS)[0] not in range(BLIND)
    given = [replace(plane, suggested=False) for plane in truth.planes]
    planes, begins = in_the_tracks_frame(run, given)
    assert begins == 0
    assert planes == given
    followed = follow_or_recall(_run(recording), given, None, begins)
    assert followed.reference == 0


def test_the_track_begins_where_the_planes_are_where_one_carries_them_astray(
    blind: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half of the planes at least have to come to lie where the other scan shows some; not each: a plan has the next room's, too.

    Mutations: planes taken as carried wherever a track goes; where all of them have to lie so.
    """
    run, given = _run(blind[0]), [replace(plane, suggested=False) for plane in blind[1].planes]
    truly = cache(partial(given_frame.begin, run, None, propose_planes(blind[0], SETTINGS)))
    monkeypatch.setattr(given_frame, "begin", lambda *_: truly())
    assert in_the_tracks_frame(run, given).begins is None
    assert in_the_tracks_frame(run, [*given, Plane("next door", np.array([1.0, 0.0, 0.0]), 40.0)]).begins is None

    def astray(*_: object) -> Followed:
        followed = truly()
        return replace(followed, motions=[replace(m, p=m.p + np.array([1.0, -1.0, 2.0])) for m in followed.motions])

    monkeypatch.setattr(given_frame, "begin", astray)
    planes, begins = in_the_tracks_frame(run, given)
    assert begins == 0
    assert planes == given


def test_a_first_scan_that_was_not_followed_is_where_the_lidar_came_from(
    blind: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its track begins with the second scan, 0.1 s later, or later still, beyond what a track bridges.

    Oracle: a lidar that turns about its z axis by 0.5 rad/s and goes ahead by 2 m/s was turned back by 0.05 rad, 0.2 m behind, a
    scan before; a wall 3 m ahead of it there. Mutations: the first scan taken for the second; turned or moved on, not back;
    however long before.
    """
    recording, run = blind[0], _run(blind[0])
    reference, _ = find_reference(recording.scans, SETTINGS)
    wall = Plane("wall", np.array([-1.0, 0.0, 0.0]), 3.0)
    patch = PlanePatch(wall, np.zeros((0, 3)), 0.0, 9, True)
    none = np.zeros(0, np.int16)
    shown = PlaneProposals(
        (patch,), np.zeros((0, 3), np.float32), none, np.zeros(0, np.float32), (reference,), static=False
    )
    monkeypatch.setattr(given_frame, "propose_planes", lambda *_: shown)

    def carried(position: int) -> list[Plane] | None:
        turning, ahead = np.array([0.0, 0.0, 0.5]), np.array([2.0, 0.0, 0.0])
        known = [ScanMotion(k, np.eye(3), np.zeros(3), turning, ahead) for k in (position, reference)]
        monkeypatch.setattr(given_frame, "begin", lambda *_: Followed(reference, [], known))
        return given_frame._carried(run, [wall], 0, reference)

    planes = carried(1)
    assert planes is not None
    before_s = float(run.clocks.scan_s[1] - run.clocks.scan_s[0])
    assert before_s == pytest.approx(0.1, abs=0.01)
    turned = -0.5 * before_s
    np.testing.assert_allclose(planes[0].normal, [-np.cos(turned), -np.sin(turned), 0.0], atol=1e-12)
    # The wall's nearest point in the map: 3 m along the axis that it faced, from where the lidar was.
    nearest = np.array([-2.0 * before_s, 0.0, 0.0]) + 3.0 * np.array([np.cos(turned), np.sin(turned), 0.0])
    assert planes[0].normal @ nearest + planes[0].offset_m == pytest.approx(0.0, abs=1e-12)
    assert carried(7) is None
