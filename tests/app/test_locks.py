"""Locks by name: each keeps others out, none outlives its use."""

from __future__ import annotations

import threading

import pytest

from app.locks import NamedLocks
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
    hub.dial(recording_id).close()
    hub.open.close(recording_id)
    shared_live.http.delete(f"/api/recordings/{recording_id}")
    shared_live.wait(lambda: hub.open.locks() == 0)
