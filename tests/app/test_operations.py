"""What whoever runs the server goes by: figures, readiness that has been tried, logs with ids."""

from __future__ import annotations

import io
import json
import logging
import re

import pytest
from prometheus_client.parser import text_string_to_metric_families

from app.logs import LogLine, about
from app.server import readiness
from tests.app.support.live import serving


def figures(text):
    """Value by name and labels, by the format's own parser."""
    families = text_string_to_metric_families(text)
    return {(s.name, *sorted(s.labels.items())): s.value for family in families for s in family.samples}


def test_figures_say_what_is_under_way_and_nothing_of_whom(live):
    """Oracle: a parser of the format, and what was asked before. Mutation: counted by path: ids in the labels."""
    recording_id = live.upload("slow.bag")
    job_id = live.start(recording_id)
    live.wait(lambda: live.job(job_id)["stage"] == "solve")
    # What every recording is looked at for when it arrives may take longer than the solve takes to begin.
    live.wait(lambda: figures(live.http.get("/metrics").text)["unsweep_jobs", ("state", "running")] < 2)
    before = figures(live.http.get("/metrics").text)
    live.http.get("/api/nothing")
    answer = live.http.get("/metrics")
    after = figures(answer.text)
    assert after["unsweep_jobs", ("state", "running")] == 1
    assert after["unsweep_jobs", ("state", "queued")] == 0
    missing = ("unsweep_http_requests_total", ("method", "GET"), ("status", "404"))
    assert after[missing] == before.get(missing, 0) + 1
    assert after["unsweep_disk_free_bytes",] > 0
    assert after["process_resident_memory_bytes",] > 1e6
    assert recording_id not in answer.text
    assert job_id not in answer.text
    live.http.post(f"/api/jobs/{job_id}/cancel")


def test_figures_want_the_token(tmp_path):
    """Mutation: /metrics among the open paths."""
    with serving(tmp_path, token="correct-horse-battery") as live:
        assert live.http.get("/metrics").status_code == 200
        assert live.http.get("/metrics", headers={"Authorization": ""}).status_code == 401


def test_ready_means_that_it_was_tried(live, monkeypatch):
    """The folder is gone, as when a disk is unplugged; rights alone would not tell. Oracle: the status.

    Mutation: os.access, which says yes to root whatever the disk is like; the last answer kept for good.
    """
    assert live.http.get("/readyz").status_code == 200
    monkeypatch.setattr(readiness, "READY_FOR_S", 0.0)
    uploads = live.settings.data_dir / "uploads"
    away = uploads.rename(live.settings.data_dir / "away")
    answer = live.http.get("/readyz")
    assert (answer.status_code, answer.json()["error"]["code"]) == (503, "data_dir.unusable")
    assert str(live.settings.data_dir) not in answer.text
    away.rename(uploads)
    assert live.http.get("/readyz").status_code == 200
    assert list(uploads.iterdir()) == []


@pytest.mark.parametrize("as_json", [True, False])
def test_lines_carry_the_job_they_are_about_and_cannot_be_forged(as_json):
    """Oracle: lines read back. Mutations: ids left behind for the next line; a line break in a name taken over."""
    log, stream = logging.getLogger("unsweep.test"), io.StringIO()
    handler = logging.StreamHandler(stream)
    handler.setFormatter(LogLine(as_json=as_json))
    log.handlers[:], log.propagate = [handler], False
    with about(recording_id="a" * 32, job_id="b" * 32):
        log.warning("file %s", "x\n2026-01-01 error all is lost")
    log.warning("later")
    lines = stream.getvalue().splitlines()
    assert len(lines) == 2
    if as_json:
        first, second = (json.loads(line) for line in lines)
        assert (first["job"], first["recording"], first["level"]) == ("b" * 32, "a" * 32, "warning")
        assert "job" not in second
    else:
        assert re.fullmatch(r"\S+Z? warning file x 2026-01-01 error all is lost recording=a{32} job=b{32}", lines[0])
        assert lines[1].endswith("warning later")


def test_the_end_of_every_job_is_logged_with_its_ids(live, caplog):
    """Mutation: the supervising thread without its context."""
    caplog.set_level(logging.INFO, logger="unsweep")
    stream = io.StringIO()
    handler = logging.StreamHandler(stream)
    handler.setFormatter(LogLine(as_json=True))
    logging.getLogger("unsweep").addHandler(handler)
    try:
        job_id = live.start(live.upload("any.bag"))
        live.finish(job_id)
        live.wait(lambda: job_id in stream.getvalue())
    finally:
        logging.getLogger("unsweep").removeHandler(handler)
    lines = [json.loads(line) for line in stream.getvalue().splitlines()]
    assert [line["text"] for line in lines if line.get("job") == job_id] == ["solve is done"]
