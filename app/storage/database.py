"""The store: SQLite in the data directory (WAL), or any database SQLAlchemy reaches by URL, and its tables.

A fresh database gets the newest tables at once. An older one is brought up by the steps that upgrade.py finds, all in
one transaction. A newer one is refused: an old program must not write into it.
"""

from __future__ import annotations

import sqlite3
from datetime import UTC, datetime

from sqlalchemy import (
    BigInteger,
    Column,
    Dialect,
    Engine,
    ForeignKey,
    Integer,
    MetaData,
    String,
    Table,
    Text,
    TypeDecorator,
    create_engine,
    event,
    insert,
    inspect,
    select,
    update,
)
from sqlalchemy.engine.interfaces import DBAPIConnection, ExceptionContext
from sqlalchemy.exc import ArgumentError, NoSuchModuleError, SQLAlchemyError
from sqlalchemy.pool import ConnectionPoolEntry

from app.errors import DiskFull, Unavailable
from app.storage.upgrade import HEAD, upgrade


class UtcTime(TypeDecorator[datetime]):
    """A moment in UTC, kept as ISO text, which sorts by time and which every database keeps alike."""

    impl = String(32)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, _: Dialect) -> str | None:
        """ISO text with microseconds, so that text order is time order."""
        return None if value is None else value.astimezone(UTC).isoformat(timespec="microseconds")

    def process_result_value(self, value: str | None, _: Dialect) -> datetime | None:
        """The moment, aware of its zone. One that cannot be read must not keep all other rows from being read."""
        try:
            return None if value is None else datetime.fromisoformat(value).astimezone(UTC)
        except (TypeError, ValueError):
            return datetime.fromtimestamp(0, UTC)


METADATA = MetaData()

RECORDINGS = Table(
    "recordings",
    METADATA,
    Column("id", String(32), primary_key=True),
    Column("name", String(200), nullable=False),
    Column("origin", String(16), nullable=False),
    Column("source", Text, nullable=False),
    Column("scenario", String(60), nullable=False),
    Column("size_bytes", BigInteger, nullable=False),
    Column("state", String(16), nullable=False),
    Column("error_json", Text),
    Column("read_settings_json", Text, nullable=False),
    Column("report_json", Text),
    Column("created_at", UtcTime, nullable=False),
    Column("file_name", String(200), nullable=False, server_default=""),
    Column("source_stamp", String(32), nullable=False, server_default=""),
)

JOBS = Table(
    "jobs",
    METADATA,
    Column("id", String(32), primary_key=True),
    Column("recording_id", ForeignKey("recordings.id", ondelete="CASCADE"), nullable=False, index=True),
    Column("kind", String(16), nullable=False),
    Column("state", String(16), nullable=False, index=True),
    Column("request_json", Text, nullable=False),
    Column("error_json", Text),
    Column("outcome_json", Text),
    Column("retry_of", String(32)),
    Column("created_at", UtcTime, nullable=False),
    Column("started_at", UtcTime),
    Column("ended_at", UtcTime),
    Column("sequence", Integer, nullable=False, server_default="0"),
)

#: One JSON text per recording and name: the planes' history, the view.
DOCUMENTS = Table(
    "documents",
    METADATA,
    Column("recording_id", ForeignKey("recordings.id", ondelete="CASCADE"), primary_key=True),
    Column("name", String(32), primary_key=True),
    Column("content_json", Text, nullable=False),
)

SCHEMA_VERSION = Table("schema_version", METADATA, Column("version", Integer, primary_key=True))


#: What Alembic notes, in its own table.
REVISION = Table("alembic_version", METADATA, Column("version_num", String(32), primary_key=True))
#: Connections kept, and no more: one opened for a moment and closed again leaves its descriptors to the others, which
#: SQLite may close only when none of them holds a lock. A transaction takes milliseconds; who finds none free waits.
CONNECTIONS = 8
#: The number of stores that Alembic keeps. Up to 2 it was all there was; programs of that time refuse a larger one.
NUMBER = 3


