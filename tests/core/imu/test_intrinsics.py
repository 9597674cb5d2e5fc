"""An IMU's own scale, axes and delay: readings made by the formula, taken apart again, and their Jacobians differenced."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.gp.regression import Hyper
from calib_core.imu.intrinsics import COLUMNS, ImuIntrinsics, bends, bias_equivalents, corrected
from calib_core.imu.preintegration import NoiseDensity, UpsampledImu, asked_later, preintegrate, upsample
from calib_core.types import FloatArray

LINKS, H_S = 5, 0.01
#: Where a link is integrated: two Gauss points in each of two halves.
GAUSS = 0.25 * np.array([1 - 3**-0.5, 1 + 3**-0.5, 3 - 3**-0.5, 3 + 3**-0.5])
DENSITY = NoiseDensity(np.full(3, 1e-3), np.full(3, 1e-2))
WRONG = ImuIntrinsics(
    gyro_scale=np.array([0.01, -0.02, 0.015]),
    gyro_axes=np.array([0.004, -0.007, 0.006]),
    gyro_rotation=np.array([0.02, -0.01, 0.03]),
    accel_scale=np.array([-0.01, 0.005, 0.02]),
    accel_axes=np.array([0.003, 0.008, -0.005]),
    accel_delay_s=0.0,
    accel_quadratic=np.array([2e-3, -1e-3, 3e-3]),
    g_sensitivity=np.array([2e-3, -1e-3, 5e-4, -1.5e-3, 1e-3, 2.5e-3, -5e-4, 3e-3, -2e-3]),
    size_effect=np.array([0.03, -0.02, 0.01, 0.015, 0.02, -0.025, -0.01, 0.02, 0.03]),
)
EVERY = np.arange(COLUMNS)
#: Two poles of this make of exp(i w t) 1 / (1 + i w T)^2 of it, and delay slow motion by 2 T: 5 ms, half is gone at 32 Hz.
POLE_S = 0.005
SPREAD_S2, SKEW_S3 = 2.0 * POLE_S**2, 4.0 * POLE_S**3


def _vector(values: FloatArray) -> ImuIntrinsics:
    return ImuIntrinsics(
        values[:3],
        values[3:6],
        values[6:9],
        values[9:12],
        values[12:15],
        float(values[15]),
        values[16:19],
        values[19:28],
        values[28:37],
        values[37:39],
        values[39:],
    )


def _readings(seed: int) -> UpsampledImu:
    """Changing by little within each link, so that a link's mean is all but the whole truth of it; steadily, so that differences
    are slopes."""
    rng = np.random.default_rng(seed)
    knots_s = H_S * np.arange(LINKS + 1)
    at_s = knots_s[:-1, None] + H_S * GAUSS
    w, dw, f, df = rng.normal(size=(4, 3))
    return UpsampledImu(
        knots_s, H_S, w + at_s[..., None] * dw, 9.0 + f + at_s[..., None] * df, w + knots_s[:, None] * dw,
        9.0 + f + knots_s[:, None] * df, np.zeros((LINKS, 6)), np.ones(LINKS, bool),
    )  # fmt: skip


@pytest.mark.parametrize("absent", ["g_sensitivity", "size_effect"])
def test_a_reading_made_by_the_formula_is_taken_apart_again(absent: str) -> None:
    """Not both of these at once: what the gyroscope feels of forces is taken out of its slope as it is read.

    Mutations: the gyroscope's rotation from the other side, an upper triangle, the inverse forgotten, forces felt by
    columns, or as they are read; the places of accelerometers by columns, their turn ever faster left out."""
    true, wrong = _readings(0), replace(WRONG, **{absent: np.zeros(9)}, accel_quadratic=np.zeros(3))
    slope = (true.knot_gyro[1] - true.knot_gyro[0]) / H_S
    np.testing.assert_allclose(true.gyro[-1, -1], true.knot_gyro[0] + (true.gauss_s[-1, -1] - true.knots_s[0]) * slope)
    places = np.reshape(wrong.size_effect, (3, 3))

    def beside(w: FloatArray) -> FloatArray:
        felt = [np.cross(slope, r) + np.cross(w, np.cross(w, r)) for r in places]
        return np.stack([felt[axis][..., axis] for axis in range(3)], axis=-1)

    turn = Rotation.from_rotvec(WRONG.gyro_rotation).as_matrix()
    lower_g = np.array([[1.01, 0, 0], [0.004, 0.98, 0], [-0.007, 0.006, 1.015]])
    lower_a = np.array([[0.99, 0, 0], [0.003, 1.005, 0], [0.008, -0.005, 1.02]])
    felt = np.array([[2e-3, -1e-3, 5e-4], [-1.5e-3, 1e-3, 2.5e-3], [-5e-4, 3e-3, -2e-3]]) * wrong.g_sensitivity.any()
    gyro = true.gyro @ (lower_g @ turn).T + true.accel @ felt.T
    knot_gyro = true.knot_gyro @ (lower_g @ turn).T + true.knot_accel @ felt.T
    read = UpsampledImu(
        true.knots_s, H_S, gyro, (true.accel + beside(true.gyro)) @ lower_a.T, knot_gyro,
        (true.knot_accel + beside(true.knot_gyro)) @ lower_a.T, true.excess_density2, true.linked,
    )  # fmt: skip
    back = corrected(read, wrong)
    for name in ("gyro", "accel", "knot_gyro", "knot_accel"):
        np.testing.assert_allclose(getattr(back, name), getattr(true, name), atol=1e-12)


def test_a_line_that_bends_is_straightened() -> None:
    """To first order: what is left is twice the bend of what it bends. Mutations: its sign; squared before the axes are turned
    back; the gyroscope's.
    """
    true, bend = _readings(2), np.array([2e-4, -1e-4, 3e-4])
    accel, knot_accel = (a + bend * a**2 for a in (true.accel, true.knot_accel))
    wrong = replace(_vector(np.zeros(COLUMNS)), accel_quadratic=bend, accel_axes=WRONG.accel_axes)
    lower = np.array([[1, 0, 0], [0.003, 1, 0], [0.008, -0.005, 1]])
    back = corrected(replace(true, accel=accel @ lower.T, knot_accel=knot_accel @ lower.T), wrong)
    for name in ("accel", "knot_accel"):
        straight = getattr(true, name)
        assert (np.abs(getattr(back, name) - straight) < 2.1 * bend**2 * np.abs(straight) ** 3).all()
    np.testing.assert_allclose(back.gyro, true.gyro)


@pytest.mark.parametrize("column", [k for k in range(37) if k != 15])
def test_a_changed_parameter_is_a_bias_to_a_link(column: int) -> None:
    """Finite differences of integrated links. Mutations: a column's sign, yx for zx, scale applied before the rotation."""
    readings = _readings(1)
    at = np.concatenate(
        [
            WRONG.gyro_scale,
            WRONG.gyro_axes,
            0.5 * WRONG.gyro_rotation,
            WRONG.accel_scale,
            WRONG.accel_axes,
            [0.0],
            np.zeros(3),
            1e-2 * WRONG.g_sensitivity,
            np.zeros(9 + 4),  # the other columns leave out what they change of it
        ]
    )
    about = corrected(readings, _vector(at))
    gyro, accel = bias_equivalents(about, _vector(at), EVERY).of_links(0, LINKS)
    none = np.zeros((LINKS, 3))
    links = preintegrate(about, none, none, DENSITY)
    step = 1e-6 * np.eye(COLUMNS)[column]
    forth, back = (preintegrate(corrected(readings, _vector(at + s * step)), none, none, DENSITY) for s in (1, -1))
    for name, by_gyro, by_accel in (("Dv", links.Dv_D_bg, links.Dv_D_ba), ("Dp", links.Dp_D_bg, links.Dp_D_ba)):
        numerical = (getattr(forth, name) - getattr(back, name)) / 2e-6
        column_of = (by_gyro @ gyro[..., column : column + 1] + by_accel @ accel[..., column : column + 1])[..., 0]
        # A rotation's own right Jacobian is left out: half a rotation of some hundredths.
        np.testing.assert_allclose(column_of, numerical, atol=0.02 * np.abs(numerical).max() + 1e-12)
    turned = Rotation.from_matrix(np.swapaxes(back.DR, 1, 2) @ forth.DR).as_rotvec() / 2e-6
    np.testing.assert_allclose(
        (links.DR_D_bg @ gyro[..., column : column + 1])[..., 0], turned, atol=0.02 * np.abs(turned).max() + 1e-9
    )


