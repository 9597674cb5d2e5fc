"""Jobs call a recording what its owner calls it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from app.jobs.naming import by_name, document_by_name, events_by_name
from app.jobs.orders import Order
from calib_core.events import LogEvent, StageEvent


def order(name: str, source: str = "/data/recordings/ab12/source.bag") -> Order:
    folder = Path("/data/jobs/cd34")
    return Order(job_id="cd34", kind="inspect", recording_name=name, source=Path(source), cache=folder, folder=folder)


def test_the_kept_name_is_told_as_the_persons():
    """Mutation: the sentence passed on as it is."""
    told = by_name(order("holiday.bag"), "The file source.bag is no readable recording; source.bag is kept.")
    assert told == "The file holiday.bag is no readable recording; holiday.bag is kept."


@pytest.mark.parametrize("text", ["/other/place/source.bag", "my-source.bag", "source.bagged"])
def test_foreign_paths_and_longer_names_stay(text):
    """Mutation: a plain str.replace."""
    assert by_name(order("holiday.bag"), text) == text


def test_where_the_server_keeps_things_is_not_told():
    """Mutation: the path left in the sentence, for whoever looks at the recording."""
    text = "Cannot open /data/recordings/ab12/source.bag nor /data/recordings/ab12/1-2/a.bag nor /data/jobs/cd34/x.json"
    assert by_name(order("holiday.bag"), text) == "Cannot open holiday.bag nor 1-2/a.bag nor x.json"


def test_a_name_with_odd_signs_leaves_a_document_readable():
    """Mutations: the name put into JSON as it is; a backslash in it taken for a group of the pattern."""
    name = 'a "b" \\1 ü.bag'
    document = json.dumps({"file": "source.bag", "text": ["opening source.bag", 1.5e-05]}, indent=2)
    told = document_by_name(order(name), document)
    assert json.loads(told) == {"file": name, "text": [f"opening {name}", 1.5e-05]}
    assert "1.5e-05" in told


def test_events_are_told_by_name_too():
    """Mutation: log events left out."""
    seen = []
    tell = events_by_name(order("holiday.bag"), seen.append)
    tell(StageEvent(stage="read", fraction=0.0, text="opening source.bag"))
    tell(LogEvent(level="warning", code="x", text="source.bag is cut"))
    assert [event.text for event in seen] == ["opening holiday.bag", "holiday.bag is cut"]
