"""Verdicts of an audit: from results drawn from their own covariance, and one recording audited whole."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core import api
from calib_core.audit import compare, run
from calib_core.audit.limits import Limits, read_limits
from calib_core.audit.pose import GivenExtrinsic
from calib_core.audit.report import AuditReport, AxisAudit
from calib_core.audit.run import _sentence, report_of
from calib_core.calibrate import Calibration
from calib_core.errors import SettingsError
from calib_core.result import CalibrationResult, Transform, Uncertainty
from calib_core.settings import CalibrateSettings
from calib_core.simulate import SCENARIOS, generate
from calib_core.simulate.motions import PAPER_FAST
from calib_core.simulate.sensors import VLP_16, Spinning
from calib_core.types import ImuData, Recording
from tests.core.exporters.results import make_result

R = Rotation.from_euler("xyz", [12.0, -20.0, 130.0], degrees=True).as_matrix()
P = np.array([0.31, -0.12, 0.084])
TRUTH = np.concatenate([np.c_[R, P], [[0, 0, 0, 1]]])
OFFSET_NS = -17_300_000
#: Tight enough that three sigmas of some axes are beyond them: both branches are taken.
TIGHT = Limits(rotation_deg=0.02, translation_mm=1.0, time_offset_ms=0.05)
UNITS = np.array([np.degrees(1.0)] * 3 + [1e3] * 4)


def correlated(seed: int, scale: float = 1.0) -> np.ndarray:
    """A covariance with sigmas about 0.005 deg, 0.5 mm and 0.02 ms, and correlations."""
    rng = np.random.default_rng([seed, 7])
    mixing = np.eye(7) + 0.3 * rng.normal(size=(7, 7))
    root = np.diag(scale / UNITS * [0.005, 0.004, 0.006, 0.5, 0.6, 0.3, 0.02]) @ mixing
    return root @ root.T


def drawn(seed: int, covariance: np.ndarray) -> CalibrationResult:
    """What a solve says whose error is one draw of its own covariance: R Exp(r), p + t, dt."""
    error = np.random.default_rng(seed).multivariate_normal(np.zeros(7), covariance, method="cholesky")
    result = make_result(
        R @ Rotation.from_rotvec(error[:3]).as_matrix(), P + error[3:6], OFFSET_NS + round(error[6] * 1e9)
    )
    assert result.uncertainty is not None
    stated = result.uncertainty.model_copy(update={"covariance": covariance.tolist()})
    return result.model_copy(update={"uncertainty": Uncertainty.model_validate(stated.model_dump())})


def audited(found: CalibrationResult, T: np.ndarray, limits: Limits, offset_ns: int | None = OFFSET_NS) -> AuditReport:
    return report_of(GivenExtrinsic(T, offset_ns, "a matrix"), Calibration(found, None), limits)


def moved(axis: int, by: float) -> tuple[np.ndarray, int]:
    """The truth with an error on one axis, in the axis' unit; composed with SciPy, not with our own Exp."""
    T, error = TRUTH.copy(), np.zeros(7)
    error[axis] = by / UNITS[axis]
    T[:3, :3] = R @ Rotation.from_rotvec(error[:3]).as_matrix()
    T[:3, 3] += error[3:6]
    return T, OFFSET_NS + round(error[6] * 1e9)


@pytest.mark.parametrize("seed", range(20))
def test_the_truth_passes_and_three_sigmas_beyond_the_stated_smallest_error_fail(seed: int) -> None:
    """Mutations: difference of translations in lidar axes; rotation on the left; the time's sign; a limit of one sigma;
    fail only beyond limit plus four sigmas. One axis and sign for each seed: of errors so large one in 740 hides."""
    found = drawn(seed, correlated(seed))
    right = audited(found, TRUTH, Limits())
    assert (right.verdict, [axis.verdict for axis in right.axes]) == ("passed", ["passed"] * 7)
    k, sign = seed % 7, (-1) ** seed
    axis = audited(found, TRUTH, TIGHT).axes[k]
    T, offset_ns = moved(k, sign * (axis.smallest_error + 3.0 * axis.difference_std))
    report = audited(found, T, TIGHT, offset_ns)
    assert report.verdict == "failed"
    assert report.axes[k].verdict == "failed"
    assert report.text.startswith("Failed on ")


