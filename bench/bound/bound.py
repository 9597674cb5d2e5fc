"""The bound of one simulated recording."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bench.bound.blocks import AROUND_S, Blocks, add_to_steps, derivatives, imu_frame
from bench.bound.eliminate import covariance_of_last, solution_of_last, stepped, triangle_of
from bench.bound.lidar import Faces, Returns, all_returns, faces_of, rows_of
from bench.bound.model import CALIBRATION, Assumptions, Columns, FloatArray
from bench.bound.motion import ImuNoise, drawn_noise, forget_lateness, noise_back, steps_back
from calib_core.simulate import Scenario, Simulation, Truth, prepare

#: A plane that fewer returns came from is not used: its own three unknowns would eat what it says.
LEAST_RETURNS = 1000
#: A uniform law's variances in the square of its width.
_IN_A_SQUARE = 12.0


@dataclass(frozen=True, slots=True)
class Bound:
    """The bound of the 7 calibration parameters. covariance: (7, 7) in the contract's order, SI.   points: used.

    planes: names of those used.   efficient_error: (7,) how far the efficient estimate is from the truth with the noise that
    was really drawn for this seed, in the same order and units: an estimator as good as can be makes this error, too.
    """

    covariance: FloatArray
    points: int
    planes: tuple[str, ...]
    efficient_error: FloatArray

    @property
    def std(self) -> FloatArray:
        """(7,) rad, m, s."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def rotation_deg(self) -> float:
        """Root of the rotation block's trace."""
        return float(np.degrees(np.sqrt(np.trace(self.covariance[:3, :3]))))

    @property
    def translation_mm(self) -> float:
        """Root of the translation block's trace."""
        return float(1e3 * np.sqrt(np.trace(self.covariance[3:6, 3:6])))

    @property
    def offset_ms(self) -> float:
        """The time offset's."""
        return float(1e3 * np.sqrt(self.covariance[6, 6]))


def bound_of(
    scenario: str | Scenario,
    *,
    seed: int = 1,
    duration_s: float | None = None,
    assumed: Assumptions = Assumptions(),  # noqa: B008  frozen
) -> Bound:
    """The bound of a recording of `calib_core.simulate`. To the covariance the seed matters only by which returns were lost."""
    eliminated = _eliminated(prepare(scenario, seed=seed, duration_s=duration_s), assumed, parameters=0)
    triangle = eliminated.triangle
    return Bound(
        covariance_of_last(triangle, CALIBRATION),
        eliminated.points,
        eliminated.planes,
        solution_of_last(triangle, CALIBRATION),
    )


@dataclass(frozen=True, slots=True)
class Eliminated:
    """Everything that moves, and all returns, taken into one triangle about what lasts, the calibration last of it."""

    triangle: FloatArray
    points: int
    planes: tuple[str, ...]


def with_parameters(simulation: Simulation, assumed: Assumptions) -> tuple[FloatArray, Blocks]:
    """(size + 7, size + 7) triangle about the parameters of real sensors, without priors, and the calibration."""
    blocks = Blocks(len(simulation.scenario.lidar.pattern.ring))
    triangle = _eliminated(simulation, assumed, parameters=blocks.size).triangle
    count = blocks.size + CALIBRATION
    information = triangle[-count:, -count - 1 : -1].copy()
    # A turn of all lasers alike is one of the lidar's frame, which is where they look in the mean.
    turns = information[:, blocks.places["laser_azimuth"]]
    turns -= turns.mean(axis=1, keepdims=True)
    return information, blocks


def _eliminated(simulation: Simulation, assumed: Assumptions, *, parameters: int) -> Eliminated:
    truth = simulation.truth
    faces = faces_of(simulation)
    sweeps = list(all_returns(simulation, truth, faces, assumed))
    counts = np.bincount(np.concatenate([s.plane for s in sweeps]), minlength=len(faces.normals))
    numbers = [int(face) for face in np.flatnonzero(counts * assumed.every >= LEAST_RETURNS)]
    columns, noise = unknowns(simulation, assumed, len(numbers), parameters)
    triangle = opening(columns, assumed, truth.gravity_m_s2)
    held = columns.held(assumed.known)
    for back, disturbance, rows, drawn in instants(simulation, truth, faces, numbers, sweeps, columns, noise, assumed):
        back[:, held] = 0.0
        rows[:, held] = 0.0
        triangle = stepped(triangle, back, disturbance, rows, drawn)
    names = tuple(simulation.scenario.scene.faces[face].name for face in numbers)
    return Eliminated(triangle, int(counts[numbers].sum()), names)


