"""What is possible with sensors as they are: bounds with their faults as unknowns, and what ignoring the faults costs.

`python -m bench bound-faults [SCENARIO]`: one elimination of the recording with every parameter of blocks.py as an unknown
without a prior; each row of the table is then a small problem of its own. What is no parameter but takes away from a recording,
as scans whose stamps are late by chance, has an elimination of its own.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.bound import Assumptions, Blocks, with_parameters
from bench.bound.model import CALIBRATION, FloatArray
from bench.store import RESULTS
from bench.tables import append_row, read_rows
from calib_core.simulate import Fault, parse_faults, prepare

FAULT_BOUNDS = "fault_bounds.csv"
#: The row without faults.
IDEAL = "ideal sensors"
#: An estimator that is told of no sensor has to allow for a gyroscope that feels forces, too.
UNTOLD = ", sensors not named"
#: Cheap sensors' faults, as an estimator that is told of no sensor has to allow for them.
_CHEAP = "consumer,g-sensitivity=1.8e-4"
#: The rows of the table; sizes are standard deviations here, also of what comes once.
ROWS = {
    "laser offsets 8 mm": "laser-offsets=8mm",
    "laser angles 0.05 deg": "laser-angles=0.05deg",
    "IMU scale 0.4 %": "gyro-scale=0.4%,accel-scale=0.4%",
    "IMU axes 0.3 deg, triads 0.15 deg": "imu-axes=0.3deg,gyro-rotation=0.15deg",
    "accelerometer 2.5 ms late": "accel-delay=2.5ms",
    "clock 40 ppm": "clock-rate=40",
    "gyroscope feels 0.1 deg/s a g": "g-sensitivity=1.8e-4",
    "industrial": "industrial",
    "consumer": "consumer",
    f"industrial{UNTOLD}": "industrial,g-sensitivity=1.8e-4",
    f"consumer{UNTOLD}": _CHEAP,
}
#: Faults that leave fewer or worse readings, points or stamps: the bound of a recording with them is one of its own.
_TAKES_AWAY = ("scan-latency", "imu-repeats", "gyro-step", "voxel-grid")


def beside(faults: str) -> str:
    """The row of a recording with these, whose estimator is told of no sensor."""
    return f"consumer and {faults}{UNTOLD}"


ROWS |= {beside(name): f"{_CHEAP},{name}" for name in _TAKES_AWAY} | {
    beside("size-effect"): f"{_CHEAP},size-effect=5mm"
}
#: A fault's blocks, each with its share of the fault's size as prior.
_BLOCKS: dict[str, dict[str, float]] = {
    "laser-offsets": {"laser_range_offset": 1.0},
    "laser-elevation": {"laser_elevation": 1.0},
    "laser-azimuth": {"laser_azimuth": 1.0},
    # Amplitude and phase as two components: each has half of the amplitude's variance.
    "eccentricity": {"eccentricity": 0.5**0.5},
    "laser-angles": {"laser_elevation": 1.0, "laser_azimuth": 1.0, "eccentricity": 0.4 * 0.5**0.5},
    "laser-scale": {"laser_range_scale": 1.0},
    "range-offset": {"range_offset": 1.0},
    "gyro-scale": {"gyroscope_scale": 1.0},
    "accel-scale": {"accelerometer_scale": 1.0},
    "imu-axes": {"gyroscope_axes": 1.0, "accelerometer_axes": 1.0},
    "gyro-rotation": {"gyroscope_rotation": 1.0},
    "accel-delay": {"accelerometer_delay": 1.0},
    "accel-bend": {"accelerometer_quadratic": 1.0},
    "g-sensitivity": {"g_sensitivity": 1.0},
    "size-effect": {"size_effect": 1.0},
    "clock-rate": {"clock_rate": 1.0},
}


@dataclass(frozen=True, slots=True)
class FaultBoundRow:
    """One set of faults in a recording of so many seconds.

    rotation_deg, translation_mm, offset_ms: roots of the blocks' traces; gyroscope_rotation_deg: the same for the rotation
    into the gyroscope's mean axes.   ignoring_rotation_deg and the two below: root mean square error, over faults drawn from
    these sizes, of the efficient estimator for ideal sensors.   left: of each block's prior sigma, the part that remains,
    smallest to largest.
    """

    scenario: str
    faults: str
    duration_s: float
    rotation_deg: float
    translation_mm: float
    offset_ms: float
    gyroscope_rotation_deg: float
    ignoring_rotation_deg: float
    ignoring_translation_mm: float
    ignoring_offset_ms: float
    left: str


def priors_of(faults: Sequence[Fault], blocks: Blocks) -> FloatArray:
    """(size,) prior standard deviation of each parameter, 0 where it is known to be ideal."""
    stds = np.zeros(blocks.size)
    for fault in faults:
        if fault.size is None and fault.name in _BLOCKS:
            raise ValueError(f"the bound needs a size for the fault {fault.name}")
        for block, share in _BLOCKS.get(fault.name, {}).items():
            stds[blocks.places[block]] = share * (fault.size or 0.0)
    return stds


def joint(triangle: FloatArray, stds: FloatArray) -> FloatArray:
    """(size + 7, size + 7) covariance with the parameters as unknowns of these prior stds; 0 for those of std 0, known ones.

    triangle: of `with_parameters`.
    """
    size = len(stds)
    free = np.flatnonzero(stds)
    # In units of their priors, so that nothing is lost to their different sizes.
    information = np.vstack([triangle[:, free] * stds[free], np.eye(len(free))])
    rows = np.hstack([information, np.vstack([triangle[:, size:], np.zeros((len(free), CALIBRATION))])])
    root = np.linalg.inv(np.linalg.qr(rows, mode="r"))
    root[: len(free)] *= stds[free, None]
    covariance = np.zeros((size + CALIBRATION, size + CALIBRATION))
    places = np.array([*free, *range(size, size + CALIBRATION)])
    covariance[np.ix_(places, places)] = root @ root.T
    return covariance


def in_the_gyroscopes_axes(covariance: FloatArray, blocks: Blocks, R_imu_lidar: FloatArray) -> FloatArray:
    """(3, 3) of the rotation into the gyroscope's mean axes instead of the accelerometer's. covariance: of `joint`.

    (I + N) Exp(r) with N = symmetric + [a]x turns into them by r + a; R_c Exp(phi) becomes R_c Exp(phi + R_c^T (r + a)).
    """
    half = 0.5 * np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    turn = np.zeros((3, len(covariance)))
    turn[:, blocks.size : blocks.size + 3] = np.eye(3)
    turn[:, blocks.places["gyroscope_rotation"]] = R_imu_lidar.T
    turn[:, blocks.places["gyroscope_axes"]] = R_imu_lidar.T @ half
    return np.asarray(turn @ covariance @ turn.T)


def ignored(triangle: FloatArray, stds: FloatArray) -> FloatArray:
    """(7, 7) mean square error where parameters of these stds are there and taken for ideal."""
    size = len(stds)
    # Not np.linalg.pinv: what its cut-off takes for unknown would be called certain, here it is an error.
    q, root = np.linalg.qr(triangle[:, size:])
    pseudo = np.linalg.solve(root, q.T)
    shift = pseudo @ triangle[:, :size] * stds
    return np.asarray(pseudo @ pseudo.T + shift @ shift.T)


def compute(scenario: str, rows: dict[str, str], *, duration_s: float, folder: Path = RESULTS) -> None:
    """The rows of one scenario, shown and written; rows of other scenarios stay."""
    triangles: dict[tuple[Fault, ...], tuple[FloatArray, Blocks, FloatArray]] = {}
    made = []
    for name, faults in {IDEAL: [], **{name: parse_faults(text) for name, text in rows.items()}}.items():
        taken = tuple(fault for fault in faults if fault.name in _TAKES_AWAY)
        if taken not in triangles:
            simulation = prepare(scenario, seed=1, duration_s=duration_s, faults=taken)
            triangles[taken] = *with_parameters(simulation, Assumptions(every=7)), simulation.truth.R_imu_lidar
        triangle, blocks, R = triangles[taken]
        made.append(_row((scenario, name, duration_s), priors_of(faults, blocks), triangle, blocks, R))
    path = folder / FAULT_BOUNDS
    kept = [
        row for row in read_rows(path, FaultBoundRow, ()) if (row.scenario, row.duration_s) != (scenario, duration_s)
    ]
    path.unlink(missing_ok=True)
    for row in (*kept, *made):
        append_row(path, row, ())
    for row in made:
        sys.stdout.write(
            f"{row.faults:34}{row.rotation_deg:8.4f} deg{row.translation_mm:7.3f} mm{row.offset_ms:8.4f} ms  "
            f"gyroscope's axes: {row.gyroscope_rotation_deg:.4f} deg  ignored: "
            f"{row.ignoring_rotation_deg:7.4f}{row.ignoring_translation_mm:8.3f}{row.ignoring_offset_ms:8.4f}  {row.left}\n"
        )


def _row(
    of: tuple[str, str, float], stds: FloatArray, triangle: FloatArray, blocks: Blocks, R_imu_lidar: FloatArray
) -> FaultBoundRow:
    covariance = joint(triangle, stds)
    gyroscope = in_the_gyroscopes_axes(covariance, blocks, R_imu_lidar)
    left = np.sqrt(np.diag(covariance)[: blocks.size]) / np.where(stds > 0.0, stds, 1.0)
    parts = [
        f"{block} {left[place].min():.2f}-{left[place].max():.2f}"
        for block, place in blocks.places.items()
        if stds[place].any()
    ]
    return FaultBoundRow(
        *of,
        *_norms(covariance[blocks.size :, blocks.size :]),
        float(np.degrees(np.sqrt(np.trace(gyroscope)))),
        *_norms(ignored(triangle, stds)),
        "; ".join(parts),
    )


def _norms(covariance: FloatArray) -> tuple[float, float, float]:
    variances = np.diag(covariance)
    return (
        float(np.degrees(np.sqrt(variances[:3].sum()))),
        float(1e3 * np.sqrt(variances[3:6].sum())),
        float(1e3 * np.sqrt(variances[6])),
    )
