"""Locks by name: each keeps others out, none outlives its use."""

from __future__ import annotations

import threading

import pytest

from app.arrays.proposals import has_proposals, proposal_arrays
from app.bus import Bus
from app.errors import Conflict
from app.events import RecordingArrived
from app.locks import NamedLocks
from app.planes.service import PlaneService
from app.scene.sources import Shelf


def test_a_name_is_held_by_one_thread_at_a_time_and_forgotten_afterwards():
    """Oracle: a counter that only a lock keeps right. Mutation: the entry removed while another thread waits for it."""
    locks, inside, most = NamedLocks(), [0], [0]

    def work():
        for _ in range(200):
            with locks.hold("a"), locks.hold("a"):
                inside[0] += 1
                most[0] = max(most[0], inside[0])
                inside[0] -= 1

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == [1]
    assert len(locks) == 0


def test_a_shelf_keeps_no_lock_of_what_it_has_or_could_not_make():
    """Oracle: the count. Mutations: one left behind by every second look; by every name that could not be made."""
    shelf = Shelf[int]()
    for name in ("a", "b", "a", "a"):
        shelf.get(name, lambda: 1)
    with pytest.raises(OSError, match="gone"):
        shelf.get("c", fail)
    assert len(shelf._making) == 0


def fail():
    """What cannot be read."""
    raise OSError("gone")


def test_the_scenes_keep_no_lock_of_what_nobody_uses(shared_live):
    """Oracle: the count. Mutation: a lock for every recording ever looked at, the deleted ones too."""
    recording_id = shared_live.ready()
    hub = shared_live.services.scenes
    hub.dial(recording_id)[0].close()
    hub.open.close(recording_id)
    shared_live.http.delete(f"/api/recordings/{recording_id}")
    shared_live.wait(lambda: len(hub.open._locks) == 0)


def test_the_planes_keep_no_lock_of_what_nobody_edits(shared_live):
    """Oracle: the count. Mutation: a lock for every recording ever looked at, kept until it is deleted."""
    planes = shared_live.services.planes
    for _ in range(3):
        planes.read(shared_live.ready())
    shared_live.wait(lambda: len(planes._editing) == 0)


def test_a_recording_that_goes_while_its_planes_are_read_leaves_nothing(shared_live, monkeypatch):
    """What is in memory goes when whoever reads has come to an end. Oracle: the tables.

    Mutation: forgotten at once, and put back by whoever was reading.
    """
    planes, recording_id = shared_live.services.planes, shared_live.ready()
    planes.forget(recording_id)
    reading, go_on = threading.Event(), threading.Event()

    def slow(folder):
        reading.set()
        assert go_on.wait(20)
        return has_proposals(folder)

    monkeypatch.setattr("app.planes.service.has_proposals", slow)
    reader = threading.Thread(target=planes.read, args=(recording_id,))
    reader.start()
    assert reading.wait(20)
    forgetting = threading.Thread(target=planes.forget, args=(recording_id,))
    forgetting.start()
    forgetting.join(0.2)
    go_on.set()
    for thread in (reader, forgetting):
        thread.join(20)
    assert recording_id not in planes._rooms
    assert recording_id not in planes._names
    assert not [key for key in planes._proposals if key.startswith(recording_id)]
    assert len(planes._editing) == 0


def test_names_of_a_deleted_recording_are_not_remembered(shared_live):
    """A job's last word may come after it. Oracle: the table. Mutation: remembered whatever was found."""
    planes, recording_id = shared_live.services.planes, "0" * 32
    assert planes.looks(recording_id, ()) == []
    assert recording_id not in planes._names


def test_damage_is_told_when_the_planes_lock_is_free(shared_live):
    """Who hears of it takes the lock of jobs, whose holder asks for the names of planes: each would wait for the other.

    Oracle: another thread that reads names meanwhile comes to an end. Mutation: told from under the lock.
    """
    services, recording_id, came = shared_live.services, shared_live.ready(), []
    bus, store = Bus(), services.recordings._store
    planes = PlaneService(store, services.planes._documents, services.files, bus)

    def hear(_):
        other = threading.Thread(target=planes.looks, args=(recording_id, ()), daemon=True)
        other.start()
        other.join(10)
        came.append(not other.is_alive())

    bus.subscribe(RecordingArrived, hear)
    folder = proposal_arrays(services.files.cache(store.find(recording_id)))
    (folder / "patches.json").write_bytes(b"x")
    with pytest.raises(Conflict, match="have not been found yet"):
        planes.read(recording_id)
    assert came == [True]
