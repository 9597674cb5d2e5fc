"""Every number of the first stage, with its unit and its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Length:
    """What a recording has to have at all."""

    #: judged: a second of a usual lidar, half a second of a slow IMU. It decides only which sentence refuses a recording;
    #: twenty seconds have twenty times as many.
    fewest_scans: int = 10
    fewest_readings: int = 50


@dataclass(frozen=True, slots=True)
class Sampled:
    """What a forecast takes of a recording, which reading thins out for it."""

    #: measured over the 18 scenarios with noise (bench/results/forecast.md): with so many points of a scan standing for all of
    #: them, fifteen thousand a second, a forecast's sigmas are 0.94 to 1.02 of the solve's.
    points: int = 1500


@dataclass(frozen=True, slots=True)
class Noise:
    """White noise of the IMU, and the standstill that tells it best."""

    #: data sheets: 0.003 deg per root of an hour and a millionth of gravity, a 44th and an 18th of the least noisy parts
    #: among the presets (calib_core/presets/imu.py). What a noise-free or coarse recording is held to.
    gyro_floor_rad_s_sqrt_hz: float = 1e-6
    accel_floor_m_s2_sqrt_hz: float = 1e-5
    #: derived: a variance of N readings is known to sqrt(2 / N), so 200 readings a second tell the noise to 7 % in two
    #: seconds and to 14 % in half a second. A shorter standstill tells less of noise than the rest of the recording, and
    #: one shorter than the latter nothing.
    least_still_s: float = 2.0
    shortest_still_s: float = 0.5
    #: judged: hands, legs and machines move a sensor up to here; in a standstill only drift does. The noise that is found
    #: without a standstill depends on it.
    motion_hz: float = 8.0
    drift_hz: float = 1.0
    #: derived: of a normal law one in 370 is beyond. Noise of all frequencies and of low ones agree within so many standard
    #: deviations of the latter: then it is white.
    white_sigmas: float = 3.0
    #: measured: a reading scatters as noise makes it, 1.0 times, in twelve calm recordings by cheap sensors, walking persons
    #: about or not; 2.3 to 20 times (gyroscope) and 27 and more (accelerometer) where 18 lines of 25 to 120 Hz shake it by
    #: 0.5 to 3 m/s2.
    shaken: float = 2.0
    #: judged: noise that is given is said to be too little where the readings scatter by so many times as much: error bars are
    #: too narrow by about that then. Words alone depend on it.
    contradicted: float = 1.5
    #: judged: standing still is told by blocks of this length, of so many readings at least, shorter than the pauses of a
    #: hand. A standstill begins and ends that much later or earlier.
    block_s: float = 0.25
    fewest_in_block: int = 4
    fewest_blocks: int = 3
    #: derived: readings are taken to scatter by this at least, a step of 16 bits over 250 deg/s and over 4 g: coarse ones
    #: do not at all.
    least_gyro_rad_s: float = 1e-4
    least_accel_m_s2: float = 1e-3
    #: judged: a still block scatters by so many times the noise and this, a floor's or an engine's trembling. Which
    #: readings count as standing depends on it, and by them the noise.
    block_sigmas: float = 2.0
    trembling_rad_s: float = 2e-3
    trembling_m_s2: float = 2e-2
    #: judged: a still block's mean is that of the first within so many standard deviations of a mean, and this, which is
    #: drift by temperature: 0.2 deg/s, 4 mg. A longer standstill is cut where the bias drifts faster.
    mean_sigmas: float = 6.0
    drift_rad_s: float = 4e-3
    drift_m_s2: float = 4e-2
    #: judged: a bias is not larger than this (7 deg/s); what turns faster turns. Only an evenly turning table could be
    #: taken for standing, and only an IMU that is worse loses its standstill.
    most_bias_rad_s: float = 0.12


@dataclass(frozen=True, slots=True)
class Spectrum:
    """The floor of the readings' spectrum."""

    #: derived: of four tapers of six half bandwidths the last keeps all but 6e-10 of a line's power to its place.
    half_bandwidths: float = 6.0
    tapers: int = 4
    #: derived: six half bandwidths over eight seconds are three quarters of a hertz to each side of a line. Longer segments
    #: part lines better, shorter ones average more.
    segment_s: float = 8.0
    #: judged: segments overlap by all but one part in so many; tapers leave their ends unused, beyond three quarters hardly
    #: anything new is told.
    overlap: float = 4.0
    #: derived: of the sixteen frequencies of so many readings a taper of six half bandwidths spreads one over six to either
    #: side. With fewer there is no spectrum.
    fewest_readings: int = 32
    #: judged: a floor is looked for in stretches this wide, a step from one to the next. Wider ones hold more lines,
    #: narrower ones fewer independent values; the floor's, and so the stated, noise depends on it.
    stretch_hz: float = 10.0
    step_hz: float = 1.0
    #: judged: the part of a stretch that is noise alone at the least; a rigid body with an engine on has a dozen lines of
    #: 1.5 Hz in 50 Hz, which leave more than half.
    least_noise: float = 0.25
    #: judged: beyond this quantile of the law of noise a value belongs to a line; of noise alone one in a hundred does.
    line_quantile: float = 0.99
    #: judged: what goes on as low as it begins is noise: its power falls by less than a fifth from one half to the other,
    fall: float = 1.2
    #: derived: beyond chance of so many standard deviations, one in 370 of a normal law.
    fall_sigmas: float = 3.0
    #: judged: most passes until the values that are noise stay the same. A bound alone.
    passes: int = 20


