"""The settings' record: what it says is what is used, before and after it was written down."""

from __future__ import annotations

import json

import pytest
from pydantic import ValidationError

from calib_core.settings import (
    LARGEST_SEED,
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


@pytest.mark.parametrize("seed", [-1, LARGEST_SEED + 1, 2**64, 10**30])
def test_a_seed_is_one_that_every_program_keeps(seed: int) -> None:
    """Oracle: the numbers that a reader which knows floating point alone tells apart.

    Mutations: no limit; one below 0; the largest one itself refused.
    """
    assert CalibrateSettings(random_seed=LARGEST_SEED).random_seed == json.loads(str(LARGEST_SEED), parse_int=float)
    assert float(LARGEST_SEED - 1) != float(LARGEST_SEED)
    assert float(LARGEST_SEED + 1) == float(LARGEST_SEED + 2)
    with pytest.raises(ValidationError, match="random_seed"):
        CalibrateSettings(random_seed=seed)


def test_an_axis_has_one_prior() -> None:
    """Seen: one given ten times over HTTP counted ten times, its error bar a third. Mutation: only different ones refused."""
    tz, ty = ({"axis": axis, "value": 0.1, "std": 0.001} for axis in ("tz", "ty"))
    assert len(CalibrateSettings.model_validate({"priors": [tz, ty]}).priors) == 2
    for other in (tz, {**tz, "value": 0.2}):
        with pytest.raises(ValidationError, match="one prior for each axis, found several for tz"):
            CalibrateSettings.model_validate({"priors": [tz, ty, other]})


@pytest.mark.parametrize("std", [0.0, -1.0, 1e-300, 0.9e-9])
def test_a_prior_is_no_tighter_than_numbers_are(std: float) -> None:
    """Seen: one over the square of 1e-300 was "division by zero", told as a refusal of the recording. Mutation: any above 0."""
    assert CalibrateSettings.model_validate({"priors": [{"axis": "tz", "value": 0.1, "std": 1e-9}]}).priors
    with pytest.raises(ValidationError, match="std"):
        CalibrateSettings.model_validate({"priors": [{"axis": "tz", "value": 0.1, "std": std}]})


@pytest.mark.parametrize("magnitude_m_s2", [-9.0, 0.0, 1.6, 9.0, 10.0, 1e300])
def test_gravity_is_that_of_the_earth(magnitude_m_s2: float) -> None:
    """As the command line has it. Mutations: no limit; its sign no matter."""
    assert CalibrateSettings.model_validate({"gravity": {"magnitude_m_s2": 9.78}}).gravity.magnitude_m_s2 == 9.78
    with pytest.raises(ValidationError, match="magnitude_m_s2"):
        CalibrateSettings.model_validate({"gravity": {"magnitude_m_s2": magnitude_m_s2}})
