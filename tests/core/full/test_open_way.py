"""Between two walls, on a floor and under a ceiling no plane tells how far along the lidar came: followed, and solved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.calibrate import calibrate
from calib_core.errors import Refused
from calib_core.full.initialise.inertial_motion import OwnTurns
from calib_core.full.odometry.register import is_held
from calib_core.full.odometry.track import track
from calib_core.geometry import log
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Scenario, Truth, generate
from calib_core.simulate.motion import Pose, Start, Sway, Turn, Wave
from calib_core.simulate.motions import FACING_THE_CORNER
from calib_core.types import FloatArray, Recording
from tests.core.full.answers import errors_of
from tests.core.full.tracks import TrueTurning, begun, straightened, track_errors

#: Whole seconds, more than a track coasts where nobody knows its turns.
_DURATION_S = 8.0


@pytest.fixture(scope="module")
def corridor(short: Scenario) -> tuple[Recording, Truth]:
    """The paper's room without the walls to the west and to the east, with noise and biases."""
    faces = tuple(face for face in short.scene.faces if face.name not in {"wall west", "wall east"})
    assert len(faces) == 4
    biased = replace(short, gyro_bias_rad_s=(0.004, -0.003, 0.002), accel_bias_m_s2=(0.05, -0.08, 0.06))
    return generate(replace(biased, scene=replace(short.scene, faces=faces), duration_s=_DURATION_S), seed=3)


@pytest.fixture(scope="module")
def driven(short: Scenario) -> tuple[Recording, Truth]:
    """A vehicle on the floor of the same corridor: it turns by 60 deg to either side, and about one axis alone."""
    faces = tuple(face for face in short.scene.faces if face.name not in {"wall west", "wall east"})
    motion = Sway(
        base=Pose(rpy_deg=(0.0, 0.0, 10.0), position_m=FACING_THE_CORNER.position_m),
        position=((Wave(0.5, 0.21, 0.4),), (Wave(0.3, 0.29, 1.9),), ()),
        turns=(Turn((0.0, 0.0, 1.0), (Wave(float(np.deg2rad(60.0)), 0.17, 0.0),)),),
        start=Start(static_s=2.5, ramp_s=1.2),
    )
    return generate(replace(short, scene=replace(short.scene, faces=faces), motion=motion, duration_s=14.0), seed=5)


def _along(truth: Truth) -> FloatArray:
    """(3,) map: the direction that no plane's normal has a part in."""
    along = np.linalg.svd(np.array([plane.normal for plane in truth.planes]))[2][2]
    assert abs(along @ truth.planes[0].normal) < 0.03
    return along


def test_a_way_that_stays_open_is_told_of_each_scan_and_ends_a_track_that_may_not_coast(
    corridor: tuple[Recording, Truth],
) -> None:
    """Turns, and places across the open way, are the lidar's; the velocity along it is not known, and fades.

    Mutations: coasting for ever in any case; the open way taken for the planes' own direction; two open ways held as well.
    """
    recording, truth = corridor
    short = track(recording.scans, truth.planes, 0, turning=TrueTurning(truth, coasts=False))
    assert len(short) < 25
    motions = track(recording.scans, truth.planes, 0, turning=TrueTurning(truth, coasts=True))
    assert [m.position for m in motions] == list(range(len(recording.scans)))
    along = _along(truth)
    start_s = np.array([(scan.stamp_ns - truth.epoch_ns) * 1e-9 for scan in recording.scans])
    R, p = truth.map_lidar(start_s)
    across = np.eye(3) - np.outer(along, along)
    for m, R_true, p_true in zip(motions[1:], R[1:], p[1:], strict=True):
        assert is_held(m)
        assert np.trace(m.unseen) == pytest.approx(1.0)
        assert along @ m.unseen @ along > 0.99
        assert np.degrees(np.linalg.norm(log(R_true.T @ m.R))) < 3.0
        assert np.linalg.norm(across @ (m.p - p_true)) < 0.06
    assert not is_held(replace(motions[3], unseen=np.diag([1.0, 1.0, 0.0])))


def test_a_corridor_is_followed_by_the_gyroscopes_turns(corridor: tuple[Recording, Truth]) -> None:
    """Seen in five of an independent simulator's corridors and streets, which were refused: "its planes face two ways only".

    Mutations: turns without leave to coast; not said; the shorter track kept; found in another frame, with the open way in the
    old one's.
    """
    found, said = begun(corridor[0], given=False)
    assert found.coasts
    assert len(found.motions) == len(corridor[0].scans)
    assert "track.aided" in said
    assert "track.open_way" in said
    along = found.motions[20].unseen
    moved = found.seen_from(40)
    assert moved is not None
    R = found.motions[40].R
    np.testing.assert_allclose(moved.motions[20].unseen, R.T @ along @ R, atol=1e-12)


def test_a_vehicle_in_a_corridor_is_followed_by_its_planes(driven: tuple[Recording, Truth]) -> None:
    """Seen in another simulator's corridor: refused, as "in the 1 of 198 scans in which they were seen it hardly moved". The way
    that is open ended the track by planes alone, and turns about one axis give no rotation to lead it by.

    Mutations: no leave to coast by its own turns; not said, or said to be led by the gyroscope.
    """
    found, said = begun(driven[0], given=False)
    assert len(found.motions) == len(driven[0].scans)
    assert isinstance(found.turning, OwnTurns)
    turned_deg, _ = track_errors(*driven, found)
    assert turned_deg < 3.0
    assert "track.open_way" in said
    assert "track.aided" not in said


def test_a_track_by_its_own_turns_ends_where_those_are_lost(driven: tuple[Recording, Truth]) -> None:
    """With the floor alone nothing tells the turn about the vertical: nothing is looked at beyond half a second from the
    reference, instead of two. Mutation: as long as where a gyroscope tells the turns.
    """
    recording, truth = driven
    floor = [plane for plane in truth.planes if plane.name == "floor"]
    scans = recording.scans[40:80]
    looked_at: list[int] = []

    class Watched(OwnTurns):
        def between(self, start_ns: int, end_ns: int, /) -> None:
            looked_at.extend((start_ns, end_ns))

    assert len(track(scans, floor, 20, turning=Watched())) == 1
    away_s = np.abs(np.array(looked_at) - scans[20].stamp_ns) * 1e-9
    assert 0.5 < away_s.max() < 0.8


def test_a_straightened_corridor_is_refused_whatever_pairs_tell(
    corridor: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a slow walk along one, pairs of scans told nothing: the track took its turns from the gyroscope, and went on.

    Mutation: a track that was led is not asked.
    """
    recording, truth = corridor
    monkeypatch.setattr("calib_core.full.initialise.by_pairs._require_measured_points", lambda *_: None)
    with pytest.raises(Refused, match="the rotation that the gyroscope measured") as refused:
        begun(replace(recording, scans=[straightened(scan, truth) for scan in recording.scans]), given=False)
    assert refused.value.code == "points.straightened"


def test_a_corridor_is_calibrated(corridor: tuple[Recording, Truth]) -> None:
    """Eight seconds of a sparse lidar: within four of its own sigmas on each axis, which are no excuse."""
    recording, truth = corridor
    result = calibrate(recording, CalibrateSettings(crispness=False)).result
    assert result.status in {"calibrated", "weak"}, result.messages
    assert result.uncertainty is not None
    std = np.sqrt(np.diag(result.uncertainty.covariance))
    assert np.all(np.abs(errors_of(result, truth)) < 4.0 * std)
    assert np.degrees(std[:3]).max() < 0.5
    assert std[3:6].max() < 0.02
