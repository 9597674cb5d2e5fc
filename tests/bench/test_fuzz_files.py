"""Some thousands of spoilt archives, chunks, definitions and messages: each is taken or refused in a sentence."""

from __future__ import annotations

import random
import zipfile

import pytest

from app.scene.messages import admitted
from bench import fuzz_archives, fuzz_files, fuzz_scene
from calib_core.errors import UnreadableRecording
from calib_core.readers.container.archive import unpack_archive
from tests.bench.fuzz_counts import FILES, REQUESTS, SCENE_FRAMES

#: What every run tries at least, by what is promised.
IN_EACH_RUN = 5000


def test_thousands_of_spoilt_bytes_find_no_defect(tmp_path):
    """Oracle: what was packed, the folder, the limits. Mutations, each seen to be found by the inputs of this seed: a seek
    before the start, a name without end and a name of no letters let out of `unpack_archive`; text that is none let out of
    `admitted`; `max_bytes` not handed on to the room.
    """
    found = fuzz_files.run(FILES, 1, tmp_path)
    assert found.defects == []
    assert found.inputs == FILES
    assert found.inputs + REQUESTS + SCENE_FRAMES >= IN_EACH_RUN  # beside the machines and the clouds' own decoders
    # Neither door is always shut or always open.
    assert all(found.outcomes[name]["taken"] > 20 for name in fuzz_files.KINDS)
    assert all(found.outcomes[name]["refused"] > 100 for name in fuzz_files.KINDS if name != "definitions")


def test_the_fuzzer_sees_a_defect(tmp_path, monkeypatch):
    """Oracle: one put in, another exception and a file beside the folder.

    Mutation: in `run` a defect is counted among the outcomes and not told.
    """

    def outside(path, folder, **_):
        (folder.parent / "out.mcap").write_bytes(b"x")

    monkeypatch.setattr(fuzz_archives, "unpack_archive", outside)
    monkeypatch.setattr(fuzz_scene, "admitted", lambda _: 1 / 0)
    found = fuzz_files.run(40, 1, tmp_path, only=("archives", "said to the scene"))
    assert len(found.defects) == found.inputs == 40


def test_text_that_is_none_is_dropped():
    """Oracle: msgpack's own rules for text. Mutation: MsgspecError alone caught."""
    assert admitted(b"\x81\xa4type\xa2\xff\xfe") is None


@pytest.mark.parametrize("name", ["", "a" * 3000 + ".bag"])
def test_a_zip_with_an_impossible_name_is_one_sentence(name, tmp_path):
    """Mutations: IndexError, or an OSError of the name's length, let out of `unpack_archive`."""
    path = tmp_path / "room.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(zipfile.ZipInfo(name), b"x")
    (tmp_path / "to").mkdir()
    with pytest.raises(UnreadableRecording, match="damaged"):
        unpack_archive(path, tmp_path / "to")


def test_an_input_is_the_same_wherever_it_is_run(tmp_path):
    """Oracle: twice the same. Mutation: a chance shared by the inputs of a kind, so that one depends on those before."""
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    first, second = (
        fuzz_archives.zipped(tmp_path / each, random.Random("1 archives 7")).read_bytes() for each in ("a", "b")
    )
    assert first == second
