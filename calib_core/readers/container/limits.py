"""How much a container may unpack to. What recorders write stays far below; what is built to fill memory or disk does not."""

from __future__ import annotations

from dataclasses import dataclass

MIB = 1 << 20


@dataclass(frozen=True, slots=True)
class ContainerLimits:
    """Bounds on what comes out of compressed or declared bytes, before it is in memory or on disk."""

    #: Recorders write chunks of 1 to 4 MiB; the largest that users set are near 100 MiB.
    chunk_bytes: int = 256 * MIB
    #: A 128 x 4096 cloud of 48 bytes a point is 25 MB.
    message_bytes: int = 512 * MIB
    #: Larger than any recording of a calibration; what the disk has bounds it further.
    unpacked_bytes: int = 200 * 1024 * MIB
    #: Clouds deflate to a half or a fifth; deflate itself ends at 1032.
    unpacked_ratio: int = 100
    #: Below this a ratio says nothing: a page of zeros deflates to nothing in honest files too.
    unpacked_least_bytes: int = 16 * MIB
    #: A bag folder has a file a minute at most, and a few beside them.
    archive_entries: int = 10_000
    #: A zip's list of its files, and any one header of a tar: names and dates.
    archive_header_bytes: int = 16 * MIB
    #: Lists of files that recorders write beside them, in one archive, and the bytes of one: a line for each file and topic.
    archive_lists: int = 16
    archive_list_bytes: int = 4 * MIB
    #: Share of the free disk that one archive may take.
    disk_share: float = 0.5


LIMITS = ContainerLimits()