def test_a_late_accelerometer_is_asked_later() -> None:
    """Mutation: `query[order] - later_s`."""
    stamps_s = np.arange(0.0, 2.0, 0.005)
    delay_s = 0.004
    accel = np.stack([np.sin(2 * np.pi * 2.0 * (stamps_s - delay_s) + phase) for phase in (0.0, 1.0, 2.0)], axis=1)
    gyro = np.zeros_like(accel)
    hyper = Hyper(np.full(6, 0.1), np.ones(6), np.full(6, 1e-4))
    knots_s = np.arange(0.5, 1.5, 0.01)
    read = asked_later(upsample(stamps_s, gyro, accel, knots_s, hyper), stamps_s, accel, hyper, delay_s)
    true = np.stack([np.sin(2 * np.pi * 2.0 * knots_s + phase) for phase in (0.0, 1.0, 2.0)], axis=1)
    np.testing.assert_allclose(read.knot_accel, true, atol=2e-4)
    assert read.accel_delay_s == delay_s


def _waves(links: int, hz: float, pole_s: float) -> UpsampledImu:
    """A gyroscope and an accelerometer that swing, behind two poles whose delay is allowed for; 0 for none."""
    knots_s = H_S * np.arange(links + 1)
    at_s = knots_s[:-1, None] + H_S * GAUSS
    w, phase = 2.0 * np.pi * hz, np.array([0.0, 1.0, 2.0])
    answer = np.exp(2j * w * pole_s) / (1.0 + 1j * w * pole_s) ** 2

    def seen(t_s: FloatArray) -> FloatArray:
        return np.asarray((answer * np.exp(1j * (w * t_s[..., None] + phase))).imag)

    return UpsampledImu(
        knots_s, H_S, seen(at_s), 3.0 * seen(at_s), seen(knots_s), 3.0 * seen(knots_s), np.zeros((links, 6)),
        np.ones(links, bool),
    )  # fmt: skip


