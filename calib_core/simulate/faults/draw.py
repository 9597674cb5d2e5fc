"""One recording's own draw of the faults that were asked for."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib_core.intrinsics import CLOCK_RATE_STD_PPM, ImuPrior, LidarPrior
from calib_core.simulate.faults.engine import shaken
from calib_core.simulate.faults.imu import IDEAL_IMU, ImuDeviations
from calib_core.simulate.faults.lidar import IDEAL_LIDAR, LidarDeviations, Values
from calib_core.simulate.faults.names import Fault
from calib_core.simulate.faults.room import bent, with_door, with_skirting, with_window
from calib_core.simulate.motion import Motion, Vector
from calib_core.simulate.scene import Scene
from calib_core.types import FloatArray

#: Sizes of what has no prior, each usual. Eccentricity goes with the lasers' angles.
_ECCENTRICITY_OF_ANGLES = 0.4
#: More surfaces than any scene has.
_MATERIALS = 1024
_USUAL = {
    # 2 to 3 mrad is what data sheets call a spinning lidar's beam.
    "incidence": 0.003,
    # MEMS data sheets: some 0.1 deg/s/g.
    "g-sensitivity": 1e-4,
    # Boards with a part for each axis.
    "size-effect": 0.005,
    "low-pass": 40.0,
    # Half the amplitude is gone at 32 Hz, as boards' own filters are often set.
    "poles": 0.005,
    "stamp-latency": 0.0005,
    # The latency timer of the usual USB serial adapter.
    "stamp-bundles": 0.016,
    "imu-repeats": 2.0,
    "scan-latency": 0.0005,
    "stamp-step": 0.001,
    # 0.25 deg/s: eight bits of 32 deg/s, twelve of 512.
    "gyro-step": 0.0043633,
    "voxel-grid": 0.1,
    "vibration": 1.0,
    # 2 to 5 mm off flat over a few metres.
    "bent-walls": 0.003,
    "door-ajar": 0.08,
    "skirting": 0.015,
    "glass": 1.2,
}


@dataclass(frozen=True, slots=True)
class Drawn:
    """What one recording's sensors, clocks and stamps really are; what is not asked for is ideal.

    names: of the faults, with the sizes that were asked for.   stamp_latency_s: mean, 0:
    none.   stamp_bundles_s: between two times at which a driver empties its buffer, 0: it has none.   imu_repeats: how often
    each reading is sent.   scan_latency_s: mean, of the scans, 0: none.   stamp_step_s: of the clock that puts them,
    gyro_step_rad_s: of readings, voxel_grid_m: of cells that were left one point each; 0: none.   The scene and the motion are
    changed by `world`.
    """

    names: tuple[str, ...] = ()
    lidar: LidarDeviations = IDEAL_LIDAR
    imu: ImuDeviations = IDEAL_IMU
    clock_rate_ppm: float = 0.0
    stamp_latency_s: float = 0.0
    stamp_bundles_s: float = 0.0
    imu_repeats: int = 1
    scan_latency_s: float = 0.0
    stamp_step_s: float = 0.0
    gyro_step_rad_s: float = 0.0
    voxel_grid_m: float = 0.0


IDEAL = Drawn()


@dataclass(frozen=True, slots=True)
class Draws:
    """The random numbers of a recording's faults: each fault has its own, whatever else is asked for.

    seeds: of the recording.   channels: of the lidar.   imu_prior, lidar_prior: what is usual for these sensors.
    spins: the lidar has a rotor, and with it an encoder.
    """

    seeds: tuple[int, ...]
    channels: int
    imu_prior: ImuPrior
    lidar_prior: LidarPrior
    spins: bool = True

    def rng(self, name: str) -> np.random.Generator:
        """The fault's own."""
        return np.random.default_rng(np.random.SeedSequence([*self.seeds, zlib.crc32(name.encode())]))

    def lasers(self, name: str, std: float) -> Values:
        """One value a channel."""
        return tuple(float(value) for value in std * self.rng(name).standard_normal(self.channels))

    def axes(self, name: str, std: float) -> Vector:
        """One value an axis."""
        x, y, z = (float(value) for value in std * self.rng(name).standard_normal(3))
        return x, y, z

    def once(self, fault: Fault, usual: float) -> float:
        """What comes once: as asked for, else drawn."""
        if fault.size is not None and not fault.is_drawn:
            return fault.size
        return float((usual if fault.size is None else fault.size) * self.rng(fault.name).standard_normal())


def draw(faults: Sequence[Fault], draws: Draws) -> Drawn:
    """The sensors' own parameters."""
    drawn = Drawn(tuple(fault.text for fault in faults))
    for fault in faults:
        drawn = replace(
            drawn,
            lidar=_lidar(drawn.lidar, fault, draws),
            imu=_imu(drawn.imu, fault, draws),
            clock_rate_ppm=draws.once(fault, CLOCK_RATE_STD_PPM)
            if fault.name == "clock-rate"
            else drawn.clock_rate_ppm,
            stamp_latency_s=_usual(fault) if fault.name == "stamp-latency" else drawn.stamp_latency_s,
            stamp_bundles_s=_usual(fault) if fault.name == "stamp-bundles" else drawn.stamp_bundles_s,
            imu_repeats=round(_usual(fault)) if fault.name == "imu-repeats" else drawn.imu_repeats,
            scan_latency_s=_usual(fault) if fault.name == "scan-latency" else drawn.scan_latency_s,
            stamp_step_s=_usual(fault) if fault.name == "stamp-step" else drawn.stamp_step_s,
            gyro_step_rad_s=_usual(fault) if fault.name == "gyro-step" else drawn.gyro_step_rad_s,
            voxel_grid_m=_usual(fault) if fault.name == "voxel-grid" else drawn.voxel_grid_m,
        )
    return drawn


