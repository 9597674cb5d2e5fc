"""Arrays on disk that are damaged, half or of an earlier version: never an answer from them, never a defect, made again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.arrays.folder import CHECKSUMS, DamagedArrays, discard, verify, whole_folder
from app.arrays.recording import has_recording, read_recording, write_recording
from tests.app.support import world
from tests.app.support.damage import cut, overwrite
from tests.app.support.live import serving


def remove(path):
    """All of it gone."""
    path.unlink()


def test_what_was_written_is_read_back(tmp_path):
    """Oracle: the recording itself. Mutation: a header that promises another shape or order."""
    recording = replace(world.make_recording(), skipped_s=2.5)
    write_recording(tmp_path / "r", recording)
    again = read_recording(tmp_path / "r")
    assert again.skipped_s == 2.5
    for before, after in zip(recording.scans, again.scans, strict=True):
        np.testing.assert_array_equal(before.points, after.points)


@pytest.mark.parametrize("name", ["points.npy", "stamps.npz", "recording.json", CHECKSUMS])
@pytest.mark.parametrize("damage", [overwrite, cut, remove])
def test_no_damaged_file_is_believed(tmp_path, name, damage):
    """Mutation: has_recording looking for the folder alone: a quarter of the points overwritten gave "Calibrated"."""
    folder = tmp_path / "r"
    write_recording(folder, world.make_recording())
    assert has_recording(folder)
    damage(folder / name)
    with pytest.raises(DamagedArrays):
        verify(folder)
    assert not has_recording(folder) or damage is overwrite  # a look at the sizes tells all but that
    assert discard(folder)
    write_recording(folder, world.make_recording())
    verify(folder)


def test_a_folder_that_fails_while_it_is_filled_is_not_there(tmp_path):
    """Mutation: filling the folder in place."""

    def fill():
        with whole_folder(tmp_path / "r") as fresh:
            (fresh / "a").write_bytes(b"1")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fill()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("damage", [overwrite, cut])
def test_a_server_finds_the_damage_and_has_the_arrays_made_again(tmp_path, damage):
    """Oracle: the planes and times of before. Mutations: a 500 from np.load; discarding without a new job: 409 for ever."""
    with serving(tmp_path) as live:
        recording_id = live.ready()
        planes = live.http.get(f"/api/recordings/{recording_id}/planes").json()
        times = live.http.get(f"/api/recordings/{recording_id}/timeline").json()
    for name in ("points.npy", "cloud.npz"):
        damage(next((tmp_path / "recordings").rglob(name)))
    with serving(tmp_path) as live:
        paths = [f"/api/recordings/{recording_id}/{part}" for part in ("timeline", "planes", "view")]
        assert {live.http.get(path).status_code for path in paths} <= {200, 409}
        live.wait(lambda: {live.http.get(path).status_code for path in paths} == {200})
        assert live.http.get(paths[0]).json() == times
        assert live.http.get(paths[1]).json()["patches"] == planes["patches"]
