"""The bound with real sensors' parameters: its columns against the simulator's own faults, its algebra against dense solves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.bound.blocks import AROUND_S, Blocks, add_to_steps, derivatives
from bench.bound.lidar import faces_of, returns_of, rows_of
from bench.bound.model import Columns
from bench.bound.motion import steps_back
from bench.fault_bounds import ROWS, FaultBoundRow, compute, ignored, in_the_gyroscopes_axes, joint, priors_of
from bench.tables import read_rows
from calib_core.simulate import SCENARIOS, Simulation, parse_faults, prepare

LASERS = 16
BLOCKS = Blocks(LASERS)


def spoiled(faults: str, slug: str = "paper-fast") -> Simulation:
    return prepare(slug, seed=3, duration_s=6.0, noise=False, faults=parse_faults(faults))


def parameters_of(simulation: Simulation) -> np.ndarray:
    """(size,) true values, from what the simulator drew."""
    lidar, imu = simulation.faults.lidar, simulation.faults.imu
    values = np.zeros(BLOCKS.size)
    phase = lidar.eccentricity_phase_rad
    for block, drawn in {
        "gyroscope_scale": imu.gyro_scale,
        "gyroscope_axes": imu.gyro_axes_rad,
        "gyroscope_rotation": imu.gyro_rotation_rad,
        "accelerometer_scale": imu.accel_scale,
        "accelerometer_axes": imu.accel_axes_rad,
        "accelerometer_delay": imu.accel_delay_s,
        "accelerometer_quadratic": imu.accel_quadratic_s2_m,
        "g_sensitivity": imu.g_sensitivity,
        "size_effect": imu.accel_places_m,
        "low_pass_spread": imu.low_pass_moments[0],
        "low_pass_skew": imu.low_pass_moments[1],
        "clock_rate": simulation.faults.clock_rate_ppm,
        "range_offset": lidar.range_offset_m,
        "grazing": lidar.grazing_rad,
        "eccentricity": (lidar.eccentricity_rad * np.cos(phase), lidar.eccentricity_rad * np.sin(phase)),
        "laser_range_offset": lidar.laser_range_offset_m or 0.0,
        "laser_elevation": lidar.laser_elevation_rad or 0.0,
        "laser_azimuth": lidar.laser_azimuth_rad or 0.0,
        "laser_range_scale": lidar.laser_range_scale or 0.0,
    }.items():
        values[BLOCKS.places[block]] = drawn
    return values


@pytest.mark.parametrize(
    "faults",
    [
        "laser-offsets=1e-4",
        "laser-scale=1e-5",
        "laser-elevation=1e-5",
        "laser-azimuth=1e-5",
        "eccentricity=1e-5",
        "range-offset=1e-4",
        "incidence=1e-5",
    ],
)
def test_ranges_err_as_the_columns_say(faults: str) -> None:
    """What the simulator's lasers read too much, against the columns. Mutations: elevation's sign; the laser's ring for its
    channel; sine and cosine of the eccentricity swapped; grazing's sign."""
    simulation = spoiled(faults)
    truth, faces = simulation.truth, faces_of(simulation)
    seen = returns_of(simulation, truth, faces, 45).chosen(slice(None, None, 7))
    normals = np.einsum("nji,nj->ni", seen.R_imu @ truth.R_imu_lidar, faces.normals[seen.plane])
    columns = BLOCKS.range_errors(seen, normals, 0.0, np.zeros(len(seen.t_s)))
    expected = columns @ parameters_of(simulation)
    # Within a column of firings the bound's pose is that of the column, up to 55 us away.
    ideal = returns_of(spoiled(""), truth, faces, 45).chosen(slice(None, None, 7))
    made = seen.range_error_m - ideal.range_error_m
    # Where a ray ends on another plane than it did there is no derivative.
    same = np.abs(made) < 1e-3
    assert same.mean() > 0.99
    np.testing.assert_allclose(made[same], expected[same], atol=2e-3 * np.abs(expected).max())


