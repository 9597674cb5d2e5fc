"""Whether a process is there, also one that is nobody's child any more."""

from __future__ import annotations

from pathlib import Path


def is_alive(pid):
    """Whether it runs; one that has ended and waits to be counted does not."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"
