"""Records in PostgreSQL: what is sent to it, and everything done on a real server, which the tests start.

Or on one that is there: UNSWEEP_TEST_DATABASE_URL=postgresql+psycopg://postgres@localhost/postgres
"""

from __future__ import annotations

import os
import uuid
from datetime import UTC, datetime, timedelta, timezone
from importlib.util import find_spec

import pytest
from sqlalchemy import create_engine, create_mock_engine, make_url, select, text
from sqlalchemy.dialects import postgresql as dialects

from app.errors import Unavailable
from app.storage.database import DOCUMENTS, JOBS, METADATA, RECORDINGS, open_database
from app.storage.records import JobRecord, RecordingRecord
from app.storage.store import DocumentStore, JobStore, RecordingStore
from tests.app.support.live import serving
from tests.app.support.postgresql import postgresql, programs

URL = os.environ.get("UNSWEEP_TEST_DATABASE_URL", "")
#: Foreign keys before what they point at would be refused.
IN_ORDER = ["alembic_version", "recordings", "schema_version", "documents", "jobs"]
NOW = datetime(2026, 7, 1, 12, 0, 0, 250, tzinfo=UTC)
#: A microsecond later, elsewhere.
FAR = NOW.astimezone(timezone(timedelta(hours=-7))) + timedelta(microseconds=1)


@pytest.fixture(scope="module")
def server():
    """The address of a PostgreSQL."""
    if not find_spec("psycopg"):
        pytest.skip("psycopg, the driver of PostgreSQL, is not installed")
    if URL:
        yield URL
    elif programs() is None:
        pytest.skip("no PostgreSQL is installed here (Debian's package postgresql)")
    else:
        with postgresql() as address:
            yield address


@pytest.fixture
def database(server):
    """The address of an empty schema on the server, gone afterwards."""
    name = f"unsweep_{uuid.uuid4().hex[:12]}"
    engine = create_engine(server)
    with engine.begin() as connection:
        connection.execute(text(f"CREATE SCHEMA {name}"))
    whole = make_url(server).update_query_dict({"options": f"-csearch_path={name}"})
    yield whole.render_as_string(hide_password=False)
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


DIALECT = dialects.dialect()


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


def rows_of(engine):
    """Everything that is kept, whatever keeps it."""
    with engine.connect() as connection:
        return {
            table.name: [tuple(row) for row in connection.execute(select(table).order_by(*table.primary_key.columns))]
            for table in (RECORDINGS, JOBS, DOCUMENTS)
        }


def keep_some(engine):
    """Recordings, jobs and documents: new, changed, gone; large sizes, other zones, other letters, nothing at all."""
    recordings, jobs, documents = RecordingStore(engine), JobStore(engine), DocumentStore(engine)
    one = RecordingRecord(
        "1" * 32, "Пол’s hall ☂.bag", "upload", "s.bag", "", 5 * 2**30, "ready", None, "{}", None, NOW
    )
    gone = RecordingRecord(
        "2" * 32, "b", "folder", "/r/b.mcap", "", 1, "failed", '{"code": "x"}', "{}", '{"a": 1}', NOW
    )
    for record in (one, gone):
        recordings.add(record)
    job = JobRecord("a" * 32, one.id, "solve", "queued", '{"client": ""}', None, None, None, NOW, None, None)
    late = JobRecord("0" * 32, one.id, "audit", "running", "{}", None, None, job.id, NOW, FAR, None)
    lost = JobRecord("b" * 32, gone.id, "planes", "done", "{}", None, "{}", None, NOW, NOW, NOW)
    kept = [jobs.add(each) for each in (job, late, lost)]
    jobs.save(JobRecord(**{**fields(kept[0]), "state": "failed", "error_json": '{"text": "ü"}', "ended_at": FAR}))
    failed = JobRecord(**{**fields(kept[1]), "state": "failed", "ended_at": FAR})
    jobs.save(failed, recording={"state": "failed", "error_json": '{"text": "ü"}'})
    written = [
        recordings.change(one.id, {"name": "☂"}, where={"state": state, "report_json": None})
        for state in ("ready", "failed")
    ]
    assert written == [False, True]
    documents.write(one.id, "view", "1")
    documents.write(one.id, "view", '{"zoom": 2}')
    documents.write(gone.id, "planes", "[]")
    recordings.remove(gone.id)
    return [each.id for each in jobs.in_states(["failed", "queued"])], jobs.of_recording(one.id)


def fields(record):
    return {name: getattr(record, name) for name in record.__dataclass_fields__}


def test_postgresql_and_sqlite_keep_the_same(database, tmp_path):
    """Row by row, in the same order. Mutations: times without their zone, or cut to milliseconds; no cascade in SQLite; jobs
    in the order of their ids; columns of a recording changed whatever is there.
    """
    told, kept = {}, {}
    for name, url in (("sqlite", f"sqlite:///{tmp_path / 'a.sqlite'}"), ("postgresql", database)):
        engine = open_database(url)
        told[name], kept[name] = keep_some(engine), rows_of(engine)
        engine.dispose()
    assert told["postgresql"] == told["sqlite"]
    assert kept["postgresql"] == kept["sqlite"]
    assert {name: len(rows) for name, rows in kept["sqlite"].items()} == {"recordings": 1, "jobs": 2, "documents": 1}
    in_states, of_recording = told["sqlite"]
    assert in_states == ["a" * 32, "0" * 32]
    assert of_recording[0].started_at == FAR


def test_a_server_on_either_has_the_same_table_of_jobs(database, tmp_path):
    """One that works, one that cannot be read, one that is cancelled; then read by another server.

    Ids and times are each server's own, and jobs of one recording may end in any order. Mutation: --database not handed on.
    """
    told = {}
    for name, url in (("sqlite", None), ("postgresql", database)):
        settings = {} if url is None else {"database_url": url}
        with serving(tmp_path / name, **settings) as live:
            live.finish(live.start(live.ready()))
            broken = live.upload("broken.bag")
            live.wait(
                lambda live=live, broken=broken: live.job_states(broken) == {"inspect": "failed", "planes": "done"}
            )
            slow = live.start(live.ready("slow.bag"))  # ready: an inspection under way at the end is interrupted
            live.wait(lambda live=live, slow=slow: live.job(slow)["text"] == "thinking")
            live.http.post(f"/api/jobs/{slow}/cancel")
            live.finish(slow)
        with serving(tmp_path / name, **settings) as live:
            told[name] = sorted(
                (
                    record["name"],
                    record["state"],
                    job["kind"],
                    job["state"],
                    str(job["error"]),
                    job["settings"]["method"],
                )
                for record in live.http.get("/api/recordings").json()
                for job in live.http.get(f"/api/recordings/{record['id']}/jobs").json()
            )
    assert told["postgresql"] == told["sqlite"]
    assert {row[3] for row in told["sqlite"]} == {"done", "failed", "cancelled"}
    assert len(told["sqlite"]) == 8
