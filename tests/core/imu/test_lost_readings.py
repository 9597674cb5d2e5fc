"""Readings that were lost, and what their neighbours tell of them: beside those that are known to have been there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from calib_core.gp.regression import Hyper
from calib_core.imu.lost_readings import Restored, restored
from calib_core.imu.preintegration import NoiseDensity, upsample
from calib_core.types import BoolArray, FloatArray, ImuData
from tests.core.imu.instants import NOISE, even_instants, in_ns, readings_at
from tests.core.imu.shaken import shaken_at


def _imu(t: FloatArray, values: FloatArray) -> ImuData:
    return ImuData(in_ns(t), values[:, :3], values[:, 3:])


def _without(imu: ImuData, lost: BoolArray) -> ImuData:
    kept = ~lost
    return replace(imu, stamps_ns=imu.stamps_ns[kept], gyro_rad_s=imu.gyro_rad_s[kept], accel_m_s2=imu.accel_m_s2[kept])


def _restored(imu: ImuData, lost: BoolArray) -> Restored:
    found = restored(_without(imu, lost))
    assert found is not None
    return found


def _lost_in_rows(rng: np.random.Generator, count: int, most: int) -> BoolArray:
    lost = np.zeros(count, np.bool_)
    for at in range(60, count - 60, 47):
        lost[at : at + int(rng.integers(1, most + 1))] = True
    return lost


def rumbling_at(t: FloatArray, rng: np.random.Generator) -> FloatArray:
    """(N, 6) a hand's motion on a road, a band of 10 to 20 Hz of thirty times the noise."""
    band = sosfilt(butter(2, [0.2, 0.4], "bandpass", output="sos"), rng.standard_normal((len(t), 6)), axis=0)
    return np.asarray(readings_at(t, rng) + 30.0 * NOISE * band / band.std(axis=0))


@pytest.mark.parametrize("moved", [readings_at, shaken_at, rumbling_at])
def test_what_was_lost_is_told_as_well_as_is_said(
    moved: Callable[[FloatArray, np.random.Generator], FloatArray],
) -> None:
    """Of a hand's motion, of one with an engine of a hundred times the noise on it, and on a road; up to three in a row, some
    near others.

    Mutations: those missing in a row taken one by one, as if the others were zero; the variance of one for all; an instant late.
    """
    rng = np.random.default_rng(3)
    t = even_instants(rng, 6000)
    values = moved(t, rng)
    imu, lost = _imu(t, values), _lost_in_rows(rng, len(t), 3)
    lost[[100, 103, 107]] = True
    found = _restored(imu, lost)
    assert np.array_equal(found.imu.stamps_ns, imu.stamps_ns)
    assert np.array_equal(found.index, np.flatnonzero(lost))
    error = np.hstack([found.imu.gyro_rad_s, found.imu.accel_m_s2])[lost] - values[lost]
    for n in (1, 2, 3):
        mine = found.run == n
        share = np.mean(error[mine] ** 2 / found.variance[mine])
        # Three standard deviations of a mean of so many squares, and a tenth for what a hundred trials know of their size.
        assert abs(share - 1.0) < 3.0 * np.sqrt(2.0 / error[mine].size) + 0.1
    if moved is not rumbling_at:  # an engine's lines are known to a few times the noise, a hundredth of what they are
        assert np.all(found.variance[found.run == 1] < 9.0 * NOISE**2)


def test_rows_end_where_too_many_are_missing_and_nothing_is_told_beside_their_ends() -> None:
    """Mutations: four in a row restored; those beside an end told by zeros beyond it."""
    rng = np.random.default_rng(4)
    t = even_instants(rng, 3000)
    imu, lost = _imu(t, shaken_at(t, rng)), np.zeros(len(t), np.bool_)
    lost[[5, 500, 1490, 1513, 2990]] = True
    lost[1500:1504] = True
    found = _restored(imu, lost)
    assert np.array_equal(found.imu.stamps_ns[found.index], imu.stamps_ns[[500]])
    assert len(found.imu.stamps_ns) == len(t) - lost.sum() + 1


def test_nothing_is_restored_where_nothing_is_missing_or_nobody_knows_what() -> None:
    """Mutations: stamps that jitter counted, too; tried nowhere."""
    rng = np.random.default_rng(5)
    t = even_instants(rng, 12000)
    imu = _imu(t, shaken_at(t, rng))
    assert restored(imu) is None
    lost = _lost_in_rows(rng, len(t), 1)
    jitter_ns = rng.integers(-700_000, 700_000, len(t))
    assert restored(_without(replace(imu, stamps_ns=imu.stamps_ns + jitter_ns), lost)) is None
    assert restored(_without(imu, np.arange(len(t)) >= 200)) is None
    often = (
        np.arange(len(t)) % 34 == 0
    )  # so often that one is left between two that is whole, and two were lost nowhere else
    often[68 * 34 + 1] = True
    assert restored(_without(imu, often)) is None


def test_a_channel_that_stands_still_goes_on_standing_still() -> None:
    """As of a turntable without noise. Mutation: a filter of nothing, which is no number."""
    rng = np.random.default_rng(6)
    t = even_instants(rng, 2000)
    values = shaken_at(t, rng)
    values[:, 1], values[:, 4] = 0.0, 0.25
    lost = _lost_in_rows(rng, len(t), 2)
    found = _restored(_imu(t, values), lost)
    assert np.array_equal(found.imu.gyro_rad_s[:, 1], values[:, 1])
    assert np.allclose(found.imu.accel_m_s2[:, 1], 0.25, rtol=1e-12)
    assert np.isfinite(found.imu.gyro_rad_s).all()


def test_links_are_as_much_looser_as_restored_readings_are_further_off() -> None:
    """A reading's error counts for a period: of density D, D h is the variance of a link's integral. Two in a row, off alike, are
    off by twice as much together.

    Mutations: the noise that every reading has counted once more; each of two by itself; on the link after.
    """
    t = np.arange(2000) * 0.01
    hyper = Hyper(np.full(6, 0.2), np.ones(6), NOISE)
    up = upsample(t, np.zeros((len(t), 3)), np.zeros((len(t), 3)), np.arange(0.0, 19.0, 0.02), hyper)
    size = (NOISE * np.arange(1.0, 7.0)) ** 2
    variance = 2.0 * NOISE**2 + size * np.array([[1.0], [4.0], [4.0]])
    of = Restored(_imu(t, np.zeros((len(t), 6))), np.array([501, 801, 802]), variance, np.array([1, 2, 2]))
    density = NoiseDensity(NOISE[:3] * 0.1, NOISE[3:] * 0.1)  # at a hundred readings a second
    more = of.allowed_for(up, t, density).excess_density2 - up.excess_density2
    assert np.allclose(more[250] * 0.02, size * 0.01**2, atol=0.0)
    assert np.allclose((more[400] + more[401]) * 0.02, 4.0 * size * (2 * 0.01) ** 2, atol=0.0)
    assert np.count_nonzero(more.any(axis=1)) == 3
