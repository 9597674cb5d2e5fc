"""What a person sees: the report, the summary, the progress. Nothing here may be lost, wrong by a unit, or a crash."""

from __future__ import annotations

import io
import json
import math
from typing import Any

import numpy as np
import pytest
from rich.console import Console, RenderableType

from app.cli.inspect_report import report_block
from app.cli.inspect_sensors import sparkline, still_strip
from app.cli.summary import refusal, result_summary, verdict
from app.cli.terminal import LiveProgress, Manner, PlainProgress, error_bar, iteration_table, listener
from calib_core.doctor.report import (
    DoctorReport,
    EvidenceReport,
    ExcitationReport,
    FindingReport,
    Forecast,
    ImuNoiseReport,
    ImuReport,
    LidarPresetReport,
    LidarReport,
    ParameterForecast,
    PlaneReport,
    PlanesReport,
    SaturationReport,
    Span,
    StampReport,
    Timeline,
    TopicReport,
)
from calib_core.events import IterationEvent, LogEvent, PlaneResidual, StageEvent
from calib_core.plane_kinds import kind_of
from calib_core.result import Message
from calib_core.settings import ImuNoise
from tests.core.exporters.results import make_result

ITERATION = IterationEvent(
    iteration=4,
    round=1,
    cost=1234.5,
    matrix=np.eye(4).tolist(),
    translation_m=[-0.080, 0.089, -0.053],
    euler_xyz_deg=[2.9, -1.11, 179.9],
    time_offset_s=0.0127,
    rotation_std_deg=[0.004, 0.005, 0.006],
    translation_std_m=[0.0003, 0.03, 0.0004],
    time_offset_std_s=1e-5,
    planes=[PlaneResidual(name="floor", rms_m=0.02, points=100)],
)


def shown(what: RenderableType, width: int = 110) -> str:
    """What a console of that width shows, without colours."""
    console = Console(file=io.StringIO(), width=width)
    console.print(what)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def stamps(**changes: float) -> StampReport:
    regular = {"rate_hz": 100.0, "period_s": 0.01, "jitter_s": 2e-4, "duplicates": 0, "rewinds": 0, "gaps": 0}
    return StampReport.model_validate({**regular, "longest_gap_s": 0.01, "dropped": 0, **changes})


def report(**changes: object) -> DoctorReport:
    noise = ImuNoise(gyroscope_noise_density_rad_s_sqrt_hz=1.2e-4, accelerometer_noise_density_m_s2_sqrt_hz=1.18e-3)
    imu = ImuReport(
        topic="/imu/data",
        frame_id="imu_link",
        readings=2000,
        stamps=stamps(gaps=1, longest_gap_s=0.53, dropped=50),
        accelerometer_unit="g",
        gyroscope_unit="rad_s",
        gravity_at_rest_m_s2=9.806,
        saturation=SaturationReport(
            gyroscope_max_rad_s=1.2,
            accelerometer_max_m_s2=11.0,
            gyroscope_clipped_share=0.001,
            accelerometer_clipped_share=0.0,
        ),
        excitation=ExcitationReport(
            rotation_rms_deg_s=(14, 12, 13),
            rotation_peak_deg_s=(40, 39, 41),
            angular_acceleration_peak_deg_s2=(100, 120, 90),
            acceleration_rms_m_s2=(0.3, 0.2, 0.4),
            axis_condition=1.4,
            rotation_reversals=40,
            weakest_axis=(0.1, -0.9, 0.3),
            weakest_axis_rms_deg_s=11.2,
            moving_s=18.2,
        ),
        still_spans=(Span(start_s=0.0, end_s=5.0),),
        measured_noise=None,
        preset_noise=ImuNoiseReport(origin="preset", noise=noise, source="Xsens MTi-3"),
        preset_identified=False,
        noise_used="preset",
    )
    fields: dict[str, object] = {
        "name": "room.bag",
        "size_bytes": 123_456_789,
        "container": "ros1",
        "duration_s": 20.0,
        "start_ns": 1_700_000_000_000_000_000,
        "topics": (TopicReport(name="/imu/data", type="sensor_msgs/msg/Imu", messages=2000, rate_hz=100, role="imu"),),
        "lidar_candidates": (),
        "imu_candidates": ("/imu/data",),
        "lidar": None,
        "imu": imu,
        "clock_offset_s": 0.0,
        "timeline": Timeline(rotation_norm_deg_s=(0.0, 10.0, 40.0)),
        "findings": (
            FindingReport(code="a.b", level="info", text="A quiet one."),
            FindingReport(
                code="imu.unit", level="warning", text="Looks like g [not m/s2].", override="--accelerometer-unit m_s2"
            ),
        ),
        "verdict": "limited",
        "reasons": ("There is no lidar.",),
        "advice": ("Turn more.", "Turn more."),
        "forecast": Forecast(
            parameters=(ParameterForecast(name="tz", std=0.04, unit="m", weak=True),), planes=("floor",)
        ),
    }
    return DoctorReport.model_validate({**fields, **changes})


