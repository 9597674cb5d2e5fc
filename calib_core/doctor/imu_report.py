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
    StampReport,
)
from calib_core.doctor.stillness import StillSpan, still_spans
from calib_core.presets import GENERIC_IMU, find_imu_preset
from calib_core.readers.imu.readings import GAP_PERIODS, stamp_statistics
from calib_core.types import BoolArray, FloatArray, ImuData, IntArray

_REVERSAL_RAD_S = np.deg2rad(5.0)

#: The narrowest ranges that are sold: 125 deg/s (2.18 rad/s) and 2 g (19.6 m/s2); and a tenth for scale errors.
_LEAST_GYRO_RANGE_RAD_S = 1.96
_LEAST_ACCEL_RANGE_M_S2 = 17.6


def imu_report(
    imu: ImuData,
    *,
    header_ns: IntArray,
    receive_ns: IntArray,
    recording_start_ns: int,
    units: tuple[str, str],
    wanted_preset: str = "",
) -> ImuReport:
    """The report of one IMU; its still spans in the recording's seconds.

    header_ns, receive_ns: stamps in receive order, before cleaning.   units: accelerometer's and gyroscope's, detected.
    """
    spans = still_spans(imu)
    lag_ns = int(np.median(receive_ns - header_ns)) if header_ns.size else 0
    start_s = (int(imu.stamps_ns[0]) + lag_ns - recording_start_ns) * 1e-9
    preset = find_imu_preset(wanted_preset, imu.topic, imu.frame_id)
    shown_preset = preset or GENERIC_IMU
    measured = measured_noise(imu)
    shown = tuple(Span(start_s=round(s.start_s + start_s, 3), end_s=round(s.end_s + start_s, 3)) for s in spans)
    return ImuReport(
        topic=imu.topic,
        frame_id=imu.frame_id,
        readings=int(header_ns.size),
        stamps=stamp_report(header_ns, receive_ns, taken_ns=imu.stamps_ns),
        accelerometer_unit=units[0],
        gyroscope_unit=units[1],
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


def stamp_report(header_ns: IntArray, receive_ns: IntArray, *, taken_ns: IntArray | None = None) -> StampReport:
    """Regularity of stamps given in receive order. taken_ns: increasing, those that are used where they are others."""
    statistics = stamp_statistics(header_ns, receive_ns, taken_ns=taken_ns)
    period_ns = statistics.period_s * 1e9
    dropped = 0
    if period_ns > 0:
        steps = np.asarray(np.diff(np.unique(header_ns) if taken_ns is None else taken_ns) / period_ns, np.float64)
        # A step of k periods hides k - 1 messages; beyond GAP_PERIODS it is a gap, counted with them.
        dropped = int(np.sum(np.maximum(np.rint(steps) - 1, 0)[steps > 1.6]))
    return StampReport(
        rate_hz=round(statistics.rate_hz, 4),
        period_s=statistics.period_s,
        jitter_s=statistics.jitter_s,
        duplicates=statistics.n_duplicates,
        rewinds=statistics.n_rewinds,
        gaps=statistics.n_gaps,
        longest_gap_s=statistics.longest_gap_s,
        dropped=dropped,
    )


def _gravity(imu: ImuData, spans: tuple[StillSpan, ...]) -> float:
    rows = np.concatenate([np.arange(s.first, s.last) for s in spans]) if spans else np.arange(imu.stamps_ns.size)
    return float(np.median(np.linalg.norm(imu.accel_m_s2[rows], axis=1)))


def _saturation(imu: ImuData) -> SaturationReport:
    return SaturationReport(
        gyroscope_max_rad_s=float(np.abs(imu.gyro_rad_s).max()),
        accelerometer_max_m_s2=float(np.abs(imu.accel_m_s2).max()),
        gyroscope_clipped_share=clipped_share(imu.gyro_rad_s, _LEAST_GYRO_RANGE_RAD_S),
        accelerometer_clipped_share=clipped_share(imu.accel_m_s2, _LEAST_ACCEL_RANGE_M_S2),
    )


def clipped_share(channels: FloatArray, least_range: float = 0.0) -> float:
    """Share of readings that stay within 0.01 % of an axis's extreme for three readings or more in a row.

    A smooth peak leaves its summit at once; a clipped one is flat.   channels: (Q, 3).   least_range: in the same unit;
    no sensor clips below it: readings that are alike there are coarse, or repeated by the driver.
    """
    worst = 0.0
    for axis in range(3):
        values = channels[:, axis]
        for extreme in (values.max(), values.min()):
            if abs(extreme) < least_range or abs(extreme) < 0.2 * np.abs(channels).max() or extreme == 0:
                continue
            at = np.abs(values - extreme) <= 1e-4 * abs(extreme)
            edges = np.flatnonzero(np.diff(np.concatenate([[False], at, [False]]).astype(np.int8)))
            runs = np.diff(edges.reshape(-1, 2), axis=1)
            worst = max(worst, float(runs[runs >= 3].sum()) / values.size)
    return worst


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
    alpha = np.gradient(rates, times_s, axis=0)
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
    """Moving mean over about 50 ms: peaks and angular accelerations of motion, not of noise."""
    period_ns = float(np.median(np.diff(stamps_ns)))
    width = max(1, round(5e7 / max(period_ns, 1.0)))
    kernel = np.ones(width) / width
    return np.stack([np.convolve(rates[:, a], kernel, mode="same") for a in range(3)], axis=1)


def _reversals(rates: FloatArray) -> int:
    count = 0
    for axis in range(3):
        strong = rates[np.abs(rates[:, axis]) > _REVERSAL_RAD_S, axis]
        count += int(np.count_nonzero(np.diff(np.sign(strong))))
    return count


def _axes(values: FloatArray) -> Axes:
    return float(values[0]), float(values[1]), float(values[2])
