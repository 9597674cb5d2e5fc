"""Traps in units and stamps, from the bag through to the answer: the untrapped twin's answer is the oracle.

The whole table is `python -m tests.core.readers.traps --calibrate`, its last run in bench/results/traps.md; here are
those that change the reading itself, a stamp's meaning, and a clock.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from calib_core import api
from calib_core.settings import ReadSettings
from tests.core.readers import traps
from tests.core.readers.traps import TRAPS

SIMULATION = traps.small()


@pytest.fixture(scope="module")
def twin(tmp_path_factory: pytest.TempPathFactory) -> api.Recording:
    return api.load(traps.write(tmp_path_factory.mktemp("twin") / "twin.bag", SIMULATION, TRAPS["twin"]))


@pytest.fixture(scope="module")
def true_answer(twin: api.Recording) -> traps.Answer:
    return traps.answer(twin)


@pytest.mark.parametrize(
    "name", [name for name in TRAPS if TRAPS[name].same_answer and TRAPS[name].shift_ns is not None]
)
def test_a_trap_is_detected_and_read_as_its_twin(name: str, twin: api.Recording, tmp_path: Path) -> None:
    """Mutation: a factor of ten in NS_PER_UNIT; swap the misfits in `detect_gyroscope`; drop `_epoch_finding`."""
    trap = TRAPS[name]
    recording = api.load(traps.write(tmp_path / "trap.bag", SIMULATION, trap), trap.settings)
    assert not traps.missed(recording, trap)
    moved, worst_ns, reading = traps.difference(recording, twin, trap.lidar_epoch_ns)
    assert moved == 0
    assert worst_ns <= trap.tolerance_ns
    assert reading < 1e-15


@pytest.mark.slow
@pytest.mark.parametrize("name", ["IMU in g and deg/s", "stamp at the end", "lidar clock since its start"])
def test_a_trap_does_not_reach_the_answer(name: str, true_answer: traps.Answer, tmp_path: Path) -> None:
    """Mutation: forget `coarse_offset_ns` in the result's offset; forget pi/180 in `clean_imu`."""
    trap = TRAPS[name]
    got = traps.answer(api.load(traps.write(tmp_path / "trap.bag", SIMULATION, trap), ReadSettings()))
    assert got.status == true_answer.status == "calibrated"
    assert traps.in_sigmas(got, true_answer, trap.shift_ns) < 0.05


@pytest.mark.parametrize("name", [name for name in TRAPS if not TRAPS[name].same_answer])
def test_flipped_axes_are_found_in_the_readings(name: str, tmp_path: Path) -> None:
    """Mutation: return None from `_mirrored_axes`."""
    recording = api.load(traps.write(tmp_path / "trap.bag", SIMULATION, TRAPS[name]))
    assert not traps.missed(recording, TRAPS[name])


def test_the_doctor_counts_a_return_once(tmp_path: Path) -> None:
    """As the solve does. Mutations: the finding not passed on; the plain decoder kept."""
    plain, twice = (
        api.inspect(traps.write(tmp_path / f"{k}.bag", SIMULATION, TRAPS[name]))
        for k, name in enumerate(("twin", "two returns of each beam"))
    )
    assert "points.twice" in [finding.code for finding in twice.findings]
    ranges, of_twice = (report.lidar and report.lidar.ranges for report in (plain, twice))
    assert ranges is not None
    assert ranges == of_twice
