"""Sweeps against the scene's planes, against poses evaluated point by point, and their noise against its law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from calib_core.simulate import SCENARIOS, Simulation, generate, prepare
from calib_core.simulate.layouts import scan_of
from calib_core.simulate.lidar import Sweep, firings_rays
from calib_core.simulate.motion import Pose, Sway
from calib_core.simulate.patterns import Rosette, Spinning
from calib_core.simulate.scene import Face, Scene
from calib_core.simulate.sensors import LIVOX, OS1_64, VLP_16, XT_32, Lidar
from calib_core.simulate.truth import Truth
from calib_core.types import FloatArray, Scan

LIDARS: dict[str, Lidar] = {"vlp-16": VLP_16, "xt-32": XT_32, "os1-64": OS1_64, "livox": LIVOX}


def _to_map(scan: Scan, truth: Truth) -> FloatArray:
    """The scan's points in the map frame, each by the exact pose of its own time."""
    R, p = truth.map_lidar(truth.seconds(scan.stamp_ns + scan.points["offset_ns"].astype(np.int64)))
    return np.einsum("nij,nj->ni", R, scan.points["xyz"].astype(np.float64)) + p


@pytest.mark.parametrize("slug", ["noise-free", "noise-free-fast"])
def test_every_exact_point_lies_on_a_plane_of_the_truth(slug: str) -> None:
    """Fails when points of a column share its instant, when the time field is rounded, or a plane's offset is negated.

    The tolerance is float32's: half a unit in the last place of each coordinate (ranges below 8 m) and of a point time
    of 0.1 s (4 ns) at the fastest point's speed.
    """
    simulation = prepare(slug, duration_s=6.0)
    truth = simulation.truth
    for index in (0, 33, 59):
        points = _to_map(scan_of(simulation.cloud(index)), truth)
        distance = np.stack([points @ plane.normal + plane.offset_m for plane in truth.planes])
        assert np.abs(distance).min(axis=0).max() < 4.2e-7
        assert distance.min() > -4.2e-7
    still = scan_of(simulation.cloud(59)).points["xyz"]
    assert np.abs(points - still).max() > 0.1