def unknowns(
    simulation: Simulation, assumed: Assumptions, planes: int, parameters: int = 0
) -> tuple[Columns, ImuNoise]:
    """The columns and the IMU's noise under the assumptions, with the faults of the recording that only take away what is known:
    readings sent twice are half as many, steps add to their noise, scans are late by what nobody knows."""
    imu, faults = simulation.scenario.imu, simulation.faults
    fewer = np.sqrt(faults.imu_repeats) * assumed.imu_noise_factor
    step_density = faults.gyro_step_rad_s / np.sqrt(_IN_A_SQUARE * imu.rate_hz)
    noise = ImuNoise(
        float(np.hypot(imu.gyroscope_noise_density_rad_s_sqrt_hz, step_density)) * fewer,
        imu.accelerometer_noise_density_m_s2_sqrt_hz * fewer,
        imu.gyroscope_random_walk if assumed.gyro_walk is None else assumed.gyro_walk,
        imu.accelerometer_random_walk if assumed.accel_walk is None else assumed.accel_walk,
    )
    walk = noise.gyro_walk > 0 or noise.accel_walk > 0
    return Columns(walk, planes, parameters, scans_late=faults.scan_latency_s > 0.0), noise


def opening(columns: Columns, assumed: Assumptions, gravity_m_s2: float) -> FloatArray:
    """What is known before the first instant: the frame's gauge, gravity's magnitude, and what is held as known.

    gravity_m_s2: the true one.   Returns (size, size + 1), the right-hand side last.
    """
    gauge = np.zeros((6, columns.size + 1))
    gauge[:3, columns.turn] = gauge[3:, columns.position] = np.eye(3) / assumed.gauge_std
    magnitude = np.zeros((1, columns.size + 1))
    # World z is against gravity: an error upwards makes it smaller.
    magnitude[0, columns.gravity.stop - 1] = 1.0 / assumed.gravity_std_m_s2
    magnitude[0, -1] = (gravity_m_s2 - assumed.gravity_m_s2) / assumed.gravity_std_m_s2
    held = np.eye(columns.size, columns.size + 1)[columns.held(assumed.known)]
    return triangle_of(np.vstack([gauge, magnitude, held]))[: columns.size]


def instants(
    simulation: Simulation,
    truth: Truth,
    faces: Faces,
    numbers: list[int],
    sweeps: list[Returns],
    columns: Columns,
    noise: ImuNoise,
    assumed: Assumptions,
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray, FloatArray]]:
    """Step by step: errors before it from those after it, from its noise, the rows of the returns around its end, and what was
    drawn for its noise."""
    h = assumed.step_s
    first_s, last_s = float(sweeps[0].t_s.min()), float(max(s.t_s.max() for s in sweeps if len(s.t_s)))
    n = int(np.ceil((last_s - first_s) / h)) + 1
    middles_s = np.asarray(first_s + h * (np.arange(n) - 0.5), dtype=np.float64)
    middles = truth.imu(middles_s)
    force = middles.a_m_s2 - truth.gravity_world_m_s2
    back = steps_back(middles.R_world, force, h, columns)
    disturbance = noise_back(force, h, noise, columns)
    drawn = drawn_noise(simulation, truth, middles_s, middles.R_world, h, noise, columns)
    if columns.scans_late:
        scan = np.floor((first_s + h * np.arange(-1, n)) / simulation.scenario.lidar.pattern.period_s)
        forget_lateness(back, disturbance, np.flatnonzero(np.diff(scan)), simulation.faults.scan_latency_s, columns)
    blocks = Blocks(len(simulation.scenario.lidar.pattern.ring))
    if columns.parameters:
        around = [truth.imu(middles_s + step) for step in AROUND_S]
        rates = derivatives(np.stack([each.omega_rad_s for each in around]))
        forces = derivatives(np.stack([imu_frame(each, truth.gravity_world_m_s2) for each in around]))
        add_to_steps(back, columns, blocks.rate_errors(rates, forces), blocks.force_errors(rates, forces))
    scenario = simulation.scenario
    range_std_m = scenario.lidar.range_std_m * assumed.range_noise_factor / np.sqrt(assumed.every)
    pending = iter(sweeps)
    rows = np.zeros((0, columns.size + 1))
    nearest = np.zeros(0, dtype=np.intp)
    more = True
    for number in range(n):
        while more and (len(nearest) == 0 or nearest[-1] <= number):
            seen = next(pending, None)
            if seen is None:
                more = False
                break
            seen = seen.chosen(np.isin(seen.plane, numbers))
            mine = np.rint((seen.t_s - first_s) / h).astype(np.intp)
            after_s = seen.t_s - first_s - h * mine
            new = rows_of(seen, truth.R_imu_lidar, faces, numbers, after_s, range_std_m, columns)
            if columns.scans_late:
                new[:, columns.lateness] = new[:, columns.calibration.stop - 1]
            if columns.parameters:
                normals = np.einsum("nji,nj->ni", seen.R_imu @ truth.R_imu_lidar, faces.normals[seen.plane])
                offset = new[:, columns.calibration.stop - 1] * range_std_m
                middle_s = truth.middle_ns * 1e-9
                new[:, columns.extra] = blocks.range_errors(seen, normals, middle_s, offset) / range_std_m
            rows, nearest = np.vstack([rows, new]), np.concatenate([nearest, mine])
        end = int(np.searchsorted(nearest, number, side="right"))
        yield back[number], disturbance[number], rows[:end], drawn[number]
        rows, nearest = rows[end:], nearest[end:]