def test_a_false_alarm_is_as_rare_as_three_sigmas_say() -> None:
    """Limits of nothing, 200 draws, 1400 axes: 0.27 % are 3.8, and 12 are four standard deviations more. Mutations: two
    sigmas; variances for standard deviations."""
    exact = Limits(rotation_deg=1e-6, translation_mm=1e-6, time_offset_ms=1e-6)
    covariance = correlated(3)
    reports = [audited(drawn(seed, covariance), TRUTH, exact) for seed in range(200)]
    verdicts = [axis.verdict for report in reports for axis in report.axes]
    assert verdicts.count("failed") <= 12
    assert verdicts.count("passed") == 0


def test_numbers_of_each_axis_are_those_of_the_error_put_in() -> None:
    """Without an error of the solve's own. Mutation: found minus given."""
    found = make_result(R, P, OFFSET_NS)
    for k, by in enumerate((0.7, -0.8, 0.9, 25.0, -30.0, 35.0, 2.5)):
        T, offset_ns = moved(k, by)
        differences = [axis.difference for axis in audited(found, T, Limits(), offset_ns).axes]
        np.testing.assert_allclose(differences, np.where(np.arange(7) == k, by, 0.0), atol=1e-5)


def test_what_the_recording_cannot_tell_is_said() -> None:
    """Mutations: pass whatever does not fail; a refused recording taken for a pass; judge a null limit."""
    blind = audited(drawn(1, correlated(1, scale=100.0)), TRUTH, Limits())
    assert blind.verdict == "unknown"
    assert blind.text.startswith("This recording cannot tell: it determines the ")
    refused = audited(make_result(R, P, status="refused"), TRUTH, Limits())
    assert (refused.verdict, refused.axes, refused.rotation_deg) == ("unknown", [], None)
    assert "never moved" in refused.text
    lenient = Limits(rotation_deg=5.0, translation_mm=None, time_offset_ms=None)
    loose = audited(drawn(1, correlated(1, scale=100.0)), TRUTH, lenient)
    assert [axis.verdict for axis in loose.axes] == ["passed"] * 3 + [None] * 4
    assert loose.verdict == "passed"
    nothing = Limits(rotation_deg=None, translation_mm=None, time_offset_ms=None)
    assert audited(make_result(R, P), TRUTH, nothing).verdict == "unknown"


def test_axes_are_counted_that_are_judged() -> None:
    """A file without a time offset, limits without turns. Mutations: one of seven said of six; "every axis" of six."""
    found = make_result(R, P, OFFSET_NS)
    wrong, _ = moved(5, 300.0)
    assert audited(found, wrong, Limits()).text.startswith("Failed on 1 of 7 axes: ")
    assert audited(found, wrong, Limits(), None).text.startswith("Failed on 1 of the 6 axes that are judged: ")
    assert "within its limits on every axis;" in audited(found, TRUTH, Limits()).text
    right = audited(found, TRUTH, Limits(rotation_deg=None), None).text
    assert "within its limits on the 3 axes that are judged; errors from" in right
    assert " ms" not in right


@pytest.mark.parametrize(
    ("difference", "std", "said"),
    [
        (50.31, 0.998, "+50.3 ± 1.0 mm"),
        (-0.6214, 0.0996, "-0.62 ± 0.10 mm"),
        (112_204.0, 934.0, "+112204 ± 934 mm"),
        (112_204.0, 1234.0, "+112.2 ± 1.2 m"),
    ],
)
def test_a_failure_is_told_to_its_sigmas_second_digit(difference: float, std: float, said: str) -> None:
    """As the table beside the sentence. Mutations: significant digits (1 for 1.0, 1.12e+05); a sigma counted unrounded."""
    axis = AxisAudit(
        axis="tz", unit="mm", difference=difference, difference_std=std, limit=0.1, smallest_error=0.1, verdict="failed"
    )
    assert said in _sentence("failed", [axis], Calibration(drawn(1, correlated(1)), None))