def test_what_is_in_force_is_not_offered_as_another() -> None:
    """Mutation: the detection's own values told as what would override it."""
    times = FindingReport(
        code="points.time_field",
        level="info",
        text="Point times are field 't' in ns.",
        override="--point-time-field t --point-time-unit ns --point-time-reference header-first",
    )
    text = " ".join(shown(report_block(report(findings=(times,)))).split())
    assert "--point-time-field --point-time-unit --point-time-reference" in text.replace("│ ", "")


def test_report_says_it_all() -> None:
    """Fails if a part is left out, a unit is not converted, or text in brackets is eaten as markup (seen: `Text`
    dropped around a finding's words)."""
    text = shown(report_block(report()))
    for words in (
        "Usable with limits.",
        "There is no lidar.",
        "123.5 MB",
        "2023-11-14 22:13:20 UTC",
        "1 gap, 50 messages missing, the longest gap 0.53 s",
        "g and rad/s; at rest it reads 9.806",
        "0.10 % clipped",
        "40 weak",
        "Next: unsweep calibrate room.bag",
        "Looks like g [not m/s2].",
        "To override: --accelerometer-unit m_s2",
    ):
        assert words in text
    assert text.index("Looks like g") < text.index("A quiet one."), "warnings first"
    assert text.count("Turn more.") == 1
    assert text.index("40 weak") < text.index("Turn more.") < text.index("Usable with limits."), "the verdict last"


def test_the_next_command_says_which_topic() -> None:
    """Of a recording with two lidars the command as it stood ended with exit code 2. Mutations: topics only where they were
    chosen, or only where they were not."""
    two = ("/front", "/rear")
    assert "room.bag --lidar-topic TOPIC" in shown(report_block(report(lidar=None, lidar_candidates=two)))
    chosen = shown(report_block(report(imu_candidates=("/imu/data", "/imu/raw"))))
    assert "Next: unsweep calibrate room.bag --imu-topic /imu/data" in chosen


def test_sentences_below_tables_stay_below_them() -> None:
    """At 80 columns each line of them is as far in as the table. Mutation: the indent written before the first line alone."""
    parameters = (ParameterForecast(name="rx", std=0.1, unit="deg", weak=False),)
    forecast = Forecast(parameters=parameters, planes=("floor", "wall 1"), covered_s=20.0)
    lines = shown(report_block(report(forecast=forecast)), width=80).splitlines()
    first = next(i for i, line in enumerate(lines) if "weak beyond" in line)
    assert len(lines[first + 1].strip()) > 0
    assert all(line.startswith("  ") for line in lines[first : first + 2])


def test_forecast_has_two_digits_and_no_number_for_what_is_unknown() -> None:
    """Fails if ten metres of a prior are shown as if they were a forecast, metres are not turned into millimetres, or standstill
    counts as motion.
    """
    parameters = (
        ParameterForecast(name="rx", std=0.00234, unit="deg", weak=False),
        ParameterForecast(name="tx", std=0.00062, unit="m", weak=False),
        ParameterForecast(name="ty", std=9.13, unit="m", weak=True),
        ParameterForecast(name="dt", std=0.0000161, unit="s", weak=False),
    )
    text = shown(report_block(report(forecast=Forecast(parameters=parameters, covered_s=20.1))))
    for words in ("0.0023", "0.62", "unknown", "0.016", "; from 20 s that could be followed"):
        assert words in text
    assert "9130" not in text
    silent = Forecast(parameters=(), reason="nothing moved", text="No forecast: nothing moved.")
    assert "No forecast: nothing moved." in shown(report_block(report(forecast=silent)))


def test_planes_to_expect_are_listed() -> None:
    """Fails if a plane without a known tilt ends in a crash, or the sentence that sums them up is left out."""
    wall = PlaneReport(
        name="wall 1", kind="wall", tilt_deg=88.6, area_m2=9.9, distance_m=1.25, points=900, rms_m=0.0164
    )
    other = wall.model_copy(update={"name": "plane 2", "kind": "plane", "tilt_deg": None})
    planes = PlanesReport(planes=(wall, other), determinacy=0.9, determined=True, text="They fix it.")
    text = shown(report_block(report(planes=planes)))
    for words in ("wall 1", "9.9 m²", "1.2 m", "89°", "16 mm", "They fix it.", "plane 2"):
        assert words in text


