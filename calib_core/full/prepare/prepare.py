"""The first stage: when the readings were taken, how noisy they are, and how they are to be interpolated."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from calib_core.errors import Refused
from calib_core.events import LogEvent, OnEvent, ShouldCancel, StageEvent
from calib_core.full.prepare.clocks import clocks_of, look
from calib_core.full.prepare.coarse_stamps import exact_stamps, imu_step, point_step, scan_step
from calib_core.full.prepare.imu_noise import noise_of
from calib_core.full.prepare.imu_stamps import as_taken, with_lost
from calib_core.full.prepare.settings import LENGTH, NOISE, SWEEPS
from calib_core.full.prepare.sieve import Sieve, in_words, sieve_of
from calib_core.full.prepare.sweep_stamps import begun_evenly, late_ns
from calib_core.full.run import Clocks, ImuNoiseLevel, Run, StampStep
from calib_core.gp.training import fit_hyper
from calib_core.imu.clipped_readings import unclipped
from calib_core.imu.clipping import clipped, clipped_text
from calib_core.imu.preintegration import NoiseDensity
from calib_core.imu.quantisation import coarse_text
from calib_core.presets import by_preset_names
from calib_core.settings import CalibrateSettings, ImuNoise
from calib_core.types import IntArray, Recording

#: What helps where readings are clipped, as a clause after one that names the sensor.
LESS_CLIPPED = "move more gently, or widen its range"


def require_length(recording: Recording, purpose: str, advice: str = "") -> None:
    """Raises Refused where the recording is too short for anything. purpose: what for, "a calibration"."""
    scans, readings = len(recording.scans), len(recording.imu.stamps_ns)
    if scans < LENGTH.fewest_scans or readings < LENGTH.fewest_readings:
        raise Refused(
            "recording.too_short",
            f"{purpose} needs at least {LENGTH.fewest_scans} scans and {LENGTH.fewest_readings} IMU readings, the recording has "
            f"{scans} and {readings}{advice}",
        )


def require_order(stamps_ns: IntArray, what: str) -> None:
    """Raises Refused where stamps (N,) do not increase. `load` has them in order; a `Recording` that a script made may not.

    what: they are of, in words.
    """
    late = np.flatnonzero(np.diff(stamps_ns) <= 0)
    if late.size:
        raise Refused(
            "recording.order",
            f"{what} have to come in order, each once: number {late[0] + 1} (from 0) is stamped no later than the one before;"
            " sort them by stamp and drop what is there twice",
        )


def prepare(recording: Recording, settings: CalibrateSettings, on_event: OnEvent, should_cancel: ShouldCancel) -> Run:
    """The run that all stages share: both clocks, when readings were taken, the IMU's noise and interpolation.

    Raises Refused where stamps are out of order, SettingsError for a sensor of an unknown name. What is found of the recording
    on the way is said to on_event. The fit of the interpolation goes on in the background.
    """
    settings = by_preset_names(settings)
    on_event(StageEvent(stage="planes", fraction=0.0, text="noise of the IMU"))
    require_order(recording.imu.stamps_ns, "IMU readings")
    stamps_ns = np.array([scan.stamp_ns for scan in recording.scans], dtype=np.int64)
    steps = _steps(recording, stamps_ns, settings)
    _say_exact(recording, stamps_ns, settings, on_event)
    recording, imu_line = as_taken(recording, settings, on_event)
    cut = unclipped(recording.imu)
    shares = clipped(recording.imu)
    recording = recording if cut is None else replace(recording, imu=cut.imu)
    recording, lost = with_lost(recording, settings, on_event)
    stamped = look(recording, stamps_ns)
    require_order(stamped.stamps_ns, "scans")
    sieve = _sieve(recording, stamped.period_s, settings, on_event)
    recording, seen, sweeps_line = begun_evenly(recording, stamped, settings, on_event)
    clocks = replace(
        clocks_of(recording, seen),
        line=imu_line.beside(sweeps_line),
        late_ns=late_ns(stamped, seen),
        steps=steps,
        sieve_std_s=0.0 if sieve is None else sieve.std_s,
    )
    imu = recording.imu
    if text := clipped_text(shares):
        text += f"; its scale, axes and delay may be wrong because of this: {LESS_CLIPPED}"
        on_event(LogEvent(level="warning", code="imu.clipped", text=text))
    noise = _imu_noise(recording, settings, clocks, on_event)
    if text := coarse_text(clocks.imu_s, imu, noise.density):
        on_event(LogEvent(level="warning", code="imu.coarse", text=text))
        noise = replace(noise, coarse=True)
    # A thread of its own, not one of the shared workers: it goes on for seconds.
    pool = ThreadPoolExecutor(1)
    values = np.hstack([imu.gyro_rad_s, imu.accel_m_s2])
    training = pool.submit(fit_hyper, clocks.imu_s, values, noise_std=noise.sample_std)
    pool.shutdown(wait=False)
    return Run(
        recording, settings, clocks, noise, training, on_event, should_cancel,
        farthest_m=seen.farthest_m, nearest_m=seen.nearest_m if seen.nearest_m < SWEEPS.blind_m else 0.0,
        sieve_m=0.0 if sieve is None else sieve.cell_m,
        restored=cut if lost is None else lost.after(cut),
    )  # fmt: skip


def _steps(recording: Recording, stamps_ns: IntArray, settings: CalibrateSettings) -> tuple[StampStep, ...]:
    """The steps of stamps and point times that are cut to a clock's ticks, but for those that the settings take as stamped."""
    found: list[StampStep | None] = []
    if settings.imu_sampling != "as-stamped":
        found.append(imu_step(recording.imu))
    if settings.lidar_sampling != "as-stamped":
        topic = recording.lidar.topic
        found += [scan_step(stamps_ns, topic), point_step(recording.scans, topic)]
    return tuple(step for step in found if step is not None)


