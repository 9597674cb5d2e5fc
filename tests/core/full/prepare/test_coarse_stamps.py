"""Stamps cut to a clock's ticks: what the mean of what was cut off may be, by drawing it, and whom it must not trouble."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.calibrate import calibrate
from calib_core.events import ignore_event, never_cancel
from calib_core.full.prepare.coarse_stamps import exact_stamps, imu_step, point_step, scan_step
from calib_core.full.prepare.prepare import prepare
from calib_core.readers.imu.bundles import spread, told_apart
from calib_core.settings import CalibrateSettings
from calib_core.simulate import SCENARIOS, Truth, generate
from calib_core.types import POINT_DTYPE, FloatArray, ImuData, IntArray, Recording, Scan

EPOCH_NS = 1_700_000_000_123_456_789
MS = 1_000_000


def _imu(stamps_ns: IntArray, step_ns: int = 0) -> ImuData:
    nothing = np.zeros((len(stamps_ns), 3))
    return ImuData(stamps_ns, nothing, nothing, "/imu", stamp_step_ns=step_ns)


def _instants(rng: np.random.Generator, period_ns: float, count: int = 1500) -> IntArray:
    """Of an even clock, begun at any time."""
    return EPOCH_NS + np.rint(rng.uniform(0.0, 1e9) + period_ns * np.arange(count)).astype(np.int64)


def _cut(t: IntArray, step_ns: int, *, nearest: bool) -> IntArray:
    return np.asarray((t + (step_ns // 2 if nearest else 0)) // step_ns * step_ns, dtype=np.int64)


@pytest.mark.parametrize(("period_ns", "covered"), [(10_000_000.0, 0.0), (10_007_770.0, 1.0)])
def test_the_mean_of_what_was_cut_off_is_as_unsure_as_drawn(period_ns: float, covered: float) -> None:
    """A thousand recordings at 100 Hz, half of them cut and half rounded: the root mean square of the mean of what is gone.
    Mutations: a quarter of a step for cutting alone; the width left out where the sensor keeps step; the phases always spread.
    """
    rng, means_s = np.random.default_rng(1), []
    for k in range(1000):
        t = _instants(rng, period_ns)
        stamps = _cut(t, MS, nearest=k % 2 == 0)
        means_s.append(1e-9 * float(np.mean(t - stamps)))
        if np.all(stamps % (10 * MS) == 0):  # taken for exact, one in ten: see below
            continue
        found = imu_step(_imu(stamps))
        assert found is not None
        assert found.step_s == 1e-3
        assert found.spread == pytest.approx(covered, abs=0.05)
        assert found.std_s == pytest.approx([0.4564e-3, 0.3536e-3][round(covered)], rel=0.02)
    assert np.sqrt(np.mean(np.square(means_s))) == pytest.approx([0.4564e-3, 0.3536e-3][round(covered)], rel=0.05)


def test_readings_that_share_a_tick_lie_after_it() -> None:
    """200 Hz against ticks of 10 ms, through the reader's part: two readings a stamp, both kept, a period apart. Oracle: the mean
    off the true instants over 400 recordings. Mutations: the newest at the tick (off by 7.5 ms, cut); the tick not handed on.
    """
    rng, means_s, std_s = np.random.default_rng(2), [], 0.0
    for k in range(400):
        t = _instants(rng, 5_000_000.0, 400)
        stamps = _cut(t, 10 * MS, nearest=k % 2 == 0)
        kept, apart = told_apart(stamps, rng.standard_normal((400, 1)))
        found = spread(apart)
        assert found is not None
        assert (len(kept), found.tick_ns) == (400, 10 * MS)
        assert np.all(np.diff(found.stamps_ns) > 0)
        step = imu_step(_imu(found.stamps_ns, found.tick_ns))
        assert step is not None
        std_s = step.std_s
        means_s.append(1e-9 * float(np.mean(t - found.stamps_ns)))
    assert np.sqrt(np.mean(np.square(means_s))) == pytest.approx(std_s, rel=0.06)
    assert std_s == pytest.approx(2.887e-3, rel=0.01)


def test_a_buffer_that_is_emptied_is_no_clock_that_ticks() -> None:
    """Every 16 ms, by a timer that no clock's epoch knows. Mutation: any even bundles are ticks."""
    t = _instants(np.random.default_rng(3), 5_000_000.0)
    emptied = EPOCH_NS + 3_217_000 - (EPOCH_NS + 3_217_000 - t) // (16 * MS) * (16 * MS)
    found = spread(told_apart(emptied, np.random.default_rng(3).standard_normal((len(t), 1)))[1])
    assert found is not None
    assert found.tick_ns == 0


