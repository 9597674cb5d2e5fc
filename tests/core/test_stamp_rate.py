"""The rate of a row of stamps, against rows whose rate is known."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.stamp_rate import rate_hz, usual_step_ns

STEP_NS = 10_000_000


def row(count: int = 2000) -> np.ndarray:
    return 1_700_000_000_000_000_000 + STEP_NS * np.arange(count, dtype=np.int64)


@pytest.mark.parametrize("seed", range(5))
def test_jitter_and_losses_do_not_change_the_rate(seed: int) -> None:
    """To a few of what a single sample of 2000 is counted wrong by: a stamp that is late beside a gap. Mutations: the median step
    (off by 2e-3), the mean one (off by the losses); steps of one sample.
    """
    rng = np.random.default_rng(seed)
    late = rng.exponential(5e5, 2000) + np.where(rng.random(2000) < 0.01, rng.uniform(0.0, 8e6, 2000), 0.0)
    stamps = np.sort(row() + late.astype(np.int64))
    lost = np.delete(stamps, [*rng.integers(1, 1999, 20), *range(700, 760)])
    for given in (stamps, lost):
        assert rate_hz(given) == pytest.approx(100.0, rel=3e-4)


def test_exact_rows_are_exact_and_few_stamps_tell_what_they_can() -> None:
    """Mutation: a step of ten samples asked of fewer."""
    assert usual_step_ns(row()) == STEP_NS
    assert usual_step_ns(row(3)) == STEP_NS
    assert [rate_hz(row(count)) for count in (0, 1)] == [0.0, 0.0]


def test_stamps_in_bundles_keep_their_median_step() -> None:
    """A driver that empties a buffer: five at once, a millisecond apart. Mutation: the wait between two of
    them taken for steps of many."""
    stamps = (row(400)[:, None] + np.arange(400)[:, None] * 4 * STEP_NS + np.arange(5) * 1_000_000).ravel()
    assert usual_step_ns(stamps) == 1_000_000
