"""What one job may take of the machine, put in force by its process before it reads a byte of the recording.

Memory is RLIMIT_DATA: what the process allocates, not what it maps of files, which a cached recording is shown from.
"""

from __future__ import annotations

import errno
import os
import resource
from contextlib import suppress
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from app.schemas.common import ErrorFacts

#: A job that may have less than this cannot even load its libraries.
LEAST_MEMORY_BYTES = 2**30
_FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
_CGROUP_MEMORY = Path("/sys/fs/cgroup/memory.max")


class JobLimits(BaseModel):
    """Bounds of one job's process."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    memory_bytes: int = Field(gt=0)
    file_bytes: int = Field(gt=0, description="of any one file it writes")


def apply_limits(limits: JobLimits) -> None:
    """Bound this process and what it starts. It leaves no core file: that would hold somebody's recording."""
    for kind, most in (
        (resource.RLIMIT_DATA, limits.memory_bytes),
        (resource.RLIMIT_FSIZE, limits.file_bytes),
        (resource.RLIMIT_CORE, 0),
    ):
        _, hard = resource.getrlimit(kind)
        bound = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(kind, (bound, bound))


def fair_memory_bytes(concurrent_jobs: int) -> int:
    """What each of so many jobs may have of this machine's memory, or of the container's where that is less."""
    machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    with suppress(OSError, ValueError):  # no container, or one without a bound
        machine = min(machine, int(_CGROUP_MEMORY.read_text(encoding="ascii")))
    return max(LEAST_MEMORY_BYTES, machine // concurrent_jobs)


def full_disk(error: OSError) -> ErrorFacts | None:
    """The sentence for a write that found no room; None for any other error."""
    if error.errno not in _FULL:
        return None
    return ErrorFacts(
        code="job.disk_full", text="The disk of the data directory is full: delete recordings, then run the job again."
    )


def out_of_memory(limits: JobLimits | None) -> ErrorFacts:
    """The sentence for an allocation that was refused."""
    most = "memory than there is" if limits is None else f"than the {limits.memory_bytes / 1e9:.1f} GB a job may have"
    text = f"The job needed more {most}: choose a shorter time span, or a larger machine."
    return ErrorFacts(code="job.memory", text=text)
