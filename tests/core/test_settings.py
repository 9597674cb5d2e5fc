"""The settings' record: what it says is what is used, before and after it was written down."""

from __future__ import annotations

import pytest

from calib_core.settings import (
    OBEYED_BY_PAPER,
    PAPER_FIELD_OF_VIEW_DEG,
    PAPER_POINTS_PER_PLANE_PER_SCAN,
    USED_AFTER_MOTION,
    USED_AFTER_TRACKING,
    CalibrateSettings,
)


def test_the_published_methods_defaults_stand_in_its_settings() -> None:
    """Seen: 100 points were used, null was in the result's provenance, and those settings read again used all points.

    Mutations: no defaults of the published method; its defaults for the other method, too; before what was asked for.
    """
    published = CalibrateSettings(method="paper")
    used = published.points_per_plane_per_scan, published.field_of_view_deg
    assert used == (PAPER_POINTS_PER_PLANE_PER_SCAN, PAPER_FIELD_OF_VIEW_DEG)
    assert CalibrateSettings.model_validate_json(published.model_dump_json()) == published
    full = CalibrateSettings(method="full")
    assert (full.points_per_plane_per_scan, full.field_of_view_deg) == (None, None)
    every = CalibrateSettings(method="paper", points_per_plane_per_scan=None, field_of_view_deg=60.0)
    assert (every.points_per_plane_per_scan, every.field_of_view_deg) == (None, 60.0)


@pytest.mark.parametrize(
    "listed",
    [OBEYED_BY_PAPER, USED_AFTER_TRACKING, USED_AFTER_MOTION],
    ids=("by_paper", "after_tracking", "after_motion"),
)
def test_what_is_listed_beside_the_settings_is_one_of_them(listed: frozenset[str]) -> None:
    """Mutation: a field renamed in the record alone."""
    assert listed <= set(CalibrateSettings.model_fields)
