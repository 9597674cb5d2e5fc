"""The forecast against what whole solves of short recordings then know. All scenarios: `python -m bench.forecast`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.rigs import cluttered
from calib_core.calibrate import calibrate
from calib_core.doctor.outlook import forecast_report, foresee, planes_report, weak_parameters
from calib_core.doctor.report import Forecast
from calib_core.doctor.sampling import SampledScans
from calib_core.full.forecast import forecast
from calib_core.full.joint.state import Estimate
from calib_core.full.odometry.distance_travelled import stood_text
from calib_core.result import COVARIANCE_ORDER, CalibrationResult
from calib_core.settings import CalibrateSettings
from calib_core.simulate import SCENARIOS, generate
from calib_core.simulate.motions import ONE_AXIS, STILL
from calib_core.types import Recording
from tests.core.full.conftest import SHORT

FACTOR = 1.5


@pytest.fixture(scope="module")
def recording() -> Recording:
    """Six seconds of fast turning about all axes."""
    return generate(SHORT, seed=4)[0]


def foretold(recording: Recording) -> Forecast:
    sampled = SampledScans.of(recording)
    outlook = foresee(sampled, recording.imu, recording.coarse_offset_ns, whole=recording.scans)
    return forecast_report(outlook, planes_report(outlook.proposals, outlook.gravity), share=sampled.share)


def stds(result: CalibrationResult) -> np.ndarray:
    """The seven of a result [deg, m, s]."""
    assert result.uncertainty is not None
    std = np.sqrt(np.diag(np.array(result.uncertainty.covariance)))
    return np.concatenate([np.degrees(std[:3]), std[3:]])


def test_what_is_foretold_is_what_a_solve_knows(recording: Recording) -> None:
    """Mutation: count each sampled point once only (`stands_for` left out): every ratio above 1.5."""
    told = foretold(recording)
    result = calibrate(recording, CalibrateSettings(crispness=False)).result
    assert result.status == "calibrated"
    assert [p.name for p in told.parameters] == list(COVARIANCE_ORDER)
    assert not any(p.weak for p in told.parameters)
    assert told.weak == ()
    ratio = np.array([p.std for p in told.parameters]) / stds(result)
    assert ((ratio > 1 / FACTOR) & (ratio < FACTOR)).all(), ratio
    assert told.covered_s == pytest.approx(6.0, abs=0.3)
    assert {"floor", "ceiling", "wall 1", "wall 2"} <= set(told.planes)


def test_a_lever_arm_that_the_start_misses_by_a_metre_is_foretold() -> None:
    """A vehicle's start has no height in it, and 0.4 deg of a metre of height are 7 mm. Oracle: the solve; 1.5 mm was foretold.

    Mutations: judged about the start; what the first round held stays held.
    """
    recording = generate(replace(SCENARIOS["vehicle"], duration_s=14.0), seed=42)[0]
    told = foretold(recording)
    result = calibrate(recording, CalibrateSettings(crispness=False)).result
    ratio = np.array([p.std for p in told.parameters]) / stds(result)
    assert stds(result)[3] > 5e-3
    assert ((ratio > 1 / FACTOR) & (ratio < FACTOR)).all(), ratio


def test_what_is_foretold_to_be_weak_is_weak() -> None:
    """Mutation: judge with the calibration anywhere along the open direction (no `hold`): the turn about it seems weak too.

    Turning about one axis: the lever arm along it, a mixture of x, y and z, stays open; nothing else does.
    """
    turning = generate(replace(SHORT, motion=ONE_AXIS, duration_s=8.0), seed=2)[0]
    told = foretold(turning)
    result = calibrate(turning, CalibrateSettings(crispness=False)).result
    assert result.status == "weak"
    assert "solve.disagreement" not in [message.code for message in result.messages]
    assert [p.name for p in told.parameters if p.weak] == ["tx", "ty", "tz"]
    assert len(told.weak) == len(result.observability.weak_directions) == 1
    assert list(told.advice) == result.observability.advice
    own = {p.name: p.advice for p in told.parameters}
    assert all(
        own[name] in ("", line)
        for name in ("tx", "ty", "tz")
        for line in told.advice
        if f"IMU's {name[1]} axis," in line
    )
    assert {text for text in own.values() if text} == set(told.advice)
    ratio = np.array([p.std for p in told.parameters]) / stds(result)
    assert ((ratio > 1 / FACTOR) & (ratio < FACTOR)).all(), ratio


def test_a_standstill_has_no_forecast_but_planes() -> None:
    """Mutations: linearise a motion that is none: seven numbers that mean nothing; a sentence that is not the solve's."""
    still = generate(replace(SHORT, motion=STILL), seed=1)[0]
    sampled = SampledScans.of(still)
    outlook = foresee(sampled, still.imu, 0)
    assert (outlook.knowledge, outlook.code, outlook.reason) == (None, "motion.none", stood_text())
    assert len(outlook.proposals.patches) >= 5


