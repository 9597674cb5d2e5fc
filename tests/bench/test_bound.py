"""The Cramér-Rao bound: its rows against finite differences, its elimination against a dense inverse, its laws."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from bench.bound import Assumptions, bound_of
from bench.bound.bound import instants, opening, unknowns
from bench.bound.eliminate import covariance_of_last, stepped
from bench.bound.lidar import Faces, Returns, faces_of, returns_of, rows_of
from bench.bound.model import Columns
from bench.bound.motion import ImuNoise, drawn_noise, noise_back, steps_back
from calib_core.simulate import SCENARIOS, Scenario, Simulation, parse_faults, prepare
from calib_core.simulate.sensors import Spinning

COLUMNS = Columns(biases_walk=False, planes=6)


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    """Fast motion, in full swing after four seconds."""
    return prepare("paper-fast", seed=1, duration_s=6.0)


def exp(turn: Any) -> Any:
    return Rotation.from_rotvec(turn).as_matrix()


def predicted_range(simulation: Simulation, faces: Faces, seen: Returns, i: int, z: Any) -> float:
    """The range a return would have had, were every unknown off by z: written from the geometry, not from its derivative."""
    truth = simulation.truth
    t = seen.t_s[i]
    imu = truth.imu(np.array([t - z[COLUMNS.calibration][6]]))
    turn, shift = z[COLUMNS.turn], z[COLUMNS.position]
    R = exp(turn) @ imu.R_world[0]
    p = imu.p_m[0] + shift
    R_c = truth.R_imu_lidar @ exp(z[COLUMNS.calibration][:3])
    p_c = truth.p_imu_lidar + z[COLUMNS.calibration][3:6]
    face = seen.plane[i]
    delta = z[COLUMNS.plane(int(face))]
    n = faces.normals[face] + delta[:2] @ faces.axes[face]
    ray = seen.x_m[i] / np.linalg.norm(seen.x_m[i])
    origin, direction = R @ p_c + p, R @ R_c @ ray
    return float(-(n @ origin + faces.offsets_m[face] + delta[2]) / (n @ direction))


def test_rows_are_the_derivatives_of_the_range(simulation: Simulation) -> None:
    """Central differences of the ray's range. Fails on a flipped sign in any block (seen: the time offset's) or on a
    turn taken about the wrong origin (seen: hit instead of arm)."""
    faces = faces_of(simulation)
    everything = returns_of(simulation, simulation.truth, faces, 45)
    some = np.zeros(len(everything.t_s), dtype=bool)
    some[::977] = True
    seen = everything.chosen(some)
    R_c = simulation.truth.R_imu_lidar
    rows = rows_of(seen, R_c, faces, range(6), np.zeros(len(seen.t_s)), 1.0, COLUMNS)
    checked = [c for c in range(COLUMNS.size) if not COLUMNS.gravity.start <= c < COLUMNS.calibration.start]
    step = 1e-6
    for i in range(len(seen.t_s)):
        at = predicted_range(simulation, faces, seen, i, np.zeros(COLUMNS.size))
        assert at == pytest.approx(np.linalg.norm(seen.x_m[i]), abs=1e-9)
        for column in checked:
            z = np.zeros(COLUMNS.size)
            z[column] = step
            slope = (
                predicted_range(simulation, faces, seen, i, z) - predicted_range(simulation, faces, seen, i, -z)
            ) / (2 * step)
            if COLUMNS.velocity.start <= column < COLUMNS.velocity.stop:
                slope = 0.0  # it counts only through the time since the instant, which is 0 here
            assert rows[i, column] == pytest.approx(slope, rel=1e-5, abs=1e-6)


def test_velocity_moves_the_position_of_later_returns(simulation: Simulation) -> None:
    """Fails if the time since the instant is left out or has the wrong sign."""
    faces = faces_of(simulation)
    seen = returns_of(simulation, simulation.truth, faces, 45).chosen(slice(0, 50))
    after = np.linspace(-1e-3, 1e-3, len(seen.t_s))
    rows = rows_of(seen, simulation.truth.R_imu_lidar, faces, range(6), after, 1.0, COLUMNS)
    np.testing.assert_allclose(rows[:, COLUMNS.velocity], rows[:, COLUMNS.position] * after[:, None])


def dead_reckoned(simulation: Simulation, first_s: float, last_s: float, z: Any) -> Any:
    """Attitude, velocity and position at last_s by integrating exact readings in which biases and gravity are off by z,
    from a start that is off by z; an adaptive integrator of its own. z: (B, size). Returns (B, 15)."""
    truth = simulation.truth
    start = truth.imu(np.array([first_s]))
    R0 = exp(z[:, COLUMNS.turn]) @ start.R_world[0]
    gravity = truth.gravity_world_m_s2 + z[:, COLUMNS.gravity]

    def slope(t: float, flat: Any) -> Any:
        state = flat.reshape(len(z), 15)
        now = truth.imu(np.array([t]))
        R = state[:, :9].reshape(-1, 3, 3)
        w = now.omega_rad_s[0] - z[:, COLUMNS.gyro_bias]
        force = now.R_world[0].T @ (now.a_m_s2[0] - truth.gravity_world_m_s2) - z[:, COLUMNS.accel_bias]
        turned = np.stack([np.cross(w, R[:, i]) * -1.0 for i in range(3)], axis=1)  # rows of R [w]x
        pull = (R @ force[..., None])[..., 0] + gravity
        return np.hstack([turned.reshape(-1, 9), pull, state[:, 9:12]]).ravel()

    velocity, position = start.v_m_s + z[:, COLUMNS.velocity], start.p_m + z[:, COLUMNS.position]
    flat = np.hstack([R0.reshape(-1, 9), velocity, position]).ravel()
    end = solve_ivp(slope, (first_s, last_s), flat, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    return end.reshape(len(z), 15)


def test_steps_are_the_derivatives_of_dead_reckoning(simulation: Simulation) -> None:
    """Half a second of steps, composed, against differences of an integrated motion. Fails on a wrong sign or power of
    the step in any block (seen: gravity's sign; the bias's square term)."""
    first, last, h = 4.0, 4.5, 0.0025
    n = round((last - first) / h)
    middle = simulation.truth.imu(first + h * (np.arange(n) + 0.5))
    back = steps_back(middle.R_world, middle.a_m_s2 - simulation.truth.gravity_world_m_s2, h, COLUMNS)
    whole = np.eye(COLUMNS.size)
    for one in back:
        step = np.eye(COLUMNS.size)
        step[:9] = one
        whole = whole @ step
    forward = np.linalg.inv(whole)[:9]
    eps = 1e-5
    free = [*range(9), *range(COLUMNS.gravity.start, COLUMNS.accel_bias.stop)]
    z = eps * np.eye(COLUMNS.size)[free]
    plus, minus = np.split(dead_reckoned(simulation, first, last, np.vstack([z, -z])), 2)
    R_plus, R_minus = plus[:, :9].reshape(-1, 3, 3), minus[:, :9].reshape(-1, 3, 3)
    turns = Rotation.from_matrix(R_plus @ np.swapaxes(R_minus, 1, 2)).as_rotvec()
    slopes = np.hstack([turns, plus[:, 9:] - minus[:, 9:]]) / (2 * eps)
    np.testing.assert_allclose(forward[:, free].T, slopes, rtol=1e-4, atol=2e-5)


def test_noise_has_the_variance_of_integrated_white_noise() -> None:
    """Over a second at constant attitude and force: the textbook integrals of white noise. Fails if a density enters
    per step instead of per root of time, or a cross term has the wrong sign (seen)."""
    h, n = 0.002, 500
    force = np.array([0.3, -0.5, 9.7])
    noise = ImuNoise(2e-3, 3e-2, 0.0, 0.0)
    back = steps_back(np.tile(np.eye(3), (n, 1, 1)), np.tile(force, (n, 1)), h, COLUMNS)[:, :9, :9]
    disturbance = noise_back(np.tile(force, (n, 1)), h, noise, COLUMNS)
    covariance, after_one = np.zeros((9, 9)), None
    for one, spread in zip(back, disturbance, strict=True):
        forward = np.linalg.inv(one)
        covariance = forward @ (covariance + spread @ spread.T) @ forward.T
        after_one = covariance if after_one is None else after_one
    assert after_one is not None
    A = np.array([[0, force[2], -force[1]], [-force[2], 0, force[0]], [force[1], -force[0], 0]])
    T, g2, f2 = n * h, noise.gyro**2, noise.accel**2
    expected = np.zeros((9, 9))
    expected[:3, :3] = g2 * T * np.eye(3)
    expected[3:6, :3] = g2 * T**2 / 2 * A
    expected[6:, :3] = g2 * T**3 / 6 * A
    expected[3:6, 3:6] = f2 * T * np.eye(3) + g2 * T**3 / 3 * A @ A.T
    expected[6:, 3:6] = f2 * T**2 / 2 * np.eye(3) + g2 * T**4 / 8 * A @ A.T
    expected[6:, 6:] = f2 * T**3 / 3 * np.eye(3) + g2 * T**5 / 20 * A @ A.T
    lower = np.tril(np.ones((9, 9), dtype=bool))
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((covariance - expected) / scale)[lower].max() < 5e-3
    # Within a single step the cross terms with the turn are exact.
    np.testing.assert_allclose(after_one[3:6, :3], g2 * h**2 / 2 * A, atol=1e-12 * g2 * h**2)
    np.testing.assert_allclose(after_one[6:, :3], g2 * h**3 / 6 * A, atol=1e-12 * g2 * h**3)


@pytest.mark.parametrize("walks", [False, True])
def test_elimination_is_the_dense_inverse(walks: bool) -> None:
    """Every instant's unknowns and all noises in one dense least squares. Fails if the filter forgets rows, or carries
    the lasting unknowns wrongly through a step (seen: the lasting part of the triangle dropped)."""
    rng = np.random.default_rng(3)
    columns = Columns(biases_walk=walks, planes=1)
    n, moving, noises, steps = columns.size, columns.moving, columns.noises, 6
    backs = rng.standard_normal((steps, moving, n)) * 0.2
    backs[:, np.arange(moving), np.arange(moving)] += 1.0
    spreads = rng.standard_normal((steps, moving, noises)) * 0.3
    rows = rng.standard_normal((steps, 9, n))
    triangle = opening(columns, Assumptions(), 9.807)[:, :-1]
    first = triangle.copy()
    for back, spread, row in zip(backs, spreads, rows, strict=True):
        triangle = stepped(triangle, back, spread, row)
    # Unknowns: moving at the end, lasting, noises of every step; earlier instants are linear in them.
    total = n + noises * steps
    now = np.eye(n, total)[:moving]
    last = np.eye(n, total)[moving:]
    dense = []
    for k in reversed(range(steps)):
        own = np.eye(noises, total, n + noises * k)
        dense += [rows[k] @ np.vstack([now, last]), own]
        now = backs[k] @ np.vstack([now, last]) + spreads[k] @ own
    dense.append(first @ np.vstack([now, last]))
    J = np.vstack(dense)
    covariance = np.linalg.inv(J.T @ J)[n - 7 : n, n - 7 : n]
    np.testing.assert_allclose(covariance_of_last(triangle, 7), covariance, rtol=1e-6, atol=1e-9 * covariance.max())


def short(simulation: Simulation, assumed: Assumptions) -> Any:
    """The covariance of a few seconds."""
    truth, faces = simulation.truth, faces_of(simulation)
    sweeps = [returns_of(simulation, truth, faces, i).chosen(slice(0, None, 20)) for i in range(20, 60, 2)]
    columns, noise = unknowns(simulation, assumed, 6)
    triangle = opening(columns, assumed, truth.gravity_m_s2)
    for step in instants(simulation, truth, faces, list(range(6)), sweeps, columns, noise, assumed):
        triangle = stepped(triangle, *step)
    return covariance_of_last(triangle, 7)


def spoilt(faults: str) -> Simulation:
    return prepare("paper-fast", seed=1, duration_s=6.0, faults=parse_faults(faults))


def test_late_scans_are_an_unknown_each(simulation: Simulation) -> None:
    """Against an elimination in which the lateness of every scan is an unknown that lasts, with its prior. Seen red: scans
    that keep the lateness of the one before (`back` not cleared); no prior (the noise left out); scans that end twenty steps
    later."""
    assumed, std_s = Assumptions(step_s=0.005), 0.0005
    truth, faces = simulation.truth, faces_of(simulation)
    taken = range(20, 60, 2)
    sweeps = [returns_of(simulation, truth, faces, i).chosen(slice(0, None, 20)) for i in taken]
    columns, noise = unknowns(simulation, assumed, 6)
    first = columns.calibration.start
    scans, period_s = 60, simulation.scenario.lidar.pattern.period_s

    def wider(rows: Any) -> Any:
        return np.insert(rows, [first] * scans, 0.0, axis=1)

    prior = np.zeros((scans, columns.size + scans + 1))
    prior[:, first : first + scans] = np.eye(scans) / std_s
    triangle = np.linalg.qr(np.vstack([wider(opening(columns, assumed, truth.gravity_m_s2)), prior]), mode="r")
    start_s = min(seen.t_s.min() for seen in sweeps)
    steps = instants(simulation, truth, faces, list(range(6)), sweeps, columns, noise, assumed)
    for number, (back, disturbance, rows, _) in enumerate(steps):
        late = wider(rows)
        late[:, first + int((start_s + assumed.step_s * number) / period_s)] = rows[:, columns.calibration.stop - 1]
        triangle = stepped(
            triangle[: columns.size + scans], wider(np.hstack([back, back[:, :1]]))[:, :-1], disturbance, late
        )
    expected = covariance_of_last(triangle[: columns.size + scans], 7)
    mine = short(spoilt("scan-latency=0.5ms"), assumed)
    np.testing.assert_allclose(np.diag(mine), np.diag(expected), rtol=0.01)
    assert np.diag(mine)[6] > 3.0 * short(simulation, assumed)[6, 6]


def test_what_is_taken_away_counts(simulation: Simulation) -> None:
    """Readings sent twice are half as many, each as good; steps are noise of a twelfth of their square a reading; a grid leaves
    one point a cube. Seen red: the repeats' factor squared; the step's variance at a rate of one; every seventh point for the
    first of each cube."""
    assumed = Assumptions()
    plain = unknowns(simulation, assumed, 6)[1]
    twice = unknowns(spoilt("imu-repeats=2"), assumed, 6)[1]
    assert (twice.gyro / plain.gyro) ** 2 == pytest.approx(2.0) == (twice.accel / plain.accel) ** 2
    imu, step_rad_s = simulation.scenario.imu, 0.02
    stepping = unknowns(spoilt(f"gyro-step={step_rad_s}"), assumed, 6)[1]
    rng = np.random.default_rng(4)
    rounding = rng.uniform(-step_rad_s / 2.0, step_rad_s / 2.0, 200_000)
    density = np.sqrt(plain.gyro**2 + rounding.var() / imu.rate_hz)
    assert stepping.gyro == pytest.approx(density, rel=0.01) and stepping.accel == plain.accel
    gridded = spoilt("voxel-grid=0.2")
    faces = faces_of(gridded)
    seen, sent = returns_of(gridded, gridded.truth, faces, 20), gridded.cloud(20)
    points = np.stack([sent.points[axis] for axis in "xyz"], axis=1).astype(np.float64)
    mine = seen.x_m + seen.ray * seen.range_error_m[:, None]
    apart = cKDTree(points).query(mine)[0]
    assert len(mine) == pytest.approx(len(points), rel=0.05)
    assert np.mean(apart < 1e-3) > 0.95


def test_laws_of_the_bound(simulation: Simulation) -> None:
    """The gauge is free, finer steps change nothing, walks so slow that nothing walks are constants, noise scales.
    Fails if the gauge's strength leaks into the calibration (seen: gauge on the velocity)."""
    base = Assumptions(step_s=0.005)
    reference = short(simulation, base)
    scale = np.sqrt(np.outer(np.diag(reference), np.diag(reference)))
    # Not to the last digit: a step follows the path to the third order only.
    assert np.abs((short(simulation, replace(base, gauge_std=1.0)) - reference) / scale).max() < 1e-4
    finer = np.diag(short(simulation, replace(base, step_s=0.0025)))
    np.testing.assert_allclose(finer, np.diag(reference), rtol=5e-3)
    still = np.diag(short(simulation, replace(base, gyro_walk=1e-12, accel_walk=1e-12)))
    np.testing.assert_allclose(still, np.diag(reference), rtol=1e-4)
    walking = short(simulation, replace(base, gyro_walk=1e-3, accel_walk=1e-2))
    assert np.all(np.linalg.eigvalsh(walking - reference) > -1e-12)
    loud = short(simulation, replace(base, imu_noise_factor=2.0, range_noise_factor=2.0, gravity_std_m_s2=0.04))
    np.testing.assert_allclose(loud, 4.0 * reference, rtol=1e-6)