@pytest.mark.parametrize(
    "slug", ["paper-fast", "handheld", "partial-views", "outdoor", "attic", "ouster", "livox", "vehicle"]
)
def test_every_return_is_where_its_surface_was(slug: str) -> None:
    """Fails when the optics' distance from the rotor's axis is not added to the point, or surfaces are mislabelled.

    In double precision, before any driver rounds: each point of a face, put into the world by the exact pose of its own
    time, is on that face.
    """
    simulation = prepare(slug, noise=False)
    faces = simulation.scenario.scene.faces
    sweep = simulation.sweep(simulation.n_scans // 2 + 1)
    on_face = sweep.valid & (sweep.surface >= 0) & (sweep.surface < len(faces))
    chosen = np.flatnonzero(on_face)[::7]
    assert chosen.shape[0] > 20
    pose = simulation.truth.lidar(sweep.time_ns.reshape(-1)[chosen] * 1e-9)
    world = np.einsum("nij,nj->ni", pose.R_world, sweep.xyz_m.reshape(-1, 3)[chosen]) + pose.p_m
    surface = sweep.surface.reshape(-1)[chosen]
    normals = np.stack([face.unit_normal for face in faces])[surface]
    offsets = np.array([face.offset_m for face in faces])[surface]
    np.testing.assert_allclose(np.einsum("ni,ni->n", normals, world) + offsets, 0.0, atol=1e-9)


@pytest.mark.parametrize("name", LIDARS)
def test_each_ray_leaves_from_the_pose_of_its_own_time(name: str) -> None:
    """Fails when the turn within a column is left out, or taken with the wrong sign or only to first order in time.

    The oracle evaluates the motion at every single point's time.
    """
    simulation = prepare(replace(SCENARIOS["noise-free-fast"], lidar=LIDARS[name]))
    firings = LIDARS[name].pattern.firings(37)
    truth = simulation.truth
    home = truth.lidar(np.zeros(1)).p_m[0]
    rays = firings_rays(firings, truth.lidar(firings.column_ns * 1e-9), home)
    t_s = ((firings.column_ns[:, None] + firings.channel_ns) * 1e-9).reshape(-1)
    np.testing.assert_allclose(rays.t_s, t_s, atol=1e-12)
    chosen = np.arange(5, t_s.shape[0], 37)
    exact = truth.lidar(t_s[chosen])
    d = firings.directions.reshape(3, -1)[:, chosen].T
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1.0, rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(
        rays.directions[:, chosen].T, np.einsum("nij,nj->ni", exact.R_world, d), rtol=0.0, atol=1e-11
    )
    start = exact.p_m
    if firings.origin_m is not None:
        lever = firings.origin_m.reshape(3, -1)[:, chosen].T
        start = start + np.einsum("nij,nj->ni", exact.R_world, lever)
    np.testing.assert_allclose(rays.origins_m[:, chosen].T, start, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(rays.lidar_m[:, chosen].T, exact.p_m, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("name", ["vlp-16", "xt-32", "os1-64"])
def test_a_spinning_lidar_turns_once_per_period(name: str) -> None:
    """Fails when it turns the other way, when sweeps overlap, or when a sweep is not cut at the rotor's zero."""
    lidar = LIDARS[name]
    assert isinstance(lidar.pattern, Spinning)
    previous_end = None
    for index in range(30):
        firings = lidar.pattern.firings(index)
        start, end = int(firings.column_ns[0]), int(firings.column_ns[-1])
        assert 0 <= start - index * 100_000_000 < lidar.pattern.columns_per_packet * lidar.pattern.column_period_ns
        if previous_end is not None:
            assert start - previous_end == pytest.approx(lidar.pattern.column_period_ns, abs=1.0)
        previous_end = end
        azimuth = np.unwrap(np.arctan2(firings.directions[1, :, 0], firings.directions[0, :, 0]))
        rate = np.diff(azimuth) / (np.diff(firings.column_ns) * 1e-9)
        np.testing.assert_allclose(rate, -2.0 * np.pi * 10.0, rtol=1e-6)
    elevations = np.arcsin(lidar.pattern.firings(0).directions[2, 0])
    assert (np.diff(elevations[np.argsort(lidar.pattern.ring)]) > 0).all()


def test_a_vlp_16_is_the_datasheets() -> None:
    """Fails when a firing cycle is not 55.296 us, a laser not 2.304 us, or ring 0 is not the lowest."""
    firings, ring = VLP_16.pattern.firings(0), VLP_16.pattern.ring
    assert (np.diff(firings.column_ns) == 55_296).all()
    assert (np.diff(firings.channel_ns) == 2_304).all()
    assert ring.tolist() == [0, 8, 1, 9, 2, 10, 3, 11, 4, 12, 5, 13, 6, 14, 7, 15]
    np.testing.assert_allclose(np.rad2deg(np.arcsin(firings.directions[2, 0])), -15.0 + 2.0 * ring, atol=1e-9)
    sizes = [VLP_16.pattern.firings(k).column_ns.shape[0] * 16 for k in range(100)]
    assert set(sizes) == {28_800, 29_184}
    assert pytest.approx(np.mean(sizes), rel=2e-3) == 16 * 1e8 / 55_296


def test_a_rosette_stays_in_its_cone_and_does_not_repeat() -> None:
    """Fails when frames restart the pattern, or the cone is not filled to its edge and its middle."""
    assert isinstance(LIVOX.pattern, Rosette)
    one, other = LIVOX.pattern.firings(0), LIVOX.pattern.firings(1)
    off_axis = np.rad2deg(np.arccos(one.directions[0]))
    assert 33.0 < off_axis.max() <= 35.2 + 1e-9
    assert (off_axis < 4.0).any()
    assert one.directions.shape[1] * one.directions.shape[2] == 24_000
    apart = np.linalg.norm(one.directions - other.directions, axis=0)
    assert np.median(apart) > 0.01
    times = (one.column_ns[:, None] + one.channel_ns).reshape(-1)
    assert (np.diff(times) > 0).all()


def test_range_noise_is_white_along_the_ray() -> None:
    """Fails when the noise is across the ray, has another sigma, or repeats from sweep to sweep. Chi-square at 1e-4."""
    noisy, exact = prepare("static", seed=2), prepare("static", seed=2, noise=False)
    errors = []
    for index in range(3):
        a, b = noisy.sweep(index), exact.sweep(index)
        both = a.valid & b.valid
        unit = b.xyz_m[both] / np.linalg.norm(b.xyz_m[both], axis=1, keepdims=True)
        error = a.xyz_m[both] - b.xyz_m[both]
        along = np.einsum("ni,ni->n", error, unit)
        np.testing.assert_allclose(error, along[:, None] * unit, atol=1e-12)
        n = along.shape[0]
        low, high = stats.chi2.ppf([5e-5, 1 - 5e-5], n)
        assert low < float((along**2).sum()) / 0.02**2 < high
        assert abs(along.mean()) < 4.5 * 0.02 / np.sqrt(n)
        errors.append(along[:28_000])
    assert abs(np.corrcoef(errors)[0, 1]) < 0.03


def test_outliers_are_a_tenth_and_share_the_noise_of_the_rest() -> None:
    """Fails when the fraction is of all rays instead of returns, or when drawing outliers shifts the range noise."""
    clean, wrong = prepare("paper-normal", seed=5).sweep(7), prepare("outliers", seed=5).sweep(7)
    other = wrong.valid & (wrong.surface < 0)
    assert 0.09 < other.sum() / wrong.valid.sum() < 0.11
    same = wrong.valid & (wrong.surface >= 0)
    np.testing.assert_array_equal(wrong.xyz_m[same], clean.xyz_m[same])
    scattered = np.linalg.norm(wrong.xyz_m[other], axis=1)
    assert stats.kstest(scattered, stats.uniform(0.5, 9.5).cdf).pvalue > 1e-4


def test_a_narrow_view_keeps_only_its_azimuths() -> None:
    """Fails when the view is centred elsewhere than on +x, or is twice as wide."""
    narrow = replace(SCENARIOS["paper-normal"], lidar=replace(VLP_16, field_of_view_deg=90.0))
    recording, _ = generate(narrow, duration_s=0.5)
    xyz = recording.scans[2].points["xyz"]
    azimuth = np.rad2deg(np.arctan2(xyz[:, 1], xyz[:, 0]))
    assert np.abs(azimuth).max() <= 45.0 + 1e-4
    assert azimuth.min() < -44.0
    assert azimuth.max() > 44.0
    assert 0.24 < xyz.shape[0] / 28_800 < 0.26


def test_far_dark_and_grazed_surfaces_do_not_answer() -> None:
    """Fails when reflectivity or incidence is left out of the reach.

    A floor alone, 1 m below a level VLP-16: ring -d meets it at 1 / sin(d), at a cosine of sin(d).
    """
    floor = Scene((Face("floor", (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), reflectivity=0.1),))
    still = Sway(Pose())
    dim = replace(VLP_16, range_std_m=0.0, range_at_tenth_m=20.0)
    sweep = Simulation(replace(SCENARIOS["static"], scene=floor, motion=still, lidar=dim), 0).sweep(0)
    for ring in range(16):
        down = np.deg2rad(15.0 - 2.0 * ring)
        answers = down > 0 and 1.0 / np.sin(down) < 20.0 * np.sqrt(np.sin(down))
        column = int(np.flatnonzero(sweep.ring == ring)[0])
        assert sweep.valid[:, column].all() == answers
        assert sweep.valid[:, column].any() == answers


def _fractions(slug: str, index: int) -> tuple[Sweep, FloatArray]:
    simulation = prepare(slug)
    sweep = simulation.sweep(index)
    n_faces = len(simulation.scenario.scene.faces)
    return sweep, np.bincount(sweep.surface[sweep.valid] + 1, minlength=n_faces + 2)[1:].astype(np.float64)


def test_the_operator_and_the_walker_are_seen() -> None:
    """Fails when bodies are left out of the scene, or the walker stands still."""
    _, hits = _fractions("handheld", 300)
    assert 300 < hits[6:].sum() < 6_000
    simulation = prepare("walking-person")
    places = []
    for index in (20, 80):
        sweep = simulation.sweep(index)
        on_person = sweep.surface >= 6
        assert on_person.sum() > 300
        pose = simulation.truth.lidar(sweep.time_ns[on_person] * 1e-9)
        places.append((np.einsum("nij,nj->ni", pose.R_world, sweep.xyz_m[on_person]) + pose.p_m).mean(axis=0))
    assert np.linalg.norm(places[1] - places[0]) > 1.0


def test_partial_views_lose_the_planes_one_by_one() -> None:
    """Fails when the lidar does not turn away far enough: scans with three, two, one and no plane must all occur."""
    seen = {int((_fractions("partial-views", index)[1][:3] > 50).sum()) for index in range(0, 400, 12)}
    assert seen == {0, 1, 2, 3}


def test_most_rays_outdoors_find_nothing() -> None:
    """Fails when the ground goes on for ever, or one of the three planes is not seen."""
    for index in (0, 120, 280):
        sweep, hits = _fractions("outdoor", index)
        assert sweep.valid.mean() < 0.5
        assert (hits[:3] > 1_000).all()
