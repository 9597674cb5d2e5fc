"""A rotor's wander beside what its stamps jitter: against dense matrices, and drawn."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.full.prepare import rotor_wander
from calib_core.full.prepare.rotor_wander import wander_of
from calib_core.types import FloatArray

TURNS = 600
EVERY = np.arange(TURNS)


def _about_a_line(y: FloatArray) -> FloatArray:
    return np.asarray(y - np.polyval(np.polyfit(EVERY, y, 1), EVERY))


def _host(seed: int) -> FloatArray:
    return np.random.default_rng(seed).exponential(5e-4, TURNS)


def test_the_smoother_and_its_likelihood_are_those_of_dense_matrices() -> None:
    """The restricted likelihood of what no line tells, whose covariance is written out: lambdas differ by as much, and a line.

    Mutations: first differences; turns that were lost counted as measured; log |A| left out, or halved; the exponent N; a line
    without its determinant.
    """
    turns, rng = 14, np.random.default_rng(3)
    there = np.ones(turns)
    there[[4, 9]] = 0.0
    y, n = rng.normal(size=turns) * there, turns - 2
    D = np.diff(np.eye(turns), n=2, axis=0)
    seen = np.flatnonzero(there)
    line = np.stack([np.ones(n), seen], axis=1)
    K = np.linalg.svd(line)[0][:, 2:]
    G = (np.linalg.pinv(D) @ np.linalg.pinv(D).T)[np.ix_(seen, seen)]
    z = K.T @ y[seen]
    told = [(rotor_wander._evenly(y, there), (n - 2) * np.log(z @ z / (n - 2)))]
    for weight in (0.3, 7.0, 400.0):
        x, by_bands = rotor_wander._smoothed(y, there, weight)
        np.testing.assert_allclose(x, np.linalg.solve(np.diag(there) + weight * D.T @ D, there * y), atol=1e-9)
        S = K.T @ (np.eye(n) + G / weight) @ K
        dense = (n - 2) * np.log(z @ np.linalg.solve(S, z) / (n - 2)) + np.linalg.slogdet(S)[1]
        told.append((by_bands, dense))
    by_bands, dense = np.diff(told, axis=0).T
    np.testing.assert_allclose(by_bands, dense, rtol=1e-8)


@pytest.mark.parametrize("wander_s", [2e-4, 1e-3])
def test_what_a_rotor_wanders_by_is_found_where_stamps_follow_it(wander_s: float) -> None:
    """Mutation: the likeliest of the longest two periods only."""
    wander = _about_a_line(wander_s * np.sin(2.0 * np.pi * EVERY / 126.0))
    exact = wander + 8e-6 * np.random.default_rng(0).normal(size=TURNS)
    found = wander_of(EVERY, exact, np.ones(TURNS, bool))
    assert np.std(found - wander) < 8e-6
    late = _about_a_line(1e-3 * np.sin(2.0 * np.pi * EVERY / 126.0)) + _about_a_line(_host(1))
    found = wander_of(EVERY, late, np.ones(TURNS, bool))
    assert np.std(late - found - _about_a_line(_host(1))) < 2e-4, "0.7 ms before"


def test_lost_turns_and_a_hosts_stalls_do_not_lead_it_aside() -> None:
    """Mutations: turns counted by their place; stalls followed."""
    rng = np.random.default_rng(5)
    wander = _about_a_line(5e-4 * np.sin(2.0 * np.pi * EVERY / 126.0))
    stalls = rng.random(TURNS) < 0.03
    kept = (rng.random(TURNS) > 0.1) | (EVERY < 2) | (EVERY > TURNS - 3)
    kept[200:260] = False
    off = wander + 2e-5 * rng.normal(size=TURNS) + np.where(stalls, rng.uniform(5e-3, 2e-2, TURNS), 0.0)
    found = wander_of(EVERY[kept], off[kept], ~stalls[kept])
    assert np.abs(found - wander[kept]).max() < 5e-5


def test_an_hour_is_no_longer_than_digits_reach() -> None:
    """36,000 turns that wander by 20 ms in twenty minutes. Mutation: periods of eight hours, which leave no digit."""
    turns = np.arange(36_000)
    wander = 0.02 * np.sin(2.0 * np.pi * turns / 12_000.0)
    off = wander + 5e-5 * np.random.default_rng(2).normal(size=len(turns))
    off -= np.polyval(np.polyfit(turns, off, 1), turns)
    found = wander_of(turns, off, np.ones(len(turns), bool))
    assert np.std(off - found) == pytest.approx(5e-5, rel=0.05)


@pytest.mark.parametrize("pause", [3000, 864_000])
def test_a_pause_is_gone_over(pause: int) -> None:
    """Of five minutes or a day, between fifteen seconds each. Mutation: every turn of it counted (no digit is left of a day)."""
    turns = np.concatenate([np.arange(150), np.arange(150) + 150 + pause])
    noise = 5e-6 * np.random.default_rng(1).normal(size=len(turns))
    wander = 3e-4 * np.sin(2.0 * np.pi * turns / 100.0)
    for drawn in (noise, wander + noise):
        off = drawn - np.polyval(np.polyfit(turns, drawn, 1), turns)
        found = wander_of(turns, off, np.ones(len(turns), bool))
        assert np.std(off - found) < 6e-6
    assert found.any()


def test_what_a_host_is_late_by_anew_each_time_is_no_wander() -> None:
    """Of 60 draws none: by chance one in a thousand would be. Mutation: whatever is likelier at all."""
    assert not any(wander_of(EVERY, _about_a_line(_host(seed)), np.ones(TURNS, bool)).any() for seed in range(60))
