"""A thousand senseless requests: none is a 500, none brings a traceback, and what was stored can still be read."""

from __future__ import annotations

from contextlib import closing

from bench.fuzz_http import Fuzzer
from bench.still_server import server_of_its_own
from tests.bench.fuzz_counts import REQUESTS


def test_a_thousand_senseless_requests_find_no_defect(tmp_path, caplog):
    """Oracle: statuses, and the server's own log. Mutations: int() of a Last-Event-ID; JSON's null where a number was."""
    with server_of_its_own(tmp_path) as (address, _), closing(Fuzzer(address, seed=11)) as fuzzer:
        found = fuzzer.run(REQUESTS)
    assert found.faults == []
    assert found.asked == REQUESTS
    assert sum(found.statuses[status] for status in (200, 201)) > 100  # not everything is turned away at the door
    assert found.statuses[422] > 100
    assert not [record for record in caplog.records if "defect" in record.message or record.exc_info]


def test_the_fuzzer_sees_a_defect(tmp_path, monkeypatch):
    """Oracle: one put in. Mutation: statuses counted and never judged."""

    def broken(*_):
        raise ZeroDivisionError("put in")

    with server_of_its_own(tmp_path) as (address, server), closing(Fuzzer(address, seed=1)) as fuzzer:
        monkeypatch.setattr(server.config.app.state.services.folder, "listing", broken)
        faults = fuzzer.run(200).faults
    assert faults
    assert all(fault.startswith("500 GET /api/folder") for fault in faults)
