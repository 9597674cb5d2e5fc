"""Run by Alembic: the steps, on the connection that app/storage/upgrade.py hands over."""

from alembic import context

context.configure(connection=context.config.attributes["connection"])
context.run_migrations()
