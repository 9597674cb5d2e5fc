"""Stores of earlier versions brought up to this program's, by the steps in migrations/versions.

Alembic is loaded where there is something to do, which is once after a new version: it takes as long as all the rest of
opening a store.
"""

from __future__ import annotations

from pathlib import Path

from sqlalchemy import Connection

from app.errors import Unavailable

#: The newest revision in migrations/versions.
HEAD = "0005"
MIGRATIONS = Path(__file__).with_name("migrations")


def upgrade(connection: Connection, found: str, *, folder: Path = MIGRATIONS) -> None:
    """Bring a store of the revision `found` to the newest one; Unavailable where a newer program has written it."""
    from alembic import command
    from alembic.config import Config
    from alembic.script import ScriptDirectory

    config = Config()
    config.set_main_option("script_location", str(folder).replace("%", "%%"))
    if found not in {script.revision for script in ScriptDirectory.from_config(config).walk_revisions()}:
        raise newer(found)
    config.attributes["connection"] = connection
    command.upgrade(config, "head")


def newer(found: str) -> Unavailable:
    """The refusal of a store that a newer program has written."""
    return Unavailable(
        "store.newer",
        f"The record store has revision {found}, this program knows up to {HEAD}: "
        "use the newer program, or another data directory.",
    )
