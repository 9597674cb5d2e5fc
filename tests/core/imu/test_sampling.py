"""Lines through jittering stamps, and what the readings say of them, on readings whose instants are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from calib_core.imu.sampling import Sampling, _spread_runs, study_sampling
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


@pytest.mark.parametrize("kink_s", [60.0, 55.0])
def test_a_drifting_clock_bends_the_line(kink_s: float) -> None:
    """Mutation: a straight line through a clock that runs 40 ppm faster later on (0.6 ms off in the middle)."""
    rng = np.random.default_rng(5)
    t = _instants(rng, 12000)
    clock = t + 40e-6 * np.maximum(t - kink_s, 0.0)
    sampling = _known(_stamps(clock + _jitter(rng, len(t))), _values(t, rng))
    assert np.abs(_off_s(sampling, clock)).max() < 2.5e-4
    assert sampling.jitter_s == pytest.approx(JITTER_S / np.sqrt(3.0), rel=0.03)


@pytest.mark.parametrize(("step_s", "ppm"), [(0.004, 0.0), (0.0, 500.0)])
def test_a_clock_that_is_set_leaves_the_stamps_around_as_they_are(step_s: float, ppm: float) -> None:
    """A host's clock put forward by 4 ms, or slewed by 6 ms in 12 s, within a row: the stamps are that clock's, and right.

    Mutation: take wandering for jitter (stamps 2 ms off for seconds, where they were wrong by 0.2 ms).
    """
    rng = np.random.default_rng(11)
    t = _instants(rng, 6000)
    clock = t + np.where(t > 33.0, step_s, 0.0) + 1e-6 * ppm * np.clip(t - 33.0, 0.0, 12.0)
    wrong = 2e-4 * rng.standard_normal(len(t))
    sampling = _known(_stamps(clock + wrong), _values(t, rng))
    assert sampling.is_even
    assert 0.7 < sampling.in_rows < 0.95
    assert np.sqrt(np.mean(_off_s(sampling, clock) ** 2)) < 0.6 * 2e-4
    assert np.abs(_off_s(sampling, clock)).max() < 8e-4


@pytest.mark.parametrize("kind", ["asleep between", "uneven pace", "late for a while"])
def test_sampling_that_wanders_below_stamps_that_jitter_is_never_put_on_a_line(kind: str) -> None:
    """A poll that sleeps a period each time; one whose pace swings by 1.5 ms; one that is late by up to a millisecond or two
    for an eighth of a second at a time. Their stamps jitter, too, by less.

    Mutations: ask the readings of their nearest neighbours only; take wandering for jitter (1 ms off where it was 0.2).
    """
    rng = np.random.default_rng(12)
    t = _instants(rng, 6000)
    if kind == "asleep between":
        t = np.asarray(t + np.cumsum(1e-4 * rng.standard_normal(len(t))))
    elif kind == "uneven pace":
        t = np.asarray(t + 1.5e-3 * np.sin(np.pi * t))
    else:
        fading = np.exp(-1.0 / 12.0)
        t = np.asarray(t + lfilter([8e-4 * np.sqrt(1.0 - fading**2)], [1.0, -fading], rng.standard_normal(len(t))))
    sampling = study_sampling(_stamps(t + 3e-4 * rng.standard_normal(len(t))), _values(t, rng))
    assert sampling is None or not sampling.is_even


def test_stamps_that_are_left_keep_their_own_uncertainty() -> None:
    """Motion only where a clock was set and no line is drawn. Mutation: count nothing for readings without a line."""
    rng = np.random.default_rng(18)
    t = _instants(rng, 6000)
    moving = (t > 31.0) & (t < 35.0)
    values = np.where(moving[:, None], _values(t, rng), _NOISE * rng.standard_normal((len(t), 6)))
    wrong = 2e-4 * rng.standard_normal(len(t))
    sampling = _known(_stamps(t + np.where(t > 33.0, 0.004, 0.0) + wrong), values)
    assert sampling.in_rows < 0.95
    assert sampling.mean_std_s > 0.9 * 2e-4 / np.sqrt(np.count_nonzero(moving))


def test_late_stamps_are_late_and_change_nothing_else() -> None:
    """One reading in fifty 4 ms late.

    Mutations: give up a row where two readings would be the same sample; let late stamps pull at the line.
    """
    rng = np.random.default_rng(13)
    t = _instants(rng, 6000)
    stamps = t + 3e-4 * rng.standard_normal(len(t))
    late = stamps + np.where(rng.random(len(t)) < 0.02, 0.004, 0.0)
    sampling = _known(_stamps(late), _values(t, rng))
    assert sampling.is_even
    assert np.abs(_off_s(sampling, t)).max() < 6e-5
    assert sampling.jitter_s == pytest.approx(3e-4, rel=0.05)


@pytest.mark.parametrize("rate_hz", [100, 200])
def test_the_tail_of_a_one_sided_law_is_part_of_its_mean_and_a_stall_is_not(rate_hz: int) -> None:
    """Twelve recordings of a host that is late by 0.5 ms in the mean, exponentially, and stalls once in a hundred readings.

    The law's own mean is what a time offset holds. Mutations: leave the lines where they are, without the tail (0.018 ms
    off); count what waited behind a stall (0.03 ms off).
    """
    off_s, within = [], []
    for seed in range(12):
        rng = np.random.default_rng([seed, rate_hz])
        t = 0.0037 + np.arange(20 * rate_hz) / rate_hz
        late = rng.exponential(5e-4, len(t)) - 5e-4
        late += np.where(rng.random(len(t)) < 0.01, rng.uniform(0.005, 0.02, len(t)), 0.0)
        place = 2e-5 * np.arange(len(t))
        sampling = _known(_stamps(np.maximum.accumulate(t + late - place) + place), _values(t, rng))
        off_s.append(float(np.mean(_off_s(sampling, t))))
        within.append(abs(off_s[-1]) < 3.0 * sampling.mean_std_s)
    # Four times what chance makes of the mean: 0.0032 and 0.0023 ms.
    assert abs(np.mean(off_s)) < 4.0 * 5e-4 / np.sqrt(12 * 20 * rate_hz)
    assert all(within)


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
    sampling = _known(_stamps(stamps), _values(t, rng))
    assert sampling.is_even
    assert sampling.in_rows == 1.0
    assert np.abs(_off_s(sampling, t))[10:].max() < 4e-4
    assert np.median(np.abs(_off_s(sampling, t))) < 1e-5
    assert sampling.jitter_s == pytest.approx(3e-4, rel=0.05)


def test_an_hour_is_asked_by_samples_of_it() -> None:
    """Runs of neighbours, from its beginning to its end. Mutations: every n-th reading; the first ones."""
    centre = 7 + np.arange(3_600_000)
    some = _spread_runs(centre)
    assert len(some) == 200_000
    assert (np.diff(some) == 1).mean() > 0.99
    assert some[0] == 7
    assert some[-1] > 3_599_000
    assert (np.diff(some) >= 1).all()
    np.testing.assert_array_equal(_spread_runs(centre[:150_000]), centre[:150_000])


def test_stamps_coarser_than_the_period_still_count_right() -> None:
    """400 Hz in whole milliseconds: steps of 2 and 3. Mutation: begin with the median step only."""
    rng = np.random.default_rng(14)
    t = 0.0025 * np.arange(8000)
    sampling = _known(_stamps(np.floor(t * 1e3) * 1e-3), _values(t, rng))
    assert sampling.period_s == pytest.approx(0.0025, rel=1e-6)
    assert np.ptp(_off_s(sampling, t)) < 2e-5


def test_a_channel_that_is_stuck_says_nothing() -> None:
    """Constant 9.81 differs from its neighbours' mean by rounding. Mutation: every channel whose spread is not zero."""
    rng = np.random.default_rng(15)
    t = _instants(rng)
    polled = np.asarray(t + _jitter(rng, len(t)))
    values = _values(polled, rng, pace=0.05)
    stuck = np.column_stack([values[:, :5], np.full(len(t), 9.81)])
    seen = _known(_stamps(polled), stuck)
    alone = _known(_stamps(polled), values[:, :5])
    assert (seen.in_sampling, seen.in_sampling_std) == (alone.in_sampling, alone.in_sampling_std)
    dead = _known(_stamps(polled), np.full((len(t), 6), 9.81))
    assert not dead.is_even
    assert not dead.is_as_stamped


