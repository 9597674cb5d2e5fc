"""Which recordings a folder or a list has, and what their documents are called."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from app.fleet.find import document_names, find_recordings
from calib_core.errors import InputError


def test_a_folder_and_a_list_are_looked_through(tmp_path):
    """Mutations: do not descend; take a ROS 2 folder's own files for recordings; count a path of the list twice; the mark with
    which some editors begin a file taken for a part of the first path."""
    for name in ("b.bag", "deep/a.mcap", "run/metadata.yaml", "run/run_0.db3", "notes.txt", ".hidden.bag"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert find_recordings(tmp_path) == [tmp_path / "b.bag", tmp_path / "deep" / "a.mcap", tmp_path / "run"]
    listed = tmp_path / "deep" / "list.txt"
    listed.write_text(f"\ufeff../run\n# two of them\n\n{tmp_path / 'gone.bag'}\n../run\n")
    assert find_recordings(listed) == [tmp_path / "deep" / ".." / "run", tmp_path / "gone.bag"]
    for wrong, words in ((tmp_path / "b.bag", "one recording"), (tmp_path / "none", "found nothing")):
        with pytest.raises(InputError, match=words):
            find_recordings(wrong)


@pytest.mark.parametrize("text", ['{\n  "schema": "unsweep.calibration/1",\n  "status": "weak"\n}\n', "x" * 9000])
def test_a_text_of_which_no_line_leads_anywhere_is_no_list(tmp_path, text):
    """A result was "91 recordings", and failed as often. Mutations: taken for a list; a list of recordings that are gone by now
    taken for none, whose documents may be there."""
    listed = tmp_path / "result.json"
    listed.write_text(text)
    with pytest.raises(InputError, match=r"none of its .* leads anywhere .*, the first to") as refusal:
        find_recordings(listed)
    assert str(listed) in str(refusal.value)
    listed.write_text("gone.bag\n")
    assert find_recordings(listed) == [tmp_path / "gone.bag"]


def test_links_are_followed_and_each_recording_is_found_once(tmp_path):
    """Mutations: links not entered; a circle entered for ever; one that leads nowhere left out; a file counted again under a
    link's name, or named by the link though its own name is there, or is reached by a link itself.
    """
    folder, other = tmp_path / "folder", tmp_path / "other"
    for path in (folder / "deep" / "z.bag", other / "far.mcap"):
        path.parent.mkdir(parents=True)
        path.touch()
    (folder / "aside").symlink_to(other)
    (folder / "deep" / "up").symlink_to(folder)
    (other / "back").symlink_to(folder)
    (folder / "a.bag").symlink_to(folder / "deep" / "z.bag")
    (folder / "gone.bag").symlink_to(tmp_path / "nowhere.bag")
    (folder / "round.bag").symlink_to(folder / "round.bag")
    (folder / "gone.txt").symlink_to(tmp_path / "nowhere.txt")
    found = [folder / "deep" / "z.bag", folder / "gone.bag", folder / "round.bag", folder / "aside" / "far.mcap"]
    assert find_recordings(folder) == found
    assert find_recordings(folder / "aside") == [
        folder / "aside" / "far.mcap",
        *(folder / "aside" / "back" / path for path in ("deep/z.bag", "gone.bag", "round.bag")),
    ]


def test_a_recording_that_a_list_spells_twice_is_run_once(tmp_path):
    """Mutation: paths compared as they are written."""
    (tmp_path / "deep").mkdir()
    (tmp_path / "room.bag").touch()
    listed = tmp_path / "list.txt"
    listed.write_text("deep/../room.bag\nroom.bag\n./deep/../deep/gone.bag\ndeep/gone.bag\n")
    assert find_recordings(listed) == [tmp_path / "room.bag", tmp_path / "deep" / "gone.bag"]
    listed.write_text("deep/../room.bag\n")
    assert find_recordings(listed) == [tmp_path / "deep" / ".." / "room.bag"]


def test_a_path_of_a_list_ends_where_its_line_does(tmp_path):
    """Oracle: a line of a file ends at a line feed, whoever wrote it; a name may hold what else ends lines for Python. Mutation:
    splitlines."""
    listed = tmp_path / "list.txt"
    names = ["room\u2028one.bag", "hall\x85.bag", "yard.bag"]
    listed.write_bytes("\r\n".join(names).encode())
    assert find_recordings(listed) == [tmp_path / name for name in names]


def test_a_list_may_come_through_a_pipe(tmp_path, monkeypatch):
    """It was told to be one recording. Mutations: a pipe is no list; its paths are taken from /dev/fd."""
    monkeypatch.chdir(tmp_path)
    reads, writes = os.pipe()
    os.write(writes, b"room.bag\n/else/where.bag\n")
    os.close(writes)
    (tmp_path / "room.bag").touch()
    assert find_recordings(Path(f"/dev/fd/{reads}")) == [tmp_path / "room.bag", Path("/else/where.bag")]
    os.close(reads)


def test_no_two_documents_have_one_name_and_names_stay():
    """Mutations: forget what is taken; compare letters by case; give a recording a new name in the second run."""
    paths = [Path(text) for text in ("/a/room.bag", "/b/room.mcap", "/b/ROOM.bag", "/c/b/room.db3", "/a/summary.bag")]
    first = document_names(paths, {})
    assert first == dict(zip(paths, ["room", "b-room", "ROOM-2", "room-3", "a-summary"], strict=True)) | {
        paths[2]: first[paths[2]]
    }
    assert len({name.casefold() for name in first.values()}) == len(paths)
    assert document_names([Path("/0/room.bag"), *paths], first) == first | {Path("/0/room.bag"): "0-room"}
