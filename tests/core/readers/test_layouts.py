"""Each layout of each driver, written by this test's own packing, read back to exact points and instants."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib_core.readers.load import load
from calib_core.settings import ReadSettings
from tests.core.readers import build
from tests.core.readers.layouts import LAYOUTS

N_SCANS = 55


@pytest.mark.parametrize("container", ["ros1", "ros2"])
@pytest.mark.parametrize("name", LAYOUTS)
def test_layout_reads_back_exactly(name: str, container: str, tmp_path: Path) -> None:
    """Mutation: drop `is_bigendian` in `cloud_dtype`; take Livox's CDR stride as 19; keep the origin in `_returns`."""
    layout = LAYOUTS[name]
    cdr = container == "ros2"
    if layout.cdr_only and not cdr:
        return
    truths = [layout.make(k, cdr) for k in range(N_SCANS)]
    received = [build.EPOCH_NS + (k + 1) * layout.period_ns + 5_000_000 for k in range(N_SCANS)]
    clouds = [(layout.topic, layout.type, at, t.payload) for at, t in zip(received, truths, strict=True)]
    order = ">" if layout.cdr_only else "<"
    messages = build.in_order(clouds, build.still_imu(5.5, cdr=cdr, order=order))
    path = build.write_ros2(tmp_path / "r", messages) if cdr else build.write_ros1(tmp_path / "r.bag", messages)

    loaded = load(path, ReadSettings())

    found = next(f for f in loaded.findings if f.code == "points.time_field")
    assert found.override.split() == [
        "--point-time-field",
        layout.field,
        "--point-time-unit",
        layout.unit,
        "--point-time-reference",
        layout.reference,
    ]
    assert found.confidence > 0.5
    assert loaded.lidar.layout == layout.name
    # Segments of a sweep are put together: as many as last a tenth of a second.
    parts = round(1e8 / layout.period_ns) if layout.period_ns < 4e7 else 1
    sweeps = [truths[first : first + parts] for first in range(0, N_SCANS, parts)]
    assert len(loaded.scans) == len(sweeps)
    assert loaded.imu.stamps_ns.size == 550
    for scan, expected in zip(loaded.scans, sweeps, strict=True):
        points = scan.points
        np.testing.assert_array_equal(points["xyz"], np.concatenate([part.xyz[part.valid] for part in expected]))
        times_ns = np.concatenate([part.times_ns[part.valid] for part in expected])
        error = scan.stamp_ns + points["offset_ns"].astype(np.int64) - times_ns
        assert np.abs(error).max() <= layout.tolerance_ns + 1
        assert points["offset_ns"].min() == 0
        rings = [part.ring[part.valid] for part in expected if part.ring is not None]
        if rings:
            np.testing.assert_array_equal(points["ring"], np.concatenate(rings))
