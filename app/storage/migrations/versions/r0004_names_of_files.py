"""Recordings keep the name of the file that they came as, whatever people call them afterwards."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"


def upgrade() -> None:
    """Of recordings that are there it is not known any more: their names may have been changed."""
    op.add_column("recordings", sa.Column("file_name", sa.String(200), nullable=False, server_default=""))
