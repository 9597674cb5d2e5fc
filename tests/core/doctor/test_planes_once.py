"""The planes that the doctor lists are those that the library proposes: one list, whoever shows it."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from app.planes.state import PlaneHistory, suggested
from app.planes.upright import named, room_of
from app.planes.wire import wire_planes
from calib_core import api
from calib_core.doctor.examination import Examination, choose, detect, read
from calib_core.doctor.whole_scans import WholeScans
from calib_core.events import ignore_event, never_cancel
from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.container.opening import open_recording
from calib_core.readers.container.storage import RawMessage
from calib_core.readers.load import load
from calib_core.settings import ReadSettings
from calib_core.types import Scan
from tests.core.readers import build
from tests.core.readers.cut_sweeps import cut_up


@pytest.mark.parametrize("scenario", ["walking-person", "paper-normal"])
def test_terminal_file_and_page_list_the_same_planes(tmp_path: Path, scenario: str) -> None:
    """Oracle: what is proposed of the whole recording. Mutation: the doctor's planes found in its samples, `whole=None`."""
    bag = tmp_path / "room.bag"
    api.simulate(scenario, bag, seed=1, duration_s=8.0)
    report = api.inspect(bag)
    proposals = api.propose_planes(api.load(bag, fingerprint=False))
    assert report.planes is not None
    assert report.forecast is not None
    history = PlaneHistory(cache_key="", revision=0, steps=(suggested(proposals),), cursor=0)
    room = room_of(report.planes, proposals, report.forecast)
    page = wire_planes(named(history, room), static=proposals.static, up=room.up)
    assert len(page.patches) >= 4
    assert [(p.name, p.area_m2, p.n_points, p.rms_m) for p in page.patches] == [
        (p.name, p.area_m2, p.points, p.rms_m) for p in report.planes.planes
    ]
    assert report.forecast.planes == tuple(p.name for p in page.patches)


def reread(bag: Path, looked: int | None = None) -> list[Scan]:
    """All scans, each decoded a second time. looked: scans that are sampled, the others are known by their headers alone."""
    settings, state = ReadSettings(), Examination()
    with open_recording(bag) as recording:
        choose(state, recording, settings)
        detect(state, recording, settings, (None, None))
        read(state, recording, settings, (None, None), ignore_event, never_cancel)
        assert state.sampled is not None
        if looked is not None:
            state.sampled.drop(np.array([scan.index for scan in state.sampled.scans[looked:]]))
        scans = WholeScans(state, state.sampled, recording, settings)
        order = [*range(0, len(scans), 3), *range(len(scans))]  # as a search does it, and then in one go
        return [scans[k] for k in order][-len(scans) :]


@pytest.mark.parametrize("parts", [1, 2, 10])
@pytest.mark.parametrize("looked", [None, 12])
def test_scans_read_again_are_those_of_the_recording(tmp_path: Path, parts: int, looked: int | None) -> None:
    """Oracle: the reader of whole recordings. Mutations: a gathered scan begun with its second part; all scans after the sample
    taken for one cloud each; a neighbour given without a look at which it is.
    """
    clouds = build.velodyne_messages(40, cdr=True) if parts == 1 else cut_up(parts, twice=True)
    bag = build.write_ros2(tmp_path / "parts", build.in_order(clouds, build.still_imu(4.2, cdr=True)))
    whole = load(bag, ReadSettings(), fingerprint=False).scans
    again = reread(bag, looked)
    assert len(again) == len(whole) == 40
    for one, other in zip(again, whole, strict=True):
        assert (one.stamp_ns, len(one.points)) == (other.stamp_ns, len(other.points))
        np.testing.assert_array_equal(one.points["xyz"], other.points["xyz"])


def test_scans_that_came_out_of_order_are_read_again_in_theirs(tmp_path: Path) -> None:
    """Two clouds that came late, of one receive time with another. Mutation: the stream read on past a scan that lies behind."""
    clouds = build.velodyne_messages(30, cdr=True)
    late = [replace_receive(clouds[k], clouds[k + 2][2]) for k in (7, 20)]
    sent = [m for k, m in enumerate(clouds) if k not in (7, 20)] + late
    bag = build.write_ros2(tmp_path / "late", build.in_order(sent, build.still_imu(3.2, cdr=True)))
    whole = load(bag, ReadSettings(), fingerprint=False).scans
    again = reread(bag)
    assert [scan.stamp_ns for scan in again] == [scan.stamp_ns for scan in whole]
    assert all(one.stamp_ns < other.stamp_ns for one, other in pairwise(again))


def replace_receive(message: build.Message, receive_ns: int) -> build.Message:
    """The message as it comes at another time."""
    return (*message[:2], receive_ns, message[3])


def test_a_scan_that_is_gone_has_no_points(tmp_path: Path) -> None:
    """Mutation: the scan after it in its place."""
    bag = build.write_ros2(
        tmp_path / "bag",
        build.in_order(build.velodyne_messages(30, cdr=True), build.still_imu(3.2, cdr=True)),
    )
    settings, state = ReadSettings(), Examination()
    with open_recording(bag) as recording:
        choose(state, recording, settings)
        detect(state, recording, settings, (None, None))
        read(state, recording, settings, (None, None), ignore_event, never_cancel)
        assert state.sampled is not None
        assert state.decoder is not None
        decoder = state.decoder

        def failing(message: RawMessage) -> RawCloud:
            cloud = decoder(message)
            gone = cloud.header_ns == state.header_ns[4]
            return replace(cloud, points=cloud.points[:0]) if gone else cloud

        state.decoder = failing
        scans = WholeScans(state, state.sampled, recording, settings)
        assert len(scans[4].points) == 0
        assert [scans[k].index for k in (5, 6)] == [5, 6]
