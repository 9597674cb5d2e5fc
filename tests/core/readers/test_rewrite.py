"""Recordings written again: only the coordinates of valid points may differ, byte for byte."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib_core.errors import SettingsError
from calib_core.events import StageEvent
from calib_core.readers.container.opening import open_recording
from calib_core.readers.load import load
from calib_core.readers.write.rewrite import CloudFormat, rewrite_clouds
from calib_core.settings import ReadSettings
from calib_core.types import FloatArray, Scan
from tests.core.maps.own_readers import pcd_columns, ply_columns
from tests.core.readers import build
from tests.core.readers.layouts import LAYOUTS, PERIOD_NS, start_ns

N = 12


def written(folder: Path, layout_name: str, *, cdr: bool) -> Path:
    layout = LAYOUTS[layout_name]
    stream = [(layout.topic, layout.type, start_ns(k) + PERIOD_NS, layout.make(k, cdr).payload) for k in range(N)]
    messages = build.in_order(stream, build.still_imu(1.0, cdr=cdr))
    if cdr:
        return next(build.write_ros2(folder / "r", messages).glob("*.mcap"))
    return build.write_ros1(folder / "r.bag", messages)


def shifted(scan: Scan) -> FloatArray:
    """One metre along x for each second since the scan's first point, plus the scan's number along z."""
    moved = scan.points["xyz"].astype(np.float64)
    moved[:, 0] += 1e-9 * scan.points["offset_ns"]
    moved[:, 2] += scan.index
    return moved


def payloads(path: Path) -> list[tuple[str, int, bytes]]:
    with open_recording(path) as recording:
        return [(m.topic, m.receive_ns, m.payload) for m in recording.messages([t.name for t in recording.topics])]


@pytest.mark.parametrize("suffix", [".bag", ".mcap", ".db3"])
@pytest.mark.parametrize("layout", ["velodyne-organised", "ouster", "livox-custom-1", "hesai"])
def test_only_coordinates_of_valid_points_change(layout: str, suffix: str, tmp_path: Path) -> None:
    """Mutation: patch row 0 of a padded cloud at the unpadded place; move NaN points; write header stamps anew."""
    cdr = suffix != ".bag"
    source = written(tmp_path, layout, cdr=cdr)
    out = tmp_path / f"out{suffix}"
    assert rewrite_clouds(source, None, out, shifted) == N

    before, after = payloads(source), payloads(out)
    assert [(t, r, len(p)) for t, r, p in before] == [(t, r, len(p)) for t, r, p in after]
    assert [p for t, _, p in before if t == "/imu/data"] == [p for t, _, p in after if t == "/imu/data"]
    settings = ReadSettings(range_min_m=1e-4, range_max_m=1e6)
    old, new = load(source, settings), load(out, settings)
    changed = 0
    for a, b in zip(old.scans, new.scans, strict=True):
        assert a.stamp_ns == b.stamp_ns
        for name in ("offset_ns", "intensity", "ring"):
            np.testing.assert_array_equal(a.points[name], b.points[name])
        np.testing.assert_array_equal(b.points["xyz"], shifted(a).astype(np.float32))
        changed += int(np.count_nonzero(a.points["xyz"] != b.points["xyz"])) * 4
    differing = sum(
        sum(x != y for x, y in zip(p, q, strict=True)) for (_, _, p), (_, _, q) in zip(before, after, strict=True)
    )
    assert 0 < differing <= changed


def test_a_folder_of_ply_holds_every_point_and_field(tmp_path: Path) -> None:
    """Mutation: write only the valid points; number the files by stamp."""
    source = written(tmp_path, "ouster", cdr=False)
    assert rewrite_clouds(source, "/points", tmp_path / "plys", shifted) == N
    files = sorted((tmp_path / "plys").iterdir())
    assert [f.name for f in files] == [f"{k:06d}.ply" for k in range(N)]
    raw = files[3].read_bytes()
    end = raw.index(b"end_header\n") + len(b"end_header\n")
    kinds = {"float": "<f4", "uint": "<u4", "uint16": "<u2"}
    lines = [line.split() for line in raw[:end].decode().splitlines() if line.startswith("property")]
    points = np.frombuffer(raw[end:], np.dtype([(name, kinds[kind]) for _, kind, name in lines]))
    truth = LAYOUTS["ouster"].make(3, False)
    assert points.size == truth.valid.size
    assert list(points.dtype.names) == ["x", "y", "z", "intensity", "t", "reflectivity", "ring", "ambient", "range"]
    expected = truth.xyz.astype(np.float64)
    moved_z = expected[:, 2] + 3
    np.testing.assert_allclose(points["z"], np.where(truth.valid, moved_z, expected[:, 2]), atol=2e-6)
    elapsed_s = (truth.times_ns - truth.times_ns[truth.valid].min()) * 1e-9
    np.testing.assert_allclose(points["x"], expected[:, 0] + np.where(truth.valid, elapsed_s, 0), atol=2e-6)


def test_a_folder_of_pcd_holds_the_same(tmp_path: Path) -> None:
    """Livox points, times as driver 1 sends them, uint8 tags. Mutation: write .ply bytes whatever is asked for."""
    source = written(tmp_path, "livox-custom-1", cdr=False)
    assert rewrite_clouds(source, None, tmp_path / "a", shifted) == N
    assert rewrite_clouds(source, None, tmp_path / "b", shifted, cloud_format="pcd") == N
    ply, pcd = ply_columns(tmp_path / "a" / "000004.ply"), pcd_columns(tmp_path / "b" / "000004.pcd")
    assert ply == pcd
    assert {"x", "y", "z", "offset_time", "tag", "line"} <= set(pcd)


@pytest.mark.parametrize("kind", ["ply", "pcd"])
def test_a_field_of_several_numbers_is_written_one_by_one(kind: CloudFormat, tmp_path: Path) -> None:
    """Such fields were left out of the files, in silence. Mutation: scalar fields alone."""
    points = build.velodyne_points(build.sweep())
    wide = np.zeros(points.size, np.dtype([*((n, points.dtype[n]) for n in points.dtype.names), ("echo", "<u2", (3,))]))
    for name in points.dtype.names:
        wide[name] = points[name]
    wide["echo"] = np.arange(3 * points.size).reshape(-1, 3) % 60_000
    clouds = [
        (topic, type_, at, build.pointcloud2(wide, cdr=False, stamp_ns=at - 105_000_000, frame_id="velodyne"))
        for topic, type_, at, _ in build.velodyne_messages(N, cdr=False)
    ]
    nothing = build.pointcloud2(wide[:0], cdr=False, stamp_ns=clouds[5][2] - 105_000_000, frame_id="velodyne")
    clouds[5] = (*clouds[5][:3], nothing)
    source = build.write_ros1(tmp_path / "r.bag", build.in_order(clouds, build.still_imu(1.0, cdr=False)))
    assert rewrite_clouds(source, None, tmp_path / "out", shifted, cloud_format=kind) == N
    file = tmp_path / "out" / f"000002.{kind}"
    columns = ply_columns(file) if kind == "ply" else pcd_columns(file)
    for k in range(3):
        np.testing.assert_array_equal(columns[f"echo_{k}"], wide["echo"][:, k])


def test_packets_become_clouds(tmp_path: Path, real_data: Path) -> None:
    """Mutation: copy the packets where points were moved."""
    folder = next(p for p in (real_data / "velodyne_ros2_packets" / "vlp16").iterdir() if p.is_dir())
    assert rewrite_clouds(folder, None, tmp_path / "out.mcap", shifted) == 4
    with open_recording(tmp_path / "out.mcap") as recording:
        assert [(t.name, t.type, t.count) for t in recording.topics] == [
            ("/velodyne_packets", "sensor_msgs/msg/PointCloud2", 4)
        ]


def test_a_scan_left_alone_is_copied(tmp_path: Path) -> None:
    """Mutation: treat None as zeros."""
    source = written(tmp_path, "velodyne", cdr=False)
    rewrite_clouds(source, None, tmp_path / "same.bag", lambda scan: None)
    assert payloads(source) == payloads(tmp_path / "same.bag")


def test_outputs_that_do_not_fit(tmp_path: Path) -> None:
    """Mutation: overwrite an existing output; write a ROS 1 bag from a ROS 2 recording."""
    source = written(tmp_path, "velodyne", cdr=False)
    with pytest.raises(SettingsError, match=r"does not fit r\.bag.*\.$"):
        rewrite_clouds(source, None, tmp_path / "out.mcap", shifted)
    with pytest.raises(SettingsError, match=r"exists already.*\.$"):
        rewrite_clouds(source, None, source, shifted)

    def fails(scan: Scan) -> FloatArray:
        raise RuntimeError("defect")

    with pytest.raises(RuntimeError):
        rewrite_clouds(source, None, tmp_path / "new.bag", fails)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["r.bag"]


@pytest.mark.parametrize("suffix", ["", ".bag"])
def test_receive_times_are_those_of_the_motion(suffix: str, tmp_path: Path) -> None:
    """Headers of another century: the points are asked for as `load` gives them, and headers stay.

    Seen: a motion solved by receive times was asked for by headers. Mutation: the decoder of headers again.
    """
    source, out, told = written(tmp_path, "velodyne", cdr=False), tmp_path / f"out{suffix}", list[int]()
    settings = ReadSettings(stamps="receive")

    def transform(scan: Scan) -> FloatArray:
        told.append(scan.stamp_ns)
        return scan.points["xyz"].astype(np.float64)

    rewrite_clouds(source, None, out, transform, settings=settings)
    assert told == [scan.stamp_ns for scan in load(source, settings).scans]
    assert told != [scan.stamp_ns for scan in load(source, ReadSettings()).scans]
    if suffix:
        assert payloads(source) == payloads(out)


@pytest.mark.parametrize("suffix", ["", ".bag"])
def test_a_cloud_that_cannot_be_decoded_is_left_and_counted(suffix: str, tmp_path: Path) -> None:
    """One cloud without point times, as `load` takes with a word. Mutations: what is malformed alone is left; nothing is said."""
    without = build.velodyne_points(build.sweep(seed=3))[["x", "y", "z", "intensity", "ring"]]
    body = build.pointcloud2(without, cdr=False, stamp_ns=build.EPOCH_NS + 3 * PERIOD_NS, frame_id="velodyne")
    clouds = build.velodyne_messages(N, cdr=False)
    clouds[3] = (*clouds[3][:3], body)
    source = build.write_ros1(tmp_path / "r.bag", build.in_order(clouds, build.still_imu(1.0, cdr=False)))
    assert len(load(source, ReadSettings()).scans) == N - 1

    said = list[str]()
    out = tmp_path / f"out{suffix}"
    settings = ReadSettings(range_min_m=1e-4, range_max_m=1e6)
    moved = rewrite_clouds(
        source, None, out, shifted, settings=settings, on_event=lambda e: said.append(getattr(e, "code", ""))
    )
    assert moved == N
    assert said.count("points.malformed") == 1
    if suffix:
        before, after = payloads(source), payloads(out)
        same = [a == b for a, b in zip(before, after, strict=True) if a[0] == "/velodyne_points"]
        assert same == [k == 3 for k in range(N)]


@pytest.mark.parametrize("suffix", ["", ".bag"])
@pytest.mark.parametrize("end_s", [None, 2.05])
def test_progress_ends_with_the_work(suffix: str, end_s: float | None, tmp_path: Path) -> None:
    """Of a span it ended where its share of the whole file did. 40 scans of 0.1 s. Mutations: by the number of all scans; no
    last word; all scans named of a span."""
    source = build.write_ros1(
        tmp_path / "r.bag",
        build.in_order(build.velodyne_messages(40, cdr=False), build.still_imu(4.0, cdr=False)),
    )
    told: list[StageEvent] = []
    count = rewrite_clouds(
        source,
        None,
        tmp_path / f"out{suffix}",
        shifted,
        settings=ReadSettings(end_s=end_s),
        on_event=lambda event: told.append(event) if isinstance(event, StageEvent) else None,
    )
    assert (told[-1].fraction, told[-1].text) == (1.0, f"{count} scans")
    expected = np.array([10.0 * k for k in range(1, count // 10 + 1)]) / count
    np.testing.assert_allclose([event.fraction for event in told[:-1]], expected, atol=2.0 / count)
    assert ("of 40" in told[0].text) == (end_s is None)
