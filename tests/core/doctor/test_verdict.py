"""The doctor's opinion on recordings that are known to lack something, with and without a forecast."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.doctor.imu_report import imu_report
from calib_core.doctor.report import Forecast, ImuReport, ParameterForecast, PlaneReport, PlanesReport
from calib_core.doctor.verdict import Opinion, judge
from calib_core.readers.imu.readings import CleanedImu
from calib_core.readers.timing.clocks import HeaderTimes
from calib_core.types import Finding, FloatArray
from tests.core.doctor.readings import data
from tests.core.readers.tilting import tilting

NAMES = ("rx", "ry", "rz", "tx", "ty", "tz", "dt")
WALL = PlaneReport(name="wall", kind="wall", tilt_deg=90.0, area_m2=9.0, distance_m=2.0, points=900, rms_m=0.02)
ROOM = PlanesReport(planes=(WALL,) * 3, determinacy=1.0, determined=True, text="3 planes.")


def report(gyro: FloatArray, accel: FloatArray) -> ImuReport:
    imu = data(gyro, accel)
    headers = HeaderTimes(imu.stamps_ns, imu.stamps_ns + 500_000)
    return imu_report(CleanedImu(imu, headers, "m_s2", "rad_s", ()), recording_start_ns=int(imu.stamps_ns[0]))


def opinion(
    imu: ImuReport, *, overlap_s: float = 25.0, planes: PlanesReport | None = ROOM, forecast: Forecast | None = None
) -> Opinion:
    return judge(lidar=None, imu=imu, problems=(), findings=(), overlap_s=overlap_s, planes=planes, forecast=forecast)


def foretold(*weak: str, sentences: tuple[str, ...] = (), advice: tuple[str, ...] = ()) -> Forecast:
    parameters = tuple(ParameterForecast(name=n, std=1e-3, unit="m", weak=n in weak) for n in NAMES)  # type: ignore[arg-type]
    return Forecast(text="All is known.", parameters=parameters, weak=sentences, advice=advice)


@pytest.mark.parametrize(
    ("change", "verdict", "words"),
    [
        ("still", "unusable", "stands still throughout"),
        ("no-rotation", "limited", "hardly turns"),
        ("one-axis", "limited", "little rotation about"),
        ("clipped", "limited", "gyroscope is clipped"),
        ("short", "limited", "less than 15 s"),
        ("very-short", "unusable", "cover only"),
    ],
)
def test_without_a_forecast_the_imu_speaks(change: str, verdict: str, words: str) -> None:
    """Mutation: raise or lower the thresholds of verdict.py by a factor of ten."""
    rng = np.random.default_rng(1)
    gyro, accel = tilting(25)
    overlap_s = 24.0
    if change == "still":
        gyro, accel = rng.normal(0, 2e-3, gyro.shape), np.array([0, 0, 9.81]) + rng.normal(0, 0.02, accel.shape)
    elif change == "no-rotation":
        gyro = rng.normal(0, 2e-3, gyro.shape)
        accel = np.array([0, 0, 9.81]) + rng.normal(0, 0.02, accel.shape)
        accel[300:, 0] += 2 * np.sin(np.arange(len(gyro) - 300) / 20)
    elif change == "one-axis":
        sway = np.deg2rad(2.5) * np.sin(np.arange(len(gyro)) / 30)
        gyro[:, :2] = rng.normal(0, 2e-3, (len(gyro), 2))
        gyro[300:, 0] += sway[300:]
        gyro[300:, 1] += np.roll(sway, 47)[300:]
    elif change == "clipped":
        gyro = np.clip(9.0 * gyro, -2.7, 2.7)  # beyond the narrowest range that is sold
    else:
        overlap_s = 9.5 if change == "short" else 3.8
    got = opinion(report(gyro, np.asarray(accel)), overlap_s=overlap_s)
    assert got.verdict == verdict, got.reasons
    assert any(words in reason for reason in got.reasons), got.reasons
    assert got.advice


def test_a_forecast_has_the_last_word_on_the_motion() -> None:
    """Mutation: judge the motion by the gyroscope although a solve is foretold to know everything, or the reverse.

    A gyroscope that hardly turns would be called weak; its forecast says that nothing is, and the other way round.
    """
    quiet, _ = tilting(25)
    slow = report(0.1 * quiet, np.array([0, 0, 9.81]) + np.random.default_rng(1).normal(0, 0.02, quiet.shape))
    assert opinion(slow).verdict == "limited"
    good = opinion(slow, forecast=foretold())
    assert (good.verdict, good.reasons) == ("good", ("All is known.",))
    lively = report(*tilting(25))
    assert opinion(lively).verdict == "good"
    weak = opinion(lively, forecast=foretold("tz", sentences=("Not the height.",), advice=("Turn about x.",)))
    assert (weak.verdict, weak.reasons, weak.advice) == ("limited", ("Not the height.",), ("Turn about x.",))


def test_a_short_recording_that_is_foretold_to_do_is_good() -> None:
    """Mutation: count its length against a recording whatever the forecast says; ask for length without a forecast only."""
    lively = report(*tilting(25))
    got = opinion(lively, overlap_s=9.0, forecast=foretold())
    assert got.verdict == "good"
    assert "Record 30 to 60 s." in got.advice
    assert opinion(lively, overlap_s=9.0, forecast=foretold("dt")).verdict == "limited"


@pytest.mark.parametrize(
    ("overlap_s", "std_m", "short"),
    [(12.0, 0.031, True), (12.0, 0.032, False), (22.0, 0.023, True), (22.0, 0.024, False), (12.0, 5.8, False)],
)
def test_a_recording_is_short_where_more_of_it_would_do(overlap_s: float, std_m: float, short: bool) -> None:
    """Of 20 mm, 20 sqrt(30 / 12) = 31.6 mm is the most that 12 s may leave, sqrt(30 / 22) is 23.4 mm. A lever arm that the motion
    does not tell at all, 5.8 m, is not told by more of it. Mutations: said of every recording below 15 s, as it was; the time's
    ratio for its root.
    """
    weak = ParameterForecast(name="tz", std=std_m, unit="m", weak=True)
    known = foretold()
    forecast = known.model_copy(
        update={
            "parameters": tuple(weak if p.name == "tz" else p for p in known.parameters),
            "weak": ("Not the height.",),
        }
    )
    got = opinion(report(*tilting(25)), overlap_s=overlap_s, forecast=forecast)
    said = (
        f"Lidar and IMU cover {overlap_s:.1f} s together, too short for the translation along the IMU's z axis: 30 s of such"
        " motion would be enough."
    )
    assert got.reasons == ((said, "Not the height.") if short else ("Not the height.",))
    assert ("Record 30 to 60 s." in got.advice) == (short or overlap_s < 15.0)


@pytest.mark.parametrize(
    ("code", "verdict"),
    [
        ("motion.none", "unusable"),
        ("motion.undetermined", "unusable"),
        ("points.unit", "unusable"),
        ("points.straightened", "unusable"),
        ("start.no_overlap", "limited"),
    ],
)
def test_what_a_solve_would_refuse_is_not_usable(code: str, verdict: str) -> None:
    """Mutation: take every reason without a forecast for fatal, or none; say the standstill twice."""
    silent = Forecast(text="No forecast.", parameters=(), reason="it does not move", code=code)
    rng = np.random.default_rng(1)
    imu = report(rng.normal(0, 2e-3, (2500, 3)), np.array([0, 0, 9.81]) + rng.normal(0, 0.02, (2500, 3)))
    got = opinion(imu if code == "motion.none" else report(*tilting(25)), forecast=silent)
    assert got.verdict == verdict
    assert len(got.reasons) == 1
    assert "t does not move" in got.reasons[0]


def test_planes_that_leave_a_direction_open_limit_and_none_at_all_end_it() -> None:
    """Mutation: look at the number of planes instead of what they determine."""
    lively = report(*tilting(25))
    corridor = PlanesReport(planes=(WALL,) * 4, determinacy=0.001, determined=False, text="4 planes, open.")
    got = opinion(lively, planes=corridor, forecast=foretold())
    assert (got.verdict, got.reasons) == ("limited", ("4 planes, open.",))
    none = PlanesReport(planes=(), determinacy=0.0, determined=False, text="No plane.")
    lost = Forecast(parameters=(), reason="no plane was found", code="planes.none")
    got = opinion(lively, planes=none, forecast=lost)
    assert (got.verdict, got.reasons) == ("unusable", ("No plane.",))


def test_nobody_is_told_to_name_the_imu() -> None:
    """Mutation: ask for --imu-noise where there is no standstill: a solve measures the noise in motion."""
    gyro, accel = tilting(25)
    got = report(gyro[320:], accel[320:])
    assert got.noise_used == "moving"
    assert got.measured_noise is not None
    # 2e-3 rad/s a reading at 100 Hz, as `tilting` adds it.
    assert got.measured_noise.noise.gyroscope_noise_density_rad_s_sqrt_hz == pytest.approx(2e-4, rel=0.1)
    said = opinion(got, forecast=foretold())
    assert said.verdict == "good"
    assert not any("imu-noise" in line for line in said.advice)
    assert any("stand still" in line for line in said.advice)


@pytest.mark.parametrize(
    ("override", "told"),
    [
        ("--point-time-unit ns", "This is unsure; check it, or set it with --point-time-unit ns."),
        ("record them anew", "This is unsure; record them anew."),
    ],
)
def test_an_unsure_finding_names_its_cure(override: str, told: str) -> None:
    """An option is set, an action is done. Mutation: every cure called something to set it with."""
    finding = Finding("points.time_synthesised", "warning", "Times were made up.", (), 0.3, "", override)
    imu = report(*tilting(25))
    found = judge(lidar=None, imu=imu, problems=(), findings=(finding,), overlap_s=25.0, planes=ROOM, forecast=None)
    assert f"Times were made up. {told}" in found.reasons
