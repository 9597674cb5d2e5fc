"""The report that one signs: what it holds, what it draws, and the evidence behind its pictures."""

from __future__ import annotations

import base64
import html
import re
import shlex
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import binom

from app.results import agreement, captions, plot_parts, plots
from app.results.companions import Beside
from app.results.evidence import CORNER_SIDE_M, StepListener, densest, measure_evidence
from app.results.imu_evidence import compare_imu, imu_motion
from app.results.report import SETTINGS, report_page
from app.results.scans import measure_scans
from app.results.sensors import kinds_of
from app.results.thickness import measure_thickness
from app.results.verdict import solve_outcome
from calib_core import api
from calib_core.intrinsics import NAMES, UNITS
from calib_core.result import Crispness, Intrinsic, Message, RoomCrispness
from calib_core.settings import CalibrateSettings
from calib_core.simulate import generate
from calib_core.types import Trajectory
from tests.app.support import fake_jobs, world

NAME = "room<b>.bag"


@pytest.fixture(scope="module")
def beside():
    """Everything that a solve of the world leaves behind."""
    recording, trajectory, result = world.make_recording(), world.make_trajectory(), world.make_result()
    # The lidar turns about the map's z: gravity as its own axes have it, seen by a tilted IMU.
    weight = np.tile(world.R_IMU_LIDAR @ [0.0, 0.0, 9.81], (len(recording.imu.stamps_ns), 1))
    recording = replace(recording, imu=replace(recording.imu, accel_m_s2=weight))
    told = []
    listener = StepListener(told.append)
    for step in range(4):
        listener(fake_jobs.iteration(step))
    assert len(told) == len(listener.steps) == 4
    return Beside(
        walls=measure_thickness(recording, trajectory, result.quality.planes),
        scans=measure_scans(recording, trajectory, result.quality.planes),
        evidence=measure_evidence(recording, result, trajectory, listener.steps),
        command="unsweep calibrate 'room<b>.bag' --output result.json",
        made_at=datetime(2026, 3, 4, 5, 6, tzinfo=UTC),
    )


@pytest.fixture(scope="module")
def page(beside):
    crisp = RoomCrispness(mean_entropy_nat=-5.0, thickness_std_m=0.02, points=9, cubes=3)
    result = world.make_result(name=NAME)
    quality = result.quality.model_copy(
        update={"crispness": Crispness(before=crisp, after=crisp, text="Crisp & clear.")}
    )
    settings = CalibrateSettings(random_seed=7).model_dump(mode="json")
    provenance = result.provenance.model_copy(update={"settings": settings})
    return report_page(result.model_copy(update={"quality": quality, "provenance": provenance}), beside)


@pytest.fixture
def unrendered(monkeypatch):
    """Pages are asked for their words, captions included: to render the pictures is all of their time."""
    monkeypatch.setattr(plots.Canvas, "svg", lambda _: "data:image/svg+xml,")


def test_the_page_says_what_one_signs_for(page):
    """Mutations: the date, the settings, the hash or the command left out; the recording's name not escaped."""
    for said in (
        "2026-03-04 05:06 UTC",
        "<b>seed of the plane search: 7</b>",
        "; IMU sampling",
        "room&lt;b&gt;.bag",
        "unsweep calibrate",
        "signature",
    ):
        assert said in page
    assert "Crisp &amp; clear." in page
    assert "unsweep calibrate &#39;room" in page
    # The recording's and the document's own.
    assert len(set(re.findall(r"<code>([0-9a-f]{64})</code>", page))) == 2
    assert NAME not in page