def test_evidence_is_written_as_people_write_numbers() -> None:
    """Mutations: what was rounded to nothing from below as -0; digits in one row; words taken for a number."""
    found = (EvidenceReport(name="drift", value=-0.0), EvidenceReport(name="points", value=13107200))
    found += (EvidenceReport(name="field", value="t"), EvidenceReport(name="rate", value=-0.25, unit="s"))
    finding = FindingReport(code="a.b", level="info", text="A quiet one.", evidence=found)
    assert "drift 0, points 13,107,200, field t, rate -0.25 s" in shown(report_block(report(findings=(finding,))), 200)


def test_a_tilt_is_rounded_once() -> None:
    """88.531 deg is 89 on the page. Mutation: rounded to 88.5 where it is found, which Python shows as 88."""
    lean = np.radians(88.531)
    kind, tilt_deg = kind_of(np.array([np.sin(lean), 0.0, np.cos(lean)]), np.array([0.0, 0.0, 1.0]))
    wall = PlaneReport(name="w", kind=kind, tilt_deg=tilt_deg, area_m2=9.9, distance_m=1.2, points=900, rms_m=0.02)
    planes = PlanesReport(planes=(wall,), determinacy=0.9, determined=True, text="They fix it.")
    assert "89°" in shown(report_block(report(planes=planes)))


@pytest.mark.parametrize("width", [40, 80, 200])
def test_report_without_sensors_is_shown_at_any_width(width: int) -> None:
    """Fails if a missing part or a narrow terminal ends in a crash."""
    empty = report(imu=None, forecast=None, findings=(), advice=(), timeline=Timeline(), verdict="unusable")
    assert "Not usable." in shown(report_block(empty), width)


def test_sparkline_keeps_the_peaks() -> None:
    """Fails if a short jerk is averaged away: every stretch shows its largest value."""
    values = [0.0] * 1000
    values[501] = 5.0
    strip = sparkline(values, 50)
    assert len(strip) == 50
    assert strip[25] == "█"
    assert set(strip) == {" ", "█"}
    assert sparkline([0.0, 0.0], 50) == "  "


def test_still_strip_is_where_the_spans_are() -> None:
    """Fails if seconds and cells are mixed up."""
    assert still_strip((Span(start_s=0.0, end_s=5.0),), 20.0, 8) == "━━······"


def test_iteration_is_in_degrees_millimetres_milliseconds() -> None:
    """Fails if a scale is forgotten, or the offset's sign turns."""
    text = shown(iteration_table(ITERATION))
    for words in ("179.9000", "0.0060", "-80.00", "0.30", "89 ", "30 ", "12.700", "0.010", "1234.5"):
        assert words in text


def test_error_bars_are_whole_at_80_columns() -> None:
    """Seen: all six cells long, whatever they showed. Oracle: a console of any width. Mutation: columns of 14 for numbers."""
    step = ITERATION.model_copy(
        update={"iteration": 116, "cost": 1.37306e6, "euler_xyz_deg": [-179.9123, -89.1234, 179.9123]}
    )
    narrow, wide = (shown(iteration_table(step), width=width).splitlines() for width in (80, 200))
    bars = [[line.count("━") for line in lines if "1 sigma" in line] for lines in (narrow, wide)]
    assert bars[0] == bars[1]
    assert len(set(bars[1])) > 1


def test_what_is_held_is_called_so() -> None:
    """Mutations: a number for it; the bar of the others missing, or a bar for what has none."""
    stds = {"translation_std_m": [None, 0.03, 0.0004], "rotation_std_deg": [None] * 3, "time_offset_std_s": None}
    lines = shown(iteration_table(ITERATION.model_copy(update=stds))).splitlines()
    assert [line.count("held") for line in lines if "1 sigma" in line] == [3, 1, 1]
    assert ["━" in line for line in lines if "1 sigma" in line] == [False, True, False]


def test_error_bar_shrinks_with_every_decade() -> None:
    """Fails if the bar is linear (a thousandth would not be seen) or longer than its cells."""
    lengths = [error_bar(std, 1.0).plain.count("━") for std in (100.0, 10.0, 1.0, 0.1, 0.01, 1e-9, 0.0)]
    assert lengths == sorted(lengths, reverse=True)
    assert lengths[0] == lengths[1] > lengths[2] > lengths[3] > lengths[4]
    assert error_bar(2.0, 1.0).style == "yellow"
    assert error_bar(math.inf, 1.0).plain