def test_a_range_that_errors_explain_is_explained(simulation: Simulation) -> None:
    """What a return drew is on the side of the errors that would have made it. Mutation: the right-hand side's sign."""
    faces = faces_of(simulation)
    everything = returns_of(simulation, simulation.truth, faces, 45)
    some = np.zeros(len(everything.t_s), dtype=bool)
    some[::977] = True
    seen = everything.chosen(some)
    z = 1e-5 * np.random.default_rng(4).standard_normal(COLUMNS.size)
    z[COLUMNS.velocity] = 0.0
    none = np.zeros(COLUMNS.size)
    made = [
        predicted_range(simulation, faces, seen, i, z) - predicted_range(simulation, faces, seen, i, none)
        for i in range(len(seen.t_s))
    ]
    seen = replace(seen, range_error_m=np.array(made))
    rows = rows_of(seen, simulation.truth.R_imu_lidar, faces, list(range(6)), np.zeros(len(made)), 0.02, COLUMNS)
    np.testing.assert_allclose(rows[:, :-1] @ z, rows[:, -1], atol=2e-3 * np.abs(rows[:, -1]).max())


def test_noise_of_the_imu_that_was_drawn_is_undone(simulation: Simulation) -> None:
    """Over one sample the errors of what the readings integrate to, against the readings with and without noise.

    Mutations: the sign, the sample before instead of the nearest, the IMU's axes instead of the world's.
    """
    quiet = prepare("paper-fast", seed=1, duration_s=6.0, noise=False).imu_messages
    noisy = simulation.imu_messages
    sample, h = 470, 0.0025
    middles_s = noisy.true_ns[sample] * 1e-9 + h * (np.arange(4) - 1.5)
    middles = simulation.truth.imu(middles_s)
    noise = ImuNoise(1e-3, 1e-2, 0.0, 0.0)
    drawn = drawn_noise(simulation, simulation.truth, middles_s, middles.R_world, h, noise, COLUMNS)
    back = noise_back(middles.a_m_s2 - simulation.truth.gravity_world_m_s2, h, noise, COLUMNS)
    grown = -np.einsum("nij,nj->i", back, drawn)
    R = simulation.truth.imu(middles_s.mean(keepdims=True)).R_world[0]
    turned = 4 * h * R @ (noisy.gyro_rad_s - quiet.gyro_rad_s)[sample]
    pushed = 4 * h * R @ (noisy.accel_m_s2 - quiet.accel_m_s2)[sample]
    np.testing.assert_allclose(grown[:3], turned, atol=0.01 * np.abs(turned).max())
    np.testing.assert_allclose(grown[3:6], pushed, atol=0.02 * np.abs(pushed).max())