@pytest.mark.usefixtures("unrendered")
def test_no_sigma_stands_beside_an_angle_that_it_is_not_of():
    """Drawn from the covariance, roll, pitch and yaw of a lidar on its side scatter otherwise than turns about its axes do.

    Mutation: the sigmas of the turns beside roll, pitch and yaw.
    """
    turns_deg = np.array([0.09, 0.36, 0.05])
    R = Rotation.from_euler("ZYX", [0.0, 0.0, 90.0], degrees=True)
    drawn = R * Rotation.from_rotvec(turns_deg * np.random.default_rng(3).normal(size=(4000, 3)), degrees=True)
    scatter = dict(zip(("Yaw", "Pitch", "Roll"), drawn.as_euler("ZYX", degrees=True).std(axis=0), strict=True))
    assert scatter["Yaw"] == pytest.approx(0.36, rel=0.1) and scatter["Pitch"] == pytest.approx(0.05, rel=0.1)

    result = world.make_result()
    transform = result.T_imu_lidar.model_copy(update={"euler_xyz_deg": [90.0, 0.0, 0.0]})
    uncertainty = result.uncertainty.model_copy(update={"rotation_std_deg": list(turns_deg)})
    page = report_page(result.model_copy(update={"T_imu_lidar": transform, "uncertainty": uncertainty}), Beside())
    told = dict(
        re.findall(
            r'<th scope="row">([^<]*)</th><td class="n">[^<]*</td><td class="n">([\d.]*)</td>', html.unescape(page)
        )
    )
    for name, std in scatter.items():
        assert told[f"{name} [deg]"] == "" or float(told[f"{name} [deg]"]) == pytest.approx(std, rel=0.1)
    assert [told[f"Turn about the lidar's {axis} [deg]"] for axis in "xyz"] == ["0.090", "0.36", "0.050"]


@pytest.mark.usefixtures("unrendered")
def test_the_sensors_own_errors_stand_kind_by_kind():
    """Mutations: the largest for the surest; radians; a sign of nothing; considered and estimated of a kind as one."""

    def one(block, name, value, std, state="estimated"):
        told = {"block": block, "name": name, "unit": UNITS[block], "value": value, "std": std, "prior_std": 0.008}
        return Intrinsic.model_validate({**told, "state": state, "significant": abs(value) > 3.0 * std})

    found = [
        one("laser_range_offset", "2", -0.0091, 0.0003),
        one("laser_range_offset", "5", 0.0112, 0.002),
        one("laser_range_offset", "7", 0.001, 0.002),
        one("clock_rate", "rate", -0.01, 4.2),
        one("gyroscope_rotation", "x", 0.01, 0.001),
        one("gyroscope_rotation", "y", 0.0, 0.001, "considered"),
        one("g_sensitivity", "xz", 1e-4, 1e-5),
    ]
    result = world.make_result().model_copy(update={"intrinsics": found, "imu_frame": "those of nobody"})
    rows = [(row.kind, row.count, row.state, row.largest, row.before, row.beyond) for row in kinds_of(result)]
    assert rows == [
        ("laser range offset", 3, "estimated", "ring 2: -9.10 ± 0.30 mm", "8.0 mm", 2),
        ("clock rate", 1, "estimated", "0.0 ± 4.2 ppm", "0.0080 ppm", 0),
        ("gyroscope rotation", 1, "estimated", "0.573 ± 0.057 deg", "0.46 deg", 1),
        ("gyroscope rotation", 1, "considered", "0.000 ± 0.057 deg", "0.46 deg", 0),
        ("g sensitivity", 1, "estimated", "0.0562 ± 0.0056 deg/s per g", "4.5 deg/s per g", 1),
    ]
    page = report_page(result)
    assert "The IMU's axes here are those of nobody." in page
    assert "ring 2: -9.10 ± 0.30 mm" in page
    assert "own errors</h2>" not in report_page(result.model_copy(update={"intrinsics": []}))


@pytest.mark.usefixtures("unrendered")
def test_the_offset_has_the_instant_at_which_it_holds():
    """Mutations: the instant, or the way the offset goes on from there, left out; a rate of -0.04 ± 4.2 told as "-0.0"; clocks
    that were taken to run alike told to do so.
    """
    alike = world.make_result()
    assert "after the recording began" not in report_page(alike)
    for rate, told in ((-1.53, "-1.5"), (-0.04, "0.0"), (48.21, "48.2")):
        apart = {"clock_rate_ppm": rate, "clock_rate_ppm_std": 4.2, "time_offset_at_s": 10.04}
        page = report_page(alike.model_copy(update=apart))
        assert (
            f"The offset holds 10.0 s after the recording began; from there it changes by {told} ± 4.2 µs per second."
            in page
        )


