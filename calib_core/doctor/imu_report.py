"""What the IMU saw: excitation per axis, saturation, stillness, noise beside its preset."""

from __future__ import annotations

import numpy as np

from calib_core.doctor.noise import measured_noise, noise_in_words
from calib_core.doctor.report import (
    Axes,
    ExcitationReport,
    ImuNoiseReport,
    ImuReport,
    SaturationReport,
    Span,
)
from calib_core.doctor.stamps import stamp_report
from calib_core.doctor.stillness import StillSpan, still_spans
from calib_core.events import ignore_event
from calib_core.full.prepare.imu_stamps import as_taken
from calib_core.imu.clipping import clipped
from calib_core.presets import GENERIC_IMU, find_imu_preset
from calib_core.readers.imu.readings import CleanedImu
from calib_core.readers.imu.units import usual_norm
from calib_core.settings import CalibrateSettings
from calib_core.stamp_rate import GAP_PERIODS
from calib_core.types import BoolArray, FloatArray, ImuData, IntArray, Recording

_REVERSAL_RAD_S = np.deg2rad(5.0)
_SLOPE_S = 0.025


def imu_report(cleaned: CleanedImu, *, recording_start_ns: int) -> ImuReport:
    """The report of one IMU; its still spans in the recording's seconds."""
    imu, headers = cleaned.imu, cleaned.headers
    stamps = stamp_report(headers.header_ns, headers.receive_ns, taken_ns=imu.stamps_ns)
    # From here on at the times at which a solve takes them: stamps that jitter make any motion look jerky, and noise of it.
    imu = as_taken(Recording("", imu, ()), CalibrateSettings(), ignore_event)[0].imu
    spans = still_spans(imu)
    lag_ns = int(np.median(headers.receive_ns - headers.header_ns))
    start_s = (int(imu.stamps_ns[0]) + lag_ns - recording_start_ns) * 1e-9
    preset = find_imu_preset(imu.topic, imu.frame_id)
    shown_preset = preset or GENERIC_IMU
    measured = measured_noise(imu)
    shown = tuple(Span(start_s=round(s.start_s + start_s, 3), end_s=round(s.end_s + start_s, 3)) for s in spans)
    return ImuReport(
        topic=imu.topic,
        frame_id=imu.frame_id,
        readings=int(headers.header_ns.size),
        stamps=stamps,
        accelerometer_unit=cleaned.accelerometer_unit,
        gyroscope_unit=cleaned.gyroscope_unit,
        gravity_at_rest_m_s2=_gravity(imu, spans),
        saturation=_saturation(imu),
        excitation=excitation(imu, spans),
        still_spans=shown,
        measured_noise=measured,
        preset_noise=ImuNoiseReport(origin=shown_preset.name, noise=shown_preset.noise, source=shown_preset.source),
        preset_identified=preset is not None,
        noise_used="preset" if measured is None else "measured" if measured.static_s > 0 else "moving",
        noise_text=noise_in_words(measured, shown_preset, identified=preset is not None),
    )


def _gravity(imu: ImuData, spans: tuple[StillSpan, ...]) -> float:
    rows = np.concatenate([np.arange(s.first, s.last) for s in spans]) if spans else np.arange(imu.stamps_ns.size)
    return usual_norm(imu.stamps_ns[rows], imu.accel_m_s2[rows])


def _saturation(imu: ImuData) -> SaturationReport:
    gyro_share, accel_share = clipped(imu)
    return SaturationReport(
        gyroscope_max_rad_s=float(np.abs(imu.gyro_rad_s).max()),
        accelerometer_max_m_s2=float(np.abs(imu.accel_m_s2).max()),
        gyroscope_clipped_share=gyro_share,
        accelerometer_clipped_share=accel_share,
    )


