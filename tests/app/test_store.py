"""The store: versions, moments, and what is deleted with a recording."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta, timezone

import psutil
import pytest
from sqlalchemy import inspect, text

from app.errors import Unavailable
from app.server.services import Services
from app.storage.database import CONNECTIONS, open_database, touch_database
from app.storage.records import JobRecord, RecordingRecord
from app.storage.store import DocumentStore, JobStore, RecordingStore
from tests.app.support.live import serving


def recording(number, created_at):
    return RecordingRecord(f"{number:032x}", "a", "upload", "s.bag", "", 1, "ready", None, "{}", None, created_at)


def job(number, recording_id, state="queued"):
    now = datetime(2026, 1, 1, 0, 0, number, tzinfo=UTC)
    return JobRecord(f"{number:032x}", recording_id, "solve", state, "{}", None, None, None, now, None, None)


@pytest.fixture
def engine(tmp_path):
    """A fresh database."""
    made = open_database(f"sqlite:///{tmp_path / 'a.sqlite'}")
    yield made
    made.dispose()


def test_a_fresh_store_is_whole_uses_wal_and_opens_again(tmp_path, engine):
    """Mutation: create_all without a version row fails at the second start."""
    assert {"recordings", "jobs", "documents", "schema_version", "alembic_version"} == set(
        inspect(engine).get_table_names()
    )
    with engine.connect() as connection:
        assert connection.execute(text("PRAGMA journal_mode")).scalar_one() == "wal"
    again = open_database(f"sqlite:///{tmp_path / 'a.sqlite'}")
    touch_database(again)
    again.dispose()


def test_many_at_once_share_so_many_descriptors(tmp_path, engine):
    """Forty threads that all ask: the system's own list of open files stays at two for each connection, and one shared.

    Mutation: connections beyond those kept, opened for a moment: their descriptors stay while any other holds a lock.
    """
    store = RecordingStore(engine)
    together, open_files = threading.Barrier(40), []

    def ask(number):
        together.wait()
        store.add(recording(number, datetime.now(UTC)))
        store.all_newest_first()
        open_files.append(sum(str(tmp_path) in file.path for file in psutil.Process().open_files()))

    with ThreadPoolExecutor(40) as pool:
        list(pool.map(ask, range(40)))
    assert len(store.all_newest_first()) == 40
    assert max(open_files) <= 2 * CONNECTIONS + 1


def test_moments_keep_their_zone_and_their_order(engine):
    """Oracle: the same instants in Python. Mutation: storing local time reorders across zones."""
    store = RecordingStore(engine)
    east = timezone(timedelta(hours=9))
    moments = [
        datetime(2026, 1, 2, 3, tzinfo=east),
        datetime(2026, 1, 1, 19, tzinfo=UTC),
        datetime(2026, 1, 1, 17, tzinfo=UTC),
    ]
    for number, moment in enumerate(moments):
        store.add(recording(number, moment))
    found = store.all_newest_first()
    assert [record.created_at for record in found] == sorted(moments, reverse=True)
    assert all(record.created_at.tzinfo is not None for record in found)


def test_jobs_and_documents_go_with_their_recording(engine):
    """Mutation: foreign keys off (SQLite's default) leaves orphans."""
    recordings, jobs, documents = RecordingStore(engine), JobStore(engine), DocumentStore(engine)
    kept = recording(1, datetime.now(UTC))
    recordings.add(kept)
    jobs.add(job(1, kept.id))
    jobs.add(job(2, kept.id, "running"))
    documents.write(kept.id, "view", "1")
    documents.write(kept.id, "view", "2")
    assert documents.read(kept.id, "view") == "2"
    assert [record.id for record in jobs.of_recording(kept.id)] == [f"{2:032x}", f"{1:032x}"]
    assert [record.state for record in jobs.in_states(["queued"])] == ["queued"]
    recordings.remove(kept.id)
    assert jobs.find(f"{1:032x}") is None
    assert documents.read(kept.id, "view") is None
    assert recordings.find(kept.id) is None


def test_an_unusable_store_is_one_sentence(tmp_path):
    """Mutation: letting SQLAlchemy's own error through."""
    (tmp_path / "notdb.sqlite").write_bytes(b"this is no database, whatever its name says" * 100)
    with pytest.raises(Unavailable) as refused:
        open_database(f"sqlite:///{tmp_path / 'notdb.sqlite'}")
    assert "cannot be opened" in str(refused.value)


def test_a_data_directory_has_one_server(tmp_path):
    """Mutation: without the lock the second server declares the first one's jobs lost."""
    with serving(tmp_path) as live:
        live.start(live.upload("slow.bag"))
        with pytest.raises(Unavailable, match="Another unsweep server"):
            Services(live.settings)
    with serving(tmp_path):
        pass
