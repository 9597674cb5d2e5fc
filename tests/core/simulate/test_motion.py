"""The exact kinematics against finite differences of poses and products of SciPy rotations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.simulate import jets, motions
from calib_core.simulate.motion import FigureEight, Motion, Pose, Start, Sway, Turn, Wave
from calib_core.types import FloatArray

#: Eighth-order central difference.
_OFFSETS = np.array([-4, -3, -2, -1, 1, 2, 3, 4])
_WEIGHTS = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
_STEP_S = 2e-3

MOTIONS: dict[str, Motion] = {
    "hand": motions.HANDHELD,
    "fast": motions.PAPER_FAST,
    "one axis": motions.ONE_AXIS,
    "turning away": motions.TURNING_AWAY,
    "vehicle": FigureEight(
        Pose((3.0, -2.0, 40.0), (1.0, 2.0, 3.0)), 9.0, 5.0, 20.0, (Turn((0.0, 1.0, 0.0), (Wave(0.05, 1.1, 0.3),)),)
    ),
    "no start": motions.MOVING_FROM_THE_START,
}
#: Inside the ramps (1..2.5, 3..5 s) and after them, away from the instants where a ramp's fourth derivative jumps.
INSTANTS_S = np.array([1.31, 1.77, 2.12, 3.4, 4.1, 4.7, 6.3, 9.9, 17.2])


def _difference(values: FloatArray) -> FloatArray:
    """The first derivative of values (8, ...) sampled at _OFFSETS."""
    return np.tensordot(_WEIGHTS, values, axes=1) / _STEP_S


@pytest.mark.parametrize("name", MOTIONS)
def test_velocity_and_acceleration_are_the_derivatives_of_position(name: str) -> None:
    """Fails when `Jet.__mul__` loses its factor 2 or `smooth_step`'s bend its sign.

    The eighth-order difference errs by about f^(9) h^8: below 1e-8 for the fastest of these motions.
    """
    for t in INSTANTS_S:
        around = MOTIONS[name].kinematics(t + _STEP_S * _OFFSETS)
        here = MOTIONS[name].kinematics(np.array([t]))
        np.testing.assert_allclose(_difference(around.p_m), here.v_m_s[0], rtol=0.0, atol=1e-8)
        np.testing.assert_allclose(_difference(around.v_m_s), here.a_m_s2[0], rtol=0.0, atol=1e-7)


@pytest.mark.parametrize("name", MOTIONS)
def test_angular_rate_and_acceleration_are_those_of_the_rotation(name: str) -> None:
    """Fails when the stage recursion drops the term -th' a x (S^T w), or turns rates by S instead of S^T.

    [w]x = R^T dR/dt.
    """
    for t in INSTANTS_S:
        around = MOTIONS[name].kinematics(t + _STEP_S * _OFFSETS)
        here = MOTIONS[name].kinematics(np.array([t]))
        spin = here.R_world[0].T @ _difference(around.R_world)
        np.testing.assert_allclose(spin, -spin.T, rtol=0.0, atol=1e-8)
        np.testing.assert_allclose([spin[2, 1], spin[0, 2], spin[1, 0]], here.omega_rad_s[0], rtol=0.0, atol=1e-8)
        np.testing.assert_allclose(_difference(around.omega_rad_s), here.alpha_rad_s2[0], rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("name", MOTIONS)
def test_a_fixed_frame_moves_as_its_own_positions_say(name: str) -> None:
    """Fails when `Kinematics.at` leaves out the centripetal term or turns the lever arm the wrong way.

    The oracle differences R p_frame + p itself.
    """
    R = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    lever = np.array([0.3, -0.5, 0.8])
    for t in INSTANTS_S[::2]:
        around = MOTIONS[name].kinematics(t + _STEP_S * _OFFSETS)
        moved = MOTIONS[name].kinematics(np.array([t])).at(R, lever)
        places = around.R_world @ lever + around.p_m
        velocities = np.stack([k @ lever for k in _rates(MOTIONS[name], t)]) + around.v_m_s
        np.testing.assert_allclose(_difference(places), moved.v_m_s[0], rtol=0.0, atol=1e-8)
        np.testing.assert_allclose(_difference(velocities), moved.a_m_s2[0], rtol=0.0, atol=1e-6)
        turned = around.R_world @ R
        spin = moved.R_world[0].T @ _difference(turned)
        np.testing.assert_allclose([spin[2, 1], spin[0, 2], spin[1, 0]], moved.omega_rad_s[0], rtol=0.0, atol=1e-8)


def _rates(motion: Motion, t: float) -> list[FloatArray]:
    """dR/dt at each of the eight instants around t, by differences of their own."""
    return [_difference(motion.kinematics(t + _STEP_S * (k + _OFFSETS)).R_world) for k in _OFFSETS]


def test_rotation_is_the_product_of_its_stages() -> None:
    """Fails when stages are multiplied from the left, or a Pose's angles are taken in another order than Rz Ry Rx."""
    t = np.array([5.0, 7.3])
    motion = Sway(
        Pose((10.0, -20.0, 130.0)),
        turns=(Turn((0.0, 0.0, 2.0), (Wave(0.3, 0.4, 0.1),)), Turn((1.0, 1.0, 0.0), (Wave(0.2, 0.7, 0.9),))),
        start=Start(0.0, 0.0),
    )
    first, second = 0.3 * np.sin(2 * np.pi * 0.4 * t + 0.1), 0.2 * np.sin(2 * np.pi * 0.7 * t + 0.9)
    x, y, z = (
        Rotation.from_rotvec(np.deg2rad(angle) * np.eye(3)[axis]) for axis, angle in enumerate((10.0, -20.0, 130.0))
    )
    expected = (
        z
        * y
        * x
        * Rotation.from_rotvec(first[:, None] * np.array([0.0, 0.0, 1.0]))
        * Rotation.from_rotvec(second[:, None] * np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0))
    )
    np.testing.assert_allclose(motion.kinematics(t).R_world, expected.as_matrix(), rtol=0.0, atol=1e-14)


