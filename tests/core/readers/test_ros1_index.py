"""ROS 1 bags read by their index, against rosbags' own reader on the same file, intact and damaged."""

from __future__ import annotations

from pathlib import Path

import pytest
from rosbags.rosbag1 import Reader

from calib_core.readers.container.ros1_index import Ros1Index
from tests.core.readers import build

Told = tuple[list[tuple[str, int, bytes]], str]


def bag(folder: Path, *, n: int = 40) -> Path:
    """Clouds and IMU readings, some of which were received at the same instant."""
    messages: list[build.Message] = []
    for k in range(n):
        stamp_ns = build.EPOCH_NS + k * 10_000_000
        imu = build.imu_message(stamp_ns, (k, 0, 0), (0, 0, 9.81), cdr=False)
        messages.append(("/imu/data", "sensor_msgs/msg/Imu", stamp_ns, imu))
        if k % 5 == 0:
            points = build.velodyne_points(build.sweep(8, seed=k))
            cloud = build.pointcloud2(points, cdr=False, stamp_ns=stamp_ns)
            messages.append(("/points", "sensor_msgs/msg/PointCloud2", stamp_ns, cloud))
    path = folder / "bag.bag"
    build.write_ros1(path, messages, chunk=9000)
    return path


def with_time_first(path: Path) -> None:
    """Headers of records whose fields come in another order: any may, and some recorders' do."""
    body = bytearray(path.read_bytes())
    field = b"\x0d\x00\x00\x00time="
    at = body.find(field)
    while at >= 0:
        begin, end = at - 21, at + 17  # op and conn stand before it, as rosbags writes them
        body[begin:end] = body[at:end] + body[begin:at]
        at = body.find(field, end)
    path.write_bytes(body)


def told(kind: type[Reader], path: Path, start: int | None = None, stop: int | None = None) -> Told:
    """Every message as far as the reader comes, and what stops it."""
    messages: list[tuple[str, int, bytes]] = []
    reader = kind(path)
    reader.open()
    try:
        for connection, time_ns, payload in reader.messages(list(reader.connections), start, stop):
            messages.append((connection.topic, time_ns, payload))
    except Exception as error:  # noqa: BLE001  whatever it is, both have to raise it
        return messages, f"{type(error).__name__}: {error}"
    finally:
        reader.close()
    return messages, ""


@pytest.mark.parametrize("time_first", [False, True])
@pytest.mark.parametrize("span_ms", [(None, None), (50, None), (50, 200), (400, None)])
def test_it_reads_what_rosbags_reads(span_ms: tuple[int | None, int | None], time_first: bool, tmp_path: Path) -> None:
    """Mutations: `<=` at the end of a span; connections merged from the last to the first."""
    path = bag(tmp_path)
    if time_first:
        with_time_first(path)
    start, stop = (None if ms is None else build.EPOCH_NS + ms * 1_000_000 for ms in span_ms)
    expected = told(Reader, path, start, stop)
    assert told(Ros1Index, path, start, stop) == expected
    assert expected[1] == ""


def test_rosbags_reads_one_record_of_a_connection_and_no_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutations: a field of the time that is 17 bytes long, so that no shape is ever found; shapes that are not kept."""
    asked = []
    plain = Reader.messages

    def counted(self: Reader, *arguments: object) -> object:
        asked.append(1)
        return plain(self, *arguments)  # type: ignore[arg-type]

    path = bag(tmp_path)
    monkeypatch.setattr(Reader, "messages", counted)
    messages, _ = told(Ros1Index, path)
    assert len(messages) == 48
    assert len(asked) == 2


def test_a_record_that_names_another_connection_than_the_index_does(tmp_path: Path) -> None:
    """It is taken for a message of the connection it names, as rosbags takes it, and those after it for their own.

    Mutation: the first record of a connection taken for one of its shape whatever it names.
    """
    path = bag(tmp_path)
    body = bytearray(path.read_bytes())
    field = b"\x0d\x00\x00\x00time="
    places = [at for at in range(len(body)) if body.startswith(field, at)]
    for at in (places[2], places[3]):
        body[body.rfind(b"conn=", 0, at) + 5] ^= 1  # of two connections, 0 and 1
    path.write_bytes(body)
    expected = told(Reader, path)
    assert told(Ros1Index, path) == expected
    assert [topic for topic, _, _ in expected[0]].count("/imu/data") == 38


@pytest.mark.parametrize("time_first", [False, True])
@pytest.mark.parametrize("seed", range(100))
def test_damage_is_told_as_rosbags_tells_it(seed: int, time_first: bool, tmp_path: Path) -> None:
    """One byte of a record's header or size is another. Mutations: a payload that ends where the chunk does; the time, or what
    stands before or after it, not compared.
    """
    path = bag(tmp_path, n=12)
    if time_first:
        with_time_first(path)
    body = bytearray(path.read_bytes())
    heads = []
    at = body.find(b"time=")
    while at >= 0:
        heads.append(at)
        at = body.find(b"time=", at + 1)
    head = heads[(7 * seed) % len(heads)]
    body[head - 40 + (11 * seed) % 60] ^= 1 << (seed % 8)
    path.write_bytes(body)
    try:
        expected = told(Reader, path)
    except Exception as error:  # noqa: BLE001  it cannot even be opened
        with pytest.raises(type(error)):
            told(Ros1Index, path)
        return
    assert told(Ros1Index, path) == expected


@pytest.mark.parametrize("share", [0.3, 0.7, 0.95])
def test_a_file_cut_after_its_index_was_read(share: float, tmp_path: Path) -> None:
    """Mutation: a chunk that is not all there taken for what there is of it."""
    path = bag(tmp_path)
    whole = path.read_bytes()
    found = []
    for kind in (Reader, Ros1Index):
        path.write_bytes(whole)
        reader = kind(path)
        reader.open()
        path.write_bytes(whole[: int(share * len(whole))])
        messages: list[tuple[str, int, bytes]] = []
        with pytest.raises(Exception, match="Got only") as told_of:
            messages.extend((c.topic, t, payload) for c, t, payload in reader.messages(list(reader.connections)))
        found.append((messages, str(told_of.value)))
        reader.close()
    assert found[0] == found[1]
