"""Records in PostgreSQL: what is sent to it, and, where a server is named, everything done on it.

UNSWEEP_TEST_DATABASE_URL=postgresql+psycopg://postgres@localhost/postgres python -m pytest tests/app/test_store_postgresql.py
"""

from __future__ import annotations

import os
import uuid
from datetime import UTC, datetime

import pytest
from sqlalchemy import create_engine, create_mock_engine, text
from sqlalchemy.dialects import postgresql

from app.errors import Unavailable
from app.storage.database import METADATA, open_database
from app.storage.records import RecordingRecord
from app.storage.store import DocumentStore, RecordingStore
from tests.app.support.live import serving

URL = os.environ.get("UNSWEEP_TEST_DATABASE_URL", "")
#: Foreign keys before what they point at would be refused.
IN_ORDER = ["alembic_version", "recordings", "schema_version", "documents", "jobs"]


@pytest.fixture
def database():
    """The address of an empty schema on the named server, gone afterwards."""
    if not URL:
        pytest.skip("UNSWEEP_TEST_DATABASE_URL names no PostgreSQL server")
    name = f"unsweep_{uuid.uuid4().hex[:12]}"
    engine = create_engine(URL)
    with engine.begin() as connection:
        connection.execute(text(f"CREATE SCHEMA {name}"))
    yield f"{URL}?options=-csearch_path%3D{name}"
    with engine.begin() as connection:
        connection.execute(text(f"DROP SCHEMA {name} CASCADE"))
    engine.dispose()


def test_the_tables_are_postgresqls_too():
    """Oracle: SQLAlchemy's compiler for PostgreSQL. Fails with INTEGER for sizes, which ends at 2 GB there."""
    told = []
    engine = create_mock_engine("postgresql://", lambda sql, *_, **__: told.append(str(sql.compile(dialect=DIALECT))))
    METADATA.create_all(engine, checkfirst=False)
    tables = [statement for statement in told if "CREATE TABLE" in statement]
    assert sorted(IN_ORDER) == sorted(statement.split()[2] for statement in tables)
    assert "size_bytes BIGINT NOT NULL" in "".join(tables)
    assert "".join(tables).count("ON DELETE CASCADE") == 2


DIALECT = postgresql.dialect()


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("nonsense", "cannot be read"),
        ("nosuch://host/db", "unknown kind of database"),
        ("mysql+pymysql://host/db", "package pymysql, which is not installed"),
    ],
)
def test_a_bad_address_is_one_sentence(url, words):
    """Fails with SQLAlchemy's own error let through. The address may hold a password and is not repeated."""
    with pytest.raises(Unavailable, match=words) as refused:
        open_database(url)
    assert url not in str(refused.value)


def test_records_and_documents(database):
    """A recording larger than 2 GB, its zone, and what goes with it. Fails with size_bytes as INTEGER."""
    engine = open_database(database)
    recordings, documents = RecordingStore(engine), DocumentStore(engine)
    now = datetime.now(UTC)
    kept = RecordingRecord("1" * 32, "a", "upload", "s.bag", "", 5 * 2**30, "ready", None, "{}", None, now)
    recordings.add(kept)
    documents.write(kept.id, "view", "1")
    documents.write(kept.id, "view", "2")
    assert recordings.find(kept.id) == kept
    assert documents.read(kept.id, "view") == "2"
    recordings.remove(kept.id)
    assert documents.read(kept.id, "view") is None
    engine.dispose()
    open_database(database).dispose()


def test_a_server_on_it_from_upload_to_answer_and_over_a_restart(database, tmp_path):
    """The way of a recording, then another server that finds it. Fails with the URL not handed on to the store."""
    with serving(tmp_path / "data", database_url=database) as live:
        recording_id = live.ready()
        job_id = live.start(recording_id)
        assert live.finish(job_id)["state"] == "done"
        assert not list((tmp_path / "data").glob("*.sqlite"))
    with serving(tmp_path / "data", database_url=database) as live:
        found = live.http.get("/api/recordings").json()
        assert [(one["id"], one["has_planes"]) for one in found] == [(recording_id, True)]
        assert live.job(job_id)["result"]["status"] == "calibrated"