def _filtered_by(spread_s2: FloatArray, skew_s3: FloatArray) -> ImuIntrinsics:
    return replace(_vector(np.zeros(COLUMNS)), low_pass_spread=spread_s2, low_pass_skew=skew_s3)


@pytest.mark.parametrize("hz", [1.0, 3.0])
def test_what_a_filter_smears_is_sharp_again(hz: float) -> None:
    """Against its closed form. What is left is of the filter's fourth moment, (w T)^4 of a reading, and what a quartic through 70
    ms misses of a third derivative.

    Mutations: the spread's sign; the skew's; third derivatives of a cubic's sixth; the accelerometer's spread the gyroscope's.
    """
    links, wt = 80, 2.0 * np.pi * hz * POLE_S
    smeared, sharp = _waves(links, hz, POLE_S), _waves(links, hz, 0.0)
    both = np.ones(2)
    found = corrected(smeared, _filtered_by(SPREAD_S2 * both, SKEW_S3 * both))
    inner = slice(5, links - 5)  # the ends of a recording have no neighbours
    for own, true in ((found.gyro, sharp.gyro), (found.accel / 3.0, sharp.accel / 3.0)):
        assert np.abs(own[inner] - true[inner]).max() < 3.0 * wt**4 + 0.02 * wt**3
    for knot, true in ((found.knot_gyro, sharp.knot_gyro), (found.knot_accel / 3.0, sharp.knot_accel / 3.0)):
        assert np.abs(knot[inner] - true[inner]).max() < 3.0 * wt**4 + 0.02 * wt**3
    assert np.abs(smeared.gyro[inner] - sharp.gyro[inner]).max() > 0.9 * wt**2
    only = corrected(smeared, _filtered_by(np.array([SPREAD_S2, 0.0]), np.zeros(2)))
    np.testing.assert_array_equal(only.accel, smeared.accel)
    assert np.abs(only.gyro - smeared.gyro).max() > 0.5 * wt**2


@pytest.mark.parametrize("column", [37, 38, 39, 40])
def test_a_changed_filter_is_a_bias_to_a_link(column: int) -> None:
    """What the mean of a link's corrected readings changes by, differenced. Mutations: the skew's sign; the spread not halved."""
    readings = _waves(40, 2.0, 0.0)
    step = 1e-6 if column < 39 else 1e-8
    values = np.zeros(COLUMNS)
    values[column] = step
    changed = corrected(readings, _vector(values))
    gyro, accel = bias_equivalents(readings, _vector(np.zeros(COLUMNS)), EVERY).of_links(0, 40)
    for made, own, said in ((changed.gyro, readings.gyro, gyro), (changed.accel, readings.accel, accel)):
        np.testing.assert_allclose((made - own).mean(axis=1), -step * said[:, :, column], atol=1e-12)
    assert max(np.abs(each[:, :, column]).max() for each in (gyro, accel)) > 10.0


def test_a_filter_that_feels_forces_is_a_bias_of_both() -> None:
    """What the accelerometer's filter leaves is a bias of the gyroscope too, where that feels forces.

    Mutation: its columns left out of what the gyroscope feels."""
    values = np.zeros(COLUMNS)
    values[19] = 1e-3  # x feels x
    gyro, accel = bias_equivalents(_waves(40, 2.0, 0.0), _vector(values), EVERY).of_links(0, 40)
    for column in (38, 40):
        np.testing.assert_allclose(gyro[:, 0, column], -1e-3 * accel[:, 0, column], atol=1e-12)
        assert np.abs(gyro[:, 0, column]).max() > 1e-3


def test_few_knots_bend_nowhere() -> None:
    """Fewer than a polynomial takes. Mutation: not looked at."""
    second, third = bends(np.ones((3, 3)), H_S)
    assert not second.any() and not third.any() and second.shape == (3, 3)