@pytest.mark.parametrize(
    "faults",
    [
        "gyro-scale=1e-4",
        "imu-axes=1e-4",
        "gyro-rotation=1e-4",
        "accel-scale=1e-4",
        "accel-delay=1e-5",
        "g-sensitivity=1e-5",
        "size-effect=1e-4",
        "accel-bend=1e-6",
        "poles=0.2ms",
    ],
)
def test_readings_err_as_the_columns_say(faults: str) -> None:
    """Mutations: the rotation's sign; the delay's; the axes' matrix transposed; that of the forces felt;
    places by columns; the slope of the turn left out; the filter's spread doubled."""
    faulty, plain = spoiled(faults), spoiled("")
    t_s = plain.imu_messages.true_ns * 1e-9
    truth = plain.truth
    force = plain.imu_messages.accel_m_s2
    values = parameters_of(faulty)
    rates = derivatives(np.stack([truth.imu(t_s + step).omega_rad_s for step in AROUND_S]))
    forces = derivatives(np.stack([at(truth, t_s + step) for step in AROUND_S]))
    gyro = BLOCKS.rate_errors(rates, forces) @ values
    accel = BLOCKS.force_errors(rates, forces) @ values
    for made, expected in (
        (faulty.imu_messages.gyro_rad_s - plain.imu_messages.gyro_rad_s, gyro),
        (faulty.imu_messages.accel_m_s2 - force, accel),
    ):
        np.testing.assert_allclose(made, expected, atol=2e-3 * max(np.abs(expected).max(), 1e-9))


def at(truth: object, t_s: np.ndarray) -> np.ndarray:
    imu = truth.imu(t_s)  # type: ignore[attr-defined]
    return np.einsum("nji,nj->ni", imu.R_world, imu.a_m_s2 - truth.gravity_world_m_s2)  # type: ignore[attr-defined]


def test_a_scale_moves_as_the_bias_that_it_amounts_to() -> None:
    """At a constant rate and force. Mutation: the accelerometer's block through the gyroscope's columns."""
    columns = Columns(biases_walk=False, planes=1, parameters=BLOCKS.size)
    rng = np.random.default_rng(2)
    rate, force = rng.standard_normal((1, 3)), rng.standard_normal((1, 3))
    R = np.linalg.qr(rng.standard_normal((3, 3)))[0][None]
    back = steps_back(R, (R @ force[..., None])[..., 0], 0.01, columns)
    rates, forces = (np.concatenate([at[None], np.zeros((3, 1, 3))]) for at in (rate, force))
    add_to_steps(back, columns, BLOCKS.rate_errors(rates, forces), BLOCKS.force_errors(rates, forces))
    of = {name: columns.extra.start + place.start for name, place in BLOCKS.places.items()}
    np.testing.assert_allclose(
        back[0, :9, of["gyroscope_scale"] + 1], rate[0, 1] * back[0, :9, columns.gyro_bias.start + 1], atol=1e-15
    )
    np.testing.assert_allclose(
        back[0, :9, of["accelerometer_scale"] + 2], force[0, 2] * back[0, :9, columns.accel_bias.start + 2], atol=1e-15
    )


def test_apart_clocks_are_an_offset_that_grows() -> None:
    """A rate's column is the offset's times 1e-6 (t - middle). Mutation: its sign; per second instead of per million."""
    simulation = spoiled("")
    truth, faces = simulation.truth, faces_of(simulation)
    seen = returns_of(simulation, truth, faces, 50).chosen(slice(None, None, 50))
    columns = Columns(biases_walk=False, planes=6)
    rows = rows_of(seen, truth.R_imu_lidar, faces, range(6), np.zeros(len(seen.t_s)), 1.0, columns)
    offset = rows[:, columns.calibration.stop - 1]
    normals = np.einsum("nji,nj->ni", seen.R_imu @ truth.R_imu_lidar, faces.normals[seen.plane])
    made = BLOCKS.range_errors(seen, normals, 3.0, offset)[:, BLOCKS.places["clock_rate"].start]
    np.testing.assert_allclose(made, offset * 1e-6 * (seen.t_s - 3.0))
    assert np.abs(made).max() > 0.0


