"""What readings say of when they were taken, where stamps jitter: on readings whose instants are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from calib_core.full.run import LineStd
from calib_core.imu.sampling import _spread_runs, study_sampling
from tests.core.imu.instants import (
    JITTER_S,
    NOISE,
    even_instants,
    in_ns,
    off_line_s,
    readings_at,
    studied,
    uniform_jitter,
)


def test_stamps_that_jitter_beside_even_sampling_are_put_on_their_line() -> None:
    """Mutation: number the samples by counting readings (every lost one would shift the rest by a period)."""
    rng = np.random.default_rng(1)
    t = even_instants(rng, lost=0.03)
    sampling = studied(in_ns(t + uniform_jitter(rng, len(t))), readings_at(t, rng))
    assert sampling.is_even
    assert not sampling.is_as_stamped
    assert abs(sampling.in_sampling) < 4.0 * sampling.in_sampling_std < 0.4
    assert sampling.jitter_s == pytest.approx(JITTER_S / np.sqrt(3.0), rel=0.05)
    assert np.abs(off_line_s(sampling, t)).max() < 8e-5


def test_a_sensor_polled_when_its_stamps_say_is_left_alone() -> None:
    """Mutation: take the sign of the regression the other way round."""
    rng = np.random.default_rng(2)
    t = even_instants(rng)
    t = np.asarray(t + uniform_jitter(rng, len(t)))
    sampling = studied(in_ns(t), readings_at(t, rng))
    assert sampling.is_as_stamped
    assert not sampling.is_even
    assert abs(sampling.in_sampling - 1.0) < 4.0 * sampling.in_sampling_std < 0.4


@pytest.mark.parametrize("polled", [False, True])
def test_what_is_not_beyond_doubt_is_taken_as_is_likelier(polled: bool) -> None:
    """Of 15 s of a slow hand, shaken beyond that, which tell the share of the jitter to a fifth: most even samplings are put on
    their line, a third of them beyond doubt, and no sensor that is polled.

    Mutations: what is not beyond doubt is taken as stamped (seen of 1.7 ms at 50 Hz: 5 of its sigmas off, of 7.5 mm, where it is
    0.9 mm off); any share below a half is even.
    """
    found = []
    for seed in range(30):
        rng = np.random.default_rng([21, seed])
        t = even_instants(rng, 1500)
        tau = uniform_jitter(rng, len(t))
        values = readings_at(np.asarray(t + tau) if polled else t, rng, pace=0.6)
        found.append(studied(in_ns(t + tau), values + 0.01 * rng.standard_normal(values.shape)))
    even, surely = (np.mean([getattr(f, name) for f in found]) for name in ("is_even", "is_surely_even"))
    assert even == surely == 0.0 if polled else even > 0.7 and 0.1 < surely < 0.5


def test_where_nothing_moves_nothing_is_decided() -> None:
    """Mutation: a standard deviation that forgets how small the slopes are."""
    rng = np.random.default_rng(3)
    t = even_instants(rng)
    still = NOISE * rng.standard_normal((len(t), 6))
    sampling = studied(in_ns(t + uniform_jitter(rng, len(t))), still)
    assert not sampling.is_even
    assert not sampling.is_as_stamped


def test_all_standard_deviations_are_those_of_many_recordings() -> None:
    """Chi-square over 60 recordings of each kind. Mutations: leave out what neighbours share; mean over all recordings 0; the
    line's slope by the mean of where it moves, or without the root of twelve.
    """
    shares, means, slopes = [], [], []
    for seed in range(60):
        rng = np.random.default_rng([4, seed])
        t = even_instants(rng, 1200, lost=0.01)
        tau = uniform_jitter(rng, len(t))
        sampling = studied(in_ns(t + tau), readings_at(t, rng))
        shares.append(sampling.in_sampling / sampling.in_sampling_std)
        off_s = off_line_s(sampling, t)
        means.append(off_s.mean() / sampling.mean_std_s)
        rate_std_ppm = LineStd.of(0.0, sampling.every_std_s, float(t[-1] - t[0])).rate_std_ppm
        slopes.append(1e6 * np.polyfit(t, off_s, 1)[0] / rate_std_ppm)
    # 99.9 % of chi-square with 60 degrees of freedom, over 60.
    assert 0.5 < np.mean(np.square(slopes)) < 1.66
    assert 0.5 < np.mean(np.square(shares)) < 1.66
    assert 0.5 < np.mean(np.square(means)) < 1.66
    assert abs(np.mean(shares)) < 4.0 / np.sqrt(60)


def test_jitter_that_lasts_leaves_a_mean_that_is_less_sure() -> None:
    """A host that is late for a fifth of a second at a time. Mutation: count every stamp as if it said something new."""
    means = []
    for seed in range(60):
        rng = np.random.default_rng([10, seed])
        t = even_instants(rng)
        tau = np.repeat(rng.uniform(-JITTER_S, JITTER_S, len(t) // 20), 20)
        sampling = studied(in_ns(t + tau), readings_at(t, rng))
        means.append(off_line_s(sampling, t).mean() / sampling.mean_std_s)
    assert 0.5 < np.mean(np.square(means)) < 1.66


@pytest.mark.parametrize("kind", ["asleep between", "uneven pace", "late for a while"])
def test_sampling_that_wanders_below_stamps_that_jitter_is_never_put_on_a_line(kind: str) -> None:
    """A poll that sleeps a period each time; one whose pace swings by 1.5 ms; one that is late by up to a millisecond or two
    for an eighth of a second at a time. Their stamps jitter, too, by less.

    Mutations: ask the readings of their nearest neighbours only; take wandering for jitter (1 ms off where it was 0.2).
    """
    rng = np.random.default_rng(12)
    t = even_instants(rng, 6000)
    if kind == "asleep between":
        t = np.asarray(t + np.cumsum(1e-4 * rng.standard_normal(len(t))))
    elif kind == "uneven pace":
        t = np.asarray(t + 1.5e-3 * np.sin(np.pi * t))
    else:
        fading = np.exp(-1.0 / 12.0)
        t = np.asarray(t + lfilter([8e-4 * np.sqrt(1.0 - fading**2)], [1.0, -fading], rng.standard_normal(len(t))))
    sampling = study_sampling(in_ns(t + 3e-4 * rng.standard_normal(len(t))), readings_at(t, rng))
    assert sampling is None or not sampling.is_even


def test_stamps_that_are_left_keep_their_own_uncertainty() -> None:
    """Motion only where a clock was set and no line is drawn. Mutation: count nothing for readings without a line."""
    rng = np.random.default_rng(18)
    t = even_instants(rng, 6000)
    moving = (t > 31.0) & (t < 35.0)
    values = np.where(moving[:, None], readings_at(t, rng), NOISE * rng.standard_normal((len(t), 6)))
    wrong = 2e-4 * rng.standard_normal(len(t))
    sampling = studied(in_ns(t + np.where(t > 33.0, 0.004, 0.0) + wrong), values)
    assert sampling.in_rows < 0.95
    assert sampling.mean_std_s > 0.9 * 2e-4 / np.sqrt(np.count_nonzero(moving))


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
        sampling = studied(in_ns(np.maximum.accumulate(t + late - place) + place), readings_at(t, rng))
        off_s.append(float(np.mean(off_line_s(sampling, t))))
        within.append(abs(off_s[-1]) < 3.0 * sampling.mean_std_s)
    # Four times what chance makes of the mean: 0.0032 and 0.0023 ms.
    assert abs(np.mean(off_s)) < 4.0 * 5e-4 / np.sqrt(12 * 20 * rate_hz)
    assert all(within)


@pytest.mark.parametrize("law", ["exponential", "half normal", "uniform", "normal"])
def test_how_late_the_mean_stamp_is_of_a_driver_that_waits(law: str) -> None:
    """Oracle: the laws' own means, 1 ms and 0.8; where as many come early as late, nobody is late. Mutations: the median for the
    mean; the other side's reach.
    """
    rng = np.random.default_rng(8)
    t = even_instants(rng, 8000)
    unit = rng.standard_normal(len(t))
    late_s = (
        1e-3
        * {
            "exponential": rng.exponential(size=len(t)),
            "half normal": np.abs(unit),
            "uniform": rng.uniform(-1.0, 1.0, len(t)),
            "normal": unit,
        }[law]
    )
    sampling = studied(in_ns(t + late_s), readings_at(t, rng))
    mean_s = {"exponential": 1e-3, "half normal": 1e-3 * np.sqrt(2.0 / np.pi)}.get(law, 0.0)
    assert sampling.late_s == pytest.approx(mean_s, rel=0.05)


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


def test_a_channel_that_is_stuck_says_nothing() -> None:
    """Constant 9.81 differs from its neighbours' mean by rounding. Mutation: every channel whose spread is not zero."""
    rng = np.random.default_rng(15)
    t = even_instants(rng)
    polled = np.asarray(t + uniform_jitter(rng, len(t)))
    values = readings_at(polled, rng, pace=0.05)
    stuck = np.column_stack([values[:, :5], np.full(len(t), 9.81)])
    seen = studied(in_ns(polled), stuck)
    alone = studied(in_ns(polled), values[:, :5])
    assert (seen.in_sampling, seen.in_sampling_std) == (alone.in_sampling, alone.in_sampling_std)
    dead = studied(in_ns(polled), np.full((len(t), 6), 9.81))
    assert not dead.is_even
    assert not dead.is_as_stamped


@pytest.mark.parametrize("beta", [-1.0, 6.0])
def test_readings_that_fit_neither_are_said_to(beta: float) -> None:
    """Readings taken against their stamps, or far beyond them. Mutation: any share below a half is even, any above is not."""
    rng = np.random.default_rng(16)
    t = even_instants(rng)
    tau = 0.3 * uniform_jitter(rng, len(t))
    sampling = studied(in_ns(t + tau), readings_at(np.asarray(t + beta * tau), rng))
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
        t = even_instants(rng, 6000)
        moving = t > 54.0
        values = np.where(moving[:, None], readings_at(t, rng), NOISE * rng.standard_normal((len(t), 6)))
        sampling = studied(in_ns(t + uniform_jitter(rng, len(t))), values)
        ratios.append(off_line_s(sampling, t)[moving].mean() / sampling.mean_std_s)
    assert 0.5 < np.mean(np.square(ratios)) < 1.66
