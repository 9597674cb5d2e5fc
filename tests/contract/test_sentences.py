"""What the page reads out of sentences it finds in the sentences that the library writes today."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core.errors import Refused
from calib_core.full.assess import doubtful_choice, plausibility, sensors
from calib_core.full.assess.given_values import Contradiction
from calib_core.full.initialise import axis_signs
from calib_core.full.initialise.agreement import DEGREES, Agreement
from calib_core.full.joint import bounds
from calib_core.full.joint.doubtful_planes import require_three_ways, say_left_out
from calib_core.full.joint.estimation import MapPlane
from calib_core.full.joint.undetermined import NAMES
from calib_core.full.planes.plane_tests import WORDS, Fault
from calib_core.readers.imu.units import detect_accelerometer_unit
from calib_core.result import COVARIANCE_ORDER
from calib_core.settings import ReadSettings
from calib_core.types import ImuData

SOURCES = Path(__file__).resolve().parents[2] / "frontend" / "src"
#: As that module writes them, one a line: `export const leftOut = /^(.*): left out$/;`
PATTERNS = {
    name: re.compile(pattern, re.IGNORECASE if flag else 0)
    for name, pattern, flag in re.findall(
        r"^export const (\w+) = /(.*)/(i?);$",
        (SOURCES / "api" / "sentences.ts").read_text(encoding="utf-8"),
        re.MULTILINE,
    )
}


class Telling:
    """A run that keeps what it is told."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def say(self, level: str, code: str, text: str) -> None:
        """As Run says it."""
        self.texts.append(text)


def standing_in(**facts: object) -> Any:
    """For what a sentence is made of."""
    return SimpleNamespace(**facts)


def found(name: str, text: str) -> tuple[str | None, ...]:
    """What the pattern finds in the text."""
    match = PATTERNS[name].search(text)
    assert match is not None, f"{name} does not find what it is for in: {text}"
    return match.groups()


def test_every_pattern_is_read_and_held_to_a_sentence_here() -> None:
    """Mutations: a pattern of two lines, which would be missed; one that no test below asks for."""
    written = (SOURCES / "api" / "sentences.ts").read_text(encoding="utf-8")
    assert len(PATTERNS) == written.count("export const ") == 9
    here = Path(__file__).read_text(encoding="utf-8")
    assert [name for name in PATTERNS if f'"{name}"' not in here] == []


@pytest.mark.parametrize("fault", WORDS)
def test_why_a_plane_was_left_out_is_found(fault: Fault) -> None:
    """Mutation: other words for "left out"."""
    run: Any = Telling()
    doubt = {"moved": [9.0, 0.0, 0.0], "bent": [0.0, 9.0, 0.0], "mixed": [0.0, 0.0, 9.0]}[fault]
    say_left_out(run, [MapPlane("wall")], np.array([doubt]), np.array([np.nan]))
    assert found("leftOut", run.texts[0].removeprefix("wall ")) == (WORDS[fault].removeprefix("is "),)
    say_left_out(run, [MapPlane("floor")], np.array([doubt]), np.array([-0.6]))
    why = f"{WORDS[fault].removeprefix('is ')} (0.6 m below the lidar)"
    assert found("leftOut", run.texts[1].removeprefix("floor ")) == (why,)


