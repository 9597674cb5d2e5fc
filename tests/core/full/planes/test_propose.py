"""Planes proposed for a person to judge, on a room whose planes are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.errors import Cancelled
from calib_core.events import StageEvent
from calib_core.full.odometry.reference_cloud import propose_planes
from calib_core.full.planes import propose
from calib_core.full.planes.propose import distinct, grow_plane, make_patch, no_planes, scan_points
from calib_core.geometry import log, plane_axes
from calib_core.planes.segment import PlaneFit
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import FloatArray, Plane, PlaneProposals, Recording


@pytest.fixture(scope="module")
def heard() -> list[StageEvent]:
    return []


@pytest.fixture(scope="module")
def proposals(noisy: tuple[Recording, Truth], heard: list[StageEvent]) -> PlaneProposals:
    def listen(event: object) -> None:
        assert isinstance(event, StageEvent)
        heard.append(event)

    return propose_planes(noisy[0], CalibrateSettings(), on_event=listen)


def test_patches_are_the_rooms_planes_in_the_map_frame(
    noisy: tuple[Recording, Truth], proposals: PlaneProposals, heard: list[StageEvent]
) -> None:
    """Fails when normals point away from the sensor, or the standing second is not merged (too few points a patch)."""
    truth = noisy[1]
    assert len(proposals.patches) >= 4
    for patch in proposals.patches:
        plane = patch.plane
        best = max(truth.planes, key=lambda t: float(t.normal @ plane.normal))
        assert np.degrees(np.arccos(min(float(best.normal @ plane.normal), 1.0))) < 0.5
        assert abs(best.offset_m - plane.offset_m) < 0.02
        assert plane.offset_m > 0
        assert patch.confirmed
        assert 0.005 < patch.rms_m < 0.06
    counts = [p.n_points for p in proposals.patches]
    assert counts[0] > 5000
    assert [p.plane.name for p in proposals.patches] == [f"plane {j + 1}" for j in range(len(counts))]
    assert [e.fraction for e in heard] == sorted(e.fraction for e in heard)
    assert heard[-1].fraction == 1.0


def test_the_standing_second_is_found(noisy: tuple[Recording, Truth], proposals: PlaneProposals) -> None:
    """Fails when scans that move by centimetres still count as standing: the ramp starts after one second."""
    last = noisy[0].scans[proposals.reference_scans[-1]]
    R, p = noisy[1].map_lidar(np.array([(last.stamp_ns - noisy[1].epoch_ns) * 1e-9]))
    assert np.degrees(np.linalg.norm(log(R[0]))) < 0.4
    assert np.linalg.norm(p[0]) < 0.015
    assert proposals.reference_scans[0] == 0
    assert proposals.reference_scans == tuple(range(len(proposals.reference_scans)))
    assert len(proposals.reference_scans) >= 7
    assert proposals.static


def test_every_point_of_a_patch_lies_on_it_and_its_outline_does(proposals: PlaneProposals) -> None:
    """Fails when the outline is left in the plane's own coordinates, or a point goes to a plane far from it."""
    for j, patch in enumerate(proposals.patches):
        mine = proposals.cloud_m[proposals.cloud_patch == j].astype(np.float64)
        distance = mine @ patch.plane.normal + patch.plane.offset_m
        assert len(mine) == patch.n_points
        assert np.abs(distance).max() < 0.1
        assert patch.rms_m == pytest.approx(np.sqrt(np.mean(distance**2)), rel=1e-3)
        np.testing.assert_allclose(patch.outline_m @ patch.plane.normal + patch.plane.offset_m, 0.0, atol=1e-9)
        axes = plane_axes(patch.plane.normal)
        low, high = (mine @ axes.T).min(axis=0), (mine @ axes.T).max(axis=0)
        np.testing.assert_allclose((patch.outline_m @ axes.T).min(axis=0), low, atol=1e-4)
        np.testing.assert_allclose((patch.outline_m @ axes.T).max(axis=0), high, atol=1e-4)
        assert 0 < patch.area_m2 <= 1.5 * np.prod(high - low)
    assert len(proposals.cloud_m) == len(proposals.cloud_patch) == len(proposals.cloud_intensity)