@dataclass(frozen=True, slots=True)
class Stamps:
    """What is said of the IMU's stamps."""

    #: judged: jitter below this share of the period is not worth a sentence where nothing follows from it. Words alone
    #: depend on it.
    worth_saying: float = 0.02
    #: judged: steps are uneven that differ by more than this share of their median, without those of either tail. Whether
    #: stamps are put on a line depends on it.
    uneven: float = 0.2
    tail_percent: float = 5.0
    #: judged: readings below this share of all are not worth a mention. Words alone depend on it.
    worth_counting: float = 0.005


@dataclass(frozen=True, slots=True)
class Sweeps:
    """Whose sweeps are turns of a rotor, and when their stamps are not those of it."""

    #: derived: beams that look 3 deg to either side, of which no point says which it is of, leave the direction of so many points
    #: sure to 3 / sqrt(1000) = 0.1 deg, 30 microseconds of a tenth of a second.
    sampled_points: int = 1000
    #: measured: where a quarter of the lasers, all of one side, come and go, what their looking aside leaves of a sweep's
    #: direction falls to a third with each pass. Of 9 deg, 2.5 ms of a tenth of a second, so many leave less than a microsecond.
    passes: int = 10
    #: data sheets: lidars for rigs are blind to what is nearer than 0.05 to 1 m (Avia, VLP-16). Where all returns are from beyond
    #: this, nothing was nearer.
    blind_m: float = 1.1
    #: measured: a minute's scans are looked at in 0.10 s of CPU by so many together, in 0.13 s one by one or by 128. Nothing but
    #: time depends on it.
    scans_at_once: int = 32
    #: derived: directions, turned back by the rotor's turn, are one: their mean is as long as a direction. A rosette's, all
    #: over its circle, is half as long or less; what is nearer to one is a rotor's.
    turning: float = 0.9
    #: derived: a packet of sixteen lasers holds 1.3 ms, 9.6 deg at 20 turns a second, and one more or less of them makes two
    #: sweeps in turn look elsewhere by as much. Two that look elsewhere by three times that are no two whole turns.
    alike_rad: float = 0.5
    #: derived: eight blocks of five stamps, of which fewer do not show that a clock wanders (`imu/sample_rows.py`): eight seconds
    #: of a lidar that turns five times a second.
    fewest: int = 40
    #: judged: with fewer of the scans on a line there is none. Stamps stay as they are then.
    least_share: float = 0.8
    #: derived: what packets cut counts twice the wrong way and not at all the right one. With less than half of the errors left
    #: the other way, it is the right one.
    other_way: float = 0.5
    #: measured on two real ones (VLP-16, HDL-32E, sweep_stamps.py): 8 microseconds from turn to turn. A rotor is off its
    #: line by less than ten times that.
    rotor_s: float = 1e-4


@dataclass(frozen=True, slots=True)
class Rotor:
    """What a rotor wanders by, beside what its stamps jitter."""

    #: derived: a smoother that follows nothing shorter than eight times the recording is a line, and one that follows four turns
    #: is no smoother. Between, each period is so much shorter than the one before. Where it follows nothing shorter than six
    #: thousand turns lambda is 1e12: its equations have three digits left.
    longest: float = 8.0
    shortest: float = 4.0
    most_turns: float = 6000.0
    step: float = 1.5
    #: measured: over thirty thousand turns without a scan no digit is left; over a minute's at ten a second all are.
    pause_turns: int = 600
    #: derived: by chance twice the log of a likelihood is greater by so much once in exp(-7), of a parameter that is fitted.
    likelier: float = 14.0


