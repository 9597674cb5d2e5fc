"""Every number of the first stage, with its unit and its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Length:
    """What a recording has to have at all."""

    #: With less there is nothing to compare: a second of a usual lidar, half a second of a slow IMU.
    fewest_scans: int = 10
    fewest_readings: int = 50


@dataclass(frozen=True, slots=True)
class Noise:
    """White noise of the IMU, and the standstill that tells it best."""

    #: Densities below which no MEMS or fibre-optic sensor has been: what a noise-free or coarse recording is held to.
    gyro_floor_rad_s_sqrt_hz: float = 1e-6
    accel_floor_m_s2_sqrt_hz: float = 1e-5
    #: A channel's step is looked for among so many readings.
    resolution_readings: int = 20000
    #: A shorter standstill tells less of noise than the rest of the recording, and one shorter than the latter nothing.
    least_still_s: float = 2.0
    shortest_still_s: float = 0.5
    #: Hands, legs and machines move a sensor up to here; in a standstill only drift does.
    motion_hz: float = 8.0
    drift_hz: float = 1.0
    #: Noise of all frequencies and of low ones agree within so many standard deviations of the latter: then it is white.
    white_sigmas: float = 3.0
    #: Standing still is judged by blocks of this length, of so many readings at least.
    block_s: float = 0.25
    fewest_in_block: int = 4
    fewest_blocks: int = 3
    #: Readings are taken to scatter by this at least: coarse ones do not at all.
    least_gyro_rad_s: float = 1e-4
    least_accel_m_s2: float = 1e-3
    #: A still block scatters by so many times the noise and this: a floor's or an engine's trembling.
    block_sigmas: float = 2.0
    trembling_rad_s: float = 2e-3
    trembling_m_s2: float = 2e-2
    #: Its mean is that of the first block within so many standard deviations of a mean, and this: drift by temperature.
    mean_sigmas: float = 6.0
    drift_rad_s: float = 4e-3
    drift_m_s2: float = 4e-2
    #: A bias is not larger than this (7 deg/s); what turns faster turns.
    most_bias_rad_s: float = 0.12


@dataclass(frozen=True, slots=True)
class Spectrum:
    """The floor of the readings' spectrum."""

    #: Half bandwidths of the tapers, and how many: the last of four keeps all but 1e-9 of a line's power to its place.
    half_bandwidths: float = 6.0
    tapers: int = 4
    #: Longer segments part lines better, shorter ones average more: three quarters of a hertz to each side;
    segment_s: float = 8.0
    #: they overlap by all but one part in so many, beyond which nothing more is told,
    overlap: float = 4.0
    #: and one of fewer readings has no spectrum.
    fewest_readings: int = 32
    #: A floor is looked for in stretches this wide, a step from one to the next.
    stretch_hz: float = 10.0
    step_hz: float = 1.0
    #: The part of a stretch that is noise alone at the least: a rigid body with an engine on has a dozen lines in 50 Hz.
    least_noise: float = 0.25
    #: Beyond this quantile of the law of noise a value belongs to a line.
    line_quantile: float = 0.99
    #: What goes on as low as it begins: its power falls by less than a fifth from one half to the other,
    fall: float = 1.2
    #: beyond chance of so many standard deviations.
    fall_sigmas: float = 3.0
    #: Most passes until the values that are noise stay the same.
    passes: int = 20


@dataclass(frozen=True, slots=True)
class Stamps:
    """What is said of the IMU's stamps."""

    #: Jitter below this share of the period is not worth a sentence where nothing follows from it.
    worth_saying: float = 0.02
    #: Steps are uneven that differ by more than this share of their median, without those of either tail.
    uneven: float = 0.2
    tail_percent: float = 5.0
    #: Readings below this share of all are not worth a mention.
    worth_counting: float = 0.005


@dataclass(frozen=True, slots=True)
class Sweeps:
    """Whose sweeps are turns of a rotor, and when their stamps are not those of it."""

    #: Points of a scan that its direction is taken from: beams that look 3 deg to either side leave it sure to 0.1 deg, 30
    #: microseconds of a tenth of a second.
    sampled_points: int = 1000
    #: Directions, turned back by the rotor's turn, are one: their mean is as long. A rosette's is half as long.
    turning: float = 0.9
    #: With fewer of the scans on a line there is none.
    least_share: float = 0.8
    #: A rotor is off its line by less: ten times what two real ones were from turn to turn (sweep_stamps.py).
    rotor_s: float = 1e-4


@dataclass(frozen=True, slots=True)
class Lasers:
    """How many lasers there are, from the points themselves."""

    #: Scans that are looked at.
    scans: int = 5
    #: More are no lasers but lines of pixels.
    most: int = 128
    #: A laser with fewer points tells no elevation.
    fewest_points: int = 50
    #: One laser's points vary by less in elevation, without this tail of either side: a cone's, not a rosette's.
    same_elevation_deg: float = 0.35
    tail_percent: float = 10.0


@dataclass(frozen=True, slots=True)
class ToneSizes:
    """How large an unseen shaking may be, one standard deviation of each of its amplitudes."""

    #: Several times what an engine of 3 m/s2 makes of one line, a third of a metre from where the rig turns.
    gyro_std_rad_s: float = 0.1
    accel_std_m_s2: float = 3.0


LENGTH, NOISE, SPECTRUM, STAMPS, LASERS, TONES = Length(), Noise(), Spectrum(), Stamps(), Lasers(), ToneSizes()
SWEEPS = Sweeps()
