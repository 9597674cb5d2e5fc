"""The messages of each job: followed while it runs, on disk beside its results, read back after a restart."""

from __future__ import annotations

import logging
import threading
from pathlib import Path

from pydantic import TypeAdapter

from app.jobs.journal import Journal
from app.schemas.jobs import Job, JobMessage, JobStateEvent
from app.storage.files import DataFolder
from calib_core.events import IterationEvent, LogEvent, StageEvent

_LOG = logging.getLogger("unsweep")

AnyMessage = StageEvent | IterationEvent | LogEvent | JobStateEvent
MESSAGE: TypeAdapter[AnyMessage] = TypeAdapter(JobMessage)


class JobLogs:
    """One journal of JSON texts per job that runs or is watched."""

    def __init__(self, files: DataFolder) -> None:
        self._files = files
        self._lock = threading.Lock()
        self._journals: dict[str, Journal[str]] = {}
        self._unwritten: set[str] = set()  # jobs whose log has a hole, said once

    def write(self, job_id: str, message: AnyMessage) -> None:
        """Add a message to the job's log, in memory and on disk."""
        line = message.model_dump_json()
        path = self._path(job_id)
        journal = self._journal(job_id)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("a", encoding="utf-8") as file:
                file.write(line + "\n")
        except OSError as error:  # on a full disk those who look are told all the same, and the job can end
            if job_id not in self._unwritten:
                self._unwritten.add(job_id)
                _LOG.warning("the log of job %s could not be written: %s", job_id, error.strerror)
        journal.append(line)

    def end(self, job: Job) -> None:
        """Write the final state and let followers come to their end; the log is on disk from now on."""
        self.write(job.id, JobStateEvent(job=job))
        with self._lock:
            journal = self._journals.pop(job.id, None)
        if journal is not None:
            journal.close()

    def journal(self, job_id: str, *, live: bool) -> Journal[str]:
        """The job's journal to follow; that of a job that has ended is read from disk and closed."""
        if live:
            return self._journal(job_id)
        journal = self._read(job_id)
        journal.close()
        return journal

    def iterations(self, job_id: str) -> list[IterationEvent]:
        """The steps of the job's solve so far."""
        with self._lock:
            journal = self._journals.get(job_id)
        entries, _ = (journal or self._read(job_id)).since(0)
        messages = (MESSAGE.validate_json(line) for _, line in entries if '"iteration"' in line[:40])
        return [message for message in messages if isinstance(message, IterationEvent)]

    def close(self) -> None:
        """Let all followers come to their end: the server stops."""
        with self._lock:
            journals = list(self._journals.values())
        for journal in journals:
            journal.close()

    def _journal(self, job_id: str) -> Journal[str]:
        with self._lock:
            if job_id not in self._journals:
                self._journals[job_id] = self._read(job_id)
            return self._journals[job_id]

    def _read(self, job_id: str) -> Journal[str]:
        journal: Journal[str] = Journal()
        path = self._path(job_id)
        if path.is_file():
            # What a crash cut off is no message. Bytes: it may end within a letter, and U+2028 in a name ends a line of text.
            for line in path.read_bytes().split(b"\n")[:-1]:
                journal.append(line.decode("utf-8", "replace"))
        return journal

    def _path(self, job_id: str) -> Path:
        return self._files.job(job_id) / "events.jsonl"
