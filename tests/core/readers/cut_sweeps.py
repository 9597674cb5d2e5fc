"""Sweeps that come in several messages each."""

from __future__ import annotations

import numpy as np

from tests.core.readers import build

PERIOD_NS = 100_000_000


def cut_up(parts: int, *, lost: frozenset[int] = frozenset(), twice: bool = False) -> list[build.Message]:
    """Forty sweeps, each sent in so many clouds; the parts of these numbers are lost; every seventh is sent twice."""
    messages: list[build.Message] = []
    for k in range(40):
        start_ns = build.EPOCH_NS + k * PERIOD_NS
        sweep = build.sweep(seed=k)
        part = np.floor(sweep["time_s"] / (0.1 / parts)).astype(int)
        for number in range(parts):
            if k * parts + number in lost:
                continue
            begin_s = 0.1 / parts * number
            mine = {name: values[part == number] for name, values in sweep.items()}
            header_ns = start_ns + round(begin_s * 1e9)
            points = build.velodyne_points(mine, -begin_s)
            body = build.pointcloud2(points, cdr=True, stamp_ns=header_ns, frame_id="velodyne")
            sent: build.Message = ("/velodyne_points", "sensor_msgs/msg/PointCloud2", header_ns + 12_000_000, body)
            again = twice and (k * parts + number) % 7 == 3
            messages += [sent, (*sent[:2], sent[2] + 1000, sent[3])] if again else [sent]
    return messages
