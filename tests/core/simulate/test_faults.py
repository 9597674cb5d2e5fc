"""Faults of sensors, clocks and rooms against closed forms, with the signs that `calib_core.intrinsics` gives them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.errors import SettingsError
from calib_core.simulate import SCENARIOS, Simulation, generate, parse_faults, prepare
from calib_core.simulate.faults import FAULTS, clock
from calib_core.simulate.faults.engine import shaken
from calib_core.simulate.faults.imu import ImuDeviations
from calib_core.simulate.motion import Kinematics, Pose, Sway
from calib_core.simulate.scene import Face, Scene
from calib_core.simulate.sensors import LIVOX, OS1_64, VLP_16, XT_32, Lidar
from calib_core.types import FloatArray
from tests.core.simulate.faulty import STATIC, made, truth_of

#: A level lidar 2 m above a level floor, nothing else.
OVER_THE_FLOOR = replace(
    STATIC,
    scene=Scene((Face("floor", (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), reflectivity=1.0),)),
    motion=Sway(Pose((0.0, 0.0, 0.0), (0.0, 0.0, 2.0))),
)


def ranges(simulation: Simulation, index: int = 0) -> FloatArray:
    """(C, K), NaN where nothing answered."""
    sweep = simulation.sweep(index)
    return np.where(sweep.valid, np.linalg.norm(sweep.xyz_m, axis=2), np.nan)


def test_a_still_accelerometer_reads_scaled_and_sheared_gravity() -> None:
    """Written out axis by axis. Mutations: the sign of a scale; the axes' matrix transposed; names zx and zy swapped."""
    biased = replace(STATIC, accel_bias_m_s2=(0.1, -0.2, 0.3))
    fx, fy, fz = made("", STATIC).imu_messages.accel_m_s2[0]
    faulty = made("accel-scale,imu-axes", biased)
    s, n = truth_of(faulty, "accelerometer_scale"), truth_of(faulty, "accelerometer_axes")
    expected = [
        (1 + s["x"]) * fx + 0.1,
        n["yx"] * fx + (1 + s["y"]) * fy - 0.2,
        n["zx"] * fx + n["zy"] * fy + (1 + s["z"]) * fz + 0.3,
    ]
    assert min(abs(value) for value in (*s.values(), *n.values())) > 1e-5
    np.testing.assert_allclose(faulty.imu_messages.accel_m_s2, np.tile(expected, (len(faulty.imu_messages.true_ns), 1)))


