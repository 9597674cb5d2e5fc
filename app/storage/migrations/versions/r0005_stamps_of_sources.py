"""Recordings that are read in place keep what their source was when it was inspected: somebody may replace it."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"


def upgrade() -> None:
    """Of recordings that are there nobody looked; the next inspection does."""
    op.add_column("recordings", sa.Column("source_stamp", sa.String(32), nullable=False, server_default=""))
