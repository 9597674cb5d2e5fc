"""The list of its files that a ROS 2 folder has: what it says, what is missing, what lies beside it."""

from __future__ import annotations

import io
import shutil
import time
import zipfile
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from calib_core import doctor
from calib_core.errors import UnreadableRecording
from calib_core.readers.container.files import is_recording_folder, recording_files
from calib_core.readers.container.limits import LIMITS
from calib_core.readers.container.listed import files_of
from calib_core.readers.load import load
from calib_core.settings import ReadSettings
from tests.core.readers import build

N_PARTS, PART_S = 6, 1.0
NAMES = [f"room_{part}.mcap" for part in range(N_PARTS)]

#: As rosbag2's own recorder writes it, shortened.
BY_RECORDER = """rosbag2_bagfile_information:
  version: 5
  storage_identifier: sqlite3
  relative_file_paths:
    - room_0.db3
    - "room_1.db3"
  duration:
    nanoseconds: 2500000000
  files:
    - path: room_0.db3
      starting_time:
        nanoseconds_since_epoch: 1700000000000000000
      duration:
        nanoseconds: 1500000000
      message_count: 3
    - path: room_1.db3
      starting_time:
        nanoseconds_since_epoch: 1700000001500000000
      duration:
        nanoseconds: 1000000000
      message_count: 2
  topics_with_message_count:
    []
"""


def written_by(**options: object) -> str:
    """The same text as a library for YAML writes it."""
    yaml = YAML(typ="safe", pure=True)
    for name, value in options.items():
        setattr(yaml, name, value)
    out = io.StringIO()
    yaml.dump(YAML(typ="safe", pure=True).load(BY_RECORDER), out)
    return out.getvalue()


@pytest.mark.parametrize("text", [BY_RECORDER, written_by(default_flow_style=False)])
def test_a_list_is_read_as_a_library_for_yaml_reads_it(text: str) -> None:
    """Oracle: ruamel.yaml. Mutations: quotes kept; the whole recording's duration taken for a file's; the end not seen."""
    said = YAML(typ="safe", pure=True).load(text)["rosbag2_bagfile_information"]
    expected = {one["path"]: one["duration"]["nanoseconds"] * 1e-9 for one in said["files"]}
    assert {one.name: one.duration_s for one in files_of(text)} == expected
    assert [one.name for one in files_of(text)] == said["relative_file_paths"]


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("relative_file_paths: [a.mcap, 'b.mcap']\n", ["a.mcap", "b.mcap"]),
        ("relative_file_paths: [a.mcap,\n    b.mcap]\nfiles:\n", ["a.mcap", "b.mcap"]),
        ("relative_file_paths:\n- room/a.mcap\n- ../../etc/b.mcap\nx: 1\n", ["a.mcap", "b.mcap"]),
        ("relative_file_paths:\n  - a.mcap\n  - a.mcap\n", ["a.mcap"]),
        ("relative_file_paths:\n", []),
        ("relative_file_paths: 5\nfiles: 6\n", []),
        ("", []),
        ("files:\n  - path: a\n      duration: [", []),
    ],
)
def test_a_list_in_other_words_and_what_is_none(text: str, names: list[str]) -> None:
    """Mutations: a folder's name kept; a file of the list counted twice."""
    assert [one.name for one in files_of(text)] == names