def of_few_columns(share: int) -> Scenario:
    """Fast motion, seen by one of so many columns."""
    scenario = SCENARIOS["paper-fast"]
    pattern = scenario.lidar.pattern
    assert isinstance(pattern, Spinning)
    few = replace(pattern, column_period_ns=share * pattern.column_period_ns)
    return replace(scenario, lidar=replace(scenario.lidar, pattern=few), duration_s=4.0)


@pytest.mark.slow
def test_the_efficient_estimate_errs_as_the_bound_says() -> None:
    """Chi-square of 20 recordings with walking biases. Mutations: leave out what one of the sensors drew (too small), scale
    it by the step instead of its root (too large).
    """
    imu = replace(SCENARIOS["paper-fast"].imu, gyroscope_random_walk=1e-3, accelerometer_random_walk=1e-2)
    scenario = replace(of_few_columns(16), imu=imu, duration_s=5.0, gravity_m_s2=9.807)
    nees = []
    for seed in range(20):
        bound = bound_of(scenario, seed=seed, assumed=Assumptions(step_s=0.005))
        nees.append(bound.efficient_error @ np.linalg.solve(bound.covariance, bound.efficient_error))
    low, high = chi2.ppf([0.0005, 0.9995], 7 * len(nees)) / len(nees)
    assert low < np.mean(nees) < high


