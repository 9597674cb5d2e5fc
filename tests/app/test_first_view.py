"""What is seen first: a cloud and planes from the recording's first seconds, before the rest is read."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.arrays.first_cloud import first_cloud_file, read_first_cloud
from app.arrays.recording import has_recording, recording_arrays
from app.jobs.orders import Order
from app.storage.sizes import source_stamp
from app.work.functions import PROPOSED, REPORTED, decoded, run_inspect, run_job, run_planes
from app.work.head import CLOUD, first_cloud, is_final, propose_from_head
from calib_core import api
from calib_core.errors import InputError
from calib_core.events import LogEvent, StageEvent, ignore_event, never_cancel
from calib_core.settings import ReadSettings
from calib_core.simulate import simulate
from tests.app.support import world

BAG_S = 7.0
#: Modules that only jobs need.
HEAVY = ("calib_core.calibrate", "calib_core.readers.load", "calib_core.doctor.examine", "numba", "open3d")


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Seven simulated seconds that begin with a standstill."""
    path = tmp_path_factory.mktemp("first") / "room.bag"
    simulate("handheld", path, seed=4, duration_s=BAG_S)
    return path


def order_for(bag, cache, **read):
    """A job that looks for planes."""
    return Order(
        job_id="0" * 32,
        kind="planes",
        recording_name=bag.name,
        source=bag,
        cache=cache,
        folder=cache / "job",
        read_settings=ReadSettings(**read),
    )


def same(first, second):
    """Whether two proposals are the same to the last bit."""
    assert [patch.plane.name for patch in first.patches] == [patch.plane.name for patch in second.patches]
    for one, other in zip(first.patches, second.patches, strict=True):
        np.testing.assert_array_equal(one.plane.normal, other.plane.normal)
        assert one.plane.offset_m == other.plane.offset_m
        assert one.n_points == other.n_points
    np.testing.assert_array_equal(first.cloud_m, second.cloud_m)
    np.testing.assert_array_equal(first.cloud_patch, second.cloud_patch)
    assert first.reference_scans == second.reference_scans


def test_planes_of_the_head_are_those_of_the_whole(bag, tmp_path):
    """Seconds are enough where the recording begins at rest: bit for bit the planes that reading everything gives.

    Fails with HEAD_S = 1 (nothing is final); with the head's points thinned; with a stage told before that of reading, which then
    came late to the list of them.
    """
    told = []
    early = propose_from_head(order_for(bag, tmp_path), told.append, never_cancel)
    assert early is not None
    assert {event.stage for event in told if isinstance(event, StageEvent)} == {"read"}
    same(early, api.propose_planes(api.load(bag)))


def test_the_first_things_come_first(bag, tmp_path):
    """Cloud, then planes, are told and on disk before the recording is decoded.

    What has been read stays read, and is told so by whoever needs it next. Fails with decoding put before the search; with a
    stage that is passed over in silence, so that a page's list loses it.
    """
    told = []

    def listen(event):
        if isinstance(event, LogEvent) and event.code in {CLOUD, PROPOSED}:
            told.append((event.code, recording_arrays(tmp_path).exists()))

    outcome = run_planes(order_for(bag, tmp_path), listen, never_cancel)
    assert told == [(CLOUD, False), (PROPOSED, False)]
    assert recording_arrays(tmp_path).exists()
    assert outcome.patches >= 3
    points = read_first_cloud(first_cloud_file(tmp_path))
    assert len(points) > 10 * 1000
    again = []
    decoded(order_for(bag, tmp_path), again.append, never_cancel)
    assert again == [StageEvent(stage="read", fraction=1.0, kept=True)]


def test_the_report_is_on_disk_before_it_is_told_of(bag, tmp_path):
    """Topics, then sensors, can be read when the job says so; the forecast is there at the end.

    Oracle: the file itself. Mutation: told before it is written; the whole report not written.
    """
    order = order_for(bag, tmp_path).model_copy(update={"kind": "inspect"})

    def on_disk():
        report = json.loads((order.folder / "report.json").read_text())
        return [name for name in ("topics", "lidar", "imu", "forecast") if report[name]], report["final"]

    told = []
    run_inspect(
        order,
        lambda event: told.append(on_disk()) if isinstance(event, LogEvent) and event.code == REPORTED else None,
        never_cancel,
    )
    assert told == [(["topics"], False), (["topics", "lidar", "imu"], False)]
    assert on_disk() == (["topics", "lidar", "imu", "forecast"], True)