def test_the_same_numbers_are_judged_alike_whatever_their_file_says_of_them() -> None:
    """Numbers in use are right or wrong: a weak result's own 9 m had an error of 160 mm "unknown", which a bare matrix failed by.

    Mutations: variances of both added; nothing said of the file's own; said of every file that states some.
    """
    found = make_result(R, P, OFFSET_NS)
    assert found.uncertainty is not None
    own = np.array(found.uncertainty.covariance)
    wrong, _ = moved(3, 160.0)
    bare = audited(found, wrong, Limits())
    weak = own.copy()
    weak[3, 3] += 9.1**2
    for covariance, said in ((own, 0), (weak, 1)):
        given = GivenExtrinsic(wrong, OFFSET_NS, "a result", covariance)
        report = report_of(given, Calibration(found, None), Limits())
        assert (report.verdict, report.axes) == ("failed", bare.axes)
        assert len(report.hints) == said
        assert all(
            "translation along the IMU's x axis is known only to 9.1 m (1 sigma)" in hint for hint in report.hints
        )


def test_why_no_motion_fits_is_told_without_what_a_recording_should_do() -> None:
    """The recording gives its own answer: a given extrinsic that is wrong was put down to time stamps, units or planes.

    Mutation: the refusal as it stands.
    """
    refusal = "the best answer needs IMU biases of 0.5 deg/s; the time stamps or the IMU's units are probably wrong."
    given = GivenExtrinsic(TRUTH, OFFSET_NS, "a matrix")
    report = report_of(given, Calibration(make_result(R, P, OFFSET_NS), None), Limits(), None, refusal)
    (hint,) = report.hints
    assert hint.startswith("With the given extrinsic held fixed, no motion fits the recording")
    assert hint.endswith("needs IMU biases of 0.5 deg/s.")