@pytest.mark.parametrize("beta", [-1.0, 6.0])
def test_readings_that_fit_neither_are_said_to(beta: float) -> None:
    """Readings taken against their stamps, or far beyond them. Mutation: any share below a half is even, any above is not."""
    rng = np.random.default_rng(16)
    t = _instants(rng)
    tau = 0.3 * _jitter(rng, len(t))
    sampling = _known(_stamps(t + tau), _values(np.asarray(t + beta * tau), rng))
    assert sampling.fits_neither
    assert not sampling.is_even
    assert not sampling.is_as_stamped


def test_the_mean_is_as_sure_as_where_it_is_learnt() -> None:
    """Motion in the last tenth only, where the line's end is surer by less than its middle: chi-square over 60 recordings.

    Mutation: the standard deviation of the mean over the whole recording (half of it).
    """
    ratios = []
    for seed in range(60):
        rng = np.random.default_rng([17, seed])
        t = _instants(rng, 6000)
        moving = t > 54.0
        values = np.where(moving[:, None], _values(t, rng), _NOISE * rng.standard_normal((len(t), 6)))
        sampling = _known(_stamps(t + _jitter(rng, len(t))), values)
        ratios.append(_off_s(sampling, t)[moving].mean() / sampling.mean_std_s)
    assert 0.5 < np.mean(np.square(ratios)) < 1.66


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


def test_a_host_that_is_late_at_times_only_has_the_line_of_when_it_is_not() -> None:
    """Seven of ten readings are stamped to a microsecond, the others late by a millisecond in the mean: the mean of all counts,
    as with any law. Mutations: take the mean lateness for wandering (no line); take the three for a host's stalls (0.3 ms off).
    """
    rng = np.random.default_rng(13)
    t = _instants(rng, 4000)
    late = np.where(rng.random(len(t)) < 0.3, rng.exponential(1e-3, len(t)), 1e-6 * rng.random(len(t)))
    sampling = _known(_stamps(t + late), _values(t, rng))
    assert sampling.is_even
    off = _off_s(sampling, t)
    assert np.ptp(off) < 2e-5
    assert abs(np.mean(off) - np.mean(late)) < 1e-5 < sampling.mean_std_s


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
    assert study_sampling(_stamps(np.cumsum(steps)), rng.standard_normal((count, 6))) is None


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
