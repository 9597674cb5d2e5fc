"""ROS 2 bags by their index, through rosbags, bounded where a chunk unpacks."""

from __future__ import annotations

from rosbags.rosbag2 import Reader, storage_mcap

from calib_core.readers.container.compression import bounded_lz4, bounded_zstd

__all__ = ["Reader"]

# rosbags unpacks a chunk whole, however large it comes out, and has no setting for it.
storage_mcap.DECOMPRESSORS.update(lz4=bounded_lz4, zstd=bounded_zstd)
