"""The white-noise level of moving sensors, against simulated noise of known size."""

import numpy as np
import pytest

from calib_core.gp import high_frequency_noise


def motion(t):
    """People's motion at its quickest: 3 Hz and 5 m/s^2, on gravity."""
    return np.stack([9.8 + 5.0 * np.sin(2.0 * np.pi * 3.0 * t), 2.0 * np.cos(2.0 * np.pi * 1.1 * t)], axis=1)


@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_noise_of_a_moving_sensor(jitter: float):
    """Within the spread of its own estimate, with 30 s at 100 Hz. Mutation: differences not scaled to unit length."""
    rng = np.random.default_rng(15)
    t = (np.arange(3000) + rng.uniform(-jitter, jitter, 3000)) / 100.0
    estimates = [
        high_frequency_noise(t, motion(t) + std * rng.normal(size=(3000, 2))) / std
        for std in (1e-3,) * 10 + (0.1,) * 10
    ]
    # The median's efficiency (0.37) and the differences' correlation leave about 1000 independent values: 3 %.
    assert np.all(np.abs(np.array(estimates) - 1.0) < 0.12)
    assert np.mean(estimates) == pytest.approx(1.0, abs=0.02)


def test_motion_alone_has_next_to_no_noise():
    """3 Hz at 100 Hz leaks less than 1e-4 of its size, jittered stamps included. Mutation: binomial coefficients."""
    t = (np.arange(2000) + np.random.default_rng(16).uniform(-0.2, 0.2, 2000)) / 100.0
    assert np.all(high_frequency_noise(t, motion(t)) < 5e-4)


def test_knocks_and_gaps_do_not_count():
    """1 % of wild readings and a gap of a second change it by a tenth at most.

    Mutation: the mean square in place of the median. One gap is no more than a knock to a median: `test_many_gaps`.
    """
    rng = np.random.default_rng(17)
    t = np.arange(3000) / 100.0
    t[1500:] += 1.0
    y = motion(t) + 0.02 * rng.normal(size=(3000, 2))
    y[rng.choice(3000, 30, replace=False)] += 50.0
    np.testing.assert_allclose(high_frequency_noise(t, y), 0.02, rtol=0.15)


def test_many_gaps():
    """Half a second after every twelfth reading, over which motion bends. Mutation: stretches with a gap kept (34 % more)."""
    t = np.arange(3000) / 100.0 + 0.5 * (np.arange(3000) // 12)
    y = motion(t) + 5e-4 * np.random.default_rng(18).normal(size=(3000, 2))
    np.testing.assert_allclose(high_frequency_noise(t, y), 5e-4, rtol=0.1)


def test_too_few_readings():
    """A sentence instead of an empty median. Mutation: no check."""
    with pytest.raises(ValueError, match="at least 7"):
        high_frequency_noise(np.arange(6) / 100.0, np.zeros((6, 1)))
