"""Threads for what is parallel: made once for the process, never in a loop, and never more than the machine has cores.

Work handed to them must not hand work on: a task that waits for another one's thread could wait for ever.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import lru_cache
from itertools import pairwise

from threadpoolctl import threadpool_limits

#: More threads than this gain nothing: the compiled loops wait for memory.
MOST_THREADS = 4


def usable_cores() -> int:
    """Cores that this process may use, where the system tells; else those that there are."""
    if hasattr(os, "sched_getaffinity"):  # Linux only
        return max(1, len(os.sched_getaffinity(0)))
    return max(1, os.cpu_count() or 1)


def usual_threads() -> int:
    """Threads for a loop over scans."""
    return min(MOST_THREADS, usable_cores())


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Linear algebra on one thread: small matrices by the thousand, of which a second only ever waits for, and one answer.

    SciPy brings a BLAS of its own with its first use. Loaded within, it would be bound by nothing, and the first answer of a
    process another one, by round-off, than all that follow.
    """
    import scipy.linalg  # noqa: F401

    with threadpool_limits(limits=1, user_api="blas"):
        yield


@lru_cache(maxsize=1)
def workers() -> ThreadPoolExecutor:
    """The one pool of the process. A child of a fork gets its own: threads do not survive it."""
    return ThreadPoolExecutor(usual_threads(), thread_name_prefix="calib_core")


def in_parts(count: int, job: Callable[[int, int], object], at_once: int) -> None:
    """The job on rows first..last (exclusive) of so many, in as many parts on any machine; all are done when this returns.

    at_once: rows that the job is given at a time, at most.
    """
    edges = [(count * part) // MOST_THREADS for part in range(MOST_THREADS + 1)]

    def some(first: int, last: int) -> None:
        for begin in range(first, last, at_once):
            job(begin, min(begin + at_once, last))

    for part in [workers().submit(some, first, last) for first, last in pairwise(edges) if first < last]:
        part.result()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=workers.cache_clear)
