"""The processes of the jobs under way: listened to, held to their time, asked to stop before they are stopped."""

from __future__ import annotations

import threading
from collections.abc import Callable

from app.jobs.launch import Launcher, RunningJob
from app.jobs.orders import Begun, Happened, Order, Parcel


class Processes:
    """By job. Thread-safe. grace_s: how long one that was asked to stop may take to."""

    def __init__(self, launcher: Launcher, *, grace_s: float) -> None:
        self._launcher = launcher
        self._grace_s = grace_s
        self._lock = threading.Lock()
        self._running: dict[str, RunningJob] = {}
        self._overdue: set[str] = set()

    def run(
        self,
        job_id: str,
        order: Order,
        *,
        limit_s: float,
        on_start: Callable[[], None],
        on_parcel: Callable[[Happened], None],
    ) -> Parcel | None:
        """The job's last parcel, once it has ended; None where its process died without a word.

        limit_s: so long after it has begun it is asked to stop.   on_start: it can be stopped from now on; what was asked for
        while it was being started is heeded here.   on_parcel: what it tells on the way, from the caller's thread.
        """
        running = self._launcher.launch(order)
        with self._lock:
            self._running[job_id] = running
        ending: Parcel | None = None
        limit: threading.Timer | None = None
        try:
            on_start()
            for parcel in running.parcels():
                if isinstance(parcel, Begun):
                    limit = self._limited(job_id, limit_s, instead_of=limit)
                elif isinstance(parcel, Happened):
                    on_parcel(parcel)
                else:
                    ending = parcel
        except BaseException:  # no process may outlive its supervisor
            running.terminate()
            for _ in running.parcels():
                pass
            raise
        finally:
            if limit is not None:
                limit.cancel()
        return ending

    def ask_to_stop(self, job_id: str) -> None:
        """Politely, and after the grace less so."""
        running = self.find(job_id)
        if running is not None:
            running.ask_to_stop()
            timer = threading.Timer(self._grace_s, running.terminate)
            timer.daemon = True
            timer.start()

    def terminate(self, job_id: str) -> None:
        """Stop it now."""
        running = self.find(job_id)
        if running is not None:
            running.terminate()

    def terminate_all(self) -> None:
        """Stop them now."""
        with self._lock:
            running = list(self._running.values())
        for job in running:
            job.terminate()

    def is_overdue(self, job_id: str) -> bool:
        """Whether it was stopped because its time was over."""
        return job_id in self._overdue

    def find(self, job_id: str) -> RunningJob | None:
        """The job's process, if it has one."""
        with self._lock:
            return self._running.get(job_id)

    def forget(self, job_id: str) -> None:
        """The job has ended and its ending is kept."""
        with self._lock:
            self._running.pop(job_id, None)
            self._overdue.discard(job_id)

    def _limited(self, job_id: str, limit_s: float, *, instead_of: threading.Timer | None) -> threading.Timer:
        """What stops the job when its time is up.   instead_of: what did so before it was begun anew."""
        if instead_of is not None:
            instead_of.cancel()
        limit = threading.Timer(limit_s, self._stop_overdue, (job_id,))
        limit.daemon = True
        limit.start()
        return limit

    def _stop_overdue(self, job_id: str) -> None:
        self._overdue.add(job_id)
        self.ask_to_stop(job_id)
