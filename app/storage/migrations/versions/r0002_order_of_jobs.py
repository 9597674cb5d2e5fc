"""Jobs have an order of their own, which no clock can turn around."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    """Jobs that are there are numbered in the order in which they were asked for."""
    op.add_column("jobs", sa.Column("sequence", sa.Integer, nullable=False, server_default="0"))
    op.execute(
        """UPDATE jobs SET sequence = (SELECT COUNT(*) FROM jobs AS earlier WHERE earlier.created_at < jobs.created_at
        OR (earlier.created_at = jobs.created_at AND earlier.id <= jobs.id))"""
    )
    op.execute("UPDATE schema_version SET version = 2")