def test_every_picture_has_a_sentence_and_units_and_nothing_comes_from_a_network(page):
    """Mutations: a figure without its caption; an axis without its label; the SVG linked instead of held."""
    figures = re.findall(r"<figure.*?</figure>", page, re.DOTALL)
    assert len(figures) == 12  # all but that by ring: this lidar has one
    for figure in figures:
        source = re.search(r'src="data:image/svg\+xml;base64,([^"]+)"', figure)
        assert source is not None
        drawn = base64.b64decode(source.group(1)).decode()
        # Text is drawn as paths; what it says stands before it as a comment.
        words = re.findall(r"<!-- (.*?) -->", drawn)
        assert any(re.search(r"\[(m|mm|s|deg|deg/s|ms|%)\]|number|step", word) for word in words), words[-4:]
        assert len(re.findall(r"<figcaption>[A-Z0-9].{60,}</figcaption>", figure)) == 1
    for address in ("http:", "https:", "<script", "<link", "@import", "url("):
        assert address not in page
    assert len(page) < 3_000_000
    assert "@page { size: A4" in page


def test_a_run_without_an_answer_has_its_page_too():
    """Mutation: figures of nothing drawn."""
    page = report_page(world.make_result("refused"), Beside(evidence=None))
    assert "<figure" not in page
    assert "T_imu_lidar" not in page
    assert "Refused.</b> Nothing moves" in page
    assert "signature" in page


@pytest.mark.usefixtures("unrendered")
def test_an_answer_whose_parts_disagree_says_so_once_and_not_in_green():
    """Oracle: the page on the screen. Mutations: the colour by status; the word of the verdict said twice."""
    result = world.make_result()
    said = Message(code="solve.disagreement", level="warning", text="the parts disagree 9.2 times")
    page = report_page(result.model_copy(update={"messages": [*result.messages, said]}))
    assert re.search(
        r'<div class="verdict doubtful"><b>Calibrated\.</b> Parts of the recording disagree by more than noise', page
    )
    assert re.search(r'<div class="verdict good"><b>Calibrated\.</b> One standard deviation is', report_page(result))
    refused = result.model_copy(update={"status": "refused", "T_imu_lidar": None, "uncertainty": None})
    assert re.search(r'<div class="verdict bad"><b>Refused\.</b> ', report_page(refused))


def test_parts_that_say_nothing_do_not_press_the_others_flat():
    """Of one stretch the turn is known to 57 deg, of the others to 0.03. Oracle: the bars that tell, by hand. Mutations: the
    longest bar counts; shifts of the wrong unit; what crosses zero counted by the shift alone."""
    blocks = world.make_evidence().parts.time_blocks
    looks = {name: (unit, shift, std) for name, unit, shift, std in plot_parts.own_answers(blocks)}
    unit, shift, std = looks["rotation"]
    assert unit == "deg"
    assert std.max() == 57.3
    assert plot_parts.reach(shift, std) == pytest.approx(1.1 * 0.04)
    unit, shift, std = looks["position"]
    assert unit == "mm"
    assert plot_parts.reach(shift, std) == pytest.approx(1.1 * 3.5)
    assert looks["time offset"][1].shape == (8, 1)
    # Of each stretch the position along y is 2 mm off with a bar of 1 mm; all others are within theirs.
    assert agreement.crossing_zero(blocks) == (8 * 6, 8 * 7)
    assert "48 of 56 bars do, as expected from noise." in captions.time_blocks(blocks)
    # The page shows what is served: mutation: none, or of the planes.
    answered = world.make_result().model_copy(update={"evidence": world.make_evidence()})
    assert solve_outcome(answered).stretches == "48 of 56 bars do, as expected from noise"
    assert solve_outcome(answered.model_copy(update={"evidence": None})).stretches == ""