def test_seconds_in_double_precision_hide_no_step() -> None:
    """As a recorder writes three digits, and reads them as a number. Mutation: multiples to the nanosecond."""
    stamps = _cut(_instants(np.random.default_rng(4), 10_000_777.0), MS, nearest=False)
    seconds = stamps // 10**9 + (1e-9 * (stamps % 10**9))
    read = np.floor(seconds).astype(np.int64) * 10**9 + np.floor((seconds % 1.0) * 1e9).astype(np.int64)
    assert np.any(read % MS != 0)
    found = imu_step(_imu(read))
    assert found is not None
    assert found.step_s == 1e-3


def test_a_period_in_double_precision_is_the_sensors_own_all_the_same() -> None:
    """A lidar whose rotor keeps to tenths of UTC, its points' times in seconds since 1970: 100 ms and some nanoseconds between
    scans. Seen: 35 ms of doubt, and "weak". Mutation: multiples of the median to the nanosecond.
    """
    seconds = EPOCH_NS // 10**9 + 0.1 * np.arange(299)
    stamps = np.rint((seconds % 1.0) * 1e9).astype(np.int64) + np.floor(seconds).astype(np.int64) * 10**9
    assert np.median(np.diff(stamps)) % (100 * MS) != 0
    assert scan_step(stamps, "/points") is None
    assert "multiples of the 100 ms" in str(exact_stamps(stamps, "/points"))


def test_stamps_in_step_on_hundredths_of_a_second_are_the_sensors_own() -> None:
    """Scans every 100 ms that begin at 50 ms: of stamps cut to milliseconds one recording in ten begins on a hundredth. Some are
    lost, and all are told in double precision. Those that do not keep step, or keep step with milliseconds or with a host's
    ticks, are cut. Seen: ideal recordings of a simulator called weak, their offset told to 5 ms.

    Mutations: multiples of the period alone; any that keep step; those that do not keep step; ticks as well.
    """
    lost = np.delete(np.arange(300, dtype=np.int64), [7, 90, 91])
    start_ns = EPOCH_NS // 10**9 * 10**9

    def told(start_ms: float, period_ms: float, double: bool) -> tuple[bool, str]:
        stamps = start_ns + np.rint(start_ms * MS + period_ms * MS * lost).astype(np.int64)
        if double:
            seconds = stamps // 10**9 + 1e-9 * (stamps % 10**9)
            stamps = np.rint((seconds % 1.0) * 1e9).astype(np.int64) + np.floor(seconds).astype(np.int64) * 10**9
        return scan_step(stamps, "/points") is None, str(exact_stamps(stamps, "/points"))

    for double in (False, True):
        exact, said = told(50.0, 100.0, double)
        assert exact
        assert "multiples of 10 ms that come in step, every 100 ms" in said
        assert "cuts them to steps of 10 ms" in said
    assert told(53.0, 100.0, double=False) == (False, "None")
    assert told(15.625, 125.0, double=False) == (False, "None")
    rotor = _cut(start_ns + np.rint(100.3 * MS * lost).astype(np.int64), 10 * MS, nearest=False)
    found = scan_step(rotor, "/points")
    assert found is not None
    assert found.step_s == 0.01


def test_a_clock_that_keeps_step_beside_the_steps_is_cut_by_nobody() -> None:
    """Readings 5 ms apart to the nanosecond, begun 228 ns before a hundredth of a millisecond: one recording of twenty begins
    that near by chance, and all its stamps do. Mutation: each stamp is a draw.
    """
    even = EPOCH_NS // 10_000 * 10_000 + 5_000_000 * np.arange(3000, dtype=np.int64)
    assert imu_step(_imu(even - 228)) is None
    assert imu_step(_imu(even + 100)) is None
    found = imu_step(_imu(even))
    assert found is not None
    assert found.step_s == 1e-5