def test_priors_marginals_and_shifts_are_those_of_a_dense_solve() -> None:
    """Mutations: priors left out; the shift without the noise; a known parameter taken for free."""
    rng = np.random.default_rng(5)
    blocks = Blocks(2)
    triangle = np.linalg.qr(rng.standard_normal((300, blocks.size + 7)), mode="r")
    stds = priors_of(parse_faults("laser-offsets=0.3,accel-scale=0.2,clock-rate=0.5"), blocks)
    free = np.flatnonzero(stds)
    assert len(free) == 2 + 3 + 1
    chosen = [*free, *range(blocks.size, blocks.size + 7)]
    prior = np.diag([*(1.0 / stds[free] ** 2), *np.zeros(7)])
    covariance = np.linalg.inv(triangle[:, chosen].T @ triangle[:, chosen] + prior)
    mine = joint(triangle, stds)
    np.testing.assert_allclose(mine[np.ix_(chosen, chosen)], covariance, rtol=1e-9, atol=1e-12)
    assert not mine[blocks.places["incidence"]].any()
    # Drawn: noise of unit variance and parameters of these stds, solved for the calibration alone.
    J = triangle[:, -7:]
    errors = []
    for _ in range(4000):
        made = rng.standard_normal(len(triangle)) + triangle[:, : blocks.size] @ (
            stds * rng.standard_normal(blocks.size)
        )
        errors.append(np.linalg.lstsq(J, made, rcond=None)[0])
    np.testing.assert_allclose(np.mean(np.square(errors), axis=0), np.diag(ignored(triangle, stds)), rtol=0.1)


def test_what_is_unknown_is_never_certain() -> None:
    """A time offset that nothing tells has no covariance, and no small one. Mutation: `np.linalg.pinv` with its cut-off."""
    triangle = np.triu(np.random.default_rng(5).standard_normal((BLOCKS.size + 7, BLOCKS.size + 7)))
    triangle[:, -1] = 0.0
    with pytest.raises(np.linalg.LinAlgError):
        ignored(triangle, np.zeros(BLOCKS.size))


def test_the_table_is_written_and_a_size_is_asked_for(tmp_path: object, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a thin recording. Mutation: rows of another scenario dropped; the unknowns worse than ignoring them."""
    few = replace(SCENARIOS["paper-fast"].lidar, range_std_m=0.02)
    pattern = replace(few.pattern, column_period_ns=16 * few.pattern.column_period_ns)  # type: ignore[type-var]
    thin = replace(SCENARIOS["paper-fast"], slug="thin", lidar=replace(few, pattern=pattern))
    monkeypatch.setitem(SCENARIOS, "thin", thin)
    for name in ("thin", "thin"):
        compute(name, {"offsets": ROWS["laser offsets 8 mm"], "all": "consumer"}, duration_s=4.0, folder=tmp_path)  # type: ignore[arg-type]
    rows = list(read_rows(tmp_path / "fault_bounds.csv", FaultBoundRow, ()))  # type: ignore[operator]
    assert [row.faults for row in rows] == ["ideal sensors", "offsets", "all"]
    ideal, offsets, everything = rows
    for key in ("rotation_deg", "translation_mm", "offset_ms"):
        assert getattr(ideal, key) <= getattr(offsets, key) <= getattr(everything, key) * (1 + 1e-9)
        assert getattr(everything, key) <= getattr(everything, f"ignoring_{key}")
    assert offsets.left.startswith("laser_range_offset 0.")
    with pytest.raises(ValueError, match="needs a size"):
        priors_of(parse_faults("laser-offsets"), BLOCKS)


def test_the_gyroscopes_frame_is_where_its_readings_turn() -> None:
    """Gyroscopes drawn with axes off square and turned: the polar factor of each one's own matrix times the rotation, against
    the linear rule. Mutations: R_c in place of its transpose; the axes' half left out; a sign."""
    rng = np.random.default_rng(8)
    R_c = Rotation.from_rotvec([0.7, -1.1, 0.4]).as_matrix()
    stds = 1e-4 * rng.uniform(0.5, 2.0, BLOCKS.size + 7)
    turns = []
    for _ in range(3000):
        z = stds * rng.standard_normal(len(stds))
        yx, zx, zy = z[BLOCKS.places["gyroscope_axes"]]
        matrix = np.array([[1.0, 0.0, 0.0], [yx, 1.0, 0.0], [zx, zy, 1.0]])
        matrix = matrix @ Rotation.from_rotvec(z[BLOCKS.places["gyroscope_rotation"]]).as_matrix()
        left, _, right = np.linalg.svd(matrix)
        mean_axes = left @ right @ R_c @ Rotation.from_rotvec(z[BLOCKS.size : BLOCKS.size + 3]).as_matrix()
        turns.append(Rotation.from_matrix(R_c.T @ mean_axes).as_rotvec())
    expected = in_the_gyroscopes_axes(np.diag(stds**2), BLOCKS, R_c)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((np.cov(np.array(turns).T) - expected) / scale).max() < 0.1
