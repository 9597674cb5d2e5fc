"""Preintegration against closed-form motion, a loop, finite differences and Monte Carlo."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.paper.preintegration import Preintegrated, ScanPreintegration, preintegrate_scans
from calib_core.paper.upsample import Readings

ZERO = np.zeros(3)


@dataclass
class Analytic:
    """Readings from formulas of time; the same variance everywhere."""

    gyro: object
    accel: object
    var: float = 0.0

    def at(self, scan, imu_s):
        var = np.full((imu_s.size, 3), self.var)
        return Readings(self.gyro(imu_s), self.accel(imu_s), var, 4.0 * var)


def constant(vector):
    return lambda t: np.tile(np.asarray(vector, dtype=float), (t.size, 1))


def wavy(t):
    """A rate of turn that people make, every axis on its own."""
    return np.stack([1.2 * np.sin(5.0 * t), 0.9 * np.cos(4.0 * t + 1.0), 0.4 + 0.8 * np.sin(6.5 * t)], axis=1)


def swaying(t):
    return np.stack([2.0 * np.cos(3.0 * t), 9.8 + np.sin(7.0 * t), 3.0 * np.sin(4.0 * t + 0.3)], axis=1)


def integrated(source, *, offset=0.0, bg=ZERO, ba=ZERO, rate=1000.0, starts=(0.0, 0.7), duration=0.1, as_printed=False):
    starts = np.array(starts)
    return preintegrate_scans(
        source,
        starts,
        np.full(starts.size, duration),
        time_offset_prior_s=offset,
        gyro_bias_prior=np.asarray(bg, dtype=float),
        accel_bias_prior=np.asarray(ba, dtype=float),
        rate_hz=rate,
        as_printed=as_printed,
    )


def at_points(pre: ScanPreintegration) -> Preintegrated:
    """At times on and off the grid."""
    return pre.at(np.array([0, 1, 0, 1, 1]), np.array([0.0, 0.0137, 0.05, 0.07321, 0.1]))


def test_constant_acceleration_decides_for_the_half():
    """Dp = a t^2 / 2 to rounding, at any step. Mutation: eq. (3) as printed, without the 1/2."""
    a = np.array([1.0, -2.0, 0.5])
    for rate in (10.0, 50.0, 1000.0):
        pre = integrated(Analytic(constant(ZERO), constant(a)), rate=rate)
        for elapsed in (0.02, 0.0555, 0.1):
            m = pre.at(np.array([0]), np.array([elapsed]))
            np.testing.assert_allclose(m.Dv[0], a * elapsed, rtol=1e-12)
            np.testing.assert_allclose(m.Dp[0], 0.5 * a * elapsed**2, rtol=1e-12)
            np.testing.assert_allclose(m.DR[0], np.eye(3), atol=1e-15)


def test_circle_at_constant_rate():
    """On a circle of radius r the sensor feels -r w^2 and comes round. Mutation: attitude at the step's start."""
    w, r = 2.5, 0.4
    source = Analytic(constant([0.0, 0.0, w]), constant([-r * w**2, 0.0, 0.0]))
    pre = integrated(source, starts=(0.0,), duration=0.4)
    t = np.array([0.1, 0.2501, 0.4])
    m = pre.at(np.zeros(3, dtype=np.int64), t)
    np.testing.assert_allclose(m.DR, Rotation.from_rotvec(np.outer(w * t, [0, 0, 1])).as_matrix(), atol=1e-12)
    # It starts at (r, 0, 0) with velocity (0, r w, 0); eq. (4)-(6) without gravity.
    velocity = np.array([0.0, r * w, 0.0]) + m.Dv
    position = np.array([r, 0.0, 0.0]) + t[:, None] * np.array([0.0, r * w, 0.0]) + m.Dp
    circle = np.stack([np.cos(w * t), np.sin(w * t), np.zeros(3)], axis=1)
    tangent = np.stack([-np.sin(w * t), np.cos(w * t), np.zeros(3)], axis=1)
    # Midpoint rule: r w^2 t (w h)^2 / 24 and less.
    np.testing.assert_allclose(velocity, r * w * tangent, atol=r * w**2 * 0.4 * (w * 1e-3) ** 2)
    np.testing.assert_allclose(position, r * circle, atol=r * w**2 * 0.4**2 * (w * 1e-3) ** 2)


