"""The recording's scans with all their points, decoded again one by one as they are asked for.

What the doctor holds are samples: a minute of whole clouds would fill the memory. The planes that a person is shown are those
of whole scans, wherever they are shown, and their search looks at some dozens: the doctor lets it look at the same ones.
"""

from __future__ import annotations

import itertools
from bisect import bisect_left
from collections.abc import Iterator, Sequence

import numpy as np

from calib_core.doctor.examination import Examination
from calib_core.doctor.sampling import SampledScans
from calib_core.readers.container.opening import OpenRecording
from calib_core.readers.container.wire import MalformedMessage
from calib_core.readers.scans import make_scan
from calib_core.readers.sweep_assembly import Gathering
from calib_core.settings import ReadSettings
from calib_core.types import POINT_DTYPE, KeptScans, Scan

#: Messages up to which reading on is sooner done than beginning anew: a scan is gathered of so many at the most.
_READ_ON = 150
_NOWHERE = -_READ_ON - 1


class WholeScans(KeptScans):
    """Scans as reading the whole recording gives them: first those that were sampled, at the same places, then the rest.

    Neighbours asked for in their order are read in one go. Not for several threads.
    """

    def __init__(
        self, state: Examination, sampled: SampledScans, recording: OpenRecording, settings: ReadSettings
    ) -> None:
        assert state.lidar_topic is not None
        assert state.decoder is not None
        assert state.timing is not None
        self._topic, self._decoder, self._timing = state.lidar_topic.name, state.decoder, state.timing
        self._recording, self._settings = recording, settings
        self._lasting_ns = 0 if state.gathering is None else state.gathering.lasting_ns
        self._positions, self._receive_ns = state.positions, state.receive_ns
        known = [scan.index for scan in sampled.scans]
        self._firsts = [*known, *_later(state.positions, state.header_ns, known, self._lasting_ns)]
        self._coming: Iterator[Scan] = iter(())
        self._at = _NOWHERE

    def __len__(self) -> int:
        return len(self._firsts)

    def scan_at(self, place: int) -> Scan:
        """The scan at a place from 0 on; without a point where none is left of it."""
        first = self._firsts[place]
        if not 0 < first - self._at <= _READ_ON:
            self._coming = self._from(first)
        scan = next((scan for scan in self._coming if scan.index >= first), None)
        self._at = _NOWHERE if scan is None else scan.index
        return scan if scan is not None and scan.index == first else Scan(first, 0, np.zeros(0, POINT_DTYPE))

    def _from(self, position: int) -> Iterator[Scan]:
        """The scans that begin at this message and after it."""
        received_ns = self._receive_ns[bisect_left(self._positions, position)]
        same = bisect_left(self._receive_ns, received_ns)  # of several that came at one instant
        before = bisect_left(self._positions, position) - same
        gathering = Gathering(self._lasting_ns) if self._lasting_ns else None
        messages = self._recording.messages((self._topic,), start_ns=received_ns)
        for message in itertools.islice(messages, before, None):
            try:
                cloud = self._decoder(message)
                scan, _ = make_scan(
                    cloud, position, self._timing, self._settings.range_min_m, self._settings.range_max_m
                )
            except (MalformedMessage, ValueError, KeyError):
                continue
            position += 1
            if gathering is not None and scan is not None:
                scan = gathering.add(scan)
            if scan is not None:
                yield scan
        if gathering is not None and (rest := gathering.rest()) is not None:
            yield rest


def _later(positions: Sequence[int], header_ns: Sequence[int], known: Sequence[int], lasting_ns: int) -> list[int]:
    """Messages with which later scans begin, in the order of their stamps.

    positions, header_ns: of all clouds.   known: messages with which the sampled scans begin.   lasting_ns: of a scan that is
    gathered from several clouds, 0 where each cloud is one.
    """
    stamp_ns = dict(zip(positions, header_ns, strict=True))
    last = max(known, default=-1)
    first_ns = stamp_ns.get(last, 0)
    found: list[int] = []
    for position in sorted((p for p in positions if p > last), key=stamp_ns.__getitem__):
        if stamp_ns[position] == first_ns or 0 <= stamp_ns[position] - first_ns < lasting_ns:
            continue
        first_ns = stamp_ns[position]
        found.append(position)
    return found