def excitation(imu: ImuData, spans: tuple[StillSpan, ...]) -> ExcitationReport:
    """Motion per axis outside the still spans, the gyroscope's resting bias removed."""
    moving: BoolArray = np.ones(imu.stamps_ns.size, bool)
    for span in spans:
        moving[span.first : span.last] = False
    still_rates = imu.gyro_rad_s[~moving]
    bias = np.median(still_rates, axis=0) if still_rates.shape[0] else np.zeros(3)
    rates = _smoothed(imu.gyro_rad_s - bias, imu.stamps_ns)
    used = rates[moving] if moving.any() else rates
    accel = imu.accel_m_s2[moving] if moving.any() else imu.accel_m_s2
    times_s = (imu.stamps_ns - imu.stamps_ns[0]) * 1e-9
    alpha = _slopes(imu.gyro_rad_s, times_s)[moving] if moving.any() else _slopes(imu.gyro_rad_s, times_s)
    values, vectors = np.linalg.eigh(used.T @ used / used.shape[0])
    steps = np.asarray(np.diff(imu.stamps_ns), np.float64) * 1e-9
    unbroken = np.less(steps, GAP_PERIODS * np.median(steps))
    moving_s = float(np.sum(steps[moving[1:] & unbroken]))
    peaks = np.percentile(np.abs(used), 99.5, axis=0)
    return ExcitationReport(
        rotation_rms_deg_s=_axes(np.rad2deg(np.sqrt(np.mean(used**2, axis=0)))),
        rotation_peak_deg_s=_axes(np.rad2deg(peaks)),
        angular_acceleration_peak_deg_s2=_axes(np.rad2deg(np.percentile(np.abs(alpha), 99.5, axis=0))),
        acceleration_rms_m_s2=_axes(accel.std(axis=0)),
        axis_condition=float(values[2] / max(values[0], 1e-12 * max(values[2], 1e-30))),
        rotation_reversals=_reversals(rates),
        weakest_axis=_axes(vectors[:, 0]),
        weakest_axis_rms_deg_s=float(np.rad2deg(np.sqrt(max(values[0], 0.0)))),
        moving_s=round(moving_s, 3),
    )


def _smoothed(rates: FloatArray, stamps_ns: IntArray) -> FloatArray:
    """Moving mean over about 50 ms: peaks of motion, not of noise."""
    period_ns = float(np.median(np.diff(stamps_ns)))
    width = max(1, round(5e7 / max(period_ns, 1.0)))
    kernel = np.ones(width) / width
    return np.stack([np.convolve(rates[:, a], kernel, mode="same") for a in range(3)], axis=1)


def _slopes(rates: FloatArray, times_s: FloatArray) -> FloatArray:
    """(Q, 3) [rad/s2] of lines through the readings within 25 ms on either side, two at the least.

    Of a motion that a rig is given they keep 0.95 at 3 Hz; steps between two stamps that came at once make none.
    """
    reach = max(2, round(_SLOPE_S / max(float(np.median(np.diff(times_s))), 1e-9)))
    ends = np.pad(times_s, reach, mode="edge"), np.pad(rates, ((reach, reach), (0, 0)), mode="edge")
    count = len(times_s)
    time, rate, both, square = np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count)
    for step in range(2 * reach + 1):
        away_s, other = ends[0][step : step + count] - times_s, ends[1][step : step + count] - rates
        time, rate = time + away_s, rate + other
        both, square = both + away_s[:, None] * other, square + away_s**2
    width = 2 * reach + 1
    spread = np.maximum(square - time**2 / width, 0.0)
    least = 0.25 * float(np.median(spread))  # readings that came in one bundle tell no slope
    slopes = (both - time[:, None] * rate / width) / np.maximum(spread, max(least, 1e-12))[:, None]
    return np.asarray(slopes)


def _reversals(rates: FloatArray) -> int:
    count = 0
    for axis in range(3):
        strong = rates[np.abs(rates[:, axis]) > _REVERSAL_RAD_S, axis]
        count += int(np.count_nonzero(np.diff(np.sign(strong))))
    return count


def _axes(values: FloatArray) -> Axes:
    return float(values[0]), float(values[1]), float(values[2])
