"""A lidar that turns to and fro within its sweeps, by closed form, in a box whose walls are known; SciPy's rotations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.events import never_cancel
from calib_core.full.odometry import reference, scan_pairs
from calib_core.full.odometry.motion_prior import rate_within, steadied, steady_sample
from calib_core.full.odometry.reference import Followed
from calib_core.full.odometry.register import ScanMotion
from calib_core.full.odometry.scan_pairs import pair_turns
from calib_core.full.odometry.track import track
from calib_core.full.planes.propose import named_planes
from calib_core.full.run import Run
from calib_core.planes.segment import segment_planes
from calib_core.settings import CalibrateSettings
from calib_core.types import POINT_DTYPE, FloatArray, Plane, Scan

_SWEEP_NS, _EPOCH_NS = 100_000_000, 1_700_000_000_000_000_000
#: The box's walls beside the lidar [m].
_LOW, _HIGH = np.array([-3.0, -4.0, -1.2]), np.array([5.0, 2.5, 1.8])


class _Shaken:
    """Two and a half times a second by 12 deg about one axis, half as much about another: up to 50 rad/s gained in a second.

    known_until_s: nothing is known of its turning from then on.
    """

    coasts = False

    def __init__(self, known_until_s: float = np.inf) -> None:
        self._until_s = known_until_s

    def at(self, t_s: FloatArray) -> Rotation:
        turn = 2 * np.pi * 2.5 * t_s
        return Rotation.from_euler("ZX", np.radians(12) * np.stack([np.sin(turn), 0.5 * np.cos(1.3 * turn)], axis=-1))

    def between(self, start_ns: int, end_ns: int) -> FloatArray | None:
        t_s = np.array([start_ns - _EPOCH_NS, end_ns - _EPOCH_NS]) * 1e-9
        one, other = self.at(t_s)
        return None if t_s.max() > self._until_s else (one.inv() * other).as_matrix()

    def turn_std_rad(self, _turn_rad: float, _over_s: float, /) -> float:
        return np.inf

    def step(self, _motions: Sequence[ScanMotion], _to: int, /) -> None:
        return None


def _in_the_box(directions: FloatArray) -> FloatArray:
    """Where rays from the middle meet the box, (N, 3) each."""
    with np.errstate(divide="ignore"):
        reach = np.where(directions > 0, _HIGH / directions, _LOW / directions)
    return directions * reach.min(axis=1)[:, None]


def _sweep(rng: np.random.Generator, moved: _Shaken, begins_s: float, points: int = 6000) -> tuple[Scan, FloatArray]:
    """A scan of it, and where its points are in the box (N, 3)."""
    tau_ns = np.sort(rng.integers(0, _SWEEP_NS, points))
    tau_ns[-1] = _SWEEP_NS
    directions = rng.normal(size=(points, 3))
    turned = moved.at(begins_s + tau_ns * 1e-9)
    met = _in_the_box(turned.apply(directions / np.linalg.norm(directions, axis=1)[:, None]))
    told = np.zeros(points, POINT_DTYPE)
    told["xyz"], told["offset_ns"] = turned.inv().apply(met), tau_ns
    return Scan(0, _EPOCH_NS + round(begins_s * 1e9), told), met


def test_the_walls_of_a_shaken_sweep_are_flat_by_a_steady_rate() -> None:
    """Looked up every hundredth of a second, it is off a straight line by 55 rad/s2 (0.01 s)^2 / 8, 4.6 mm in a corner 6.7 m
    away; raw, a quarter of a metre.

    Mutations: points as they are; turned the other way; by the turn alone, without the rate; looked up at both ends alone.
    """
    moved = _Shaken()
    scan, met = _sweep(np.random.default_rng(1), moved, 0.37)
    rate, here = rate_within(scan, moved), moved.at(np.array([0.37]))
    assert rate is not None
    tau = scan.points["offset_ns"] * 1e-9
    by_rate = Rotation.from_rotvec(rate * tau[:, None])
    raw = (here * by_rate).apply(scan.points["xyz"])
    assert np.linalg.norm(raw - met, axis=1).max() > 0.2
    steady = (here * by_rate).apply(steadied(scan.points["xyz"].astype(np.float64), tau, scan, moved))
    assert np.linalg.norm(steady - met, axis=1).max() < 0.0046
    some, some_tau = steady_sample(scan, 500, moved)
    assert len(some) == 500
    shown = (here * Rotation.from_rotvec(rate * some_tau[:, None])).apply(some)
    assert min(np.linalg.norm(met - each, axis=1).min() for each in shown) < 0.0046


def test_what_turned_nobody_knows_how_stays_as_it_is() -> None:
    """Without turns at all, and where they end within the sweep."""
    scan, _ = _sweep(np.random.default_rng(2), _Shaken(), 0.2)
    points, tau = scan.points["xyz"].astype(np.float64), scan.points["offset_ns"] * 1e-9
    for nothing in (None, _Shaken(known_until_s=0.25)):
        np.testing.assert_array_equal(steadied(points, tau, scan, nothing), points)


def test_pairs_of_shaken_scans_turn_as_between_their_middles_once_they_are_straightened() -> None:
    """Of 15 pairs in a box to a tenth of a degree, by known turns; a degree at least as the sweeps are, bent by two motions.

    Mutations: turns within the sweeps not handed on; as seen from the sweep's beginning; from where the mean rate has led by its
    middle.
    """
    moved, rng = _Shaken(), np.random.default_rng(3)
    begins_s = 0.1 * np.arange(30)
    scans = [_sweep(rng, moved, begin)[0] for begin in begins_s.tolist()]

    def worst_deg(turning: _Shaken | None) -> float:
        scan_pairs = pair_turns(scans, turning=turning)
        assert len(scan_pairs.first) > 10
        middles = moved.at(begins_s + 0.05)
        true = middles[scan_pairs.first].inv() * middles[scan_pairs.first + 1]
        return float(np.degrees((true.inv() * Rotation.from_rotvec(scan_pairs.rotvec_rad)).magnitude().max()))

    assert worst_deg(None) > 1.0
    assert worst_deg(moved) < 0.1


def test_a_shaken_lidar_is_followed_where_it_is_known_how_it_turns() -> None:
    """From wall to wall of the box, which stand where they stand: to a fifth of a degree and a centimetre, at two degrees
    and more where each sweep is taken to turn steadily.

    Mutation: a scan's points as they are.
    """
    moved, rng = _Shaken(), np.random.default_rng(4)
    begins_s = 0.06 + 0.1 * np.arange(30)
    scans = [_sweep(rng, moved, begin)[0] for begin in begins_s.tolist()]
    start = moved.at(begins_s[:1])[0]
    inward = np.concatenate([np.eye(3), -np.eye(3)])
    reach = np.concatenate([-_LOW, _HIGH])
    walls = [Plane(f"wall {k}", start.inv().apply(inward[k]), float(reach[k])) for k in range(6)]
    motions = track(scans, walls, 0, turning=moved)
    assert [m.position for m in motions] == list(range(30))
    true = (start.inv() * moved.at(begins_s)).as_matrix()
    off_rad = (Rotation.from_matrix(true).inv() * Rotation.from_matrix(np.array([m.R for m in motions]))).magnitude()
    assert np.degrees(off_rad.max()) < 0.2
    assert np.linalg.norm([m.p for m in motions], axis=1).max() < 0.01


def test_clouds_of_an_instant_are_followed_by_how_the_lidar_is_known_to_turn() -> None:
    """A shaken flash lidar in a box: to half a degree, at three without. Oracle: its turns. Seen: what was known of them was not
    asked where no sweep lasts, and a forecast refused.

    Mutation: no rate where the points are of one instant.
    """
    moved, rng = _Shaken(), np.random.default_rng(5)
    begins_s = 0.06 + 0.1 * np.arange(30)
    scans = []
    for begin in begins_s.tolist():
        turned = moved.at(np.array([begin]))[0]
        directions = rng.normal(size=(3000, 3))
        told = np.zeros(3000, POINT_DTYPE)
        told["xyz"] = turned.inv().apply(_in_the_box(directions))
        scans.append(Scan(0, _EPOCH_NS + round(begin * 1e9), told))
    start = moved.at(begins_s[:1])[0]
    inward = np.concatenate([np.eye(3), -np.eye(3)])
    reach = np.concatenate([-_LOW, _HIGH])
    walls = [Plane(f"wall {k}", start.inv().apply(inward[k]), float(reach[k])) for k in range(6)]
    motions = track(scans, walls, 0, turning=moved)
    true = (start.inv() * moved.at(begins_s)).as_matrix()[[m.position for m in motions]]
    off_rad = (Rotation.from_matrix(true).inv() * Rotation.from_matrix(np.array([m.R for m in motions]))).magnitude()
    assert len(motions) == 30
    assert np.degrees(off_rad.max()) < 0.5


def test_a_reference_scan_is_straightened_by_how_it_is_known_to_have_turned(monkeypatch: pytest.MonkeyPatch) -> None:
    """Planes of a shaken sweep of the box, and where they lead: to a fifth of a degree; of scans that end early, once. Oracle:
    closed form. Seen: an arm's quick swing refused, followed from planes that its neighbours' poses had bent.

    Mutations: the neighbours' rate; by the rate alone; the planes as they are, too, the longer track of both.
    """
    moved, rng = _Shaken(), np.random.default_rng(6)
    begins_s = 0.06 + 0.1 * np.arange(20)
    scans = [_sweep(rng, moved, begin)[0] for begin in begins_s.tolist()]
    run = SimpleNamespace(
        recording=SimpleNamespace(scans=scans),
        clocks=SimpleNamespace(sweep_s=np.full(20, 0.1)),
        settings=CalibrateSettings(),
        should_cancel=never_cancel,
        stage=lambda *_: None,
    )
    planes_of_tracks: list[Sequence[Plane]] = []

    def counted(run: Run, planes: Sequence[Plane], *arguments: Any) -> Followed:
        planes_of_tracks.append(planes)
        return attempt(run, planes, *arguments)

    attempt = reference._attempt
    monkeypatch.setattr(reference, "_attempt", counted)
    bent = named_planes(segment_planes(scans[10].points["xyz"].astype(np.float64)))
    found = reference.follow(cast(Run, run), bent, 10, turning=moved, may_leave=False)
    start = moved.at(begins_s[10:11])[0]
    true = (start.inv() * moved.at(begins_s)).as_matrix()
    walls = start.inv().apply(np.concatenate([np.eye(3), -np.eye(3)]))
    assert [m.position for m in found.motions] == list(range(20))
    for plane in found.planes:
        assert np.degrees(np.arccos(np.clip(walls @ plane.normal, -1.0, 1.0))).min() < 0.2
    off_rad = (
        Rotation.from_matrix(true).inv() * Rotation.from_matrix(np.array([m.R for m in found.motions]))
    ).magnitude()
    assert np.degrees(off_rad.max()) < 0.2
    run.recording.scans = [*scans[:14], *(replace(scan, points=scan.points[:0]) for scan in scans[14:])]
    assert reference.follow(cast(Run, run), bent, 10, turning=moved, may_leave=False).seen == 14
    assert len(planes_of_tracks) == 2


def test_turns_in_a_lifts_cabin_are_told() -> None:
    """Four walls a metre away, seen by a fan of 30 deg, neither floor nor ceiling: half a metre of wall tells its
    tilt. Oracle: the turns it was given. Seen: no pair was believed, and a lift refused. Mutation: told to 0.03 rad.
    """
    rng, halves_m = np.random.default_rng(2), np.array([1.1, 0.9, 50.0])
    turns, scans = [], []
    for k in range(8):
        turn = Rotation.from_rotvec(rng.normal(0.0, np.radians(3.0), 3))
        azimuth, elevation = np.meshgrid(
            np.arange(450) * 2 * np.pi / 450, np.radians(np.linspace(-15.0, 15.0, 32)), indexing="ij"
        )
        rays = np.stack(
            [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)], axis=-1
        )
        directions = turn.apply(rays.reshape(-1, 3))
        reach_m = (halves_m / np.abs(directions)).min(axis=1) + rng.normal(0.0, 0.01, len(directions))
        told = np.zeros(len(directions), POINT_DTYPE)
        told["xyz"] = turn.inv().apply(directions * reach_m[:, None])
        scans.append(Scan(k, _EPOCH_NS + k * _SWEEP_NS, told))
        turns.append(turn)
    found = pair_turns(scans)
    assert found.first.tolist() == [0, 2, 4, 6]
    for first, rotvec in zip(found.first.tolist(), found.rotvec_rad, strict=True):
        off = (turns[first].inv() * turns[first + 1]).inv() * Rotation.from_rotvec(rotvec)
        assert np.degrees(off.magnitude()) < 1.0


@pytest.mark.parametrize(("well", "badly", "kept"), [(40, 40, 40), (20, 40, 60), (0, 10, 10)])
def test_worse_pairs_count_where_better_ones_are_few(
    monkeypatch: pytest.MonkeyPatch, well: int, badly: int, kept: int
) -> None:
    """Where there are enough, worse ones spoil lag and rotation: seen on stairs, by a shaken lidar.

    Mutations: all; the better ones alone.
    """
    stds = [0.01] * well + [0.05] * badly
    motions = iter([ScanMotion(0, np.eye(3), *[np.zeros(3)] * 3, std_rad=std) for std in stds])
    monkeypatch.setattr(scan_pairs, "_turn", lambda *_: next(motions))
    scans = [Scan(k, k, np.zeros(0, POINT_DTYPE)) for k in range(2 * (well + badly))]
    found = scan_pairs.pair_turns(scans)
    assert len(found.first) == len(found.rotvec_rad) == len(found.std_rad) == kept
