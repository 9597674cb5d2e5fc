"""Stamps of an IMU whose clock runs at another rate: stretched, solved, and answered for the stamps as they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.calibrate import calibrate
from calib_core.errors import Refused
from calib_core.events import ignore_event, never_cancel
from calib_core.full.clock_skew import ClockSkew, without_skew
from calib_core.full.initialise.clock_rate import ClocksApart
from calib_core.full.initialise.lidar_motion import begin
from calib_core.full.prepare.prepare import prepare
from calib_core.full.run import Run
from calib_core.intrinsics import CLOCK_RATE_STD_PPM
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import FloatArray, Recording
from tests.core.full.answers import errors_of


def _apart(recording: Recording, truth: Truth, rate: float) -> tuple[Recording, int]:
    """The recording with IMU stamps to which t_lidar = t_imu + offset + rate (t_lidar - middle) takes; and its middle's stamp.

    Of the lidar's clock.
    """
    middle_ns = (recording.scans[0].stamp_ns + recording.scans[-1].stamp_ns) // 2
    lidar_ns = recording.imu.stamps_ns + truth.time_offset_ns
    stamps_ns = recording.imu.stamps_ns - np.rint(rate * (lidar_ns - middle_ns)).astype(np.int64)
    return replace(recording, imu=replace(recording.imu, stamps_ns=stamps_ns)), middle_ns


@pytest.mark.parametrize(("rate", "away_s"), [(3e-3, 0.0), (-1.5e-3, 2.0)])
def test_a_rate_of_thousandths_is_taken_out_and_the_answer_is_that_of_the_stamps(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch, rate: float, away_s: float
) -> None:
    """away_s: from the middle to where stamps are stretched about, which the answer does not depend on. Oracle: the truth, and
    the contract's line. Mutations: the skew not undone in the offset, in the rate; its sign; the turns' rate told.

    Chi-square with 7 degrees of freedom: 24.3 is passed once in a thousand.
    """
    recording, _ = _apart(*noisy, rate)
    about_the_middle = ClocksApart.__init__

    def about(self: ClocksApart, run: Run, rate: float, rate_std: float, time_offset_s: float) -> None:
        about_the_middle(self, run, rate, rate_std, time_offset_s - away_s)

    monkeypatch.setattr(ClocksApart, "__init__", about)
    result = calibrate(recording, CalibrateSettings(crispness=False)).result
    assert result.status == "calibrated"
    said = {message.code: message.text for message in result.messages}
    assert "--imu-sampling as-stamped" in said["clock.rate"]
    assert f"run {abs(rate):.2%} {'slow' if rate > 0 else 'fast'} beside" in said["clock.rate"]
    assert "sensor.clock" not in said
    assert result.clock_rate_ppm is not None
    assert result.clock_rate_ppm_std is not None
    assert abs(result.clock_rate_ppm - 1e6 * rate) < 4.0 * result.clock_rate_ppm_std
    (listed,) = (each for each in result.intrinsics if each.block == "clock_rate")
    assert listed.value == result.clock_rate_ppm
    assert result.uncertainty is not None
    errors = errors_of(result, noisy[1])
    assert errors @ np.linalg.solve(np.array(result.uncertainty.covariance), errors) < 24.3


def test_stamps_that_are_to_be_taken_as_they_are_are_not_stretched(noisy: tuple[Recording, Truth]) -> None:
    """The way around it. Mutation: asked whatever the settings say."""
    recording, _ = _apart(*noisy, 3e-3)
    with pytest.raises(ClocksApart):
        begin(prepare(recording, CalibrateSettings(), ignore_event, never_cancel), None)
    begin(prepare(recording, CalibrateSettings(imu_sampling="as-stamped"), ignore_event, never_cancel), None)


def test_stamps_that_run_alike_are_left_as_they_are(noisy: tuple[Recording, Truth]) -> None:
    """What crystals do is the joint estimation's. Mutations: stretched by nought first; more room than crystals need."""
    seen: list[FloatArray] = []

    def solve(stamped: Recording, rate_std_ppm: float) -> None:
        seen.append(stamped.imu.stamps_ns)
        assert rate_std_ppm == CLOCK_RATE_STD_PPM

    assert without_skew(noisy[0], solve) == (None, None)
    np.testing.assert_array_equal(seen, [noisy[0].imu.stamps_ns])


def test_a_stretch_takes_a_line_of_stamps_to_one_clock(noisy: tuple[Recording, Truth]) -> None:
    """Oracle: the stamps before they were put apart, to the rounding of nanoseconds. Mutation: 1 + k for 1 / (1 - k)."""
    recording, middle_ns = _apart(*noisy, 0.01)
    about_ns = middle_ns - noisy[1].time_offset_ns
    back = ClockSkew(0.01, 0.0, about_ns).applied(recording)
    assert (
        np.abs(back.imu.stamps_ns - noisy[0].imu.stamps_ns).max() <= 101
    )  # half a nanosecond, stretched, and half a nanosecond


def test_stretches_go_together_and_what_stays_apart_is_refused_with_a_way_around(
    noisy: tuple[Recording, Truth],
) -> None:
    """Oracle: stamps stretched twice. Mutations: the second for both; begun again for ever;
    what is left of the rate left out.
    """
    recording = noisy[0]
    run = prepare(recording, CalibrateSettings(), ignore_event, never_cancel)
    rates = iter([2e-3, -5e-4, 0.0])
    asked: list[Recording] = []
    told: list[ClockSkew] = []
    left: list[float] = []

    def solve(stamped: Recording, rate_std_ppm: float) -> str:
        asked.append(stamped)
        left.append(rate_std_ppm)
        rate = next(rates)
        if rate:
            raise ClocksApart(run, rate, 3e-5, 0.0)
        return "solved"

    answer, skew = without_skew(recording, solve, told.append)
    assert answer == "solved"
    assert skew is not None
    assert skew == told[-1]
    assert left == [40.0, 50.0, 50.0]
    first, then = ClockSkew(2e-3, 0.0, skew.about_ns), ClockSkew(-5e-4, 0.0, skew.about_ns)
    one_by_one = then.applied(first.applied(recording))
    assert np.abs(asked[-1].imu.stamps_ns - one_by_one.imu.stamps_ns).max() <= 2

    def never(stamped: Recording, rate_std_ppm: float) -> str:
        raise ClocksApart(run, 1e-3, 0.0, 0.0)

    with pytest.raises(Refused, match="--imu-sampling as-stamped"):
        without_skew(recording, never)
