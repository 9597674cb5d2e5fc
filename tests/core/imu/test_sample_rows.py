"""Lines through jittering stamps: which readings are on them, and where they bend, end and go on."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.imu.sampling import study_sampling
from tests.core.imu.instants import (
    EPOCH_NS,
    JITTER_S,
    even_instants,
    in_ns,
    off_line_s,
    readings_at,
    studied,
    uniform_jitter,
)


@pytest.mark.parametrize("kink_s", [60.0, 55.0])
def test_a_drifting_clock_bends_the_line(kink_s: float) -> None:
    """Mutation: a straight line through a clock that runs 40 ppm faster later on (0.6 ms off in the middle)."""
    rng = np.random.default_rng(5)
    t = even_instants(rng, 12000)
    clock = t + 40e-6 * np.maximum(t - kink_s, 0.0)
    sampling = studied(in_ns(clock + uniform_jitter(rng, len(t))), readings_at(t, rng))
    assert np.abs(off_line_s(sampling, clock)).max() < 2.5e-4
    assert sampling.jitter_s == pytest.approx(JITTER_S / np.sqrt(3.0), rel=0.03)


@pytest.mark.parametrize(("step_s", "ppm"), [(0.004, 0.0), (0.0, 500.0)])
def test_a_clock_that_is_set_leaves_the_stamps_around_as_they_are(step_s: float, ppm: float) -> None:
    """A host's clock put forward by 4 ms, or slewed by 6 ms in 12 s, within a row: the stamps are that clock's, and right.

    Mutation: take wandering for jitter (stamps 2 ms off for seconds, where they were wrong by 0.2 ms).
    """
    rng = np.random.default_rng(11)
    t = even_instants(rng, 6000)
    clock = t + np.where(t > 33.0, step_s, 0.0) + 1e-6 * ppm * np.clip(t - 33.0, 0.0, 12.0)
    wrong = 2e-4 * rng.standard_normal(len(t))
    sampling = studied(in_ns(clock + wrong), readings_at(t, rng))
    assert sampling.is_even
    assert 0.7 < sampling.in_rows < 0.95
    assert np.sqrt(np.mean(off_line_s(sampling, clock) ** 2)) < 0.6 * 2e-4
    assert np.abs(off_line_s(sampling, clock)).max() < 8e-4


def test_late_stamps_are_late_and_change_nothing_else() -> None:
    """One reading in fifty 4 ms late.

    Mutations: give up a row where two readings would be the same sample; let late stamps pull at the line.
    """
    rng = np.random.default_rng(13)
    t = even_instants(rng, 6000)
    stamps = t + 3e-4 * rng.standard_normal(len(t))
    late = stamps + np.where(rng.random(len(t)) < 0.02, 0.004, 0.0)
    sampling = studied(in_ns(late), readings_at(t, rng))
    assert sampling.is_even
    assert np.abs(off_line_s(sampling, t)).max() < 6e-5
    assert sampling.jitter_s == pytest.approx(3e-4, rel=0.05)


@pytest.mark.parametrize("at", [7200, 4800])
def test_a_host_that_stood_still_stamps_all_it_missed_in_no_time(at: int) -> None:
    """For 0.2 s, at 200 Hz; what it missed is stamped every 0.2 ms after that.

    Mutation: hold numbers that were counted through the burst against the line (half a minute is then in no row).
    """
    rng = np.random.default_rng(0)
    t = 0.005 * np.arange(12000)
    stamps = t + 3e-4 * rng.standard_normal(len(t))
    for k in range(at, at + 40):
        stamps[k] = max(stamps[k], t[at + 40] + 2e-4 * (k - at) - 0.007)
    for k in range(1, len(t)):
        stamps[k] = max(stamps[k], stamps[k - 1] + 2e-5)
    sampling = studied(in_ns(stamps), readings_at(t, rng))
    assert sampling.is_even
    assert sampling.in_rows == 1.0
    assert np.abs(off_line_s(sampling, t))[10:].max() < 4e-4
    assert np.median(np.abs(off_line_s(sampling, t))) < 1e-5
    assert sampling.jitter_s == pytest.approx(3e-4, rel=0.05)


def test_stamps_coarser_than_the_period_still_count_right() -> None:
    """400 Hz in whole milliseconds: steps of 2 and 3. Mutation: begin with the median step only."""
    rng = np.random.default_rng(14)
    t = 0.0025 * np.arange(8000)
    sampling = studied(in_ns(np.floor(t * 1e3) * 1e-3), readings_at(t, rng))
    assert sampling.period_s == pytest.approx(0.0025, rel=1e-6)
    assert np.ptp(off_line_s(sampling, t)) < 2e-5


def test_the_clock_goes_on_through_a_gap_unless_it_was_started_anew() -> None:
    """One line where it went on, so that short rows do not tilt; two where it did not.

    Mutations: always one line (4 ms off beside the restart), or never (wandering several times as much).
    """
    rng = np.random.default_rng(6)
    t = even_instants(rng, 1500)
    held = (t < 5.0) | (t > 5.6)
    went_on = np.asarray(t[held])
    sampling = studied(in_ns(went_on + uniform_jitter(rng, len(went_on))), readings_at(went_on, rng))
    assert np.abs(off_line_s(sampling, went_on) - off_line_s(sampling, went_on).mean()).max() < 5e-5
    anew = np.asarray(went_on + np.where(went_on > 5.3, 0.004, 0.0))
    sampling = studied(in_ns(anew + uniform_jitter(rng, len(anew))), readings_at(anew, rng))
    assert sampling.is_even
    assert np.abs(off_line_s(sampling, anew)).max() < 2e-4


@pytest.mark.parametrize("seed", range(6))
def test_jitter_of_a_third_of_a_period_still_counts_right(seed: int) -> None:
    """Steps of 2.4 to 17.6 ms where samples come every 10. Mutations: number the samples by their steps alone; never correct
    the period, which the median step is far from; leave slips as they are.
    """
    rng = np.random.default_rng([9, seed])
    t = even_instants(rng, 20_000, lost=0.02)
    sampling = studied(in_ns(t + rng.uniform(-3.8e-3, 3.8e-3, len(t))), readings_at(t, rng))
    assert sampling.is_even
    assert np.abs(off_line_s(sampling, t)).max() < 4e-4


def test_a_host_that_is_late_at_times_only_has_the_line_of_when_it_is_not() -> None:
    """Seven of ten readings are stamped to a microsecond, the others late by a millisecond in the mean: the mean of all counts,
    as with any law. Mutations: take the mean lateness for wandering (no line); take the three for a host's stalls (0.3 ms off).
    """
    rng = np.random.default_rng(13)
    t = even_instants(rng, 4000)
    late = np.where(rng.random(len(t)) < 0.3, rng.exponential(1e-3, len(t)), 1e-6 * rng.random(len(t)))
    sampling = studied(in_ns(t + late), readings_at(t, rng))
    assert sampling.is_even
    off = off_line_s(sampling, t)
    assert np.ptp(off) < 2e-5
    assert abs(np.mean(off) - np.mean(late)) < 1e-5 < sampling.mean_std_s


def test_stamps_in_no_even_row_are_no_case_for_a_line() -> None:
    """Bundles of three with one stamp each but for nanoseconds; steps that nothing evens out; and too few.

    Mutations: let two readings be the same sample; count by their order what wanders.
    """
    rng = np.random.default_rng(7)
    t = even_instants(rng)
    bundled = np.asarray(t[2::3].repeat(3)[: len(t)] + 1e-6 * (np.arange(len(t) // 3 * 3) % 3)[: len(t)])
    values = readings_at(t[: len(bundled)], rng)
    assert study_sampling(in_ns(bundled), values) is None
    uneven = np.cumsum(rng.uniform(2e-3, 18e-3, len(t)))
    assert study_sampling(in_ns(uneven), readings_at(t, rng)) is None
    assert study_sampling(in_ns(t[:60]), values[:60]) is None


def test_stamps_without_jitter_stay_as_they_are_to_the_nanosecond() -> None:
    """Mutation: call a recording whose stamps are even already changed."""
    rng = np.random.default_rng(8)
    t = even_instants(rng, lost=0.02)
    sampling = studied(in_ns(t), readings_at(t, rng))
    assert np.abs(sampling.even_ns - in_ns(t)).max() <= 1
    assert not sampling.is_even


@pytest.mark.filterwarnings("error")
def test_no_stamps_are_too_strange_to_be_answered() -> None:
    """Rows whose period changes every fifty readings, up to a hundredfold, bursts, gaps at random, and a plain one.

    Fails when samples may change places, or numbers come out that are none.
    """
    answered = 0
    for seed in range(120):
        rng = np.random.default_rng(seed)
        count, period = int(rng.integers(2, 3000)), 10 ** rng.uniform(-3.3, -1.0)
        steps = period * rng.choice(
            [
                np.repeat(10 ** rng.uniform(-1.0, 1.0, count // 50 + 1), 50)[:count],
                np.where(rng.random(count) < 0.1, rng.exponential(20.0, count), 1.0 + 0.1 * rng.standard_normal(count)),
                np.abs(rng.standard_cauchy(count)),
                rng.choice([1e-6, 1.0, 3.0], count),
                1.0 + np.diff(rng.uniform(-0.2, 0.2, count + 1)),
            ]
        )
        stamps = EPOCH_NS + np.cumsum(np.maximum(np.rint(1e9 * np.abs(steps)), 1.0).astype(np.int64))
        sampling = study_sampling(stamps, rng.standard_normal((count, 6)))
        if sampling is not None:
            answered += 1
            assert (np.diff(sampling.even_ns) > 0).all()
            assert np.isfinite([sampling.mean_std_s, sampling.jitter_s]).all()
    assert answered > 5


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("seed", [82, 99, 248])
def test_a_line_is_not_fitted_to_nothing(seed: int) -> None:
    """A period that changes every fifty readings: the line runs between them all, and none is near it.

    Fails (a division by nothing) when a line is fitted to whatever readings are left near the one before.
    """
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1000, 3000))
    steps = 0.01 * np.repeat(10 ** rng.uniform(-1.0, 1.0, count // 50 + 1), 50)[:count]
    assert study_sampling(in_ns(np.cumsum(steps)), rng.standard_normal((count, 6))) is None


def test_readings_between_a_stalling_host_s_gaps_are_on_the_line_too() -> None:
    """One message in a hundred waits for up to 20 ms: what lies between two such waits may be too short to be counted by itself.

    Taken as stamped, these are late by what the host waited. Mutations: such readings in no row; a row of the fewest that keeps
    its late stamps (a hundredth of a second in a hundred readings: the whole row is late); the mean known to a hundredth of a
    millisecond although nobody says where a wait begins.
    """
    for seed in range(4):
        rng = np.random.default_rng(seed)
        true_ns = 5_000_000 * np.arange(3000)
        late_s = rng.exponential(5e-4, 3000) + np.where(rng.random(3000) < 0.01, rng.uniform(0.005, 0.02, 3000), 0.0)
        apart = 20_000 * np.arange(3000)
        stamps_ns = np.maximum.accumulate(true_ns + np.rint((late_s - 5e-4) * 1e9).astype(np.int64) - apart) + apart
        t = true_ns * 1e-9
        values = np.stack([np.sin(3.0 * t), np.cos(2.3 * t)], axis=1) + 1e-3 * rng.normal(size=(3000, 2))
        sampling = study_sampling(stamps_ns, values)
        assert sampling is not None
        assert sampling.is_even
        assert sampling.in_rows == 1.0
        wrong_s = (sampling.even_ns - true_ns) * 1e-9
        assert np.abs(wrong_s).max() < 1e-4
        assert abs(wrong_s.mean()) < 3.0 * sampling.mean_std_s < 1e-4


@pytest.mark.parametrize("jitter_s", [0.006, 0.008, 0.012])
@pytest.mark.parametrize("seed", [3, 7, 11])
def test_stamps_without_a_nearest_sample_are_counted_by_their_order(jitter_s: float, seed: int) -> None:
    """Jitter to both sides by more than half a period of 10 ms, so that stamps change places.

    Mutations: no row at all; the nearest sample for each (jitter 2.9 ms, the line's pace off by readings that took another's).
    """
    rng = np.random.default_rng(seed)
    t = even_instants(rng, 4000)
    stamps = np.sort(t + jitter_s * rng.standard_normal(len(t)))
    sampling = studied(in_ns(stamps), readings_at(t, rng))
    assert sampling.is_even
    assert sampling.in_rows == 1.0
    off = off_line_s(sampling, t)
    # Stamps that changed places are like their neighbours: the mean of 4000 is known as if there were fewer.
    assert sampling.mean_std_s > jitter_s / np.sqrt(len(t)) / 2.0
    assert abs(float(np.mean(off))) < 3.0 * sampling.mean_std_s
    assert float(np.std(off)) < 4.0 * sampling.mean_std_s


def test_readings_taken_when_stamped_stay_there_however_uneven() -> None:
    """A host that polls, by more than half a period off. Mutation: even stamps for all that are counted by their order."""
    rng = np.random.default_rng(5)
    t = np.sort(even_instants(rng, 4000) + 0.007 * rng.standard_normal(4000))
    sampling = studied(in_ns(t), readings_at(t, rng))
    assert sampling.is_as_stamped


def test_a_reading_that_was_lost_is_not_counted_over() -> None:
    """One of 12000, where stamps have no nearest sample. Mutation: one line through both sides (5 ms off, slowly changing)."""
    rng = np.random.default_rng(9)
    t = np.delete(even_instants(rng, 12001), 4000)
    stamps = np.sort(t + 0.006 * rng.standard_normal(len(t)))
    sampling = studied(in_ns(stamps), readings_at(t, rng))
    even = np.flatnonzero(sampling.even_ns != in_ns(stamps))
    assert 0.6 < len(even) / len(t) < 1.0
    assert np.abs(off_line_s(sampling, t)[even]).max() < 1.5e-3
