"""One job for each scan of a view, or for every few of them, on several threads where allowed; results in the scans' order."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

from calib_core.full.joint.settings import SURVEYING
from calib_core.full.joint.view import View
from calib_core.threads import workers

T = TypeVar("T")
#: Told how many of the scans are done.
OnScans = Callable[[int], None]


def ignore(_: int) -> None:
    """For callers who do not ask how far it is."""


def over_scans(view: View, positions: Sequence[int], job: Callable[[int], T], on_scans: OnScans = ignore) -> list[T]:
    """A job for each scan; results in the order of the positions."""
    return list(_over(view, positions, [[i] for i in positions], lambda batch: job(batch[0]), on_scans))


def over_batches(
    view: View,
    positions: Sequence[int],
    stride: int,
    job: Callable[[Sequence[int]], T],
    on_scans: OnScans = ignore,
    *,
    most: int | None = None,
) -> Iterator[T]:
    """A job for every few scans in a row: of thinned scans, a single one would not be worth the call. Results are handed on one
    by one while the next are at work.

    most: scans in a job; None for as many as hold points for one.
    """
    return _over(view, positions, _batches(view, positions, stride, most), job, on_scans)


def _batches(view: View, positions: Sequence[int], stride: int, most: int | None) -> list[list[int]]:
    batches: list[list[int]] = []
    room = 0
    for i in positions:
        points = int(view.clocks.scan_points[i]) // stride
        if points > room or not batches or len(batches[-1]) == most:
            batches.append([])
            room = SURVEYING.batch_points
        batches[-1].append(i)
        room -= points
    return batches


def _over(
    view: View,
    positions: Sequence[int],
    tasks: Sequence[list[int]],
    job: Callable[[Sequence[int]], T],
    on_scans: OnScans,
) -> Iterator[T]:
    """The jobs' results in order; on_scans is told from the caller's own thread, which may stop it all by raising."""
    view.lay_out(positions)
    several = view.threads > 1 and len(tasks) > 1
    done = 0
    for task, result in zip(tasks, workers().map(job, tasks) if several else map(job, tasks), strict=True):
        yield result
        done += len(task)
        on_scans(done)