def test_what_is_wrong_with_a_plane_that_counts_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutation: other words for "counts all the same"."""
    monkeypatch.setattr(doubtful_choice, "standings", lambda *_: None)
    monkeypatch.setattr(doubtful_choice, "doubts", lambda _: np.zeros((1, 3)))
    monkeypatch.setattr(doubtful_choice, "fault_of", lambda _: "bent")
    monkeypatch.setattr(doubtful_choice, "is_mostly_bent", lambda _: False)
    monkeypatch.setattr(doubtful_choice, "plane_residuals", lambda *_: [(0.01, 1000)])
    run: Any = Telling()
    planes = [MapPlane("wall", chosen=True)]
    solved = standing_in(problem=None, estimate=None, planes=planes)
    doubtful_choice.say_doubtful_choice(run, solved)
    assert found("doubted", run.texts[0].removeprefix("wall ")) == ("not flat",)


def test_the_planes_that_a_refusal_is_for_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutations: named behind a semicolon, or with other words between them and what follows."""
    planes = [
        MapPlane("box", chosen=True, fault="bent"),
        MapPlane("cart", chosen=True, fault="moved"),
        MapPlane("wall"),
    ]
    with pytest.raises(Refused) as doubtful:
        require_three_ways(planes, ["bent", "moved", ""], np.eye(3))
    monkeypatch.setattr(bounds, "last_move", lambda *_: (np.full(7, 9.0), np.ones(7)))
    with pytest.raises(Refused) as unsettled:
        bounds.require_rest(standing_in(), standing_in(planes=planes), 1.0)
    for refused in (doubtful, unsettled):
        assert found("blamed", str(refused.value)) == ("box is not flat, cart moves against the other planes",)


@pytest.mark.parametrize(("axis", "name"), list(zip(COVARIANCE_ORDER, NAMES, strict=True)))
def test_the_number_that_was_given_is_found(axis: str, name: str) -> None:
    """Mutation: an axis by another name."""
    kind, of = found("contradictedPrior", Contradiction(name, "3 mm", 9.0).text)
    assert axis == ("dt" if kind is None else f"{kind[0]}{of}")


@pytest.mark.parametrize("sensor", ["IMU", "lidar"])
def test_the_sensor_that_has_to_be_named_is_found(monkeypatch: pytest.MonkeyPatch, sensor: str) -> None:
    """Mutation: other words for naming it."""
    monkeypatch.setattr(sensors, "cost_of_sensors", lambda _: np.array([1.0, 9.0, 1.0]))
    monkeypatch.setattr(sensors, "_unnamed", lambda _: [sensor])
    solved = standing_in(nuisance=standing_in(sensors=standing_in(blocks=(1,))))
    ((_, text),) = sensors.told_cost(standing_in(beyond_sheets=False), solved, None)
    assert found("toBeNamed", text) == (sensor,)


def test_a_doubt_about_the_gyroscopes_unit_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutation: a sentence with neither a unit in it nor the turning of the lidar."""
    monkeypatch.setattr(axis_signs, "agreement", lambda *_: Agreement(1.0, DEGREES, 0.0))
    text = axis_signs.unit_complaint(standing_in(omega_rad_s=np.ones((9, 3))), np.zeros(9), _resting(1.0))
    found("ofGyroscope", text)
    found("gyroscopeUnitDoubted", text)


def test_a_doubt_about_the_accelerometers_unit_is_found_and_readings_in_g_are_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Mutations: other words for a unit, for gravity, or for what is neither; a doubt for readings in g."""
    monkeypatch.setattr(plausibility, "_beyond_gravity", lambda *_: True)
    run = standing_in(settings=standing_in(gravity=standing_in(magnitude_m_s2=9.81, std_m_s2=0.01)))
    solved = standing_in(estimate=standing_in(gravity=np.array([0.0, 0.0, 7.5])))
    doubts = [
        _said_of_accelerations(3.1),
        axis_signs.gravity_complaint(_resting(1.0).stamps_ns / 1e9, _resting(1.0), 9.81),
        plausibility.implausible(run, solved) or "",
    ]
    for text in doubts:
        found("ofAccelerometer", text)
        found("accelerometerUnitDoubted", text)
    assert PATTERNS["accelerometerUnitDoubted"].search(_said_of_accelerations(1.0)) is None


def _resting(norm: float) -> ImuData:
    """An IMU at rest whose accelerations are this large."""
    stamps_ns = np.arange(4000, dtype=np.int64) * 5_000_000
    accel = np.zeros((len(stamps_ns), 3))
    accel[:, 2] = norm
    return ImuData(stamps_ns, np.zeros_like(accel), accel)


def _said_of_accelerations(norm: float) -> str:
    imu = _resting(norm)
    return detect_accelerometer_unit(imu.stamps_ns, imu.gyro_rad_s, imu.accel_m_s2, ReadSettings(), "/imu")[1].text
