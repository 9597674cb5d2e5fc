"""Counts in sentences: one plane, two planes."""

from __future__ import annotations


def counted(count: int, one: str, many: str = "") -> str:
    """A number with its noun, and what else has the number. many: where it is not `one` with an s."""
    return f"{count:,} {one if count == 1 else many or f'{one}s'}"