def test_it_is_said_whether_as_many_bars_cross_zero_as_should():
    """Oracle: the binomial law's first percentile, from SciPy. Mutations: two thirds themselves as the limit; the other
    tail; seldom is as ever.
    """
    for bars in (7, 21, 56, 140):
        fewest = int(binom.ppf(0.01, bars, 0.6827))
        told = [agreement.as_chance_has(crossing, bars) for crossing in (fewest - 1, fewest, bars)]
        assert told == ["fewer than noise explains", "few, but noise alone may cause that", "as expected from noise"]
        usual = int(binom.ppf(0.16, bars, 0.6827))
        told = [agreement.as_chance_has(crossing, bars) for crossing in (usual - 1, usual)]
        assert told == ["few, but noise alone may cause that", "as expected from noise"]
    assert agreement.as_chance_has(38, 56) == "as expected from noise"
    assert agreement.as_chance_has(29, 56) == "fewer than noise explains"


def test_every_axis_has_three_ticks_however_low(beside):
    """Mutation: matplotlib's own two at least, which low axes of the IMU's readings come to."""
    canvas = plots.Canvas(plots.FULL, 2.2)
    for axes in canvas.axes(4, 1)[:, 0]:
        axes.plot([0.0, 1.0], [-0.1, 0.09])
    canvas.svg()
    for axes in canvas.figure.axes:
        low, high = axes.get_ylim()
        assert sum(low <= tick <= high for tick in axes.get_yticks()) >= 3


@pytest.mark.usefixtures("unrendered")
def test_a_command_is_broken_before_its_options_only():
    """Oracle: the shell's own words. Mutation: broken at every hyphen, or inside of a quoted name."""
    command = "unsweep calibrate 'a -- b.bag' --lidar-topic /velodyne --output result.json"
    page = report_page(world.make_result(), Beside(command=command))
    (shown,) = re.findall(r"<pre>(unsweep.*?)</pre>", page, re.DOTALL)
    assert shlex.split(html.unescape(shown).replace("\\\n", "")) == shlex.split(command)
    assert [line.strip().split(" ")[0] for line in shown.splitlines()] == ["unsweep", "--lidar-topic", "--output"]


def test_what_the_turning_says_is_the_profiles_own_sentence():
    """Mutation: an old document's highest value, three steps away in a curve that may be flat, is a disagreement."""
    profile = world.make_evidence().time_offset_profile
    assert captions.offset_profile(profile).endswith(f"one clear peak at zero. {profile.text}")
    old = captions.offset_profile(profile.model_copy(update={"best_s": -0.03, "text": ""}))
    assert old.endswith("one clear peak at zero. The highest is at -30.0 ms.")


def test_the_scans_spread_says_what_it_is_of(beside):
    """A chair 0.2 m from a wall counts. Mutations: the gate of what is measured, or of what is said, is another."""
    assert "of its points within 0.3 m of one. Furniture and persons so near count" in captions.over_time(beside.scans)
    scan, planes = world.make_recording().scans[0], world.plane_quality()
    points = scan.points.copy()
    points["xyz"] *= np.float32(0.94)  # walls are 2 to 4 m away
    seen = replace(world.make_recording(), scans=[replace(scan, points=points)])
    assert measure_scans(seen, world.make_trajectory(), planes).rms_m[0] > 0.1


def test_the_same_run_gives_the_same_pictures(beside):
    """A page that was signed can be made again. Mutation: matplotlib's own names and date left in the pictures."""
    one, other = plots.drawn(lambda: (plots.thickness(beside.walls), plots.thickness(beside.walls)))
    assert one == other


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="the kernel's list of open files is Linux's")
def test_reports_hold_no_more_files_the_more_threads_ask_for_them(beside):
    """A server answers in whichever thread is free. Oracle: the kernel's list of open files. Mutation: drawn in the thread
    that asks, each of which has matplotlib open the fonts anew and keep them.
    """

    def fonts():
        held = [path.readlink().name for path in Path("/proc/self/fd").iterdir() if path.is_symlink()]
        return sum(name.endswith(".ttf") for name in held)

    def ask(_):
        plots.drawn(lambda: plots.thickness(beside.walls))
        together.wait()  # no thread ends and leaves its number to the next

    ask_at_once, together = 4, threading.Barrier(4)
    plots.drawn(lambda: plots.thickness(beside.walls))
    before = fonts()
    with ThreadPoolExecutor(ask_at_once) as pool:
        list(pool.map(ask, range(ask_at_once)))
    assert fonts() == before > 0


