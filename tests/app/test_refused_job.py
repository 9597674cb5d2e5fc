"""What a solve that ends without an answer tells on the way."""

from __future__ import annotations

from types import SimpleNamespace

from app.jobs.orders import StoredRequest
from app.results import companions
from app.work import functions
from calib_core.events import StageEvent
from tests.app.support import world
from tests.app.support.orders import order_of


def test_a_refused_solve_ends_at_the_stage_that_refused_it(monkeypatch, tmp_path) -> None:
    """There is no motion to take out. Mutation: what the plots show is measured, and told, as of an answer."""

    def calibrate(*_, on_event, **__):
        on_event(StageEvent(stage="track", fraction=0.4, text="following"))
        return SimpleNamespace(result=world.make_result("refused"), trajectory=None)

    monkeypatch.setattr(functions, "decoded", lambda *_: None)
    monkeypatch.setattr(functions.api, "calibrate", calibrate)
    monkeypatch.setattr(companions, "measure_evidence", lambda *_: SimpleNamespace(model_dump_json=lambda: "{}"))
    order = order_of(tmp_path, "solve", request=StoredRequest())
    heard: list[StageEvent] = []
    outcome = functions.run_job(order, heard.append, lambda: False)
    assert outcome.status == "refused"
    assert [event.stage for event in heard] == ["track"]