def test_half_a_recording_foretells_the_whole(recording: Recording) -> None:
    """Mutation: leave the share out, or scale standard deviations by it instead of variances."""
    sampled = SampledScans.of(recording)
    whole = forecast(replace(recording, scans=sampled.scans), sampled.points)
    half = forecast(replace(recording, scans=sampled.scans), sampled.points, share=0.5)
    assert whole.knowledge is not None
    assert half.knowledge is not None
    assert half.knowledge.data_std == pytest.approx(whole.knowledge.data_std * np.sqrt(0.5), rel=0.01)
    assert weak_parameters(half.knowledge) == [False] * 7


def test_a_coarser_sample_foretells_the_same(recording: Recording) -> None:
    """Mutation: weigh by the number of sampled points. A third of them says the same, within a tenth."""
    sampled = SampledScans.of(recording)
    scans = [replace(s, points=s.points[::3]) if i > 2 else s for i, s in enumerate(sampled.scans)]
    dense = forecast(replace(recording, scans=sampled.scans), sampled.points)
    sparse = forecast(replace(recording, scans=scans), sampled.points)
    assert dense.knowledge is not None
    assert sparse.knowledge is not None
    assert sparse.knowledge.data_std == pytest.approx(dense.knowledge.data_std, rel=0.1)


def test_planes_that_only_later_scans_show_are_listed_and_not_followed(recording: Recording) -> None:
    """The sample ends before the first scan whose planes fix a place. Mutation: they are followed from that scan all the same."""
    some = replace(recording, scans=list(recording.scans[:45]))
    sampled = SampledScans.of(some)
    bare = [replace(scan, points=scan.points[:50]) for scan in some.scans]
    whole = [*bare, *recording.scans[45:]]
    outlook = forecast(replace(some, scans=sampled.scans), sampled.points, whole=whole)
    assert outlook.proposals.reference_scans[0] >= 45
    assert len(outlook.proposals.patches) >= 5
    assert outlook.gravity is None
    assert outlook.knowledge is not None


def test_what_a_solve_leaves_out_is_foretold_and_counts_for_nothing() -> None:
    """Oracle: the solve of the same room with people and boxes: what is called doubtful before it, it leaves out.

    Mutations: doubts of another plane; the doubtful left in the problem; two good walls and a doubtful floor judged all the same.
    """
    recording = generate(cluttered(duration_s=10.0), seed=203)[0]
    sampled = SampledScans.of(recording)
    outlook = foresee(sampled, recording.imu, recording.coarse_offset_ns, whole=recording.scans)
    doubtful = [place for place, fault in enumerate(outlook.faults) if fault]
    assert doubtful
    patches = outlook.proposals.patches
    suggestion = [replace(patch.plane, name=f"patch {k}", suggested=True) for k, patch in enumerate(patches)]
    result = calibrate(recording, CalibrateSettings(crispness=False), planes=suggestion).result
    assert not {plane.name for plane in result.quality.planes} & {f"patch {place}" for place in doubtful}
    foresight = outlook.foresight
    assert foresight is not None
    sound = [place for place in range(len(patches)) if place not in doubtful]
    np.testing.assert_array_equal(foresight.growth(sound), np.ones(7))
    report = planes_report(outlook.proposals, outlook.gravity, outlook.faults)
    told = forecast_report(outlook, report, share=sampled.share)
    ratio = np.array([p.std for p in told.parameters]) / stds(result)
    assert ((ratio > 1 / FACTOR) & (ratio < FACTOR)).all(), ratio


def test_of_few_planes_none_is_called_doubtful_by_a_motion_that_it_bends(
    recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All but two planes are at fault, and then all but five. Mutations: left out all the same; none left out at all."""
    points = [len(scan.points) for scan in recording.scans]
    for sound, wanted in ((2, 0), (5, 1)):

        def doubts(_problem: object, estimate: Estimate, sound: int = sound) -> np.ndarray:
            return np.where(np.arange(len(estimate.normals))[:, None] < sound, 0.1, [3.0, 0.0, 0.0])

        monkeypatch.setattr("calib_core.full.forecast.plane_doubts", doubts)
        assert [bool(fault) for fault in forecast(recording, points).faults].count(True) == wanted
