"""What a worker is told, for tests that ask a job's function itself."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from app.jobs.orders import Order


def order_of(folder: Path, kind: Any, **more: Any) -> Order:
    """Of a recording, with its kept arrays and the job's own folder in `folder`. more: fields of an order."""
    named = {"recording_name": "room.bag", "source": folder / "room.bag", **more}
    return Order(job_id="0" * 32, kind=kind, cache=folder / "cache", folder=folder / "job", **named)