def test_a_list_that_is_made_to_take_time_does_not() -> None:
    """Mutation: a pattern that goes back over what it has read, or a list without end."""
    began = time.monotonic()
    for text in ("relative_file_paths:\n" + "  - a\n" * 700_000, "files:\n" + " " * 4_000_000, "- path:" * 600_000):
        assert len(files_of(text)) <= LIMITS.archive_entries
    assert (
        len(files_of("relative_file_paths:\n" + "".join(f"- {k}\n" for k in range(50_000)))) <= LIMITS.archive_entries
    )
    assert time.monotonic() - began < 5.0


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six seconds in six files, with a list that tells how long each is."""
    folder = tmp_path_factory.mktemp("whole") / "room"
    folder.mkdir()
    messages = build.in_order(build.velodyne_messages(60, cdr=True), build.still_imu(6.2, cdr=True))
    blocks = []
    for part, name in enumerate(NAMES):
        first_ns = build.EPOCH_NS + round(part * PART_S * 1e9)
        last = part == N_PARTS - 1
        own = [m for m in messages if first_ns <= m[2] and (last or m[2] < first_ns + PART_S * 1e9)]
        written = build.write_ros2(folder.parent / f"part{part}", own)
        shutil.move(next(written.glob("*.mcap")), folder / name)
        blocks.append(f"    - path: {name}\n      duration:\n        nanoseconds: {round(PART_S * 1e9)}\n")
    listed = "".join(f"    - {name}\n" for name in NAMES)
    text = f"rosbag2_bagfile_information:\n  relative_file_paths:\n{listed}  files:\n{''.join(blocks)}"
    (folder / "metadata.yaml").write_text(text)
    return folder


def copied(whole: Path, tmp_path: Path, *without: str) -> Path:
    """The folder without some of its files."""
    return Path(shutil.copytree(whole, tmp_path / "room", ignore=lambda *_: set(without)))


def zipped(folder: Path) -> Path:
    """Its archive."""
    with zipfile.ZipFile(folder.parent / "room.zip", "w") as archive:
        for file in sorted(folder.iterdir(), reverse=True):  # the list last, as it may come
            archive.write(file, f"room/{file.name}")
    return folder.parent / "room.zip"


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("lost", [("room_4.mcap", "room_5.mcap"), ("room_0.mcap",), ("room_2.mcap",)])
def test_parts_that_the_list_has_and_that_are_missing_are_told(
    lost: tuple[str, ...], packed: bool, whole: Path, tmp_path: Path
) -> None:
    """In what is read and in the report. Oracle: the files that were taken away, a second each.

    Seen: two of twelve missing, "good". Mutations: the list not read; its durations not; an archive's list left in it; the
    finding kept from the verdict.
    """
    path = copied(whole, tmp_path, *lost)
    path = zipped(path) if packed else path
    loaded = load(path, ReadSettings())
    found = next(finding for finding in loaded.findings if finding.code == "recording.incomplete")
    assert found.level == "warning"
    assert f"lacks {len(lost)} of the 6 files" in found.text
    assert all(name in found.text for name in lost)
    assert f"{len(lost):.1f} s of it" in found.text
    report = doctor.inspect(path, ReadSettings())
    assert any(one.code == "recording.incomplete" for one in report.findings)
    assert any("lacks" in reason for reason in report.reasons)


def test_too_little_of_the_parts_is_refused(whole: Path, tmp_path: Path) -> None:
    """Mutation: missing files do not count as damage."""
    with pytest.raises(
        UnreadableRecording, match=r"The recording room lacks 5 of the 6 files .* left of it"
    ) as refused:
        load(copied(whole, tmp_path, *NAMES[1:]), ReadSettings())
    assert refused.value.code == "recording.truncated"


def test_what_lies_beside_the_listed_files_is_left_out_and_told(whole: Path, tmp_path: Path) -> None:
    """Seen: "holds 2 recordings, other.db3 and split_0.db3; give one of them". Mutations: read too; not told; a split that a
    killed recorder has not listed left out with it, or a listed one's compressed copy read beside it.
    """
    folder = copied(whole, tmp_path)
    (folder / "other.db3").write_bytes(b"-")
    (folder / "room_3.mcap.zst").write_bytes(b"-")
    loaded = load(folder, ReadSettings())
    assert len(loaded.scans) == 60
    found = next(finding for finding in loaded.findings if finding.code == "recording.beside")
    assert found.text == (
        "other.db3 and room_3.mcap.zst lie in the folder of room without being in its metadata.yaml, and are left out."
    )
    assert not any(finding.code == "recording.incomplete" for finding in loaded.findings)
    shutil.copy(folder / "room_5.mcap", folder / "room_6.mcap")
    assert [file.name for file in recording_files(folder).files] == [*NAMES, "room_6.mcap"]


@pytest.mark.parametrize(
    ("names", "is_one"),
    [
        (["room_0.mcap", "room_1.mcap"], True),
        (["room_0.db3"], True),
        (["any.db3", "metadata.yaml"], True),
        (["metadata.yaml"], False),
        (["monday_0.mcap", "monday_1.mcap"], False),
        (["room_0.mcap", "other.mcap"], False),
        (["room_1.bag", "room_2.bag"], False),
        (["room.bag"], False),
        ([], False),
    ],
)
def test_a_folder_is_one_recording_by_its_list_or_by_its_recorders_names(
    names: list[str], is_one: bool, tmp_path: Path
) -> None:
    """Seen: a folder of twelve splits was twelve recordings. Mutations: the list asked for alone; any files taken for splits."""
    (tmp_path / "room").mkdir()
    for name in names:
        (tmp_path / "room" / name).write_bytes(b"-")
    assert is_recording_folder(tmp_path / "room") is is_one
