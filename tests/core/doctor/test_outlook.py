"""Planes and forecasts put into words, from planes and information that were made here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.doctor.outlook import doubts_settled, forecast_report, in_words, planes_report
from calib_core.doctor.report import ParameterForecast
from calib_core.doctor.sampling import LOOKED_S, SampledScans
from calib_core.full.assess.observability import Knowledge
from calib_core.full.assess.plausibility import SIGNS_RIGHT
from calib_core.full.assess.weak_sentences import Advice
from calib_core.full.forecast import NO_PLANES, Outlook
from calib_core.full.joint.undetermined import UNITS
from calib_core.planes.sample import sample_scan
from calib_core.types import POINT_DTYPE, Finding, Plane, PlanePatch, PlaneProposals, Scan

UP = np.array([0.0, 0.6, 0.8])
SIDE = np.array([1.0, 0.0, 0.0])
AHEAD = np.cross(UP, SIDE)


def proposals(*normals: np.ndarray) -> PlaneProposals:
    patches = tuple(
        PlanePatch(Plane(f"plane {i + 1}", n / np.linalg.norm(n), 1.5 + i), np.zeros((0, 3)), 100, 0.01, 4.0)
        for i, n in enumerate(normals)
    )
    return PlaneProposals(patches, NO_PLANES.cloud_m, NO_PLANES.cloud_patch, NO_PLANES.cloud_intensity, (0,), True)


def test_planes_are_called_what_they_are_to_someone_upright() -> None:
    """Mutation: take gravity for up (floor and ceiling change places), or the normal's angle to it for the tilt.

    Normals point at the lidar: a floor's up, a ceiling's down; gravity is slanted in the planes' frame.
    """
    seen = proposals(UP, -UP, SIDE, -SIDE, AHEAD + 1.2 * UP)
    got = planes_report(seen, -9.81 * UP)
    assert [p.name for p in got.planes] == ["floor", "ceiling", "wall 1", "wall 2", "slope"]
    assert [p.kind for p in got.planes] == ["floor", "ceiling", "wall", "wall", "slanted"]
    slant = np.degrees(np.arctan(1 / 1.2))
    assert [p.tilt_deg for p in got.planes] == pytest.approx([0, 0, 90, 90, slant], abs=0.1)
    assert [p.distance_m for p in got.planes] == pytest.approx([1.5, 2.5, 3.5, 4.5, 5.5])
    assert "2 walls" in got.text
    assert planes_report(seen, None).planes[1].name == "plane 2"


def test_what_a_solve_would_leave_out_is_named_and_not_counted() -> None:
    """Mutations: a doubt on the plane beside; doubtful planes among those that the forecast rests on; none named."""
    seen = proposals(UP, -UP, SIDE, AHEAD)
    got = planes_report(seen, -9.81 * UP, ("", "moved", "", "bent"))
    assert [plane.doubt for plane in got.planes] == [
        "",
        "seems to move against the other planes",
        "",
        "does not seem to be flat",
    ]
    assert got.text.endswith(
        "Likely to be left out by a solve: ceiling seems to move against the other planes and wall 2 does not seem to be flat."
    )
    assert forecast_report(known(), got, share=1.0).planes == ("floor", "wall 1")
    assert "doubtful" not in planes_report(seen, -9.81 * UP, ("",) * 4).text


@pytest.mark.parametrize(
    ("normals", "share", "fixed"),
    [
        ((UP, SIDE, AHEAD), 1.0, True),
        ((UP, SIDE, -SIDE, -UP), 0.0, False),
        ((UP, SIDE), 0.0, False),
        ((UP, SIDE, SIDE + 0.1 * AHEAD), 0.0, False),
    ],
)
def test_planes_fix_a_pose_where_no_direction_is_left_open(
    normals: tuple[np.ndarray, ...], share: float, fixed: bool
) -> None:
    """Mutation: count planes, or forget that opposite walls are one direction."""
    got = planes_report(proposals(*normals), None)
    assert got.determined is fixed
    assert got.determinacy == pytest.approx(share, abs=0.02)
    assert ("leave" in got.text) is not fixed


def known(**std: float) -> Outlook:
    spread = np.array([std.get(n, 0.01) for n in ("rx", "ry", "rz", "tx", "ty", "tz", "dt")]) * UNITS
    return Outlook(proposals(UP, SIDE, AHEAD), None, Knowledge(np.diag(spread**2), spread, (), rotation_known=True))


def test_a_forecast_is_in_degrees_metres_seconds_and_marks_what_is_weak() -> None:
    """Mutation: leave radians, or mark by the sentence's number of weak directions instead of the contract's limits; the
    first advice given for all.
    """
    outlook = known(rz=0.6, ty=1.9, dt=2.1)
    got = forecast_report(outlook, planes_report(outlook.proposals, None), share=1.0)
    assert [p.std for p in got.parameters] == pytest.approx([0.01, 0.01, 0.6, 1e-4, 0.019, 1e-4, 2.1e-3])
    assert [p.unit for p in got.parameters] == ["deg"] * 3 + ["m"] * 3 + ["s"]
    assert [p.name for p in got.parameters if p.weak] == ["rz", "dt"]
    assert got.text == (
        "A solve would know the rotation about x and y to 0.010 deg and the translation to 19 mm (1 sigma), "
        "but not the rotation about z nor the time offset."
    )
    said = (Advice("Turn about z.", (0, 1, 2)), Advice("Be quick.", (6,)))
    asked = forecast_report(replace(outlook, advice=said), planes_report(outlook.proposals, None), share=1.0)
    assert [p.advice for p in asked.parameters] == ["", "", "Turn about z.", "", "", "", "Be quick."]
    assert asked.advice == ("Turn about z.", "Be quick.")
    assert "50 %" in forecast_report(outlook, planes_report(outlook.proposals, None), share=0.5).text


def test_units_and_signs_that_the_lidar_bears_out_are_certain() -> None:
    """Mutations: certain without a forecast; with a turn that stays unknown; other findings made certain too."""
    doubted = [
        Finding("imu.gyroscope_unit", "info", "Angular rates on /imu are in rad/s (nothing speaks).", confidence=0.5),
        Finding("imu.accelerometer_unit", "info", "Accelerations are in g.", confidence=0.4),
        Finding("imu.axis_signs", "warning", "Gyroscope axis y on /imu looks flipped.", confidence=0.6),
    ]

    def said(outlook: Outlook) -> list[tuple[str, float]]:
        forecast = forecast_report(outlook, planes_report(outlook.proposals, None), share=1.0)
        return [(f.text, f.confidence) for f in doubts_settled(doubted, forecast)]

    kept = [(f.text, f.confidence) for f in doubted]
    unit = "Angular rates on /imu are in rad/s: the lidar turns at the same rate."
    assert said(known()) == [(unit, 1.0), kept[1], (SIGNS_RIGHT, 1.0)]
    assert said(known(tz=2.5)) == said(known())  # how far it is away has no part in it
    assert said(known(rz=0.6)) == kept
    assert said(Outlook(NO_PLANES, code="a.b", reason="nothing moved")) == kept
    assert [(f.text, f.confidence) for f in doubts_settled(doubted, None)] == kept


def test_no_forecast_says_why() -> None:
    """Mutation: drop the reason, or give seven parameters all the same."""
    got = forecast_report(
        Outlook(NO_PLANES, code="a.b", reason="nothing moved"), planes_report(NO_PLANES, None), share=1.0
    )
    assert (got.parameters, got.reason, got.code, got.text) == (
        (),
        "nothing moved",
        "a.b",
        "No forecast: nothing moved.",
    )


def test_everything_weak_is_one_plain_sentence() -> None:
    """Mutation: join no words at all (an empty list has no first word)."""
    every = [
        ParameterForecast(name=n, std=9.0, unit="m", weak=True) for n in ("rx", "ry", "rz", "tx", "ty", "tz", "dt")
    ]  # type: ignore[arg-type]
    assert in_words(every) == "A solve would know none of the parameters well."


def scan(index: int, count: int) -> Scan:
    points = np.zeros(count, POINT_DTYPE)
    points["offset_ns"] = np.arange(count)
    points["ring"] = np.arange(count) % 16
    return Scan(index, 10**9 + index * 10**8, points)


def test_a_sample_is_spread_over_time_and_rings() -> None:
    """Mutation: take every k-th point (k = 16 would be one ring), or the first ones."""
    got = sample_scan(scan(0, 24_000), 1500).points
    assert len(got) == pytest.approx(1500, abs=20)
    assert (np.diff(got["offset_ns"]) > 0).all()
    assert np.histogram(got["offset_ns"], 10, (0, 24_000))[0] == pytest.approx(np.full(10, 150), abs=5)
    assert np.bincount(got["ring"], minlength=16) == pytest.approx(np.full(16, 1500 / 16), abs=12)
    assert len(sample_scan(scan(0, 900), 1500).points) == 900


def test_a_long_recording_is_looked_at_for_a_minute() -> None:
    """Mutation: hold every scan of an hour; forget how many points a sample stands for; drop by place, not by index."""
    sampled = SampledScans(36_000, 0.1)
    for position in range(700):
        if sampled.wants(position):
            sampled.add(scan(position, 30_000))
    assert len(sampled.scans) == LOOKED_S / 0.1
    assert sampled.points == [30_000] * len(sampled.scans)
    assert sampled.share == pytest.approx(LOOKED_S / 3600.0)
    assert sum(len(s.points) for s in sampled.scans) < 2_500_000
    assert len(sampled.scans[0].points) > 10_000
    sampled.drop(np.array([0, 7]))
    assert [s.index for s in sampled.scans[:3]] == [1, 2, 3]
    sampled.drop(np.array([0, 3]))
    assert [s.index for s in sampled.scans[:3]] == [1, 2, 4]
