"""Stores and data directories of earlier versions, brought up; of later ones, refused."""

from __future__ import annotations

import shutil
import sqlite3
from datetime import UTC, datetime
from pathlib import Path

import pytest
from sqlalchemy import create_engine, inspect, text

from app.errors import Unavailable
from app.storage import database, upgrade
from app.storage.database import open_database
from app.storage.records import JobRecord
from app.storage.store import JobStore
from tests.app.support.live import serving

#: A data directory as version 0.2 left it: a solved recording whose plane was renamed, a cancelled solve, a broken file.
OF_0_2 = Path(__file__).parent / "data" / "directory_0_2"
ROOM, SOLVED = "714003e50f8642788a627eba4e68b6c0", "702a864430104153989afcd7657ab473"


@pytest.fixture
def of_0_2(tmp_path):
    """That data directory."""
    folder = tmp_path / "data"
    shutil.copytree(OF_0_2, folder)
    with sqlite3.connect(folder / "unsweep.sqlite") as connection:
        connection.executescript((folder / "store.sql").read_text())
    rows = connection.execute("SELECT id FROM recordings").fetchall()
    connection.close()
    for (recording_id,) in rows:
        source = folder / "recordings" / recording_id / "source.bag"
        source.parent.mkdir(parents=True)
        source.write_bytes(b"some bytes")
    return folder


def tables(engine):
    """Columns by table, with their types and defaults."""
    seen = inspect(engine)
    return {
        name: sorted((c["name"], str(c["type"]), c["nullable"], c["primary_key"]) for c in seen.get_columns(name))
        for name in seen.get_table_names()
    }


def revision(path):
    """What the store says of itself."""
    with sqlite3.connect(path) as connection:
        found = connection.execute("SELECT version_num, version FROM alembic_version, schema_version").fetchall()
    connection.close()
    return found


def test_a_data_directory_of_0_2_is_taken_over_whole(of_0_2):
    """Oracle: what 0.2 answered when the directory was made. Mutation: the number 2 taken for the newest revision."""
    with serving(of_0_2) as live:
        listed = {one["name"]: one for one in live.http.get("/api/recordings").json()}
        assert {name: one["state"] for name, one in listed.items()} == {
            "room.bag": "ready",
            "slow.bag": "ready",
            "broken.bag": "failed",
        }
        assert listed["room.bag"]["latest_job"]["result"]["status"] == "calibrated"
        document = live.http.get(f"/api/results/{SOLVED}").json()
        assert document["T_imu_lidar"]["translation_m"] == [0.1, -0.05, 0.2]
        jobs = live.http.get(f"/api/recordings/{listed['slow.bag']['id']}/jobs").json()
        assert [job["kind"] for job in jobs] == ["solve", "inspect", "planes"]
        assert jobs[0]["state"] == "cancelled"
        # Its arrays were left behind: reading it again finds the planes, and its people's names for them.
        assert live.http.patch(f"/api/recordings/{ROOM}", json={"range_max_m": 50}).status_code == 200
        live.wait(lambda: live.job_states(ROOM) == {"inspect": "done", "planes": "done", "solve": "done"})
        assert live.http.get(f"/api/recordings/{ROOM}/planes").status_code == 200
    assert revision(of_0_2 / "unsweep.sqlite") == [(upgrade.HEAD, database.NUMBER)]


def test_every_step_from_the_first_release_makes_the_tables_of_today(tmp_path):
    """Oracle: the tables of a fresh store. Mutations: a column added to the tables and to no step; HEAD left behind."""
    fresh = open_database(f"sqlite:///{tmp_path / 'fresh.sqlite'}")
    old = create_engine(f"sqlite:///{tmp_path / 'old.sqlite'}")
    with old.begin() as connection:
        upgrade_from_nothing(connection)
    assert tables(old) == tables(fresh)
    for engine in (old, fresh):
        engine.dispose()
    assert revision(tmp_path / "old.sqlite") == revision(tmp_path / "fresh.sqlite") == [(upgrade.HEAD, database.NUMBER)]


def upgrade_from_nothing(connection):
    """All steps, by Alembic's own command."""
    from alembic import command
    from alembic.config import Config

    config = Config()
    config.set_main_option("script_location", str(upgrade.MIGRATIONS))
    config.attributes["connection"] = connection
    command.upgrade(config, "head")


def test_jobs_of_the_first_release_keep_their_order_and_new_ones_come_behind(of_0_2):
    """A store as version 1 left it. Oracle: the order of creation. Mutation: no UPDATE: all are at place 0."""
    path = of_0_2 / "unsweep.sqlite"
    with sqlite3.connect(path) as connection:
        connection.execute("ALTER TABLE jobs DROP COLUMN sequence")
        connection.execute("UPDATE schema_version SET version = 1")
        connection.execute("UPDATE jobs SET recording_id = ?", (ROOM,))
        asked = [row[0] for row in connection.execute("SELECT id FROM jobs ORDER BY created_at DESC, id DESC")]
    connection.close()
    engine = open_database(f"sqlite:///{path}")
    now = datetime(2001, 1, 1, tzinfo=UTC)
    JobStore(engine).add(JobRecord("9" * 32, ROOM, "solve", "queued", "{}", None, None, None, now, None, None))
    assert [record.id for record in JobStore(engine).of_recording(ROOM)] == ["9" * 32, *asked]
    engine.dispose()


@pytest.mark.parametrize("change", ["alembic_version SET version_num = 'f00d'", "schema_version SET version = 7"])
def test_a_store_of_a_newer_program_is_refused_and_left_as_it_is(of_0_2, change):
    """Mutations: an unknown revision passed to Alembic, which answers with its own error; noting before refusing."""
    path = of_0_2 / "unsweep.sqlite"
    if "alembic" in change:
        open_database(f"sqlite:///{path}").dispose()
    with sqlite3.connect(path) as connection:
        connection.execute(f"UPDATE {change}")
        before = list(connection.iterdump())
    connection.close()
    with pytest.raises(Unavailable, match="use the newer program, or another data directory") as refused:
        open_database(f"sqlite:///{path}")
    assert refused.value.code == "store.newer"
    with sqlite3.connect(path) as connection:
        assert list(connection.iterdump()) == before
    connection.close()


def test_an_upgrade_that_ends_half_way_has_changed_nothing(of_0_2, monkeypatch):
    """A step that fails after it has altered a table. Oracle: the store's text before. Mutation: no write before the steps."""
    path = of_0_2 / "unsweep.sqlite"
    with sqlite3.connect(path) as connection:
        before = list(connection.iterdump())
    connection.close()

    def half(connection, _):
        connection.execute(text("ALTER TABLE jobs ADD COLUMN note TEXT"))
        raise RuntimeError("the power is gone")

    with monkeypatch.context() as broken:
        broken.setattr(database, "upgrade", half)
        with pytest.raises(RuntimeError):
            open_database(f"sqlite:///{path}")
    with sqlite3.connect(path) as connection:
        assert list(connection.iterdump()) == before
    connection.close()
    open_database(f"sqlite:///{path}").dispose()
    assert revision(path) == [(upgrade.HEAD, database.NUMBER)]
