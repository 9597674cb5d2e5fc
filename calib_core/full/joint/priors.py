"""What is known of the shared unknowns without this recording: standing priors, the user's, gravity's, the biases' walk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.full.joint.settings import CHAIN
from calib_core.full.joint.state import CALIBRATION, GRAVITY, BiasNodes, Estimate, Layout
from calib_core.geometry import log
from calib_core.presets import USUAL_WALK
from calib_core.types import FloatArray


@dataclass(frozen=True)
class PriorRow:
    """One Gaussian statement about the shared state: column, value (of the quantity itself), std."""

    column: int
    value: float
    std: float


@dataclass(frozen=True)
class Held:
    """A direction of the calibration that the data do not determine, held where it is said to be.

    vector: (7,) over [turn from R_reference, translation, time offset], SI.   value: of vector . that.   std: small.
    """

    vector: FloatArray
    value: float
    std: float


@dataclass(frozen=True)
class Priors:
    """Statements that are not measurements of this recording.

    R_reference: rotation priors are turns away from it.   gravity_m_s2, gravity_std_m_s2: std 0 fixes the magnitude.
    standing: on calibration columns 0..6, so wide that they only keep every number finite.   given: on the same columns, what a
    person knows, which the recording is held against (assess/given_values.py).   bias walk densities: per sqrt(s); 0 with a
    single node.   What is known of the sensors' own parameters comes with these (prepare/nuisance.py).
    """

    R_reference: FloatArray
    standing: tuple[PriorRow, ...]
    gravity_m_s2: float
    gravity_std_m_s2: float
    given: tuple[PriorRow, ...] = ()
    gyro_bias_std_rad_s: float = CHAIN.gyro_bias_std_rad_s
    accel_bias_std_m_s2: float = CHAIN.accel_bias_std_m_s2
    gyro_walk: float = USUAL_WALK[0]
    accel_walk: float = USUAL_WALK[1]
    held: tuple[Held, ...] = ()

    @property
    def rows(self) -> tuple[PriorRow, ...]:
        """All that is said of single parameters of the calibration: what stands first, then what was given."""
        return (*self.standing, *self.given)

    def calibration_vector(self, estimate: Estimate) -> FloatArray:
        """(7,): turn from R_reference [rad], translation [m], time offset [s]: what the prior rows speak of."""
        turn = log(self.R_reference.T @ estimate.R_imu_lidar)
        return np.concatenate([turn, estimate.p_imu_lidar, [estimate.time_offset_s]])

    def calibration_information(self) -> FloatArray:
        """(7, 7) that the rows and the held directions add to the calibration's information."""
        total = np.zeros((CALIBRATION, CALIBRATION))
        for row in self.rows:
            total[row.column, row.column] += 1.0 / row.std**2
        for held in self.held:
            total += np.outer(held.vector, held.vector) / held.std**2
        return total


#: Whitened residuals (M,) and their Jacobian over the shared columns (M, S).
_Rows = tuple[FloatArray, FloatArray]


def prior_rows(priors: Priors, nodes: BiasNodes, estimate: Estimate, layout: Layout) -> _Rows:
    """Whitened residuals of all priors (M,) and their Jacobian over the shared columns (M, S)."""
    kinds = [
        _of_calibration(priors, estimate, layout),
        _of_gravity(priors, estimate, layout),
        _of_biases(estimate.gyro_bias, layout.gyro_bias(), layout, nodes, priors.gyro_bias_std_rad_s, priors.gyro_walk),
        _of_biases(
            estimate.accel_bias, layout.accel_bias(), layout, nodes, priors.accel_bias_std_m_s2, priors.accel_walk
        ),
        _of_sensors(estimate, layout),
        *(_together(estimate, layout, place, whitener) for place, whitener in estimate.sensors.blocks.whiteners),
    ]
    return np.concatenate([residual for residual, _ in kinds]), np.concatenate([jacobian for _, jacobian in kinds])


def _of_calibration(priors: Priors, estimate: Estimate, layout: Layout) -> _Rows:
    """What stands, what was given, and directions that are held."""
    now = priors.calibration_vector(estimate)
    vectors = [np.eye(CALIBRATION)[row.column] / row.std for row in priors.rows]
    residual = [(float(now[row.column]) - row.value) / row.std for row in priors.rows]
    vectors += [held.vector / held.std for held in priors.held]
    residual += [(float(held.vector @ now) - held.value) / held.std for held in priors.held]
    jacobian = np.zeros((len(vectors), layout.size))
    jacobian[:, :CALIBRATION] = np.reshape(vectors, (-1, CALIBRATION))
    return np.array(residual), jacobian


def _of_gravity(priors: Priors, estimate: Estimate, layout: Layout) -> _Rows:
    """Its magnitude: one row."""
    magnitude = float(np.linalg.norm(estimate.gravity))
    std = max(priors.gravity_std_m_s2, CHAIN.exact_gravity_m_s2)
    jacobian = np.zeros((1, layout.size))
    jacobian[0, GRAVITY] = estimate.gravity / magnitude / std
    return np.array([(magnitude - priors.gravity_m_s2) / std]), jacobian


def _of_biases(
    values: FloatArray, columns: slice, layout: Layout, nodes: BiasNodes, first_std: float, walk: float
) -> _Rows:
    """Of one sensor's (N, 3), axis by axis: how large at the first node, and how far from each node to the next.

    walk: density, per sqrt(s).
    """
    count, axes = values.shape
    step_std = np.maximum(walk * np.sqrt(np.diff(nodes.times_s)), 1e-9)
    steps = np.diff(values, axis=0) / step_std[:, None]
    later = np.arange(1, count)
    jacobian = np.zeros((axes, count, layout.size))
    for axis in range(axes):
        place = columns.start + axis + axes * np.arange(count)
        jacobian[axis, 0, place[0]] = 1.0 / first_std
        jacobian[axis, later, place[:-1]], jacobian[axis, later, place[1:]] = -1.0 / step_std, 1.0 / step_std
    residual = np.vstack([values[:1] / first_std, steps]).T
    return residual.ravel(), jacobian.reshape(-1, layout.size)


def _of_sensors(estimate: Estimate, layout: Layout) -> _Rows:
    """Of the sensors' own parameters those that are correlated with no other: a row each."""
    sensors = estimate.sensors
    correlated = {k for place, _ in sensors.blocks.whiteners for k in range(place.start, place.stop)}
    alone = np.array([k for k in range(len(sensors.values)) if k not in correlated], np.int64)
    jacobian = np.zeros((len(alone), layout.size))
    jacobian[np.arange(len(alone)), layout.nuisance().start + alone] = 1.0 / sensors.blocks.prior_std[alone]
    return (sensors.values / sensors.blocks.prior_std)[alone], jacobian


def _together(estimate: Estimate, layout: Layout, place: slice, whitener: FloatArray) -> _Rows:
    """Of parameters that are correlated: n rows."""
    jacobian = np.zeros((len(whitener), layout.size))
    start = layout.nuisance().start
    jacobian[:, start + place.start : start + place.stop] = whitener
    return whitener @ estimate.sensors.values[place], jacobian