@dataclass(frozen=True, slots=True)
class Steps:
    """Stamps that a clock's ticks cut."""

    #: judged: steps are tenths of a second and down to hundred-thousandths, of which a half is a hundredth of the least time
    #: offset's standard deviation that was ever stated; and ticks of hosts, 64 and 250 a second. Cut otherwise, nothing is said.
    decades: int = 5
    ticks_s: tuple[float, ...] = (0.015625, 0.004)
    #: derived: seconds since 1970 in double precision are rounded by a quarter of a microsecond.
    rounding_s: float = 2.5e-7
    #: derived: a nanosecond cut either way, of stamps that are whole nanoseconds.
    same_ns: int = 2
    #: judged: most clocks that cut stamps count milliseconds. Where they do and sampling keeps step, stamps are multiples of the
    #: sampling's own period by chance in one recording of ten at 100 Hz, in all at 1000 Hz, and multiples of 10 ms in one of
    #: ten. Rarer than in one of so many, such stamps are taken for exact: a clock's that starts the sampling, a receiver's
    #: seconds, a simulation's.
    usual_s: float = 1e-3
    chance: float = 5.0
    #: derived: fewer stamps are multiples by chance, or tell no line.
    fewest_stamps: int = 20
    #: judged: scans that are looked at for the points' times, and instants of a sweep, fewer than any lidar has and as many as
    #: ten milliseconds leave of it.
    scans: int = 10
    fewest_instants: int = 5
    #: derived: columns of a lidar that turns ten times a second are 0.2 deg and 50 microseconds apart, and may be whole tenths of
    #: a millisecond; whole milliseconds would be 3.6 deg.
    least_of_points_s: float = 1e-3
    #: derived: what widens a standard deviation by an eighth is worth a sentence, hypot(1, 0.5) = 1.12.
    worth_saying: float = 0.5


@dataclass(frozen=True, slots=True)
class Sieving:
    """Whether clouds were thinned by a grid."""

    #: judged: cells that people choose, and steps in which they do. What is thinned by another size counts as it came.
    least_m: float = 0.02
    most_m: float = 0.5
    step_m: float = 0.005
    #: judged: clouds that are looked at, and points of the largest that every size is tried on. Time alone depends on it, once
    #: there are thousands.
    scans: int = 20
    first_points: int = 5000
    #: derived: of so many points that share a cell beside, chance would leave none in the grid itself once in e^200 recordings.
    fewest_beside: int = 200
    #: derived: coordinates in single precision are rounded by a ten-millionth of themselves, and one point in a hundred
    #: thousand lies so near to a face; clouds put together of two were thinned by themselves, and share a seam.
    most_shared: float = 0.02
    #: derived: times of the first of a cell's points, evenly over half of the beam's way through it, would scatter directions by
    #: an eighth of that way about their mean; their own scatter them by less.
    in_time: float = 0.125
    #: derived: a packet more or less makes a scan of a tenth of a second longer by a hundredth; of so many turns as long but for
    #: that, the nearest is off by a thousandth, 1.6 mrad for half of the points, and a cell of 10 cm is 20 wide at 5 m.
    uneven: float = 0.01
    periods: int = 21


@dataclass(frozen=True, slots=True)
class Lasers:
    """How many lasers there are, from the points themselves."""

    #: judged: scans that are looked at; the lasers are the same in each.
    scans: int = 5
    #: data sheets: 128 is the most of spinning lidars; more are no lasers but lines of pixels.
    most: int = 128
    #: judged: a laser with fewer points tells no elevation. It is then left without parameters of its own.
    fewest_points: int = 50
    #: judged: one laser's points vary by less in elevation, without this tail of either side: a cone's, not a rosette's.
    #: Whether lasers have parameters of their own depends on it.
    same_elevation_deg: float = 0.35
    tail_percent: float = 10.0
    #: measured: where lasers look to in the mean is the lidar's frame, as published. How far they may be off together, of what as
    #: many independent ones would be: 16 lasers of a real VLP-16 were within 0.04 deg, 0.4 of the prior that elevations need.
    azimuth_together: float = 0.4


@dataclass(frozen=True, slots=True)
class ToneSizes:
    """How large an unseen shaking may be, one standard deviation of each of its amplitudes."""

    #: derived: several times what an engine of 3 m/s2 makes of one line, a third of a metre from where the rig turns. A
    #: prior so wide tells nothing of what it is given to.
    gyro_std_rad_s: float = 0.1
    accel_std_m_s2: float = 3.0


LENGTH, NOISE, SPECTRUM, STAMPS, LASERS, TONES = Length(), Noise(), Spectrum(), Stamps(), Lasers(), ToneSizes()
SWEEPS, ROTOR, SIEVING, STEPS, SAMPLED = Sweeps(), Rotor(), Sieving(), Steps(), Sampled()
