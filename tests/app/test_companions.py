"""What is measured beside a result: where its motion is known and its solve has looked, by browser and terminal alike."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from app.cli import commands
from app.cli.main import run
from app.cli.terminal import Manner
from app.jobs.orders import StoredRequest
from app.results.companions import Beside, measure_beside
from app.scene.build import Solved
from app.scene.inspect import Look, Motions, build_inspection
from app.scene.nudge import wall_blur
from app.work import functions
from calib_core import api
from calib_core.settings import CalibrateSettings
from tests.app.support import world
from tests.app.support.orders import order_of

RECORDING = world.make_recording()
RESULT = world.make_result()
PATH = world.make_trajectory()
SPANS_S = ((0.35, 0.45),)


def until(t_s):
    """The motion up to then, as where a clock was set or the IMU fell silent."""
    known = PATH.times_s < t_s
    R, p = PATH.R_map_lidar[known], PATH.p_map_lidar[known]
    return replace(PATH, times_s=PATH.times_s[known], R_map_lidar=R, p_map_lidar=p, valid=PATH.valid[known])


def bridged(start_s, end_s):
    """The motion, between these instants only bridged."""
    return replace(PATH, valid=(PATH.times_s < start_s) | (PATH.times_s > end_s))


def only(places):
    """The recording with these scans alone."""
    return replace(RECORDING, scans=[RECORDING.scans[place] for place in places])


@pytest.mark.parametrize(
    ("path", "known"),
    [
        (until(0.62), [0, 1, 2, 3, 4, 5]),
        (bridged(0.31, 0.55), [0, 1, 2, 6, 7, 8, 9, 10, 11]),
    ],
)
def test_scans_whose_motion_is_not_known_are_in_no_number(path, known):
    """Oracle: the same of the other scans alone. Mutations, in walls, scans and evidence each: every scan taken, at the pose
    that the motion had last; in scans and evidence: bridged motion taken for known.
    """
    whole = measure_beside(RECORDING, RESULT, path, [])
    alone = measure_beside(only(known), RESULT, path, [])
    assert whole.walls == alone.walls
    assert whole.walls.after_rms_m < 2e-3
    assert [place for place, rms_m in enumerate(whole.scans.rms_m) if rms_m is not None] == known
    assert whole.evidence.room == alone.evidence.room
    assert whole.evidence.by_range == alone.evidence.by_range


def test_a_scan_that_ends_with_the_motion_is_evidence_however_long_a_sweep_is():
    """Sweeps of 50 ms, of which the last ends 30 ms before the motion does. Mutation: a tenth of a second for each sweep."""
    scans = []
    for scan in RECORDING.scans:
        first_half = scan.points[scan.points["offset_ns"] < 50_000_000]
        scans.append(replace(scan, points=first_half))
    path = until(0.585)
    seen = measure_beside(replace(RECORDING, scans=scans), RESULT, path, []).evidence
    alone = measure_beside(replace(RECORDING, scans=scans[:6]), RESULT, path, []).evidence
    short = measure_beside(replace(RECORDING, scans=scans[:5]), RESULT, path, []).evidence
    assert seen.by_range == alone.by_range
    assert seen.by_range != short.by_range


def test_scans_that_were_left_out_keep_their_place_and_have_no_number():
    """Oracle: the library's own choice. Mutations: the whole recording to walls, or to evidence; every scan given a number."""
    kept = api.without_spans(RECORDING, SPANS_S)
    left_out = [k for k, scan in enumerate(RECORDING.scans) if scan.index not in {one.index for one in kept.scans}]
    assert left_out == [3, 4]
    measured = measure_beside(RECORDING, RESULT, PATH, [], excluded_spans_s=SPANS_S)
    alone = measure_beside(kept, RESULT, PATH, [])
    assert measured.walls == alone.walls
    assert measured.evidence == alone.evidence
    assert len(measured.scans.t_s) == world.N_SCANS
    assert [k for k, rms_m in enumerate(measured.scans.rms_m) if rms_m is None] == left_out
    assert [k for k, share in enumerate(measured.scans.share) if share is None] == left_out


def test_without_a_motion_only_the_evidence_is_there():
    """Mutation: walls measured of a refusal."""
    measured = measure_beside(RECORDING, world.make_result("refused"), None, [])
    assert (measured.walls, measured.scans) == (None, None)
    assert measured.evidence is not None


class Solving:
    """Stands in for the estimator, and notes what is measured beside its answer."""

    def __init__(self, monkeypatch):
        self.spans_s = []
        monkeypatch.setattr(api, "get_ready", lambda: None)  # nothing is computed here
        monkeypatch.setattr(api, "load", lambda *_, **__: RECORDING)
        monkeypatch.setattr(api, "calibrate", lambda *_, **__: SimpleNamespace(result=RESULT, trajectory=PATH))

    def measured(self, *_, excluded_spans_s, **__):
        self.spans_s.append(excluded_spans_s)
        return Beside()


def test_terminal_and_browser_leave_out_what_the_solve_left_out(monkeypatch, tmp_path):
    """Mutation: the spans not handed on by either; the report of `calibrate --report` had them in."""
    solving = Solving(monkeypatch)
    monkeypatch.setattr("app.results.companions.measure_beside", solving.measured)
    monkeypatch.setattr(functions, "measure_beside", solving.measured)
    monkeypatch.setattr(functions, "decoded", lambda *_: RECORDING)
    monkeypatch.setattr("app.results.report.report_page", lambda *_: "a page")
    monkeypatch.setattr(commands, "_manner", lambda _: Manner.quiet)
    words = ["calibrate", "room.bag", "--exclude", "0.35:0.45", "--report", str(tmp_path / "page.html")]
    assert run([*words, "--output", str(tmp_path / "result.json")]) == 0
    request = StoredRequest(settings=CalibrateSettings(excluded_spans_s=SPANS_S))
    order = order_of(tmp_path, "solve", request=request)
    functions.run_job(order, lambda _: None, lambda: False)
    assert solving.spans_s == [SPANS_S, SPANS_S]


def test_the_scenes_map_and_its_blur_are_of_scans_whose_motion_is_known():
    """Oracle: the room. Mutations: every scan laid into the map, or into the blur."""
    half = until(0.62)
    solved = Solved(half, world.plane_quality(), [0, 1, 2, 3, 4, 5], world.transform_matrix(), 0.004)
    look = Look(place=5, show="deskewed", against="raw", extent="map", color_by="plane", wipe=0.5, limit=100_000)
    shown = build_inspection(RECORDING, look, Motions(solved, half, None), None)
    (cloud,) = (item for item in shown.items if getattr(item, "path", "") == "/deskewed")
    assert len(cloud.xyz) == 6 * 1500
    assert np.abs(np.abs(cloud.xyz) - world.HALF_M).min(axis=1).max() < 5e-3
    assert wall_blur(RECORDING, solved, half).solved_rms_m < 2e-3