def test_a_gyroscope_is_turned_scaled_and_feels_force() -> None:
    """Mutations: the rotation transposed; scale before the rotation; force taken behind the accelerometer's own errors."""
    deviations = ImuDeviations(
        gyro_scale=(0.0, 0.0, 0.01),
        gyro_rotation_rad=(0.0, 0.3, 0.0),
        g_sensitivity=(0.0, 0.0, 1e-3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        accel_scale=(0.5, 0.5, 0.5),
    )

    def exact(t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.tile([0.0, 0.0, 2.0], (len(t_s), 1)), np.tile([0.0, 0.0, 9.8], (len(t_s), 1))

    gyro, _ = deviations.readings(exact, np.zeros(1))
    np.testing.assert_allclose(gyro[0], [2.0 * np.sin(0.3) + 9.8e-3, 0.0, 2.02 * np.cos(0.3)])


def test_an_accelerometers_line_bends_axis_by_axis() -> None:
    """A still one's: q f^2 more on each axis, whatever the sign of f. Mutations: the norm's square; the sign of f kept."""
    plain, bent = made("", STATIC), made("accel-bend=1e-4", STATIC)
    q = truth_of(bent, "accelerometer_quadratic")
    f = plain.imu_messages.accel_m_s2[0]
    expected = f + np.array([q["x"], q["y"], q["z"]]) * f**2
    np.testing.assert_allclose(bent.imu_messages.accel_m_s2, np.tile(expected, (len(bent.imu_messages.true_ns), 1)))
    assert min(abs(value) for value in q.values()) > 1e-6


def test_accelerometers_apart_feel_the_turns() -> None:
    """A turntable's x accelerometer, 0.1 m out along x, is pulled in by w^2 r; y's, as far out, is dragged by w' r; z's along the
    axis feels nothing. The gyroscope reads the same. Mutations: the sign of either; a place for another axis; the slope halved.
    """

    def exact(t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        rate = np.zeros((len(t_s), 3))
        rate[:, 2] = 2.0 + 0.7 * t_s
        return rate, np.tile([0.0, 0.0, 9.8], (len(t_s), 1))

    out_m = (0.1, 0.0, 0.0)
    t_s = np.linspace(0.0, 3.0, 4)
    gyro, accel = ImuDeviations(accel_places_m=(*out_m, *out_m, 0.0, 0.0, 0.2)).readings(exact, t_s)
    np.testing.assert_array_equal(gyro, exact(t_s)[0])
    expected = np.stack([-0.1 * (2.0 + 0.7 * t_s) ** 2, np.full(4, 0.07), np.full(4, 9.8)], axis=1)
    np.testing.assert_allclose(accel, expected, atol=1e-8)
    assert truth_of(made("size-effect=2mm"), "size_effect").keys() == {
        row + column for row in "xyz" for column in "xyz"
    }


def test_a_late_accelerometer_shifts_a_sine() -> None:
    """Mutation: the delay's sign, or the gyroscope late as well."""

    def exact(t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        wave = np.tile(np.sin(7.0 * t_s)[:, None], (1, 3))
        return wave, wave

    t_s = np.linspace(0.0, 1.0, 50)
    gyro, accel = ImuDeviations(accel_delay_s=0.0025).readings(exact, t_s)
    np.testing.assert_allclose(gyro[:, 0], np.sin(7.0 * t_s))
    np.testing.assert_allclose(accel[:, 1], np.sin(7.0 * (t_s - 0.0025)))
    assert truth_of(made("accel-delay=2.5ms"), "accelerometer_delay") == {"delay": 0.0025}


def test_the_low_pass_has_its_cutoff_and_keeps_slow_motion_in_time() -> None:
    """A second-order Butterworth: 1 / sqrt(1 + (f/fc)^4) of a sine; at 1 Hz late by less than 10 us after its delay is
    allowed for. Mutations: delay not allowed for (5.6 ms); first order (0.707 at the cutoff, too, but 0.447 at twice it)."""
    t_s = np.linspace(0.0, 1.0, 400, endpoint=False)
    for hz in (1.0, 40.0, 80.0):

        def exact(at_s: FloatArray, hz: float = hz) -> tuple[FloatArray, FloatArray]:
            wave = np.tile(np.sin(2 * np.pi * hz * at_s)[:, None], (1, 3))
            return wave, wave

        seen = ImuDeviations(low_pass_hz=40.0).readings(exact, t_s)[0][:, 0]
        answer = 2.0 * np.mean(seen * np.exp(-2j * np.pi * hz * t_s))
        assert abs(answer) == pytest.approx(1.0 / np.sqrt(1.0 + (hz / 40.0) ** 4), rel=1e-5)
        if hz == 1.0:
            assert abs(np.angle(answer * 1j)) / (2 * np.pi) < 1e-5


@pytest.mark.parametrize("lidar", [VLP_16, XT_32, OS1_64, LIVOX], ids=["vlp-16", "xt-32", "os1-64", "livox"])
def test_a_laser_is_off_by_the_offset_of_its_number(lidar: Lidar) -> None:
    """By the number that the driver publishes. Mutations: the offset's sign; the firing order instead of the ring."""
    scenario = replace(STATIC, lidar=lidar)
    exact, faulty = generate(scenario)[0], generate(scenario, seed=5, faults=parse_faults("laser-offsets=8mm"))[0]
    offsets = truth_of(made("laser-offsets=8mm", scenario), "laser_range_offset")
    assert len(offsets) == len(lidar.pattern.ring)
    a, b = exact.scans[0].points, faulty.scans[0].points
    rows = lidar_key(a), lidar_key(b)
    _, mine, theirs = np.intersect1d(*rows, return_indices=True)
    longer = np.linalg.norm(b["xyz"][theirs], axis=1) - np.linalg.norm(a["xyz"][mine], axis=1)
    expected = [offsets[str(ring)] for ring in a["ring"][mine]]
    # The optics of an OS1 sit beside its origin: seen from there the offset is all but along the ray.
    np.testing.assert_allclose(longer, expected, atol=2e-6 if lidar is not OS1_64 else 2e-5)


def test_a_surface_reads_long_by_its_own_offset_from_wherever_it_is_met() -> None:
    """A still room twice: each wall's ranges differ by one number, and no two walls' by the same. Mutations: times the cosine;
    the offset of the surface before; the same for all."""
    exact, faulty = made("", STATIC), made("materials=5mm", STATIC)
    a, b = exact.sweep(0), faulty.sweep(0)
    longer = np.linalg.norm(b.xyz_m, axis=-1) - np.linalg.norm(a.xyz_m, axis=-1)
    both = a.valid & b.valid
    found = [longer[both & (a.surface == of)] for of in np.unique(a.surface[both])]
    assert len(found) > 3
    for of_surface in found:
        np.testing.assert_allclose(of_surface, of_surface[0], atol=1e-9)
    assert len({round(float(of_surface[0]), 7) for of_surface in found}) == len(found)
    of = np.unique(a.surface[both])[2]
    drawn = faulty.faults.lidar.surface_range_offset_m[of]
    assert found[2][0] == pytest.approx(drawn, abs=1e-9)


def lidar_key(points: np.ndarray) -> np.ndarray:
    return points["offset_ns"].astype(np.int64) * 256 + points["ring"]


def test_lasers_look_and_read_as_told_over_a_floor() -> None:
    """From 2 m above a floor a ray of elevation e is 2 / sin(-e) long. Mutations: the sign of elevation or scale; the
    direction published where it is fired."""
    down = np.deg2rad(np.asarray(VLP_16.pattern.elevations_deg))  # type: ignore[attr-defined]
    ring = VLP_16.pattern.ring
    looks_down = down < -0.06
    raised = made("laser-elevation=0.1deg", OVER_THE_FLOOR)
    e = np.array([truth_of(raised, "laser_elevation")[str(r)] for r in ring])
    seen = np.nanmean(ranges(raised)[:, looks_down], axis=0)
    np.testing.assert_allclose(seen, (-2.0 / np.sin(down + e))[looks_down], rtol=1e-9)
    published = raised.sweep(0).xyz_m[3]
    elevation = np.arcsin(published[looks_down, 2] / np.linalg.norm(published[looks_down], axis=1))
    np.testing.assert_allclose(elevation, down[looks_down], atol=1e-12)
    scaled = made("laser-scale", OVER_THE_FLOOR)
    s = np.array([truth_of(scaled, "laser_range_scale")[str(r)] for r in ring])
    seen = np.nanmean(ranges(scaled)[:, looks_down], axis=0)
    np.testing.assert_allclose(seen, ((1 + s) * -2.0 / np.sin(down))[looks_down], rtol=1e-9)


def test_a_slanting_beam_reads_short() -> None:
    """Over a floor: tan(incidence) is 1 / tan(-e). Mutations: long instead of short; by the cosine's inverse."""
    down = np.deg2rad(np.asarray(VLP_16.pattern.elevations_deg))  # type: ignore[attr-defined]
    steep = down < -0.06
    seen = np.nanmean(ranges(made("incidence=2e-3", OVER_THE_FLOOR))[:, steep], axis=0)
    length = -2.0 / np.sin(down)
    expected = length * (1.0 - 0.25 * 2e-3 / np.tan(-down))
    np.testing.assert_allclose(seen, expected[steep], rtol=1e-9)


def test_the_azimuth_is_off_by_laser_and_by_the_encoder() -> None:
    """Facing a wall at x = 3 a ray of azimuth a and elevation e is 3 / (cos a cos e) long. Mutations: the sign of either;
    the cosine instead of the sine of the eccentricity."""
    wall = Scene((Face("wall", (-1.0, 0.0, 0.0), (3.0, 0.0, 0.0), reflectivity=1.0),))
    simulation = made("laser-azimuth=0.2deg,eccentricity=0.1deg", replace(OVER_THE_FLOOR, scene=wall))
    own = truth_of(simulation, "laser_azimuth")
    assert sum(own.values()) == pytest.approx(0.0, abs=1e-12)  # else the lidar's frame itself would be turned
    encoder = truth_of(simulation, "eccentricity")
    sweep = simulation.sweep(0)
    azimuth = np.arctan2(sweep.xyz_m[..., 1], sweep.xyz_m[..., 0])
    looked = (
        azimuth
        + np.array([own[str(r)] for r in sweep.ring])
        + encoder["sine"] * np.sin(azimuth)
        + encoder["cosine"] * np.cos(azimuth)
    )
    elevation = np.deg2rad(np.asarray(VLP_16.pattern.elevations_deg))  # type: ignore[attr-defined]
    expected = 3.0 / (np.cos(looked) * np.cos(elevation))
    facing = sweep.valid & (np.abs(azimuth) < 1.0)
    assert facing.sum() > 1000
    np.testing.assert_allclose(np.linalg.norm(sweep.xyz_m, axis=2)[facing], expected[facing], rtol=1e-9)


def test_the_clocks_rate_stretches_the_stamps() -> None:
    """t_lidar = t_imu + offset + rate (t_lidar - middle). Mutations: the sign; the offset of the start, not the middle."""
    plain, fast = made("", duration_s=20.0), made("clock-rate=50", duration_s=20.0)
    late_s = (fast.imu_records.stamps_ns - plain.imu_records.stamps_ns) * 1e-9
    t_s = fast.imu_messages.true_ns * 1e-9
    first, last = (fast.cloud(index).stamp_ns - fast.truth.epoch_ns for index in (0, fast.n_scans - 1))
    np.testing.assert_allclose(late_s, -50e-6 * (t_s - 0.5e-9 * (first + last)), atol=2e-9)
    assert fast.truth.time_offset_ns == plain.truth.time_offset_ns
    at = fast.truth.time_offset_at_s
    assert at == pytest.approx(0.5e-9 * (last - first), abs=1e-6)
    assert fast.truth.time_offset_ns_at(at + 10.0) - fast.truth.time_offset_ns == pytest.approx(500_000, abs=2)
    document = fast.truth.to_file()
    assert (document.clock_rate_ppm, document.time_offset_at_s) == (50.0, at)


def test_a_busy_host_stamps_late_and_sometimes_very_late() -> None:
    """Mutations: two-sided jitter; stamps that run backwards after a stall; the mean left in."""
    true_ns = np.arange(20_000, dtype=np.int64) * 5_000_000
    late_s = clock.latency_ns(true_ns, 0.0005, np.random.default_rng(1)) * 1e-9
    assert late_s.min() >= -0.0005 - 1e-9
    assert np.median(late_s) == pytest.approx(0.0005 * (np.log(2.0) - 1.0), abs=5e-5)
    assert 0.01 < np.mean(late_s > 0.005) < 0.04
    assert np.all(np.diff(true_ns + np.rint(late_s * 1e9).astype(np.int64)) > 0)


def test_a_host_stamps_scans_late_and_their_points_with_them() -> None:
    """Mutations: the mean left in; the points where they were; one lateness for all."""
    plain, late = made(""), made("scan-latency=1ms", replace(STATIC, duration_s=20.0))
    in_time = made("", replace(STATIC, duration_s=20.0))
    numbers = range(0, late.n_scans, 5)
    off = np.array([late.cloud(k).stamp_ns - in_time.cloud(k).stamp_ns for k in numbers]) * 1e-9
    assert off.min() >= -1e-3
    # The median of 40 of an exponential law is known to a sixth of its mean.
    assert abs(np.median(off) - 1e-3 * (np.log(2.0) - 1.0)) < 5e-4
    first, second = plain.cloud(2), late.cloud(2)
    np.testing.assert_array_equal(first.points["time"], second.points["time"])
    np.testing.assert_array_equal(second.time_ns - first.time_ns, second.stamp_ns - first.stamp_ns)
    assert second.stamp_ns != first.stamp_ns


def test_a_driver_that_empties_a_buffer_stamps_all_of_it_then() -> None:
    """Every 16 ms of a reading each 5: three or four at once, in order; the newest of each waited less than a period.

    Mutations: stamped when it was taken; the mean wait left in; the mean over bundles, not over readings (0.1 ms).
    """
    true_ns = np.arange(20_000, dtype=np.int64) * 5_000_000
    stamps = true_ns + clock.bundle_ns(true_ns, 0.016, np.random.default_rng(1))
    assert np.all(np.diff(stamps) > 0)
    first = np.flatnonzero(np.diff(stamps, prepend=-(10**9)) > 10_000_000)
    assert set(np.diff(first[1:]).tolist()) == {3, 4}
    sizes = np.diff(np.append(first, len(stamps)))
    wait = stamps[first] - true_ns[np.append(first[1:], len(stamps)) - 1]
    assert np.ptp(wait[:-1]) < 5_000_000
    assert abs(np.average(wait, weights=sizes)) < 1_000


def test_a_clock_that_ticks_stamps_with_its_last_tick() -> None:
    """The IMU and the scans; points keep their times after their scan's. Mutations: the nearest tick; ticks counted from the
    first stamp; a lateness that ticks were not taken of.
    """
    plain, cut = made(""), made("stamp-step=1ms")
    lost = plain.imu_records.stamps_ns - cut.imu_records.stamps_ns
    assert np.all(cut.imu_records.stamps_ns % 1_000_000 == 0)
    assert lost.min() >= 0
    assert lost.max() < 1_000_000
    first, second = plain.cloud(2), cut.cloud(2)
    assert second.stamp_ns == first.stamp_ns // 1_000_000 * 1_000_000
    np.testing.assert_array_equal(first.time_ns - first.stamp_ns, second.time_ns - second.stamp_ns)
    assert made("stamp-step=1ms,scan-latency=1ms").cloud(3).stamp_ns % 1_000_000 == 0


def test_a_gyroscope_in_steps_reads_the_nearest() -> None:
    """Mutations: cut to the step below; the accelerometer in its place."""
    plain, coarse = (made(f, replace(STATIC, noise=True)).imu_records for f in ("", "gyro-step=0.002"))
    np.testing.assert_allclose(coarse.gyro_rad_s, 0.002 * np.round(plain.gyro_rad_s / 0.002), atol=1e-15)
    np.testing.assert_array_equal(coarse.accel, plain.accel)


@pytest.mark.parametrize("slug", ["static", "ouster", "livox"])
def test_a_grid_leaves_the_first_point_of_each_cell(slug: str) -> None:
    """By a set of the cells that were filled so far, point by point. Mutations: the last of each; what did not return counts."""
    whole, thinned = (
        prepare(slug, seed=5, duration_s=1.0, faults=parse_faults(f)).cloud(1) for f in ("", "voxel-grid=0.2")
    )
    filled: set[tuple[int, int, int]] = set()
    kept = []
    for i in np.flatnonzero(whole.valid):
        x, y, z = (float(whole.points[axis][i]) for axis in "xyz")
        cell = int(np.floor(x / 0.2)), int(np.floor(y / 0.2)), int(np.floor(z / 0.2))
        if cell not in filled:
            filled.add(cell)
            kept.append(i)
    np.testing.assert_array_equal(thinned.points, whole.points[kept])
    np.testing.assert_array_equal(thinned.time_ns, whole.time_ns[kept])
    assert thinned.valid.all()


def test_an_engine_really_shakes_the_rig() -> None:
    """Velocity, acceleration and rates are the derivatives of the pose, and as large as asked for. Mutations: the
    displacement without its acceleration; the size for each axis instead of for all."""
    calm = SCENARIOS["paper-fast"].motion
    motion = shaken(calm, 2.0, np.random.default_rng(2))
    t, h = np.linspace(3.0, 5.0, 4001), 1e-5
    now, before, after = (motion.kinematics(t + step) for step in (0.0, -h, h))
    np.testing.assert_allclose((after.p_m - before.p_m) / (2 * h), now.v_m_s, atol=1e-4)
    np.testing.assert_allclose((after.v_m_s - before.v_m_s) / (2 * h), now.a_m_s2, atol=2e-4)
    turn = Rotation.from_matrix(np.swapaxes(before.R_world, 1, 2) @ after.R_world).as_rotvec() / (2 * h)
    np.testing.assert_allclose(turn, now.omega_rad_s, atol=1e-5)
    added = now.a_m_s2 - calm.kinematics(t).a_m_s2
    assert np.sqrt((added**2).sum(axis=1).mean()) == pytest.approx(2.0, rel=0.05)


def _on_faces(simulation: Simulation, number: int = 0) -> tuple[FloatArray, np.ndarray]:
    """World points (N, 3) of a sweep, and what they were hits of."""
    sweep = simulation.sweep(number)
    pose: Kinematics = simulation.truth.lidar(sweep.time_ns[sweep.valid] * 1e-9)
    world = np.einsum("nij,nj->ni", pose.R_world, sweep.xyz_m[sweep.valid]) + pose.p_m
    return world, sweep.surface[sweep.valid]


def test_bent_walls_are_where_they_bend() -> None:
    """Each point is as far off its plane as the bend says there. Mutations: the bend's sign; one step instead of four."""
    simulation = made("bent-walls=5mm", SCENARIOS["static"], noise=False)
    points, surface = _on_faces(simulation)
    off = []
    for number, face in enumerate(simulation.scenario.scene.faces):
        mine = points[surface == number]
        distance = mine @ face.unit_normal + face.offset_m
        assert face.bend is not None
        np.testing.assert_allclose(distance, face.bend.height_m(mine.T), atol=1e-7)
        off.append(distance)
    assert 0.004 < np.abs(np.concatenate(off)).max() <= 0.005


def test_a_door_skirting_and_a_window() -> None:
    """Mutations: the door opens out of the room; the board within the wall; the glass keeps every ray."""
    scene = SCENARIOS["static"].scene
    normals, offsets = np.array([f.unit_normal for f in scene.faces]), np.array([f.offset_m for f in scene.faces])
    door, surface = _on_faces(made("door-ajar=5deg"))
    leaf = door[surface >= len(scene.faces)]
    off_the_wall = (leaf @ normals.T + offsets)[:, 2:].min(axis=1)
    assert len(leaf) > 300
    # 0.9 m of leaf at 5 degrees stand 78 mm off the wall, and the leaf is 40 mm thick; walls lean a little.
    assert 0.06 < off_the_wall.max() < 0.115
    boards, surface = _on_faces(made("skirting=15mm", replace(SCENARIOS["handheld"], noise=False)))
    low = boards[surface >= len(scene.faces)]
    assert (low[:, 2] < 0.09).sum() > 20
    window, surface = _on_faces(made("glass"))
    behind = window[surface == len(scene.faces)]
    assert len(behind) > 300
    np.testing.assert_allclose((behind @ normals.T + offsets).min(axis=1), -2.0, atol=1e-9)


def test_what_is_behind_glass_is_where_it_is_wherever_it_is_seen_from() -> None:
    """A wall of the face's shape, two metres behind. Mutations: its height is that of the pane where the ray has passed it, as it
    was before; a flat wall behind a bent one.
    """
    simulation = made("bent-walls=6mm,glass", SCENARIOS["handheld"], noise=False)
    pane = simulation.scenario.scene.panes[0]
    face = simulation.scenario.scene.faces[pane.face]
    index = len(simulation.scenario.scene.faces) + len(simulation.scenario.scene.bodies)
    assert face.bend is not None
    heights = []
    for number in (0, 12):
        points, surface = _on_faces(simulation, number)
        behind = points[surface == index]
        assert len(behind) > 100
        height_m = behind @ face.unit_normal + face.offset_m + pane.depth_m
        np.testing.assert_allclose(height_m, face.bend.height_m(behind.T), atol=1e-7)
        heights.append(height_m)
    assert np.ptp(np.concatenate(heights)) > 0.002


@pytest.mark.parametrize("name", FAULTS)
def test_every_fault_changes_the_data_and_is_in_the_truth(name: str) -> None:
    """Mutation: a fault whose name is known and does nothing, or is left out of the document."""
    plain, faulty = (prepare("no-static-start", seed=5, duration_s=1.0, faults=parse_faults(f)) for f in ("", name))
    a, b = plain.imu_records, faulty.imu_records
    same = (
        np.array_equal(plain.sweep(3).xyz_m, faulty.sweep(3).xyz_m)
        and np.array_equal(a.gyro_rad_s, b.gyro_rad_s)
        and np.array_equal(a.accel, b.accel)
        and np.array_equal(a.stamps_ns, b.stamps_ns)
        and plain.cloud(3).stamp_ns == faulty.cloud(3).stamp_ns
        and len(plain.cloud(3).points) == len(faulty.cloud(3).points)
    )
    assert not same
    document = faulty.truth.to_file()
    assert document.faults == [name]
    in_the_room = {"vibration", "bent-walls", "door-ajar", "skirting", "glass", "materials"}
    assert bool(document.intrinsics) == (name not in in_the_room)


@pytest.mark.parametrize("word", ["laser-offsets=foo", "laser-offsets=", "industrial=foo", "door-ajar=1.2.3"])
def test_a_size_that_is_none_is_told_as_that(word: str) -> None:
    """Mutation: a name that is known called an unknown fault."""
    base, _, size = word.partition("=")
    with pytest.raises(SettingsError, match=f"size of the fault {base}, found {size!r}"):
        parse_faults(word)
    with pytest.raises(SettingsError, match="expected the name of a fault, found 'laser-offset=1'"):
        parse_faults("laser-offset=1")