def test_distances_are_binned_by_range_and_ring():
    """Ring 3 reads two per cent too far. Oracle: walls stand 2 to 4 m away, so that is 40 to 80 mm. Mutations: mean for
    rms; unsigned distances; signs of the planes' normals."""
    recording, trajectory = world.make_recording(), world.make_trajectory()
    scans = []
    for scan in recording.scans:
        points = scan.points.copy()
        points["ring"] = np.arange(len(points)) % 5
        points["xyz"][points["ring"] == 3] *= 1.02
        scans.append(replace(scan, points=points))
    evidence = measure_evidence(replace(recording, scans=scans), world.make_result(), trajectory, [])
    rings = evidence.by_ring
    assert rings is not None
    assert rings.at == [0.0, 1.0, 2.0, 3.0, 4.0]
    # Normals look inwards: farther is against them, and reads long.
    assert 0.03 < rings.mean_m[3] < 0.10
    assert np.abs(np.delete(rings.mean_m, 3)).max() < 0.002
    assert all(rms >= abs(mean) for rms, mean in zip(rings.rms_m, rings.mean_m, strict=True))
    assert evidence.by_range is not None
    assert evidence.by_range.at == sorted(evidence.by_range.at)


def _own(block, name, value, state="estimated"):
    """A parameter of a sensor, as a result has it."""
    unit = UNITS[block]
    return Intrinsic(block=block, name=name, unit=unit, value=value, std=0, prior_std=0, state=state, significant=True)


def test_distances_are_without_what_the_answer_took_out_of_the_ranges():
    """Ring 3 reads 60 mm long, all read what a slant makes (incidence 40 mm, grazing 10 mrad). Oracle: the equation of
    calib_core/intrinsics.py over the walls' own geometry. Mutations: ranges as sent; only the lasers', or only the slant's,
    taken out; the latter with its other sign; what was only considered taken out; the caption silent."""
    recording, trajectory = world.make_recording(), world.make_trajectory()
    planes = world.make_result().quality.planes
    normals = np.array([plane.normal for plane in planes])
    offsets_m = np.array([plane.offset_m for plane in planes])
    scans = []
    for scan in recording.scans:
        points = scan.points.copy()
        points["ring"] = np.arange(len(points)) % 5
        here = points.copy()
        here["xyz"] = 0.0
        place = api.map_points(scan, trajectory)
        ray = place - api.map_points(replace(scan, points=here), trajectory)
        range_m = np.linalg.norm(ray, axis=1)
        owner = np.abs(place @ normals.T + offsets_m).argmin(axis=1)
        cosine = np.abs(np.sum(ray * normals[owner], axis=1)) / range_m
        off_m = 0.06 * (points["ring"] == 3) + 0.04 * (1 / cosine - 1) - 0.01 * range_m * np.tan(np.arccos(cosine))
        points["xyz"] *= (1.0 + off_m / range_m)[:, None].astype(np.float32)
        scans.append(replace(scan, points=points))
    seen = replace(recording, scans=scans)

    def of(*own):
        return measure_evidence(seen, world.make_result().model_copy(update={"intrinsics": list(own)}), trajectory, [])

    slant = [_own("incidence", "all", 0.04), _own("grazing", "all", 0.01)]
    laser = _own("laser_range_offset", "3", 0.06)
    sent, mended = of(laser.model_copy(update={"state": "considered"})), of(laser, *slant)
    assert (sent.ranges, mended.ranges) == ("as-published", "corrected")
    assert sent.by_ring.mean_m[3] - sent.by_ring.mean_m[2] > 0.03
    for binned in (mended.by_ring, mended.by_range):
        assert np.abs(binned.mean_m).max() < 0.002
    for part in ([laser], slant):
        assert np.abs(of(*part).by_range.mean_m).max() > 0.004
    said = captions.by_value(mended.by_ring, "ring", ranges=mended.ranges)
    assert "beyond them and so the lidar reads long, negative where short. Ranges and angles were corrected" in said
    assert "corrected" not in captions.by_value(sent.by_ring, "ring", ranges=sent.ranges)
    assert "long" not in captions.by_value(sent.by_ring, "ring")


