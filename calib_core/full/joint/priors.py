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
    rows: on calibration columns 0..6.   bias walk densities: per sqrt(s); 0 with a single node.   What is known of the sensors'
    own parameters comes with these (prepare/nuisance.py).
    """

    R_reference: FloatArray
    rows: tuple[PriorRow, ...]
    gravity_m_s2: float
    gravity_std_m_s2: float
    gyro_bias_std_rad_s: float = CHAIN.gyro_bias_std_rad_s
    accel_bias_std_m_s2: float = CHAIN.accel_bias_std_m_s2
    gyro_walk: float = USUAL_WALK[0]
    accel_walk: float = USUAL_WALK[1]
    held: tuple[Held, ...] = ()

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


def prior_rows(priors: Priors, nodes: BiasNodes, estimate: Estimate, layout: Layout) -> tuple[FloatArray, FloatArray]:
    """Whitened residuals of the priors (M,) and their Jacobian over the shared columns (M, S)."""
    residuals: list[float] = []
    rows: list[FloatArray] = []

    def add(residual: float, columns: list[int], values: FloatArray) -> None:
        row = np.zeros(layout.size)
        row[columns] = values
        residuals.append(residual)
        rows.append(row)

    now = priors.calibration_vector(estimate)
    for row in priors.rows:
        add((float(now[row.column]) - row.value) / row.std, [row.column], np.array([1.0 / row.std]))
    for held in priors.held:
        add((float(held.vector @ now) - held.value) / held.std, list(range(CALIBRATION)), held.vector / held.std)
    magnitude = float(np.linalg.norm(estimate.gravity))
    std = max(priors.gravity_std_m_s2, CHAIN.exact_gravity_m_s2)
    add((magnitude - priors.gravity_m_s2) / std, list(range(layout.size))[GRAVITY], estimate.gravity / magnitude / std)
    for place, values, initial, walk in (
        (layout.gyro_bias().start, estimate.gyro_bias, priors.gyro_bias_std_rad_s, priors.gyro_walk),
        (layout.accel_bias().start, estimate.accel_bias, priors.accel_bias_std_m_s2, priors.accel_walk),
    ):
        for axis in range(3):
            add(values[0, axis] / initial, [place + axis], np.array([1.0 / initial]))
            for k in range(layout.nodes - 1):
                step_std = max(walk * np.sqrt(nodes.times_s[k + 1] - nodes.times_s[k]), 1e-9)
                columns = [place + 3 * k + axis, place + 3 * (k + 1) + axis]
                add((values[k + 1, axis] - values[k, axis]) / step_std, columns, np.array([-1.0, 1.0]) / step_std)
    sensors = estimate.sensors
    correlated = {k for place, _ in sensors.blocks.whiteners for k in range(place.start, place.stop)}
    for k, (value, own) in enumerate(zip(sensors.values, sensors.blocks.prior_std, strict=True)):
        if k not in correlated:
            add(value / own, [layout.nuisance().start + k], np.array([1.0 / own]))
    together = [_together(estimate, layout, place, whitener) for place, whitener in sensors.blocks.whiteners]
    return (
        np.concatenate([np.array(residuals), *(residual for residual, _ in together)]),
        np.concatenate([np.array(rows), *(jacobian for _, jacobian in together)]),
    )


def _together(estimate: Estimate, layout: Layout, place: slice, whitener: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The rows (n,), (n, S) of parameters that are correlated."""
    jacobian = np.zeros((len(whitener), layout.size))
    start = layout.nuisance().start
    jacobian[:, start + place.start : start + place.stop] = whitener
    return whitener @ estimate.sensors.values[place], jacobian