def test_a_span_in_motion_is_read_whole(bag, tmp_path):
    """Where the span begins in motion, later scans may have the better map: nothing is proposed early.

    Fails with `static` left out of is_final.
    """
    moving = order_for(bag, tmp_path, start_s=3.6)
    assert propose_from_head(moving, ignore_event, never_cancel) is None


def test_first_cloud_is_one_scan_in_motion():
    """The test world moves from its first scan on, so one scan is the cloud: more would smear.

    Fails with the leading rest not asked for.
    """
    recording = world.make_recording()
    assert len(first_cloud(recording)) == len(recording.scans[0].points)


@pytest.mark.parametrize(("scans", "expected"), [(30, True), (2, False)])
def test_is_final_needs_the_end_of_the_rest(scans, expected):
    """A standstill that lasts until the last scan read may go on: its cloud is not final.

    Fails with the last scan of the rest not compared with the scans read.
    """
    proposals = world.make_proposals()
    assert is_final(proposals, scans) is expected


def test_planes_of_merged_scans_are_not_final_where_no_single_scan_determines_a_pose():
    """In the whole recording a later scan is the reference, and these would be in another frame: a person's untouched suggestion
    was none of the planes there, in silence, and the answer 3.6 sigmas off. Mutation: `determined` not looked at.
    """
    assert is_final(world.make_proposals(), 30)
    assert not is_final(replace(world.make_proposals(), determined=False), 30)


def test_the_server_starts_without_the_estimator():
    """What takes seconds to import is imported by the processes that need it.

    Fails with the doctor's `inspect` imported beside its report's models.
    """
    told = subprocess.run(
        [
            sys.executable,
            "-c",
            "import sys, app.application; print([n for n in sys.modules if n in sys.argv[1:]])",
            *HEAVY,
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    assert told.stdout.strip() == "[]"


def test_an_archive_is_unpacked_once_for_all_jobs_of_a_recording(bag, tmp_path, monkeypatch):
    """Oracle: the one folder its file lies in, and no temporary one asked for by the reader.

    Mutation: the order's folder ignored in run_job; the archive is then unpacked three times by two jobs.
    """
    (tmp_path / "room").mkdir()
    (tmp_path / "room" / "room.bag").hardlink_to(bag)
    packed = Path(shutil.make_archive(str(tmp_path / "room"), "tar", tmp_path, "room"))
    shared = tmp_path / "unpacked"
    order = order_for(packed, tmp_path / "cache").model_copy(update={"unpacked": shared})
    own = []
    monkeypatch.setattr(tempfile, "TemporaryDirectory", lambda **_: own.append(1))
    order.folder.mkdir(parents=True)
    for kind in ("planes", "inspect"):
        run_job(order.model_copy(update={"kind": kind}), ignore_event, never_cancel)
    (file,) = shared.rglob("room.bag")
    assert file.stat().st_size == bag.stat().st_size
    assert not own
    assert api.discard_archives(shared)
    assert not file.exists()


def test_a_file_that_is_replaced_while_it_is_read_is_told_and_nothing_of_it_kept(tmp_path, monkeypatch):
    """Oracle: the stamp of the file as it was when the job was ordered. Mutation: no second look: the new file's arrays are kept
    as the old one's.
    """
    source = tmp_path / "room.bag"
    source.write_bytes(b"old")
    order = order_for(source, tmp_path / "cache").model_copy(update={"source_stamp": source_stamp(source)})

    def load(path, *_, **__):
        path.write_bytes(b"another")
        return world.make_recording()

    monkeypatch.setattr(api, "load", load)
    with pytest.raises(InputError, match=r"room\.bag was changed or replaced while it was being read"):
        decoded(order, ignore_event, never_cancel)
    assert not has_recording(recording_arrays(order.cache))