def test_finer_steps_converge_quadratically():
    """A quarter of the error at half the step. Mutation: readings at the step's start."""
    source = Analytic(wavy, swaying)
    fine = integrated(source, rate=8000.0).to_next()
    errors = []
    for rate in (250.0, 500.0, 1000.0):
        m = integrated(source, rate=rate).to_next()
        errors.append([np.abs(m.DR - fine.DR).max(), np.abs(m.Dv - fine.Dv).max(), np.abs(m.Dp - fine.Dp).max()])
    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    assert np.all((ratios > 3.5) & (ratios < 4.6))


def test_slow_twin():
    """A loop over one scan's steps with SciPy's rotations, to rounding. Mutation: scans in each other's rows."""
    source = Analytic(wavy, swaying)
    bg, ba = np.array([0.02, -0.01, 0.03]), np.array([0.1, 0.2, -0.3])
    pre = integrated(source, offset=0.013, bg=bg, ba=ba, starts=(0.3, 1.1), rate=200.0)
    m = pre.at(np.array([1]), np.array([0.063]))
    R, v, p, t, h = Rotation.identity(), np.zeros(3), np.zeros(3), 1.1, 0.005
    for k in range(13):
        step = h if k < 12 else 0.003
        middle = np.array([1.1 + k * h + 0.5 * h - 0.013])
        w, f = wavy(middle)[0] - bg, swaying(middle)[0] - ba
        force = (R * Rotation.from_rotvec(0.5 * step * w)).apply(f)
        p = p + v * step + 0.5 * force * step**2
        v = v + force * step
        R = R * Rotation.from_rotvec(step * w)
        t += step
    np.testing.assert_allclose(m.DR[0], R.as_matrix(), atol=1e-13)
    np.testing.assert_allclose(m.Dv[0], v, atol=1e-13)
    np.testing.assert_allclose(m.Dp[0], p, atol=1e-13)


def test_eq_3_to_the_letter():
    """The printed sums and the printed product, term by term: no 1/2, reading and attitude at each step's start.

    Mutations: the 1/2 put in; readings in mid-step; the attitude after the step.
    """
    source = Analytic(wavy, swaying)
    bg, ba, h = np.array([0.02, -0.01, 0.03]), np.array([0.1, 0.2, -0.3]), 0.005
    pre = integrated(source, offset=0.013, bg=bg, ba=ba, starts=(0.3, 1.1), rate=200.0, as_printed=True)
    m = pre.at(np.array([1]), np.array([0.06]))
    t = 1.1 - 0.013 + h * np.arange(12)
    turns = Rotation.from_rotvec((wavy(t) - bg) * h)
    R = [Rotation.identity()]
    for turn in turns:
        R.append(R[-1] * turn)
    push = np.array([at.apply(f) for at, f in zip(R[:-1], swaying(t) - ba, strict=True)])
    v = np.vstack([np.zeros(3), np.cumsum(push * h, axis=0)])
    np.testing.assert_allclose(m.DR[0], R[-1].as_matrix(), atol=1e-13)
    np.testing.assert_allclose(m.Dv[0], v[-1], atol=1e-13)
    np.testing.assert_allclose(m.Dp[0], (v[:-1] * h + push * h**2).sum(axis=0), atol=1e-13)


@pytest.mark.parametrize("as_printed", [False, True])
def test_biases_move_what_is_integrated_to_first_order(as_printed):
    """Central differences over each bias, by either rule. Mutation: a Jacobian of the other rule."""
    source, step = Analytic(wavy, swaying), 1e-4
    base = integrated(source, rate=200.0, as_printed=as_printed).to_next()
    for axis in range(3):
        unit = np.eye(3)[axis]
        for kind in ("bg", "ba"):
            forth, back = (
                integrated(source, rate=200.0, as_printed=as_printed, **{kind: s * step * unit}).to_next()
                for s in (1, -1)
            )
            Dp_D, Dv_D = getattr(base, f"Dp_D_{kind}"), getattr(base, f"Dv_D_{kind}")
            np.testing.assert_allclose((forth.Dv - back.Dv) / (2 * step), Dv_D[:, :, axis], atol=1e-7)
            np.testing.assert_allclose((forth.Dp - back.Dp) / (2 * step), Dp_D[:, :, axis], atol=1e-8)