@pytest.mark.parametrize(
    ("sha256", "rate_ppm", "difference_ms"),
    [("00", 80.0, 0.0), ("00", None, 1.92), ("other", 80.0, 1.92), ("", 80.0, 1.92)],
)
def test_clocks_that_run_apart_make_no_difference_within_one_recording(
    sha256: str, rate_ppm: float | None, difference_ms: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was found of a whole minute, against its first twelve seconds: 80 ppm lie 1.9 ms apart, by which it failed.

    Mutations: the offset as it stands; the rate's sign; carried into another recording.
    """
    part = make_result(R, P, OFFSET_NS - 1_920_000).model_copy(update={"time_offset_at_s": 6.0})
    monkeypatch.setattr(run, "calibrate", lambda *_, **__: Calibration(part, None))
    whole = make_result(R, P, OFFSET_NS).model_copy(update={"time_offset_at_s": 30.0, "clock_rate_ppm": rate_ppm})
    recording = whole.provenance.recording.model_copy(update={"sha256": sha256})
    whole = whole.model_copy(update={"provenance": whole.provenance.model_copy(update={"recording": recording})})
    given = api.parse_extrinsic(whole.to_json())
    room = Recording(name="x", imu=ImuData(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3))), scans=())
    report = run.audit(room, given, Limits(), CalibrateSettings())
    (time,) = [axis for axis in report.axes if axis.axis == "dt"]
    assert time.difference == pytest.approx(difference_ms, abs=1e-6)


@pytest.mark.parametrize(
    ("given_rate", "found_rate", "gained_ms", "std_ms"),
    [
        ((80.0, 2.0), (90.0, 10.0), 1.92, 0.048),
        ((90.0, 10.0), (80.0, 2.0), 1.92, 0.048),
        ((None, None), (80.0, 2.0), 1.92, 0.048),
        ((80.0, None), (90.0, 10.0), 2.16, 0.24),
        ((80.0, None), (None, None), 1.92, 0.0),
    ],
)
def test_who_knows_the_clocks_best_carries_the_offset(
    given_rate: tuple[float | None, ...], found_rate: tuple[float | None, ...], gained_ms: float, std_ms: float
) -> None:
    """The given result holds at 6 s, and what is found at 30 s: 24 s of a rate, and as unsure as that is. Mutations: the given
    one's rate alone; the one that is less well known; its sigma left out, or taken where the other's rate is."""

    def result(at_s: float, rate: tuple[float | None, ...]) -> CalibrationResult:
        told = {"time_offset_at_s": at_s, "clock_rate_ppm": rate[0], "clock_rate_ppm_std": rate[1]}
        return make_result(R, P, OFFSET_NS).model_copy(update=told)

    first, second = result(6.0, given_rate), result(30.0, found_rate)
    given = api.parse_extrinsic(first.to_json())
    moved = compare.carried(given, second)
    assert moved.time_offset_ns == OFFSET_NS + round(gained_ms * 1e6)
    assert given.covariance is not None
    assert moved.covariance is not None
    widened = np.diag(moved.covariance - given.covariance)
    np.testing.assert_allclose(widened, [0.0] * 6 + [(std_ms * 1e-3) ** 2], atol=1e-20)
    assert api.time_offset_apart_s(first, second) == pytest.approx(-gained_ms * 1e-3, abs=1e-12)
    assert api.time_offset_apart_s(second, first) == pytest.approx(gained_ms * 1e-3, abs=1e-12)


def test_the_usual_slips_are_named() -> None:
    """Mutations: the hint given for every failure; the inverse not tried."""
    found = make_result(R, P, OFFSET_NS)
    (turned,) = audited(found, np.linalg.inv(TRUTH), Limits()).hints
    assert "T_lidar_imu where T_imu_lidar is expected" in turned
    (late,) = audited(found, TRUTH, Limits(), -OFFSET_NS).hints
    assert "other sign" in late
    assert audited(found, TRUTH, Limits()).hints == []
    assert "no time offset" in audited(found, TRUTH, Limits(), None).hints[0]
    assert audited(found, TRUTH, Limits(), None).axes[6].verdict is None


def test_limits_of_ones_own(tmp_path: Path) -> None:
    """Mutation: unknown keys ignored, so that a misspelt limit is none."""
    path = tmp_path / "limits.json"
    path.write_text('{"rotation_deg": [0.1, 0.2, 0.3], "translation_mm": null}')
    assert read_limits(path).per_axis() == (0.1, 0.2, 0.3, None, None, None, 2.0)
    for text, where in (('{"rotation": 1}', "rotation"), ('{"rotation_deg": -1}', "rotation_deg"), ("[", "document")):
        path.write_text(text)
        with pytest.raises(SettingsError, match=rf"at {where}|the {where}"):
            read_limits(path)
    with pytest.raises(SettingsError, match="cannot be read"):
        read_limits(tmp_path / "none.json")


def test_a_recording_audited_whole() -> None:
    """Six seconds, a small lidar. An extrinsic half a degree and 30 mm off makes a blurrier room, and the result given
    as it stands passes. Mutation: the given extrinsic not held in its own solve; the rooms exchanged."""
    pattern = VLP_16.pattern
    assert isinstance(pattern, Spinning)
    small = replace(VLP_16, pattern=replace(pattern, column_period_ns=4 * pattern.column_period_ns))
    scenario = replace(SCENARIOS["paper-normal"], motion=PAPER_FAST, lidar=small, duration_s=6.0)
    recording, truth = generate(scenario, seed=3)
    wrong = np.eye(4)
    wrong[:3, :3] = truth.R_imu_lidar @ Rotation.from_rotvec(np.radians([0.0, 0.6, 0.0])).as_matrix()
    wrong[:3, 3] = truth.p_imu_lidar + np.array([0.03, 0.0, 0.0])
    off = api.audit(recording, GivenExtrinsic(wrong, truth.time_offset_ns, "a matrix"))
    assert off.verdict == "failed"
    assert {axis.axis for axis in off.axes if axis.verdict == "failed"} == {"ry", "tx"}
    assert off.rotation_deg == pytest.approx(0.6, abs=0.1)
    if off.crispness is not None:
        assert off.crispness.given.mean_entropy_nat > off.crispness.found.mean_entropy_nat + 0.001
    else:
        assert "no motion fits" in off.hints[0]
    assert off.calibration.T_imu_lidar is not None
    same = GivenExtrinsic(np.array(off.calibration.T_imu_lidar.matrix), off.calibration.time_offset_ns, "a result")
    found = Calibration(off.calibration, None)
    assert report_of(same, found, Limits()).verdict == "passed"
    right = GivenExtrinsic(np.array(Transform.model_validate(off.calibration.T_imu_lidar).matrix), None, "numbers")
    assert report_of(right, found, Limits()).rotation_deg == pytest.approx(0.0, abs=1e-9)
