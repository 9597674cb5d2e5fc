"""Jobs for rounds of kills in CI: reading and inspecting as fake_jobs has them, a solve as bench.kills tells and writes it."""

from __future__ import annotations

from bench import kill_jobs
from tests.app.support import fake_jobs


def run(order, on_event, should_cancel):
    """One job."""
    job = kill_jobs.run_job if order.kind == "solve" else fake_jobs.run
    return job(order, on_event, should_cancel)
