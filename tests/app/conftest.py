"""Fixtures for the application's tests."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.result import Message
from calib_core.settings import CalibrateSettings
from tests.app.support.live import serving
from tests.core.exporters.results import make_result


@pytest.fixture
def live(tmp_path):
    """A server of its own."""
    with serving(tmp_path / "data") as running:
        yield running


@pytest.fixture(scope="module")
def shared_live(tmp_path_factory):
    """One server for a module's tests that do not change its settings."""
    folder = tmp_path_factory.mktemp("shared")
    recordings = folder / "recordings"
    recordings.mkdir()
    with serving(folder / "data", recordings_dir=recordings) as running:
        yield running


@pytest.fixture
def hall(tmp_path):
    """A folder with the documents that the fake calibration of fleets gives (support/fake_fleet.py)."""
    for status in ("calibrated", "weak", "refused"):
        result = make_result(np.eye(3), np.array([0.1, 0.2, 0.3]), 4_000_000, status=status)
        if status == "refused":
            wrong = Message(code="motion.none", level="error", text="It stands still; record motion.")
            result = result.model_copy(update={"messages": [wrong]})
        result.provenance.settings.update(CalibrateSettings().model_dump(mode="json"))
        (tmp_path / f"{status}.document").write_text(result.to_json())
    return tmp_path
