"""How a scenario's answer is judged, on rows and results made by hand, and one of them through the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.bounds import BoundRow
from bench.scenarios import Row, nees_of_determined, read_rows, row_of, run, same, table, write_rows
from calib_core.full.joint.undetermined import UNITS
from calib_core.result import CalibrationResult
from calib_core.simulate import Truth, prepare

ROOM = Row(
    scenario="paper-normal",
    seed=1,
    label="abc",
    status="calibrated",
    exit_code=0,
    error=[0.004, 0.9, 0.02],
    stated=[0.006, 0.9, 0.016],
    weak=[],
    advice=[],
    errors=[],
    nees=7.0,
    determined=7,
    scans_used=200,
    scans_total=200,
    repeatable=True,
)
AXIS = ROOM.model_copy(
    update={
        "scenario": "one-axis",
        "status": "weak",
        "weak": ["the lever arm along z is open"],
        "advice": ["turn about another axis"],
        "nees": 6.0,
        "determined": 6,
    }
)
STILL = ROOM.model_copy(
    update={
        "scenario": "static",
        "status": "refused",
        "exit_code": 3,
        "error": None,
        "stated": None,
        "nees": None,
        "determined": 0,
        "errors": ["the sensors did not move"],
    }
)


@pytest.mark.parametrize(
    ("row", "changed", "holds"),
    [
        (ROOM, {}, True),
        (ROOM, {"nees": 25.0}, True),
        (ROOM, {"nees": 35.0}, False),
        (ROOM, {"status": "weak", "advice": ["move"]}, False),
        (ROOM, {"repeatable": False}, False),
        (AXIS, {}, True),
        (AXIS, {"weak": []}, False),
        (AXIS, {"weak": ["one", "two"]}, False),
        (AXIS, {"advice": []}, False),
        (AXIS, {"nees": 35.0}, False),
        # Without noise: 0.0013 deg and 0.095 mm are asked, whatever is stated.
        (ROOM, {"scenario": "noise-free-fast", "error": [0.0001, 0.013, 1e-5], "nees": 500.0}, True),
        (ROOM, {"scenario": "noise-free-fast", "error": [0.0001, 0.1, 1e-5], "nees": 1.0}, False),
        (ROOM, {"scenario": "noise-free-fast", "error": [0.002, 0.013, 1e-5], "nees": 1.0}, False),
        (STILL, {}, True),
        (STILL, {"errors": []}, False),
        (STILL, {"status": "weak", "determined": 7, "nees": 5.0}, False),
    ],
)
def test_status_directions_errors_and_repeatability_are_all_judged(
    row: Row, changed: dict[str, Any], holds: bool
) -> None:
    """Mutation: leave out any one of the five conditions."""
    assert row.model_copy(update=changed).holds is holds


def test_only_what_is_determined_counts(tmp_path: Path) -> None:
    """A lever arm off by a metre along an open direction is no error; five sigmas across it are.

    Mutation: project onto the weak directions instead of across them, or forget the units.
    """
    truth = prepare("one-axis", seed=1).truth
    open_direction = np.array([0, 0, 0, 0.6, 0.8, 0, 0])
    across = np.array([0, 0, 0, 0.8, -0.6, 0, 0])
    far = _result(truth, 100.0 * open_direction, weak=[open_direction])
    assert nees_of_determined(far, truth) == pytest.approx((0.0, 6), abs=1e-9)
    off = _result(truth, 0.05 * across + 100.0 * open_direction, weak=[open_direction])
    assert nees_of_determined(off, truth) == pytest.approx((25.0, 6), rel=1e-6)
    assert nees_of_determined(_result(truth, 0.05 * across, weak=[]), truth) == pytest.approx((25.0, 7), rel=1e-6)


def test_a_turn_that_is_open_and_far_off_leaves_nothing_to_judge() -> None:
    """Mutation: judge across directions that hold near another answer (seen: NEES 69104 with an honest covariance)."""
    truth = prepare("one-axis-in-place", seed=1).truth
    result = _result(truth, np.zeros(7), weak=[np.eye(7)[2]])
    near = row_of(result, truth, 1, "abc", 0, repeatable=True)
    assert (near.nees, near.determined) == (pytest.approx(0.0, abs=1e-9), 6)
    assert result.T_imu_lidar is not None
    turn = Rotation.from_rotvec([0.0, 0.0, np.radians(60.0)]).as_matrix()
    result.T_imu_lidar.matrix = [
        [*row, value]
        for row, value in zip((truth.R_imu_lidar @ turn).tolist(), truth.p_imu_lidar.tolist(), strict=True)
    ] + [[0.0, 0.0, 0.0, 1.0]]
    far = row_of(result, truth, 1, "abc", 0, repeatable=True)
    assert (far.nees, far.determined) == (None, 0)
    assert far.error == pytest.approx([60.0, 0.0, 0.0], abs=1e-6)


def _result(truth: Truth, error: np.ndarray[Any, np.dtype[np.float64]], weak: list[Any]) -> CalibrationResult:
    """The truth moved by an error, all sigmas a hundredth, both in units of 1 deg, 10 mm, 1 ms; translation only."""
    T = truth.T_imu_lidar.copy()
    T[:3, 3] += (error * UNITS)[3:6]
    covariance = np.diag((0.01 * UNITS) ** 2)
    document = {
        "status": "weak",
        "messages": [],
        "T_imu_lidar": {"matrix": T.tolist(), "translation_m": [], "quaternion_xyzw": [], "euler_xyz_deg": []},
        "time_offset_s": truth.time_offset_ns * 1e-9,
        "time_offset_ns": truth.time_offset_ns,
        "gyroscope_bias_rad_s": None,
        "accelerometer_bias_m_s2": None,
        "gravity_m_s2": None,
        "uncertainty": {
            "rotation_std_deg": [],
            "translation_std_m": [],
            "time_offset_std_s": 0.0,
            "gravity_std_m_s2": 0.0,
            "covariance": covariance.tolist(),
        },
        "observability": {
            "weak_directions": [{"label": None, "vector": list(v), "std_scaled": 9.0, "text": ""} for v in weak]
        },
        "quality": {
            "point_to_plane_rms_m": 0.0, "points_used": 0, "scans_used": 0, "scans_total": 0, "planes": [],
            "iterations": 0, "duration_s": 0.0,
        },
        "provenance": {
            "recording": {
                "name": "", "sha256": "", "duration_s": 0.0, "lidar_topic": "", "imu_topic": "", "lidar_frame_id": "",
                "imu_frame_id": "",
            },
            "settings": {},
            "software": {},
        },
    }  # fmt: skip
    return CalibrationResult.model_validate(document)


def test_documents_may_differ_in_their_duration_only() -> None:
    """Mutation: compare the quality without its other numbers."""

    def document(rms_m: float, duration_s: float) -> str:
        return json.dumps({"quality": {"point_to_plane_rms_m": rms_m, "duration_s": duration_s}})

    assert same(document(0.02, 3.0), document(0.02, 4.0))
    assert not same(document(0.02, 3.0), document(0.0200000001, 3.0))


def test_rows_come_back_and_the_table_says_what_fails(tmp_path: Path) -> None:
    """Mutation: sort by name, leave a failing row out of the count, or divide the bound by the error."""
    wrong = AXIS.model_copy(update={"repeatable": False})
    write_rows({row.scenario: row for row in (STILL, wrong, ROOM)}, tmp_path)
    assert list(read_rows(tmp_path)) == ["paper-normal", "one-axis", "static"]
    bound = BoundRow("paper-normal", 1, 0.005, 0.6, 0.01, (0.0,) * 7, 6, 5_000_000, 30.0)
    text = table(list(read_rows(tmp_path).values()), {"paper-normal": bound})
    assert "2 of 3 are as they should be." in text
    assert (
        "| paper-normal | calibrated | 0.004 (0.006) | 0.9 (0.9) | 0.02 (0.016) | 0.80 / 1.50 / 2.00 | 1.20 / 1.50 / 1.60 "
        "| 7.0 | 7 | 200 of 200 | yes | yes |" in text
    )
    assert "| static | refused |  |  |  |  |  |  |  | 200 of 200 | yes | yes |" in text
    assert "- the sensors did not move" in text
    assert "- To add: turn about another axis" in text


@pytest.mark.slow
def test_a_recording_goes_through_the_command_line(tmp_path: Path) -> None:
    """Mutation: judge a refused recording by an answer of an earlier one, or keep the bag."""
    row = run("static", tmp_path)
    assert (row.status, row.exit_code, row.repeatable, row.holds) == ("refused", 3, True, True)
    assert row.errors
    assert not list(tmp_path.glob("*.bag"))