def test_bins_of_range_do_not_choose_points_by_their_noise():
    """Every point gets 40 mm of noise along its ray; the mean distance is zero in every bin all the same, within four
    standard errors. Mutation: bins of the measured range; the nearest then holds what was measured too near."""
    recording, trajectory = world.make_recording(), world.make_trajectory()
    rng = np.random.default_rng(5)
    scans = []
    for scan in recording.scans:
        points = scan.points.copy()
        range_m = np.linalg.norm(points["xyz"], axis=1)
        points["xyz"] *= (1.0 + 0.04 * rng.normal(size=len(points)) / range_m)[:, None].astype(np.float32)
        scans.append(replace(scan, points=points))
    binned = measure_evidence(replace(recording, scans=scans), world.make_result(), trajectory, []).by_range
    assert binned is not None
    assert len(binned.at) > 10
    errors = np.array(binned.rms_m) / np.sqrt(binned.points)
    assert np.abs(np.array(binned.mean_m) / errors).max() < 4.0


def test_the_room_is_seen_from_above_and_thinner_de_skewed(beside):
    """The world's walls are 8 by 6 m. Mutations: the picture turned over; floor and ceiling not left out."""
    room = beside.evidence.room
    assert room.width * room.cell_m == pytest.approx(8.0, abs=1.2)
    before, after = (
        np.frombuffer(base64.b64decode(cells), np.uint8).reshape(room.height, room.width) > 0
        for cells in (room.before, room.after)
    )
    assert after.sum() < 0.5 * before.sum()
    inside = after[room.height * 2 // 5 : room.height * 3 // 5, room.width * 2 // 5 : room.width * 3 // 5]
    assert inside.mean() < 0.01


def test_readings_are_foretold_by_the_true_motion_and_not_by_one_that_is_late():
    """Oracle: the simulator's exact motion. Without noise what is left is that readings are taken as straight between
    stamps: h^2 / 12 of their second derivative. Mutations: gravity left in; the lever arm's sign; the offset subtracted;
    readings averaged over another time than the motion's differences."""
    recording, truth = generate("paper-fast", noise=False, duration_s=6.0)
    times_s = 0.01 * np.arange(1, 598)
    R, p = truth.map_lidar(times_s)
    trajectory = Trajectory(truth.epoch_ns, times_s, R, p, np.ones(len(times_s), bool))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = truth.R_imu_lidar, truth.p_imu_lidar
    compared, up = compare_imu(recording, imu_motion(trajectory, T), truth.time_offset_ns)
    assert compared is not None
    second = [np.diff(values, n=2, axis=0) for values in (recording.imu.gyro_rad_s, recording.imu.accel_m_s2)]
    assert compared.gyro_rms_rad_s < 1.5 * np.sqrt(np.mean(second[0] ** 2)) / 12
    assert compared.accel_rms_m_s2 < 1.5 * np.sqrt(np.mean(second[1] ** 2)) / 12
    assert np.linalg.norm(up) == pytest.approx(1.0)
    floor = max(truth.planes, key=lambda plane: abs(plane.normal @ up))
    assert abs(floor.normal @ up) > 0.9999
    late, _ = compare_imu(recording, imu_motion(trajectory, T), truth.time_offset_ns + 20_000_000)
    assert late is not None
    assert late.gyro_rms_rad_s > 10 * compared.gyro_rms_rad_s
    assert late.accel_rms_m_s2 > 5 * compared.accel_rms_m_s2


#: Of an IMU that is worse than a cheap one; the clocks apart by 0.3 ms a second.
OWN = {
    "gyroscope_scale": [0.03, -0.02, 0.04],
    "gyroscope_axes": [0.02, 0.0, -0.03],
    "gyroscope_rotation": [0.01, -0.04, 0.03],
    "accelerometer_scale": [0.02, 0.03, -0.02],
    "accelerometer_axes": [0.01, -0.02, 0.02],
    "accelerometer_delay": [0.02],  # two of its steps: nothing is lost between stamps
    "accelerometer_quadratic": [2e-4, -1e-4, 3e-4],
    "g_sensitivity": [0.004, 0.0, -0.003, 0.002, 0.001, 0.0, 0.0, 0.005, 0.002],
    "size_effect": [0.03, -0.02, 0.01, 0.015, 0.02, -0.025, -0.01, 0.02, 0.03],
    "clock_rate": [300.0],
}


def _read_by_such_an_imu(recording):
    """The recording as an IMU with these errors gives it. Oracle: the equations of calib_core/intrinsics.py, written anew."""
    imu, at_s = recording.imu, (recording.imu.stamps_ns - recording.imu.stamps_ns[0]) * 1e-9
    w, slope = imu.gyro_rad_s, np.gradient(imu.gyro_rad_s, at_s, axis=0)
    beside = [np.cross(slope, r) + np.cross(w, np.cross(w, r)) for r in np.reshape(OWN["size_effect"], (3, 3))]
    read = imu.accel_m_s2 + np.stack([beside[axis][:, axis] for axis in range(3)], axis=1)
    late = np.stack([np.interp(at_s - OWN["accelerometer_delay"][0], at_s, a) for a in read.T], axis=1)
    matrices = []
    for kind in ("gyroscope", "accelerometer"):
        M = np.diag(1.0 + np.array(OWN[f"{kind}_scale"]))
        M[1, 0], M[2, 0], M[2, 1] = OWN[f"{kind}_axes"]
        matrices.append(M)
    turn = Rotation.from_rotvec(OWN["gyroscope_rotation"]).as_matrix()
    felt = imu.accel_m_s2 @ np.reshape(OWN["g_sensitivity"], (3, 3)).T
    return replace(
        recording,
        imu=replace(
            imu,
            stamps_ns=imu.stamps_ns - np.rint(300e-6 * 1e9 * (at_s - 3.0)).astype(np.int64),
            gyro_rad_s=imu.gyro_rad_s @ (matrices[0] @ turn).T + felt,
            accel_m_s2=(late + np.array(OWN["accelerometer_quadratic"]) * late**2) @ matrices[1].T,
        ),
    )


def test_the_readings_are_compared_without_what_the_answer_took_out():
    """Oracle: an IMU without errors. Mutations: readings as sent; any block, the delay or the clocks' rate left in or put in
    twice; what was only considered taken out."""
    recording, truth = generate("paper-fast", noise=False, duration_s=6.0)
    times_s = 0.01 * np.arange(10, 580)  # nothing is known of readings later than the last by the delay
    trajectory = Trajectory(truth.epoch_ns, times_s, *truth.map_lidar(times_s), np.ones(len(times_s), bool))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = truth.R_imu_lidar, truth.p_imu_lidar
    plain = world.make_result()
    plain = plain.model_copy(
        update={
            "T_imu_lidar": plain.T_imu_lidar.model_copy(update={"matrix": T.tolist()}),
            "time_offset_ns": truth.time_offset_ns,
            "time_offset_at_s": 3.0
            + (recording.imu.stamps_ns[0] + truth.time_offset_ns - recording.scans[0].stamp_ns) * 1e-9,
            "clock_rate_ppm": OWN["clock_rate"][0],
        }
    )

    def compared(result, seen):
        imu = measure_evidence(seen, result, trajectory, []).imu
        assert imu is not None
        return imu

    def with_own(state):
        own = [_own(b, n, v, state) for b, values in OWN.items() for n, v in zip(NAMES[b], values, strict=True)]
        return plain.model_copy(update={"intrinsics": own})

    ideal, bad = compared(plain, recording), _read_by_such_an_imu(recording)
    mended = compared(with_own("estimated"), bad)
    assert mended.gyro_rms_rad_s < 1.3 * ideal.gyro_rms_rad_s
    assert mended.accel_rms_m_s2 < 1.5 * ideal.accel_rms_m_s2
    assert (ideal.corrected, mended.corrected) == (False, True)
    assert "its own errors that this answer found and took out" in captions.imu(mended, with_own("estimated"))
    left = compared(with_own("considered"), bad)
    assert left.gyro_rms_rad_s > 10 * ideal.gyro_rms_rad_s
    assert left.accel_rms_m_s2 > 5 * ideal.accel_rms_m_s2
    assert "what the IMU measured. Black" in captions.imu(left, with_own("considered"))
    # Kept by an older program, which took nothing out.
    assert "as it was sent, with its own errors" in captions.imu(left, with_own("estimated"))


@pytest.mark.usefixtures("unrendered")
def test_units_are_printed_as_people_print_them():
    """A sentence is the terminal's too. Mutation: the terminal's m/s2 on paper."""
    noise = "IMU noise: gyroscope 0.00012 rad/s/sqrt(Hz), accelerometer 0.0012 m/s2/sqrt(Hz)"
    result = world.make_result()
    message = Message(code="imu.noise", level="info", text=noise)
    told = report_page(result.model_copy(update={"messages": [message]}))
    assert "gyroscope 0.00012 rad/s/√Hz, accelerometer 0.0012 m/s²/√Hz" in told


@pytest.mark.usefixtures("unrendered")
def test_what_is_noticed_begins_as_a_sentence_does():
    """Mutations: a line that begins small; one that does after the word that says how grave it is."""
    noticed = [("info", "ring 4 reads 9 mm short"), ("warning", "wall 3 moves against the other planes: left out")]
    messages = [Message(code="said", level=level, text=text) for level, text in noticed]
    told = report_page(world.make_result().model_copy(update={"messages": messages}))
    assert "Ring 4 reads 9 mm short" in told
    assert "wall 3 moves against the other planes: left out" in told


@pytest.mark.usefixtures("unrendered")
def test_the_worst_distance_is_told_where_it_is_with_its_unit(beside):
    """Mutation: a range without metres."""
    assert beside.evidence.by_range is not None
    assert re.search(r" mm at range [\d.]+ m[,;]", captions.by_value(beside.evidence.by_range, "range", " m"))
    assert re.search(r"at range [\d.]+ m[,;]", report_page(world.make_result(), beside))


def test_settings_are_told_in_the_page_s_words(page):
    """Mutations: null and true as JSON has them; gravity's spread left out; what has no bound called found; a setting without
    a word of its own; one that is not told.
    """
    assert "gravity: 9.807 ± 0.02 m/s²" in page
    assert "estimate the planes: yes" in page
    assert "IMU noise: as measured" in page
    assert "what is known: nothing" in page
    assert "points per plane and scan: all;" in page
    assert "field of view, ±°: all around;" in page
    assert "spans left out, s: none" in page
    assert "biases: drift slowly" in page
    assert "sensors' own errors: where they show" in html.unescape(page)
    assert set(SETTINGS) == set(CalibrateSettings.model_fields)


def test_the_corner_that_is_shown_is_where_most_points_stand_over_one_another() -> None:
    """Forty in one cell of 5 cm at (-3.4, 7.1), thinly spread elsewhere.

    Mutations: the emptiest cell; x and y exchanged; counted from the first cell's middle.
    """
    rng = np.random.default_rng(2)
    plan = np.vstack([rng.uniform(-9.0, 9.0, (500, 2)), np.tile([-3.42, 7.12], (40, 1))]).astype(np.float32)
    left, bottom, side = densest(plan)
    assert side == CORNER_SIDE_M
    np.testing.assert_allclose([left + side / 2, bottom + side / 2], [-3.425, 7.125], atol=1e-9)
