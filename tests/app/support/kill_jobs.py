"""Jobs for rounds of kills in CI: reading and inspecting as fake_jobs has them, a solve as bench.kills tells and writes it."""

from __future__ import annotations

from tests.app.support import fake_jobs


def run(order, on_event, should_cancel):
    """One job."""
    if order.kind != "solve":
        return fake_jobs.run(order, on_event, should_cancel)
    from bench import kill_jobs

    return kill_jobs.run_job(order, on_event, should_cancel)