def _say_exact(recording: Recording, stamps_ns: IntArray, settings: CalibrateSettings, on_event: OnEvent) -> None:
    """Says which sensor's stamps are multiples of their own period: they are taken for exact, and may be cut by the driver."""
    said: list[str | None] = []
    if settings.imu_sampling != "as-stamped" and not recording.imu.stamp_step_ns:
        said.append(exact_stamps(recording.imu.stamps_ns, recording.imu.topic or "the IMU"))
    if settings.lidar_sampling != "as-stamped":
        said.append(exact_stamps(stamps_ns, recording.lidar.topic or "the lidar"))
    for text in filter(None, said):
        on_event(LogEvent(level="info", code="clock.exact", text=text))


def _sieve(recording: Recording, period_s: float, settings: CalibrateSettings, on_event: OnEvent) -> Sieve | None:
    """The grid that the clouds were thinned by, None for none; said."""
    found = None if settings.cloud == "as-sent" else sieve_of(recording.scans, period_s)
    if found is not None:
        text = in_words(found, recording.lidar.topic or "the lidar")
        on_event(LogEvent(level="warning", code="points.thinned", text=text))
    return found


def _imu_noise(recording: Recording, settings: CalibrateSettings, clocks: Clocks, on_event: OnEvent) -> ImuNoiseLevel:
    """The densities the user gave, else what is measured: never a number taken on trust while the data can tell.

    A preset's name tells which IMU it is, not how noisy this one is: its priors and its walks count (nuisance.py, presets).
    Densities that were given count as they are; where the readings scatter by more, that is said.
    """
    imu, given = recording.imu, settings.imu_noise
    level, _ = noise_of(clocks.imu_s, imu)
    measured = np.array([level.density.gyro_rad_s_sqrt_hz[0], level.density.accel_m_s2_sqrt_hz[0]])
    if isinstance(given, ImuNoise):
        two = np.array([given.gyroscope_noise_density_rad_s_sqrt_hz, given.accelerometer_noise_density_m_s2_sqrt_hz])
        times = measured / two
        if times.max() > NOISE.contradicted:
            sensor = ("gyroscope", "accelerometer")[int(np.argmax(times))]
            text = (
                f"the {sensor}'s readings scatter {times.max():.1f} times as much as the given noise, by {level.source}: the "
                "error bars rest on the given noise, and may be too narrow"
            )
            on_event(LogEvent(level="warning", code="imu.noise_given", text=text))
        density, period = np.repeat(two, 3), float(np.median(np.diff(clocks.imu_s)))
        return ImuNoiseLevel(NoiseDensity(density[:3], density[3:]), density / np.sqrt(period), "the densities given")
    on_event(
        LogEvent(
            level="info",
            code="imu.noise",
            text=f"IMU noise from {level.source}: gyroscope {measured[0]:.2g} rad/s/√Hz, "
            f"accelerometer {measured[1]:.2g} m/s²/√Hz",
        )
    )
    return level
