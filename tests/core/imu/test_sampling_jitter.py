"""What a shaken sensor's readings say of when they were taken: lines and bands whose instants are known."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.imu.sampling import Sampling
from tests.core.imu.instants import JITTER_S, even_instants, in_ns, studied
from tests.core.imu.shaken import LINES, shaken_at


def of_share(seed: int, share: float, lines: tuple[float, ...] = LINES[:5]) -> Sampling:
    """Studied readings of which so much of the stamps' jitter is in the sampling."""
    rng = np.random.default_rng([9, seed])
    t = even_instants(rng, 3000, lost=0.002)
    tau = rng.uniform(-JITTER_S, JITTER_S, len(t)) / 4.0
    return studied(in_ns(t + tau), shaken_at(np.asarray(t + share * tau), rng, lines))


def test_even_sampling_is_told_from_what_shakes_the_sensor() -> None:
    """Seen of a drone: 14 +- 14 % by cubics, readings left at stamps 0.4 ms off, 17 sigmas. Mutation: shaking is not asked."""
    sampling = of_share(1, 0.0)
    assert sampling.is_even
    assert sampling.in_sampling_std < 0.01


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_so_is_how_much_of_the_jitter_is_in_the_sampling(share: float) -> None:
    """Mutation: slopes with the other sign."""
    sampling = of_share(2, share)
    assert not sampling.is_even
    assert abs(sampling.in_sampling - share) < max(4.0 * sampling.in_sampling_std, 0.05)
    assert sampling.in_sampling_std < 0.05


def test_lines_that_are_faster_than_half_the_rate_still_tell_even_sampling_and_nothing_else() -> None:
    """Their slopes seem others than they are: of a sensor that is polled 31 to 51 % of the jitter seem to be in the sampling.

    Mutations: that neighbours are off by slopes of their own is forgotten; a share that is told by shaking, and is not 0, counts.
    """
    for seed in (1, 2, 3, 4, 5, 6):
        assert of_share(seed, 0.0, LINES).is_even
        assert not of_share(seed, 1.0, LINES).is_even


def test_its_standard_deviation_is_that_of_many_recordings() -> None:
    """Chi-square over 60 recordings. Mutation: the sum's own square in the place of the sum of the blocks' squares."""
    told = [of_share(seed, 0.0) for seed in range(60)]
    normal = np.array([each.in_sampling / each.in_sampling_std for each in told])
    # 99.9 % of chi-square with 60 degrees of freedom, over 60.
    assert 0.5 < np.mean(normal**2) < 1.66
    assert abs(normal.mean()) < 4.0 / np.sqrt(60)
