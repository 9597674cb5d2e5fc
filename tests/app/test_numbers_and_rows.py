"""Numbers that are none are refused wherever they come in; a row that cannot be read is one broken row."""

from __future__ import annotations

import pytest
from sqlalchemy import create_engine, text

from app.schemas.jobs import InitialGuess, NewJob
from app.schemas.recordings import ChangeRecording
from app.schemas.view import ChangeView, OldExtrinsic
from calib_core.settings import CalibrateSettings, Gravity, ReadSettings
from tests.app.support.live import serving

GUESS = '{"kind": "solve", "initial_guess": {"time_offset_s": %s}}'
MATRIX = '{"kind": "solve", "initial_guess": {"matrix": [[%s, 0, 0, 0]]}}'
GRAVITY = '{"kind": "solve", "settings": {"gravity": {"magnitude_m_s2": %s}}}'


def test_a_report_that_cannot_be_read_costs_the_list_nothing(shared_live):
    """Oracle: the list, and the one recording's own answer. Mutation: the verdict read without a fallback: 500 for all."""
    recording_id = shared_live.upload("any.bag")
    shared_live.wait(lambda: set(shared_live.job_states(recording_id).values()) == {"done"})
    with shared_live.services._engine.begin() as connection:
        connection.execute(text("UPDATE recordings SET report_json = '{' WHERE id = :id"), {"id": recording_id})
    listed = {recording["id"]: recording for recording in shared_live.http.get("/api/recordings").json()}
    assert (listed[recording_id]["state"], listed[recording_id]["verdict"]) == ("ready", None)
    answer = shared_live.http.get(f"/api/recordings/{recording_id}")
    assert (answer.status_code, answer.json()["error"]["code"]) == (200, "recording.unreadable")
    assert shared_live.http.delete(f"/api/recordings/{recording_id}").status_code == 204


@pytest.mark.parametrize("number", ["1e999", "-1e999", "NaN", "Infinity"])
def test_a_number_that_is_none_is_refused_and_the_list_still_works(shared_live, number):
    """Mutation: models that take infinities keep them as null, and the list of recordings is a 500 from then on."""
    recording_id = shared_live.upload("any.bag")
    bodies = [
        ("POST", f"/api/recordings/{recording_id}/jobs", GUESS),
        ("POST", f"/api/recordings/{recording_id}/jobs", MATRIX),
        ("POST", f"/api/recordings/{recording_id}/jobs", GRAVITY),
        ("PATCH", f"/api/recordings/{recording_id}", '{"range_max_m": %s}'),
        ("PATCH", f"/api/recordings/{recording_id}", '{"start_s": %s}'),
        ("PUT", f"/api/recordings/{recording_id}/view", '{"nudge": {"tx_m": %s}}'),
    ]
    for method, path, body in bodies:
        kind = {"Content-Type": "application/json"}
        answer = shared_live.http.request(method, path, content=(body % number).encode(), headers=kind)
        assert answer.status_code in {405, 422}, (method, path, body)
    assert shared_live.http.get("/api/recordings").status_code == 200


@pytest.mark.parametrize("offset_s", [9.1e9, -9.1e9, 1e300])
def test_a_time_offset_is_bounded_as_in_a_file(shared_live, offset_s):
    """Refused at once with the field's name, and in the API's document; the job failed. Mutations: no bound of a guess; of an old
    extrinsic."""
    recording_id = shared_live.upload("any.bag")
    answer = shared_live.http.post(
        f"/api/recordings/{recording_id}/jobs", json={"kind": "solve", "initial_guess": {"time_offset_s": offset_s}}
    )
    assert (answer.status_code, answer.json()["error"]["details"]["fields"]) == (
        422,
        ["body.initial_guess.time_offset_s"],
    )
    old = {"translation_m": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1], "time_offset_s": offset_s}
    assert shared_live.http.post(f"/api/recordings/{recording_id}/view", json={"old": old}).status_code == 422
    schemas = shared_live.http.get("/api/openapi.json").json()["components"]["schemas"]
    for name in ("InitialGuess", "OldExtrinsic"):
        either, _ = schemas[name]["properties"]["time_offset_s"]["anyOf"]
        assert (either["minimum"], either["maximum"]) == (-9e9, 9e9)


@pytest.mark.parametrize(
    ("model", "fields"),
    [
        (InitialGuess, {"time_offset_s": "%"}),
        (InitialGuess, {"matrix": [["%"]]}),
        (NewJob, {"kind": "solve", "settings": {"gravity": {"magnitude_m_s2": "%"}}}),
        (ChangeRecording, {"end_s": "%"}),
        (ChangeView, {"wipe": "%"}),
        (OldExtrinsic, {"translation_m": ["%", 0, 0], "quaternion_xyzw": [0, 0, 0, 1]}),
        (ReadSettings, {"range_max_m": "%"}),
        (Gravity, {"std_m_s2": "%"}),
        (CalibrateSettings, {"excluded_spans_s": [[0, "%"]]}),
    ],
)
@pytest.mark.parametrize("number", [float("inf"), float("-inf"), float("nan")])
def test_no_model_takes_one(model, fields, number):
    """Mutation: leaving allow_inf_nan out of a base class."""

    def filled(part):
        if isinstance(part, dict):
            return {key: filled(value) for key, value in part.items()}
        return [filled(value) for value in part] if isinstance(part, list) else number if part == "%" else part

    with pytest.raises(ValueError, match="validation error"):
        model.model_validate(filled(fields))


def test_a_data_directory_with_rows_that_cannot_be_read_starts_and_lists_and_heals(tmp_path):
    """As an earlier version left it. Mutation: parsing each row without a fallback is a 500 for everybody, restarts included."""
    with serving(tmp_path) as live:
        whole, read, asked = (live.ready(f"room{k}.bag") for k in range(3))
        live.finish(live.start(asked))
    engine = create_engine(f"sqlite:///{tmp_path / 'unsweep.sqlite'}")
    broken = '{"settings": {"gravity": {"magnitude_m_s2": null}}, "initial_guess": {"time_offset_s": null}}'
    with engine.begin() as connection:
        change = "UPDATE recordings SET read_settings_json = '{\"range_max_m\": null}', created_at = 'no time' WHERE id = :id"
        connection.execute(text(change), {"id": read})
        connection.execute(
            text("UPDATE jobs SET request_json = :it WHERE recording_id = :id"), {"it": broken, "id": asked}
        )
        connection.execute(
            text("UPDATE jobs SET state = 'queued' WHERE recording_id = :id AND kind = 'solve'"), {"id": asked}
        )
        connection.execute(text("UPDATE documents SET content_json = '{' WHERE recording_id = :id"), {"id": asked})
    engine.dispose()
    with serving(tmp_path) as live:
        listed = {recording["id"]: recording for recording in live.http.get("/api/recordings").json()}
        assert (listed[whole]["state"], listed[whole]["error"]) == ("ready", None)
        assert (listed[read]["state"], listed[read]["error"]["code"]) == ("failed", "recording.unreadable")
        live.wait(lambda: live.job_states(asked)["solve"] == "failed")
        jobs = live.http.get(f"/api/recordings/{asked}/jobs").json()
        assert {job["error"]["code"] for job in jobs} == {"job.unreadable"}
        assert live.http.get(f"/api/recordings/{asked}/planes").status_code == 200
        assert live.http.patch(f"/api/recordings/{read}", json={"range_max_m": 100}).json()["state"] == "inspecting"
        assert live.http.delete(f"/api/recordings/{asked}").status_code == 204