def test_what_is_known_helps_and_what_is_left_out_costs() -> None:
    """Fails if what is held as known still costs something, or its columns are those of something else."""
    scenario = of_few_columns(8)
    free = bound_of(scenario, assumed=Assumptions(step_s=0.02))
    held = bound_of(scenario, assumed=Assumptions(step_s=0.02, known=("planes", "gravity", "biases")))
    gated = bound_of(scenario, assumed=Assumptions(step_s=0.02, margin_m=0.12, min_cosine=0.1))
    assert gated.points < free.points
    assert np.all(np.linalg.eigvalsh(gated.covariance - free.covariance) > -1e-12)
    assert np.all(np.linalg.eigvalsh(free.covariance - held.covariance) > -1e-12)
    assert held.translation_mm < 0.8 * free.translation_mm
    assert free.planes == tuple(face.name for face in SCENARIOS["paper-fast"].scene.faces)


def test_furniture_says_nothing() -> None:
    """The person who walks by takes returns away and adds none. Fails if bodies are taken for planes."""
    simulation = prepare("walking-person", seed=1, duration_s=1.0)
    faces = faces_of(simulation)
    seen = returns_of(simulation, simulation.truth, faces, 0)
    assert set(np.unique(seen.plane)) <= set(range(6))
    sweep = simulation.sweep(0)
    assert len(seen.t_s) == int((sweep.valid & (sweep.surface < 6)).sum()) < int(sweep.valid.sum())
    np.testing.assert_allclose(
        np.einsum("ni,ni->n", seen.hit_m, faces.normals[seen.plane]) + faces.offsets_m[seen.plane], 0.0, atol=1e-9
    )
    assert (
        np.median(
            np.abs(
                np.linalg.norm(seen.x_m, axis=1)
                - np.linalg.norm(sweep.xyz_m[sweep.valid & (sweep.surface < 6)], axis=1)
            )
        )
        < 0.03
    )