def test_it_stands_still_and_then_starts_without_a_jerk() -> None:
    """Fails when the ramp is the cubic 3u^2 - 2u^3, whose second derivative jumps."""
    still = motions.PAPER_NORMAL.kinematics(np.array([-1.0, 0.0, 0.99]))
    assert not still.v_m_s.any()
    assert not still.omega_rad_s.any()
    np.testing.assert_array_equal(still.p_m, still.p_m[:1].repeat(3, axis=0))
    for edge in (1.0, 2.5):
        before, after = (motions.PAPER_NORMAL.kinematics(np.array([edge + side * 1e-6])) for side in (-1.0, 1.0))
        np.testing.assert_allclose(after.a_m_s2, before.a_m_s2, rtol=0.0, atol=1e-4)
        np.testing.assert_allclose(after.alpha_rad_s2, before.alpha_rad_s2, rtol=0.0, atol=1e-4)


def test_a_gentle_clock_is_the_integral_of_the_ramp() -> None:
    """Fails when any coefficient of `smooth_start`'s polynomial changes."""
    fine = np.linspace(0.0, 6.0, 60_001)
    rate = jets.smooth_step(jets.time(fine), 1.0, 2.5).f
    integral = np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2.0 * np.diff(fine))])
    np.testing.assert_allclose(jets.smooth_start(jets.time(fine), 1.0, 2.5).f, integral, rtol=0.0, atol=1e-8)


def test_the_quotes_of_the_table_hold() -> None:
    """Fails when paper-normal's peaks, or handheld's mean speeds (0.7 m/s, 26 deg/s), drift from the issue's table."""
    t = np.linspace(5.0, 60.0, 20_000)
    hand = motions.HANDHELD.kinematics(t)
    assert np.linalg.norm(hand.v_m_s, axis=1).mean() == pytest.approx(0.7, rel=0.02)
    assert np.rad2deg(np.linalg.norm(hand.omega_rad_s, axis=1)).mean() == pytest.approx(26.0, rel=0.02)
    for motion, fastest_hz in ((motions.PAPER_NORMAL, 0.53), (motions.PAPER_FAST, 1.53)):
        waves = [wave for turn in motion.turns for wave in turn.waves]
        assert all(np.rad2deg(wave.amplitude) == pytest.approx(12.0) for wave in waves)
        waves += [wave for axis in motion.position for wave in axis]
        assert max(wave.frequency_hz for wave in waves) == pytest.approx(fastest_hz)
    assert min(wave.frequency_hz for axis in motions.PAPER_NORMAL.position for wave in axis) >= 0.2
