"""What one job may take of the machine, put in force by its process before it reads a byte of the recording.

Memory is what the process has filled, not what it maps of files, which a cached recording is shown from, and not what was
allocated and never touched, half as much again in an ordinary solve. The system has no bound of that: whoever started the process
looks at it and ends it. RLIMIT_DATA, of all that is allocated, is far beyond, for what would fill the machine between two looks.
"""

from __future__ import annotations

import errno
import os
import resource
from contextlib import suppress
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from app.schemas.common import ErrorFacts
from calib_core.errors import causes_of, is_for_want_of_room

#: A job that may have less than this ends before it has an answer for an ordinary recording.
LEAST_MEMORY_BYTES = 2**30
#: What may be allocated: so many times what may be filled, and this for the program itself.
_ALLOCATED_TIMES, _ALLOCATED_BESIDE_BYTES = 2, 2**30
#: So near to RLIMIT_DATA a process counts as beyond it. A numerical library that is refused one of its buffers, of 32 MB, asks
#: again for ever: before it could be, the process is ended.
_NEAR_BYTES = 2**27
#: What stays in memory whatever the system would like to have back: lines of /proc/PID/status.
_FILLED = frozenset({"RssAnon", "RssShmem"})
_KIB = 1024
#: Of a RuntimeError: there is no memory for its stack.
_NO_THREAD = "can't start new thread"
_CGROUP_MEMORY = Path("/sys/fs/cgroup/memory.max")


class JobLimits(BaseModel):
    """Bounds of one job's process."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    memory_bytes: int = Field(gt=0)
    file_bytes: int = Field(gt=0, description="of any one file it writes")


def apply_limits(limits: JobLimits) -> None:
    """Bound this process and what it starts; its memory, whoever has started it has to watch."""
    bound_allocations(limits.memory_bytes)
    _bound(resource.RLIMIT_FSIZE, limits.file_bytes)


def bound_allocations(memory_bytes: int) -> None:
    """Bound what this process allocates, far beyond what it may fill. It leaves no core file: that would hold a recording."""
    _bound(resource.RLIMIT_DATA, _ALLOCATED_TIMES * memory_bytes + _ALLOCATED_BESIDE_BYTES)
    _bound(resource.RLIMIT_CORE, 0)


def _bound(kind: int, most: int) -> None:
    _, hard = resource.getrlimit(kind)
    bound = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(kind, (bound, bound))


def takes_too_much(pid: int, memory_bytes: int) -> bool:
    """Whether a process has filled more than it may, or is about to be refused what it allocates. Always False where the system
    does not tell: there no bound but RLIMIT_DATA is kept.
    """
    try:
        lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii", errors="replace").splitlines()
        allowed, _ = resource.prlimit(pid, resource.RLIMIT_DATA)
    except (OSError, AttributeError):  # it has just ended, or this is no Linux
        return False
    bytes_of = {name: _KIB * int(words.split()[0]) for name, words in _sizes(lines)}
    if sum(bytes_of.get(name, 0) for name in _FILLED) > memory_bytes:
        return True
    return allowed != resource.RLIM_INFINITY and bytes_of.get("VmData", 0) > allowed - _NEAR_BYTES


def _sizes(lines: list[str]) -> list[tuple[str, str]]:
    """Name and "N kB" of each line that has a size."""
    return [(name, words) for name, _, words in (line.partition(":") for line in lines) if words.endswith(" kB")]


def is_for_want_of_memory(error: BaseException) -> bool:
    """Whether that is what an error comes of, for a process with a bound: it need not be said by MemoryError."""
    return any(
        isinstance(cause, MemoryError)
        or (isinstance(cause, OSError) and cause.errno == errno.ENOMEM)
        or _NO_THREAD in str(cause)
        for cause in causes_of(error)
    )


def fair_memory_bytes(concurrent_jobs: int) -> int:
    """What each of so many jobs may have of this machine's memory, or of the container's where that is less."""
    machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    with suppress(OSError, ValueError):  # no container, or one without a bound
        machine = min(machine, int(_CGROUP_MEMORY.read_text(encoding="ascii")))
    return max(LEAST_MEMORY_BYTES, machine // concurrent_jobs)


def full_disk(error: BaseException) -> ErrorFacts | None:
    """The sentence for a write that found no room; None for any other error."""
    if not is_for_want_of_room(error):
        return None
    return ErrorFacts(
        code="job.disk_full", text="The disk of the data directory is full: delete recordings, then run the job again."
    )


def out_of_memory(limits: JobLimits | None) -> ErrorFacts:
    """The sentence for an allocation that was refused."""
    most = "memory than there is" if limits is None else f"than the {limits.memory_bytes / 1e9:.1f} GB a job may have"
    text = f"The job needed more {most}: choose a shorter time span, or a larger machine."
    return ErrorFacts(code="job.memory", text=text)