def test_a_plane_that_was_dropped_grows_back_from_a_click(proposals: PlaneProposals) -> None:
    """Fails when points that already belong to a plane are taken for the new one, or the offset's sign is not kept."""
    for j in range(3):
        dropped = proposals.patches[j]
        free = proposals.cloud_patch.copy()
        free[free == j] = -1
        rest = PlaneProposals(
            tuple(p for i, p in enumerate(proposals.patches) if i != j), proposals.cloud_m, free,
            proposals.cloud_intensity, proposals.reference_scans, proposals.static,
        )  # fmt: skip
        mine = proposals.cloud_m[proposals.cloud_patch == j].astype(np.float64)
        seed = mine[np.argsort(np.linalg.norm(mine - mine.mean(axis=0), axis=1))[len(mine) // 10]]
        grown = grow_plane(rest, seed)
        assert grown is not None
        assert np.degrees(np.arccos(min(float(grown.plane.normal @ dropped.plane.normal), 1.0))) < 0.3
        assert abs(grown.plane.offset_m - dropped.plane.offset_m) < 0.01
        assert grown.n_points > 0.7 * dropped.n_points
        assert grown.plane.name == f"plane {len(rest.patches) + 1}"


def test_a_small_board_grows_where_a_person_points(proposals: PlaneProposals) -> None:
    """0.9 m by 0.32 m at 3 m: too narrow for a wall, and wanted all the same. Mutation: a whole plane's breadth asked of it."""
    rng = np.random.default_rng(0)
    board = np.stack(
        [3.0 + rng.normal(0.0, 0.004, 400), rng.uniform(-0.45, 0.45, 400), rng.uniform(-0.16, 0.16, 400)], axis=1
    )
    alone = replace(
        proposals,
        patches=(),
        cloud_m=board.astype(np.float32),
        cloud_patch=np.full(400, -1, np.int16),
        cloud_intensity=np.zeros(400, np.float32),
    )
    grown = grow_plane(alone, np.array([3.0, 0.05, 0.02]))
    assert grown is not None
    assert abs(grown.plane.normal[0]) > 0.999
    assert grown.n_points > 300


def test_nothing_grows_in_the_air_or_where_all_is_taken(proposals: PlaneProposals) -> None:
    """Fails when the seed's own distance to the plane is not asked for."""
    assert grow_plane(proposals, np.array([0.3, 0.2, 0.1])) is None
    mine = proposals.cloud_m[proposals.cloud_patch == 0][100].astype(np.float64)
    taken = grow_plane(proposals, mine)
    assert taken is None or taken.n_points < 0.05 * proposals.patches[0].n_points


def test_a_search_that_is_cancelled_ends(noisy: tuple[Recording, Truth]) -> None:
    """Fails when `find_reference` does not poll."""
    with pytest.raises(Cancelled):
        propose_planes(noisy[0], CalibrateSettings(), should_cancel=lambda: True)


def test_field_of_view_is_applied_to_what_is_looked_at(noisy: tuple[Recording, Truth]) -> None:
    """Fails when the azimuth is taken from x and z."""
    scan = noisy[0].scans[0]
    xyz = scan_points(scan, 30.0)
    azimuth = np.degrees(np.arctan2(xyz[:, 1], xyz[:, 0]))
    assert np.abs(azimuth).max() <= 30.0
    every = scan_points(scan)
    assert len(xyz) == (np.abs(np.degrees(np.arctan2(every[:, 1], every[:, 0]))) <= 30.0).sum() > 0


@pytest.mark.parametrize(
    ("times", "code", "words"),
    [
        (1.0, "planes.none", "1 to 20 m"),
        (1000.0, "points.unit", "in millimetres"),
        (0.001, "points.unit", "nearer than"),
    ],
)
def test_coordinates_that_are_no_metres_are_told_from_a_room_without_planes(
    noisy: tuple[Recording, Truth], times: float, code: str, words: str
) -> None:
    """Half of a room's points are metres away. Mutations: either end of what lidars measure left out; the mean for the median,
    which one point at infinity decides."""
    scans = []
    for scan in noisy[0].scans[:3]:
        points = scan.points.copy()
        points["xyz"] *= times
        points["xyz"][0] = 1e6
        scans.append(replace(scan, points=points))
    refused = no_planes(scans)
    assert refused.code == code
    assert words in str(refused)


def test_a_patch_of_nothing_has_no_outline() -> None:
    """Fails when the hull's error on fewer than three points is let through."""
    patch = make_patch(Plane("p", np.array([0.0, 0.0, 1.0]), 1.0), np.zeros((2, 3)))
    assert patch.outline_m.shape == (0, 3)
    assert make_patch(Plane("p", np.array([0.0, 0.0, 1.0]), 1.0), np.zeros((0, 3))).rms_m == 0.0


def test_a_door_proud_of_its_wall_is_no_plane_of_its_own() -> None:
    """Fails when both are kept: each would make the other's points ambiguous.

    A wall, a door 6 cm in front of it, and a parallel partition 40 cm in front of it.
    """
    rng = np.random.default_rng(4)

    def sheet(x_m: float, count: int) -> FloatArray:
        return np.column_stack([x_m + 0.002 * rng.normal(size=count), rng.uniform(-1, 1, (count, 2))])

    sheets = [sheet(3.0, 600), sheet(2.94, 200), sheet(2.6, 150)]
    cloud = np.concatenate(sheets)
    ends = np.cumsum([len(s) for s in sheets])
    fits = []
    for end, s, x in zip(ends, sheets, (3.0, 2.94, 2.6), strict=True):
        mine = np.zeros(len(cloud), bool)
        mine[end - len(s) : end] = True
        fits.append(PlaneFit(np.array([-1.0, 0.0, 0.0]), x, mine, 0.002))
    assert [f.offset_m for f in distinct(fits, cloud)] == [3.0, 2.6]


@pytest.mark.parametrize(
    ("normals", "chosen"),
    [
        # A scan of two planes that face one way, one of four that face two ways, and another.
        ([[(1, 0, 0), (-1, 0, 0)], [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)], [(1, 0, 0), (0, 1, 0)]], 1),
        ([[(1, 0, 0), (0, 1, 0), (0, 0, 1)], [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0, -1, 0)]], 0),
        ([[(1, 0, 0), (0, 1, 0), (0, -1, 0)], [(1, 0, 0), (0, 1, 0), (0.1, 0, 0.9)]], 1),
        ([[(1, 0, 0), (-1, 0, 0), (1, 0, 0)], [(1, 0, 0), (0, 1, 0)]], 1),
        ([[], [(1, 0, 0)], []], 1),
    ],
)
def test_the_reference_is_the_scan_whose_planes_face_most_ways(
    monkeypatch: pytest.MonkeyPatch, normals: list[list[tuple[float, float, float]]], chosen: int
) -> None:
    """Seen: a rotor on its side between floor, ceiling and two walls, followed from a scan that saw floor and ceiling alone, and
    refused. Mutations: their number before the ways; the last of equals.
    """
    fits = [
        [PlaneFit(np.array(n) / np.linalg.norm(n), 1.0, np.ones(9, np.bool_), 0.01) for n in of_scan]
        for of_scan in normals
    ]
    left = iter(fits)
    monkeypatch.setattr(propose, "scan_points", lambda *_: None)
    monkeypatch.setattr(propose, "segment_planes", lambda *_, **__: next(left))
    position, found = propose.find_reference([None] * len(fits), CalibrateSettings())  # type: ignore[list-item]
    assert (position, found) == (chosen, fits[chosen])
