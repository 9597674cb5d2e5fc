"""Lines through jittering stamps, and what the readings say of them, on readings whose instants are known."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.imu.sampling import Sampling, study_sampling
from calib_core.types import FloatArray, IntArray

EPOCH_NS = 1_700_000_000_000_000_000
PERIOD_S = 0.01
JITTER_S = 0.001
_NOISE = np.array([1.2e-3] * 3 + [0.012] * 3)


def _instants(rng: np.random.Generator, count: int = 2000, *, lost: float = 0.0) -> FloatArray:
    """True times of an even row, some of them lost."""
    t = 0.0037 + PERIOD_S * np.arange(count)
    return np.asarray(t[rng.random(count) >= lost], dtype=np.float64)


def _values(t: FloatArray, rng: np.random.Generator, pace: float = 1.0) -> FloatArray:
    """Six channels of smooth motion as a hand makes it, and white noise."""
    phase = np.arange(6)
    rate = 2.0 * np.pi * pace * np.array([0.21, 0.37, 0.53, 0.3, 0.45, 0.6])
    size = np.array([0.5, 0.6, 0.7, 1.0, 1.2, 1.4])
    return np.asarray(
        size * np.sin(rate * t[:, None] + phase) + _NOISE * rng.standard_normal((len(t), 6)), dtype=np.float64
    )


def _stamps(t: FloatArray) -> IntArray:
    return EPOCH_NS + np.rint(t * 1e9).astype(np.int64)


def _jitter(rng: np.random.Generator, count: int) -> FloatArray:
    return np.asarray(rng.uniform(-JITTER_S, JITTER_S, count), dtype=np.float64)


def _off_s(sampling: Sampling, t: FloatArray) -> FloatArray:
    """How far the even stamps are from the true times."""
    return np.asarray((sampling.even_ns - _stamps(t)) * 1e-9, dtype=np.float64)


def _known(stamps_ns: IntArray, values: FloatArray) -> Sampling:
    sampling = study_sampling(stamps_ns, values)
    assert sampling is not None
    return sampling


def test_stamps_that_jitter_beside_even_sampling_are_put_on_their_line() -> None:
    """Mutation: number the samples by counting readings (every lost one would shift the rest by a period)."""
    rng = np.random.default_rng(1)
    t = _instants(rng, lost=0.03)
    sampling = _known(_stamps(t + _jitter(rng, len(t))), _values(t, rng))
    assert sampling.is_even
    assert not sampling.is_as_stamped
    assert abs(sampling.in_sampling) < 4.0 * sampling.in_sampling_std < 0.4
    assert sampling.jitter_s == pytest.approx(JITTER_S / np.sqrt(3.0), rel=0.05)
    assert np.abs(_off_s(sampling, t)).max() < 8e-5


def test_a_sensor_polled_when_its_stamps_say_is_left_alone() -> None:
    """Mutation: take the sign of the regression the other way round."""
    rng = np.random.default_rng(2)
    t = _instants(rng)
    t = np.asarray(t + _jitter(rng, len(t)))
    sampling = _known(_stamps(t), _values(t, rng))
    assert sampling.is_as_stamped
    assert not sampling.is_even
    assert abs(sampling.in_sampling - 1.0) < 4.0 * sampling.in_sampling_std < 0.4


def test_where_nothing_moves_nothing_is_decided() -> None:
    """Mutation: a standard deviation that forgets how small the slopes are."""
    rng = np.random.default_rng(3)
    t = _instants(rng)
    still = _NOISE * rng.standard_normal((len(t), 6))
    sampling = _known(_stamps(t + _jitter(rng, len(t))), still)
    assert not sampling.is_even
    assert not sampling.is_as_stamped


def test_both_standard_deviations_are_those_of_many_recordings() -> None:
    """Chi-square over 60 recordings of each kind. Mutations: leave out what neighbours share; mean over all recordings 0."""
    shares, means = [], []
    for seed in range(60):
        rng = np.random.default_rng([4, seed])
        t = _instants(rng, 1200, lost=0.01)
        tau = _jitter(rng, len(t))
        sampling = _known(_stamps(t + tau), _values(t, rng))
        shares.append(sampling.in_sampling / sampling.in_sampling_std)
        means.append(_off_s(sampling, t).mean() / sampling.mean_std_s)
    # 99.9 % of chi-square with 60 degrees of freedom, over 60.
    assert 0.5 < np.mean(np.square(shares)) < 1.66
    assert 0.5 < np.mean(np.square(means)) < 1.66
    assert abs(np.mean(shares)) < 4.0 / np.sqrt(60)


def test_jitter_that_lasts_leaves_a_mean_that_is_less_sure() -> None:
    """A host that is late for a fifth of a second at a time. Mutation: count every stamp as if it said something new."""
    means = []
    for seed in range(60):
        rng = np.random.default_rng([10, seed])
        t = _instants(rng)
        tau = np.repeat(rng.uniform(-JITTER_S, JITTER_S, len(t) // 20), 20)
        sampling = _known(_stamps(t + tau), _values(t, rng))
        means.append(_off_s(sampling, t).mean() / sampling.mean_std_s)
    assert 0.5 < np.mean(np.square(means)) < 1.66


def test_a_drifting_clock_bends_the_line() -> None:
    """Mutation: a straight line through a clock that runs 40 ppm faster later on (0.6 ms off in the middle)."""
    rng = np.random.default_rng(5)
    t = _instants(rng, 12000)
    clock = t + 40e-6 * np.maximum(t - 60.0, 0.0)
    sampling = _known(_stamps(clock + _jitter(rng, len(t))), _values(t, rng))
    assert np.abs(_off_s(sampling, clock)).max() < 2.5e-4
    assert sampling.jitter_s == pytest.approx(JITTER_S / np.sqrt(3.0), rel=0.03)


def test_the_clock_goes_on_through_a_gap_unless_it_was_started_anew() -> None:
    """One line where it went on, so that short rows do not tilt; two where it did not.

    Mutations: always one line (4 ms off beside the restart), or never (wandering several times as much).
    """
    rng = np.random.default_rng(6)
    t = _instants(rng, 1500)
    held = (t < 5.0) | (t > 5.6)
    went_on = np.asarray(t[held])
    sampling = _known(_stamps(went_on + _jitter(rng, len(went_on))), _values(went_on, rng))
    assert np.abs(_off_s(sampling, went_on) - _off_s(sampling, went_on).mean()).max() < 5e-5
    anew = np.asarray(went_on + np.where(went_on > 5.3, 0.004, 0.0))
    sampling = _known(_stamps(anew + _jitter(rng, len(anew))), _values(anew, rng))
    assert sampling.is_even
    assert np.abs(_off_s(sampling, anew)).max() < 2e-4


@pytest.mark.parametrize("seed", range(6))
def test_jitter_of_a_third_of_a_period_still_counts_right(seed: int) -> None:
    """Steps of 2.4 to 17.6 ms where samples come every 10. Mutations: number the samples by their steps alone; never correct
    the period, which the median step is far from; leave slips as they are.
    """
    rng = np.random.default_rng([9, seed])
    t = _instants(rng, 20_000, lost=0.02)
    sampling = _known(_stamps(t + rng.uniform(-3.8e-3, 3.8e-3, len(t))), _values(t, rng))
    assert sampling.is_even
    assert np.abs(_off_s(sampling, t)).max() < 4e-4


def test_stamps_in_no_even_row_are_no_case_for_a_line() -> None:
    """Bundles of three with one stamp each but for nanoseconds; jitter that swaps readings; and too few.

    Mutation: let two readings be the same sample.
    """
    rng = np.random.default_rng(7)
    t = _instants(rng)
    bundled = np.asarray(t[2::3].repeat(3)[: len(t)] + 1e-6 * (np.arange(len(t) // 3 * 3) % 3)[: len(t)])
    values = _values(t[: len(bundled)], rng)
    assert study_sampling(_stamps(bundled), values) is None
    swapped = np.sort(t + rng.uniform(-8e-3, 8e-3, len(t)))
    assert study_sampling(_stamps(swapped), _values(t, rng)) is None
    assert study_sampling(_stamps(t[:60]), values[:60]) is None


def test_stamps_without_jitter_stay_as_they_are_to_the_nanosecond() -> None:
    """Mutation: call a recording whose stamps are even already changed."""
    rng = np.random.default_rng(8)
    t = _instants(rng, lost=0.02)
    sampling = _known(_stamps(t), _values(t, rng))
    assert np.abs(sampling.even_ns - _stamps(t)).max() <= 1
    assert not sampling.is_even
