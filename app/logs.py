"""The server's log: a line an event, with the job and the recording it is about. Text for people, JSON for machines."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from datetime import UTC, datetime

_JOB: ContextVar[str] = ContextVar("job", default="")
_RECORDING: ContextVar[str] = ContextVar("recording", default="")


@contextmanager
def about(*, recording_id: str, job_id: str = "") -> Iterator[None]:
    """What is logged inside is about this recording, and this job."""
    recording, job = _RECORDING.set(recording_id), _JOB.set(job_id)
    try:
        yield
    finally:
        _RECORDING.reset(recording)
        _JOB.reset(job)


class LogLine(logging.Formatter):
    """One line: time in UTC, level, sentence, ids; a traceback after it, or in it where lines are JSON."""

    def __init__(self, *, as_json: bool) -> None:
        super().__init__()
        self._as_json = as_json

    def format(self, record: logging.LogRecord) -> str:
        """The line."""
        facts = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "text": record.getMessage(),
        }
        facts |= {name: found for name, found in (("recording", _RECORDING.get()), ("job", _JOB.get())) if found}
        trace = self.formatException(record.exc_info) if record.exc_info else ""
        if self._as_json:
            return json.dumps(facts | ({"traceback": trace} if trace else {}), ensure_ascii=False)
        ids = "".join(f" {name}={facts[name]}" for name in ("recording", "job") if name in facts)
        # What others put into a sentence cannot begin a line of its own.
        text = facts["text"].replace("\r", " ").replace("\n", " ")
        return f"{facts['time']} {facts['level']} {text}{ids}" + (f"\n{trace}" if trace else "")


def log_to_stderr(*, as_json: bool) -> None:
    """Write what the server has to say to stderr."""
    handler = logging.StreamHandler()
    handler.setFormatter(LogLine(as_json=as_json))
    log = logging.getLogger("unsweep")
    log.handlers[:] = [handler]
    log.setLevel(logging.INFO)
    log.propagate = False