def open_database(url: str) -> Engine:
    """An engine on a database whose tables are those of this program."""
    try:
        engine = create_engine(
            url,
            connect_args={"timeout": 30} if url.startswith("sqlite") else {},
            pool_pre_ping=True,
            pool_size=CONNECTIONS,
            max_overflow=0,
            pool_use_lifo=True,
        )
    except (ArgumentError, NoSuchModuleError) as error:
        raise Unavailable(
            "store.bad_url",
            f"Expected a database address such as postgresql+psycopg://user@host/unsweep, found one that {_shortly(error)}; "
            "correct --database or UNSWEEP_DATABASE_URL.",
        ) from error
    except ModuleNotFoundError as error:
        raise Unavailable(
            "store.no_driver",
            f"The database address needs the Python package {error.name}, which is not installed: for PostgreSQL write "
            "postgresql+psycopg:// and install it with `pip install unsweep[fleet]`.",
        ) from error
    if engine.dialect.name == "sqlite":
        event.listen(engine, "connect", _prepare_sqlite)
        event.listen(engine, "handle_error", _tell_full_disk)
    try:
        bring_up(engine)
    except SQLAlchemyError as error:
        raise Unavailable(
            "store.unusable",
            f"The record store {engine.url!r} cannot be opened: {_cause(error)}. Check its path and rights.",
        ) from error
    return engine


def bring_up(engine: Engine) -> None:
    """Make the tables, or bring those of an earlier version up, all or nothing; a newer store is refused."""
    with engine.begin() as connection:
        tables = set(inspect(connection).get_table_names())
        if SCHEMA_VERSION.name not in tables:
            METADATA.create_all(connection)
            connection.execute(insert(SCHEMA_VERSION).values(version=NUMBER))
            connection.execute(insert(REVISION).values(version_num=HEAD))
            return
        # Writing first: SQLite then has the changes of tables that follow in the same transaction, too.
        connection.execute(update(SCHEMA_VERSION).values(version=SCHEMA_VERSION.c.version))
        if REVISION.name not in tables:
            REVISION.create(connection)
            number = connection.execute(select(SCHEMA_VERSION.c.version)).scalar_one()
            connection.execute(insert(REVISION).values(version_num=f"{number:04d}"))
        found = connection.execute(select(REVISION.c.version_num)).scalar_one()
        if found != HEAD:
            upgrade(connection, found)


def touch_database(engine: Engine) -> None:
    """Raise Unavailable unless the store can be written."""
    try:
        with engine.begin() as connection:
            connection.execute(update(SCHEMA_VERSION).values(version=SCHEMA_VERSION.c.version))
    except SQLAlchemyError as error:
        raise Unavailable("store.unusable", f"The record store cannot be written: {_cause(error)}.") from error


def _shortly(error: ArgumentError | NoSuchModuleError) -> str:
    """Why an address is none; the address itself, which may hold a password, is not repeated."""
    return "names an unknown kind of database" if isinstance(error, NoSuchModuleError) else "cannot be read"


def _cause(error: SQLAlchemyError) -> str:
    return str(getattr(error, "orig", None) or error).splitlines()[0]


def _tell_full_disk(context: ExceptionContext) -> None:
    """A full disk as the sentence it is, wherever a transaction meets it."""
    error = context.original_exception
    if isinstance(error, sqlite3.OperationalError) and error.sqlite_errorname == "SQLITE_FULL":
        raise DiskFull(
            "store.disk_full",
            "The data directory's disk is full, nothing was changed: free some space, then try again.",
        ) from error


def _prepare_sqlite(connection: DBAPIConnection, _: ConnectionPoolEntry) -> None:
    cursor = connection.cursor()
    # WAL lets readers go on while a job's state is written; foreign keys are off by default in SQLite. FULL: what was
    # acknowledged outlives a power cut; NORMAL may lose the last transactions.
    for pragma in ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON"):
        cursor.execute(f"PRAGMA {pragma}")
    cursor.close()