@pytest.mark.parametrize("rate_hz", [100, 200, 400])
@pytest.mark.parametrize("law", ["nanoseconds", "microseconds", "its own period"])
def test_good_stamps_are_left_in_peace(rate_hz: int, law: str) -> None:
    """Whole microseconds cost nothing, and a receiver of satellites samples when its clock says so: at whole periods of UTC.
    Mutations: steps down to a microsecond; multiples of the period as any others.
    """
    t = _instants(np.random.default_rng(5), 1e9 / rate_hz + 7.0)
    if law == "microseconds":
        t = t // 1000 * 1000
    if law == "its own period":
        t = (EPOCH_NS // 10**9 * rate_hz + np.arange(1500)) * (10**9 // rate_hz)
    assert imu_step(_imu(t)) is None
    assert scan_step(t, "/points") is None
    said = exact_stamps(t, "/imu")
    if law != "its own period":
        assert said is None
        return
    assert said is not None
    assert f"the stamps of /imu are multiples of the {1e3 / rate_hz:.4g} ms" in said
    assert "cuts them to steps of 1 ms" in said or rate_hz == 400
    assert exact_stamps(t + 10_000, "/imu") is None


def _scans(offset_ns: FloatArray) -> list[Scan]:
    points = np.zeros(len(offset_ns), POINT_DTYPE)
    points["offset_ns"] = np.floor(offset_ns)
    return [Scan(k, EPOCH_NS + 100 * MS * k, points) for k in range(12)]


@pytest.mark.parametrize(("column_ns", "cut_ns", "found"), [
    (55_296.0, 1, False), (50_000.0, 1, False), (100_000.0, 1, False), (97_656.25, 1, False), (55_296.0, MS, True),
    (50_000.0, 10 * MS, True),
])  # fmt: skip
def test_times_of_points_in_whole_milliseconds_are_told_from_columns(
    column_ns: float, cut_ns: int, *, found: bool
) -> None:
    """VLP-16, XT-32, one of a thousand columns, OS1-64; and what a recorder makes of them. Mutations: any step; one instant of a
    sweep is enough (a flash lidar has none).
    """
    times = np.arange(0.0, 1e8, column_ns) // cut_ns * cut_ns
    step = point_step(_scans(times), "/points")
    assert (step is not None) == found
    assert step is None or step.std_s == pytest.approx(cut_ns * 1e-9 * np.sqrt(0.125), rel=0.02)
    assert point_step(_scans(np.zeros(100)), "/points") is None


@pytest.mark.parametrize("scenario", ["handheld", "outdoor", "ouster", "livox"])
def test_simulated_recordings_are_not_cut(scenario: str) -> None:
    """VLP-16, XT-32, OS1-64, rosette."""
    recording, _ = generate(SCENARIOS[scenario], seed=1, duration_s=2.5)
    stamps = np.array([scan.stamp_ns for scan in recording.scans])
    found = imu_step(recording.imu), scan_step(stamps, ""), point_step(recording.scans, "")
    assert found == (None, None, None)


def test_the_answer_counts_and_says_it_and_can_be_told_otherwise(noisy: tuple[Recording, Truth]) -> None:
    """The IMU's stamps cut to milliseconds, which at 100 Hz keep step: the answer follows them, and its time offset is as unsure
    as that. Told that stamps are as they should be, nothing is counted. Mutations: say nothing; leave it out of the sigma; count
    it whatever is asked for.
    """
    recording, truth = noisy
    cut = replace(recording, imu=replace(recording.imu, stamps_ns=recording.imu.stamps_ns // MS * MS))
    result = calibrate(cut, CalibrateSettings(intrinsics="off", crispness=False)).result
    (said,) = [m.text for m in result.messages if m.code == "clock.coarse"]
    assert "/imu/data, all 640 of them, are multiples of 1 ms" in said
    assert result.uncertainty is not None
    assert result.time_offset_s is not None
    std_s = result.uncertainty.time_offset_std_s
    assert 0.4564e-3 < std_s < np.hypot(0.4565e-3, 1e-4)
    assert abs(result.time_offset_s - truth.time_offset_ns * 1e-9) < 3.0 * std_s
    codes = [m.code for m in result.messages]
    assert "clock.exact" not in codes
    for settings, count in ((CalibrateSettings(), 1), (CalibrateSettings(imu_sampling="as-stamped"), 0)):
        assert len(prepare(cut, settings, ignore_event, never_cancel).clocks.steps) == count


def test_stamps_that_are_taken_for_exact_are_said(noisy: tuple[Recording, Truth]) -> None:
    """Once, and not where the user takes them as they are. Mutations: say nothing; whatever was asked for; the scans' for the
    IMU's.
    """
    recording, _ = noisy
    period_ns = 10 * MS
    first_ns = recording.imu.stamps_ns[0] // period_ns * period_ns
    even = first_ns + period_ns * np.arange(len(recording.imu.stamps_ns))
    exact = replace(recording, imu=replace(recording.imu, stamps_ns=even))
    said: list[str] = []
    for settings, count in ((CalibrateSettings(), 1), (CalibrateSettings(imu_sampling="as-stamped"), 0)):
        said.clear()
        prepare(exact, settings, lambda event: said.append(getattr(event, "code", "")), never_cancel)
        assert said.count("clock.exact") == count
