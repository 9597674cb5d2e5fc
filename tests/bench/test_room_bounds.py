"""What is stated of drawn rigs, held against what is possible."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench import room_bounds
from bench.bound import bound_of
from bench.rigs import draw
from bench.room_bounds import RoomBound, compute
from bench.room_rows import Row
from bench.rooms_report import beside_bare, section
from bench.tables import append_row
from calib_core.simulate.patterns import Spinning

ROW = Row(
    "room", 7, "VLP-16", 0, 0, 20.0, "ideal", "calibrated", "", "", (0.0,) * 7,
    (3e-4, 1e-9, 4e-4, 6e-4, 1e-9, 8e-4, 2e-5), 7.0, 120, 120, 6, 0, 9.0, "abc",
)  # fmt: skip


@pytest.mark.parametrize(("offset_s", "share"), [(2e-5, 100), (1e-5, 0)])
def test_the_largest_of_three_ratios_counts(offset_s: float, share: int) -> None:
    """Stated 0.5 mrad, 1 mm and 0.02 ms beside bounds of 0.4 mrad, 0.8 mm and 0.02 or 0.01 ms: 1.25 times, or twice.

    Mutations: the mean of the three; rows whose bound is not known counted; the ideal sensors' bound.
    """
    bound = RoomBound("room", 7, 12.0, (1e-6, 1e-6, 1e-6), (4e-4, 8e-4, offset_s))
    other = replace(ROW, seed=8)
    text = "\n".join(section("rooms", [ROW, other], {("room", 7): bound}))
    assert f"at most 1.5 in {share} % of 1," in text
    assert "over their bounds" not in "\n".join(section("rooms", [other], {("room", 7): bound}))


def test_a_seed_is_timed_beside_itself_without_clutter() -> None:
    """9 s beside 6 s and 12 s beside 6 s: 1.5 and 2 times; a seed without its twin tells nothing.

    Mutations: mean over mean; seeds paired in the order in which they come.
    """
    bare = [replace(ROW, place="bare", seed=s, solve_s=t) for s, t in ((8, 6.0), (7, 6.0), (6, 1.0))]
    cluttered = [replace(ROW, place="clutter", seed=s, solve_s=t) for s, t in ((7, 9.0), (8, 12.0), (9, 50.0))]
    assert [row.kind for row in (*bare, *cluttered)] == ["bare"] * 3 + ["clutter"] * 3
    text = "\n".join(beside_bare(cluttered, bare))
    assert "2 of these recordings" in text
    assert "1.75 times the processor time on average, 1.75 in the middle, 2.00 at the most" in text
    assert beside_bare(cluttered[2:], bare) == []


def test_a_rigs_bounds_are_those_of_its_recording(tmp_path: Path) -> None:
    """With ideal sensors that of bench/bound, which eliminates without the parameters; unknowns only widen it.

    Mutation: the block of the parameters in place of the calibration's.
    """
    place, _, scenario = draw(502, duration_s=7.0)
    assert isinstance(scenario.lidar.pattern, Spinning)
    thin = replace(scenario.lidar.pattern, column_period_ns=8 * scenario.lidar.pattern.column_period_ns)
    scenario = replace(scenario, lidar=replace(scenario.lidar, pattern=thin))
    found = compute(place, 502, scenario)
    whole = bound_of(scenario, seed=502)
    expected = (np.radians(whole.rotation_deg), 1e-3 * whole.translation_mm, 1e-3 * whole.offset_ms)
    np.testing.assert_allclose(found.ideal, expected, rtol=0.1)
    assert all(wide > ideal for wide, ideal in zip(found.cheap, found.ideal, strict=True))
    append_row(tmp_path / room_bounds.ROWS, found, room_bounds.NORMS)
    np.testing.assert_allclose(room_bounds.read(tmp_path)[place, 502].cheap, found.cheap, rtol=1e-6)
