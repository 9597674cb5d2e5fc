"""Windows around scans, and readings asked from them."""

import numpy as np

from calib_core.paper.upsample import HeldReadings, train_scan_windows


def readings(rate=100.0, seconds=4.0):
    rng = np.random.default_rng(30)
    t = (np.arange(int(rate * seconds)) + rng.uniform(-0.2, 0.2, int(rate * seconds))) / rate
    values = np.stack([np.sin((1.0 + 0.3 * c) * t + c) for c in range(6)], axis=1)
    return t, values + 1e-4 * rng.normal(size=values.shape)


def test_window_is_centred_on_its_scan_and_reaches_half_a_period_beyond():
    """Two periods of readings, the scan's in the middle. Mutation: a window that starts at the scan's centre."""
    t, values = readings()
    centre = np.array([0.5, 1.234, 3.0])
    windows = train_scan_windows(t, values, centre, 0.1)
    assert windows.stamps_s.shape == (3, 20)
    assert np.all(np.abs(windows.stamps_s.mean(axis=1) - centre) < 0.01)
    assert np.all(windows.stamps_s[:, 0] < centre - 0.05)
    assert np.all(windows.stamps_s[:, -1] > centre + 0.05)


def test_windows_at_the_ends_are_moved_inwards():
    """Full size at both ends of the recording. Mutation: no clipping of the first reading."""
    t, values = readings()
    windows = train_scan_windows(t, values, np.array([-0.2, 0.01, 3.99, 4.3]), 0.1)
    np.testing.assert_array_equal(windows.stamps_s[0], t[:20])
    np.testing.assert_array_equal(windows.stamps_s[3], t[-20:])


def test_channels_come_back_in_their_places():
    """Gyro first, then accelerometer, close to the signal, with its variance. Mutation: the two halves swapped."""
    t, values = readings()
    windows = train_scan_windows(t, values, np.array([1.0, 2.0]), 0.1)
    scan, when = np.array([1, 0, 1]), np.array([1.97, 1.013, 2.04])
    found = windows.at(scan, when)
    truth = np.stack([np.sin((1.0 + 0.3 * c) * when + c) for c in range(6)], axis=1)
    np.testing.assert_allclose(np.hstack([found.gyro_rad_s, found.accel_m_s2]), truth, atol=5e-4)
    assert np.all(np.sqrt(np.hstack([found.var_gyro, found.var_accel])) < 5e-4)


def test_held_readings_are_the_latest_ones():
    """At a stamp its own reading, until the next stamp. Mutation: side="left"."""
    held = HeldReadings(np.array([0.0, 0.1, 0.2]), np.arange(18.0).reshape(3, 6), np.ones(6))
    found = held.at(np.zeros(4, dtype=np.int64), np.array([-0.5, 0.1, 0.1999, 0.9]))
    np.testing.assert_array_equal(found.gyro_rad_s[:, 0], [0.0, 6.0, 6.0, 12.0])
    np.testing.assert_array_equal(found.accel_m_s2[:, 2], [5.0, 11.0, 11.0, 17.0])