def _usual(fault: Fault) -> float:
    return _USUAL[fault.name] if fault.size is None else fault.size


def _lidar(found: LidarDeviations, fault: Fault, draws: Draws) -> LidarDeviations:
    prior, name, size = draws.lidar_prior, fault.name, fault.size
    changed = found
    match name:
        case "laser-offsets":
            values = draws.lasers(name, prior.laser_range_offset_std_m if size is None else size)
            changed = replace(found, laser_range_offset_m=values)
        case "laser-scale":
            values = draws.lasers(name, prior.laser_range_scale_std if size is None else size)
            changed = replace(found, laser_range_scale=values)
        case "laser-elevation":
            values = draws.lasers(name, prior.laser_elevation_std_rad if size is None else size)
            changed = replace(found, laser_elevation_rad=values)
        case "laser-azimuth":
            values = draws.lasers(name, prior.laser_elevation_std_rad if size is None else size)
            # A turn of all lasers alike is one of the lidar's frame, which is where they look in the mean.
            changed = replace(found, laser_azimuth_rad=tuple(float(v) for v in np.asarray(values) - np.mean(values)))
        case "eccentricity":
            usual = _ECCENTRICITY_OF_ANGLES * prior.laser_elevation_std_rad
            changed = _eccentric(found, draws.once(fault, usual), draws)
        case "laser-angles":
            std = prior.laser_elevation_std_rad if size is None else size
            for part in ("laser-elevation", "laser-azimuth"):
                changed = _lidar(changed, Fault(part, std), draws)
            changed = _lidar(changed, Fault("eccentricity", _ECCENTRICITY_OF_ANGLES * std, is_drawn=True), draws)
        case "range-offset":
            changed = replace(found, range_offset_m=draws.once(fault, prior.range_offset_std_m))
        case "materials":
            # A wall reads b long at every incidence: beside its own place, as much as ranges are off from head on to a slant.
            std_m = prior.incidence_std_m if size is None else size
            offsets_m = std_m * draws.rng(name).standard_normal(_MATERIALS)
            changed = replace(found, surface_range_offset_m=tuple(offsets_m.tolist()))
        case "incidence":
            changed = replace(found, beam_divergence_rad=_usual(fault))
    return changed


def _eccentric(found: LidarDeviations, size_rad: float, draws: Draws) -> LidarDeviations:
    if not draws.spins:
        return found
    phase = float(draws.rng("eccentricity phase").uniform(0.0, 2.0 * np.pi))
    return replace(found, eccentricity_rad=size_rad, eccentricity_phase_rad=phase)


def _imu(found: ImuDeviations, fault: Fault, draws: Draws) -> ImuDeviations:
    prior, name, size = draws.imu_prior, fault.name, fault.size
    match name:
        case "gyro-scale":
            found = replace(found, gyro_scale=draws.axes(name, prior.gyroscope_scale_std if size is None else size))
        case "accel-scale":
            found = replace(
                found, accel_scale=draws.axes(name, prior.accelerometer_scale_std if size is None else size)
            )
        case "imu-axes":
            gyro, accel = (
                (prior.gyroscope_axes_std_rad, prior.accelerometer_axes_std_rad) if size is None else (size, size)
            )
            found = replace(
                found,
                gyro_axes_rad=draws.axes("gyroscope axes", gyro),
                accel_axes_rad=draws.axes("accelerometer axes", accel),
            )
        case "gyro-rotation":
            std = prior.gyroscope_rotation_std_rad if size is None else size
            found = replace(found, gyro_rotation_rad=draws.axes(name, std))
        case "g-sensitivity":
            values = _usual(fault) * draws.rng(name).standard_normal(9)
            found = replace(found, g_sensitivity=tuple(float(value) for value in values))
        case "accel-delay":
            found = replace(found, accel_delay_s=draws.once(fault, prior.accelerometer_delay_std_s))
        case "accel-bend":
            std = prior.accelerometer_quadratic_std_s2_m if size is None else size
            found = replace(found, accel_quadratic_s2_m=draws.axes(name, std))
        case "size-effect":
            places_m = _usual(fault) * draws.rng(name).standard_normal(9)
            found = replace(found, accel_places_m=tuple(places_m.tolist()))
        case "low-pass":
            found = replace(found, low_pass_hz=_usual(fault))
        case "poles":
            found = replace(found, pole_s=_usual(fault))
    return found


def world(
    scene: Scene, motion: Motion, faults: Sequence[Fault], draws: Draws, home_m: FloatArray
) -> tuple[Scene, Motion]:
    """The scene and the motion with what was asked for. home_m: (3,) the lidar's first place."""
    for fault in faults:
        rng = draws.rng(fault.name)
        match fault.name:
            case "bent-walls":
                scene = bent(scene, _usual(fault), rng)
            case "door-ajar":
                scene = with_door(scene, home_m, _usual(fault), rng)
            case "skirting":
                scene = with_skirting(scene, home_m, _usual(fault))
            case "glass":
                scene = with_window(scene, home_m, _usual(fault), rng)
            case "vibration":
                motion = shaken(motion, _usual(fault), rng)
    return scene, motion