def test_time_shift_has_the_contracts_sign():
    """Stamps early by the offset need that offset added. Mutation: t + delta t in preintegrate_scans."""
    offset = 0.02
    truth = integrated(Analytic(wavy, swaying)).to_next()
    # The reading taken at lidar time t is stamped t - offset: asked at a stamp, it answers for stamp + offset.
    stamped = Analytic(lambda s: wavy(s + offset), lambda s: swaying(s + offset))
    found = integrated(stamped, offset=offset).to_next()
    np.testing.assert_allclose(found.DR, truth.DR, atol=1e-13)
    np.testing.assert_allclose(found.Dp, truth.Dp, atol=1e-13)


@pytest.mark.parametrize("unknown", ["bg", "ba", "offset"])
def test_first_order_changes(unknown: str):
    """Eq. (12) against preintegration about the changed value: the rest is of second order.

    Mutation: any Jacobian's sign.
    """
    source = Analytic(wavy, swaying)
    base = at_points(integrated(source, offset=0.004, bg=[0.01, 0.0, 0.0], ba=[0.0, 0.1, 0.0]))
    direction = np.array([0.6, -0.5, 0.8])
    rest = []
    for size in (4e-2, 2e-2):
        bg, ba, dt = np.zeros(3), np.zeros(3), 0.0
        if unknown == "bg":
            bg = size * direction
        elif unknown == "ba":
            ba = size * direction
        else:
            dt = 0.2 * size
        moved = at_points(
            integrated(source, offset=0.004 + dt, bg=np.array([0.01, 0.0, 0.0]) + bg, ba=np.array([0.0, 0.1, 0.0]) + ba)
        )
        DR, Dv, Dp, _ = base.corrected(bg, ba, dt)
        rest.append([np.abs(DR - moved.DR).max(), np.abs(Dv - moved.Dv).max(), np.abs(Dp - moved.Dp).max()])
    rest = np.array(rest)
    change = np.abs(moved.Dv - base.Dv).max()
    assert np.all(rest[1] < 0.02 * change + 1e-6)
    # Half the change, a quarter of the rest, down to rounding and the central difference's own error.
    assert np.all(rest[1] < 0.3 * rest[0] + 1e-7)


def test_covariance_is_that_of_noisy_readings():
    """Blocks of the covariance within the spread of 4000 draws.

    Mutation: without the coupling of attitude into velocity.
    """
    rng = np.random.default_rng(20)
    std, draws, steps = 0.5, 4000, 20

    class Noisy(Analytic):
        def at(self, scan, imu_s):
            clean = super().at(scan, imu_s)
            gyro = clean.gyro_rad_s + np.sqrt(clean.var_gyro) * rng.normal(size=clean.var_gyro.shape)
            accel = clean.accel_m_s2 + np.sqrt(clean.var_accel) * rng.normal(size=clean.var_accel.shape)
            return Readings(gyro, accel, clean.var_gyro, clean.var_accel)

    arguments = {"starts": np.zeros(1), "duration": 0.1, "rate": steps / 0.1}
    source = Analytic(constant([0.5, -0.3, 0.8]), constant([20.0, 60.0, -40.0]), var=std**2)
    clean = integrated(source, **arguments).to_next()
    noisy = integrated(
        Noisy(source.gyro, source.accel, var=std**2), starts=np.zeros(draws), duration=0.1, rate=steps / 0.1
    ).to_next()
    rotvec = Rotation.from_matrix(np.swapaxes(clean.DR, 1, 2) @ noisy.DR).as_rotvec()
    for sample, cov in ((rotvec, clean.cov_R), (noisy.Dv, clean.cov_v), (noisy.Dp, clean.cov_p)):
        centred = sample - sample.mean(axis=0)
        # Whitened by the claimed covariance the sample covariance is the identity, +- sqrt(2 / draws) on the diagonal.
        whitener = np.linalg.inv(np.linalg.cholesky(cov[0]))
        found = whitener @ (centred.T @ centred / draws) @ whitener.T
        np.testing.assert_allclose(found, np.eye(3), atol=5.0 * np.sqrt(2.0 / draws))
