"""Fixtures for the application's tests."""

from __future__ import annotations

import pytest

from tests.app.support.live import serving


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
