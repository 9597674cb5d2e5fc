"""A recording that its IMU's silence breaks in two, which do not go together."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calib_core import calibrate as page
from calib_core.events import LogEvent
from calib_core.full.assess.imu_silence import imu_silence
from calib_core.method import Question
from calib_core.settings import CalibrateSettings
from calib_core.types import Recording

#: The IMU's clock is this far behind the lidar's: another epoch.
OFFSET_NS = 1_600_000_000_000_000_000


def silent_between(recording: Recording, start_s: float, end_s: float, *, offset_ns: int = OFFSET_NS) -> Recording:
    """Without readings between two instants after the first scan, the IMU's clock set back by so much."""
    imu = recording.imu
    t = (imu.stamps_ns - recording.scans[0].stamp_ns) * 1e-9
    kept = (t < start_s) | (t > end_s)
    return replace(
        recording,
        imu=replace(
            imu,
            stamps_ns=imu.stamps_ns[kept] - offset_ns,
            gyro_rad_s=imu.gyro_rad_s[kept],
            accel_m_s2=imu.accel_m_s2[kept],
        ),
    )


def test_the_longer_side_of_a_silence_is_kept(noisy: tuple[Recording, Any]) -> None:
    """Mutations: the shorter side; the IMU's clock taken for the lidar's; any gap a silence; the end of the recording one."""
    early = imu_silence(silent_between(noisy[0], 1.0, 2.0), OFFSET_NS)
    assert early is not None
    assert early.within_s == pytest.approx((1.0, 2.0), abs=0.011)
    assert early.longer_s == pytest.approx((2.0, 5.9), abs=0.011)
    assert early.left_out_s == (-np.inf, early.within_s[1])
    late = imu_silence(silent_between(noisy[0], 4.0, 4.5), OFFSET_NS)
    assert late is not None
    assert late.left_out_s == (late.within_s[0], np.inf)
    assert imu_silence(silent_between(noisy[0], 1.0, 1.2), OFFSET_NS) is None
    assert imu_silence(silent_between(noisy[0], 4.0, 9.0), OFFSET_NS) is None


@pytest.mark.parametrize(
    ("silent", "disagree", "sides"), [(True, 1, 2), (True, 2, 2), (True, 0, 1), (False, 1, 1)], ids=str
)
def test_it_is_answered_by_that_side_where_the_two_do_not_go_together(
    noisy: tuple[Recording, Any], monkeypatch: pytest.MonkeyPatch, silent: bool, disagree: int, sides: int
) -> None:
    """And the side with itself. Seen in a cluttered room: a track that slid 1.5 m in two seconds without readings, 6.2 sigmas.

    disagree: the first so many answers do.   sides: how often it is solved.
    Mutations: whatever the answers say; never; a side that does not agree either taken; silence asked of all that disagree.
    """
    asked: list[int] = []

    def answer(recording: Recording, question: Question) -> Any:
        asked.append(len(recording.scans))
        if len(asked) <= disagree:
            question.log(LogEvent(level="warning", code="solve.disagreement", text="they disagree"))
        known = {"time_offset_ns": OFFSET_NS, "evidence": None, "trajectory": None, "is_weak": False}
        found: Any = type("Found", (), known)()
        return found

    def agreed(kept: Recording, _recording: Recording, question: Question) -> Any:
        return answer(kept, question)

    monkeypatch.setattr(page, "_answer", answer)
    monkeypatch.setattr(page, "_of_one_side", agreed)
    monkeypatch.setattr(page, "document", lambda recording, _settings, _answer, messages, _s: (recording, messages))
    recording = silent_between(noisy[0], 4.0, 4.5 if silent else 4.1)
    answered: Any = page.calibrate(recording, CalibrateSettings(crispness=False)).result
    of, messages = answered
    assert asked == [60, 39][:sides]
    taken = silent and disagree == 1
    assert len(of.scans) == (39 if taken else 60)
    codes = [message.code for message in messages]
    assert ("imu.silent" in codes) is taken
    assert ("solve.disagreement" in codes) is (not taken and disagree > 0)
