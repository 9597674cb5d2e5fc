"""Where an IMU fell silent, against every span and every step looked at one by one."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from calib_core.imu.silence import longest_step_s, spans_silence


def test_spans_share_time_with_a_silence_or_do_not() -> None:
    """Two silences among readings at 200 Hz; spans anywhere, some within one, about one, and from or to its very ends.

    Mutations: spans within a silence passed over; those that touch its end counted; any step a silence.
    """
    stamps_s = np.concatenate([np.arange(0.0, 2.0, 0.005), np.arange(2.7, 4.0, 0.005), np.arange(4.2, 5.0, 0.005)])
    rng = np.random.default_rng(0)
    start_s = np.concatenate([rng.uniform(-0.5, 5.5, 400), [2.7, 2.0, 2.1, stamps_s[399]]])
    end_s = start_s + np.concatenate([rng.exponential(0.3, 400), [0.3, 0.1, 0.2, 0.6]])
    silences = [(a, b) for a, b in pairwise(stamps_s.tolist()) if b - a > 0.1]
    assert len(silences) == 2
    expected = [
        any(a < end and start < b for a, b in silences)
        for start, end in zip(start_s.tolist(), end_s.tolist(), strict=True)
    ]
    np.testing.assert_array_equal(spans_silence(stamps_s, start_s, end_s), expected)
    assert not expected[400]


def test_a_slow_imu_is_not_silent() -> None:
    """At 10 Hz each step is longer than what is a silence at 200 Hz; at 1 kHz a lost packet is none. Mutation: either bound
    alone.
    """
    slow_s = np.arange(0.0, 5.0, 0.1)
    assert not spans_silence(slow_s, slow_s[:-1], slow_s[1:]).any()
    assert longest_step_s(np.arange(0.0, 1.0, 0.001)) > 0.05
    assert longest_step_s(np.arange(1.0)) == np.inf