def test_plain_progress_has_a_line_for_each_stage() -> None:
    """Fails if a bar's every step becomes a line of a log, or a remark is lost."""
    lines: list[str] = []
    progress = PlainProgress(lines.append)
    for fraction in (0.0, 0.5, 1.0):
        progress(StageEvent(stage="read", fraction=fraction))
    progress(ITERATION)
    progress(LogEvent(level="warning", code="x", text="Mind this."))
    assert lines[0] == "Reading the recording ...\n"
    assert len(lines) == 3
    assert "translation -80.00 89.00 -53.00 mm" in lines[1]
    assert "Mind this." in lines[2]


def test_live_progress_shows_stage_table_and_remark() -> None:
    """Fails if the live view breaks on any event, or leaves itself on the screen."""
    console = Console(file=io.StringIO(), width=110, force_terminal=True)
    with LiveProgress(console) as progress:
        progress(StageEvent(stage="read", fraction=1.0))
        progress(StageEvent(stage="solve", fraction=0.4, text="round 2"))
        progress(ITERATION)
        progress(LogEvent(level="info", code="x", text="[brackets] stay"))
    assert isinstance(console.file, io.StringIO)
    text = console.file.getvalue()
    assert "Solving" in text
    assert "[brackets] stay" in text


def test_json_lines_are_the_events(capsys: pytest.CaptureFixture[str]) -> None:
    """Fails if the lines cannot be read back as the events they were."""
    with listener(Manner.json) as on_event:
        on_event(ITERATION)
    assert IterationEvent.model_validate(json.loads(capsys.readouterr().err)) == ITERATION
    with listener(Manner.quiet) as on_event:
        on_event(ITERATION)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(("found", "more"), [(0, ""), (3, ""), (4, "And 1 more"), (9, "And 6 more")])
def test_summary_has_the_biggest_few_of_the_sensors_own_errors(found: int, more: str) -> None:
    """In the document's words and order, and what it costs not to know them after those. Mutations: none; all of them; one more
    or one less than are left; a warning twice; the cost among what is left out; other messages along."""
    result = make_result(np.eye(3), np.zeros(3))
    told = [Message(code="sensor.laser_range", level="info", text=f"ring {k} reads 9 mm short") for k in range(found)]
    told.append(Message(code="sensor.priors", level="info", text="the model of the IMU is not known"))
    told.append(Message(code="sensor.astray", level="warning", text="the sensors' parameters are held instead"))
    told.append(Message(code="imu.noise", level="info", text="the IMU's noise"))
    result = result.model_copy(update={"messages": told})
    text = " ".join(shown(result_summary(result), width=200).split())
    assert [f"Ring {k} reads 9 mm short" in text for k in range(found)] == [k < 3 for k in range(found)]
    assert text.count("he model of the IMU is not known") == 1
    assert text.count("he sensors' parameters are held instead") == 1
    assert "the IMU's noise" not in text
    assert (more in text) if more else ("more of the sensors" not in text)


def test_summary_says_what_to_trust_and_what_to_do() -> None:
    """Fails if the verdict, a sigma, a weak direction or the advice is missing, or said twice."""
    weak = make_result(np.eye(3), np.array([0.1, 0.2, 0.3]), -20_000_000, status="weak")
    text = shown(result_summary(weak))
    for words in (
        "Weak. Tz is known to 40 mm.",
        "100.00",
        "0.50",
        "-20.000",
        "190 of 200 scans",
        "Next time: Turn about x.",
    ):
        assert words in text
    assert text.casefold().count("tz is known to 40 mm.") == 1
    refused = make_result(np.eye(3), np.zeros(3), status="refused")
    assert refusal(refused) == "The platform never moved; turn it."
    assert verdict(refused) in shown(result_summary(refused))


def test_what_stands_for_point_times_is_said() -> None:
    """Mutation: "none" in any case, as if the recording could not be used."""
    imu = report().imu
    assert imu is not None
    preset = LidarPresetReport(name="generic-lidar", range_std_m=0.03, source="", identified=False)
    lidar = LidarReport(
        topic="/points", frame_id="flash", layout="generic", scans=9, rings=0, stamps=imu.stamps, fields=(), point_time=None,
        ranges=None, preset=preset,
    )  # fmt: skip
    said = {
        code: shown(report_block(report(lidar=lidar, findings=() if not code else (FindingReport(**_found(code)),))))
        for code in ("", "points.at_once", "points.time_synthesised")
    }
    assert "none: the clouds carry no time for each point" in said[""]
    assert "all points of a cloud at its stamp, as asked" in said["points.at_once"]
    assert "made up, as asked" in said["points.time_synthesised"]
    assert sum("none: the clouds" in text for text in said.values()) == 1


def _found(code: str) -> dict[str, Any]:
    return {
        "code": code,
        "level": "info",
        "text": "",
        "evidence": (),
        "confidence": 1.0,
        "consequence": "",
        "override": "",
    }
