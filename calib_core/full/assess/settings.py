"""Every number of the last stage, with its unit and its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Plausible:
    """Beyond what an answer cannot be true."""

    #: How far averaged distances may stray from what noise allows: squared, in standard deviations, and in metres; both at
    #: once, as a fine lidar shows what a wall is bent by.
    worst_misfit: float = 30.0
    worst_away_m: float = 0.008
    #: How far the mean squared residual of single points may stray before the solve has not explained the data.
    worst_chi2: float = 4.0
    #: Fewer points are no recording of planes.
    fewest_points: int = 1000
    #: No working IMU is off by more than this.
    worst_gyro_bias_rad_s: float = 0.25
    worst_accel_bias_m_s2: float = 2.0
    #: Gravity is nowhere so many standard deviations away, of what is given and of what is found.
    gravity_sigmas: float = 6.0


@dataclass(frozen=True, slots=True)
class Wording:
    """How a direction of the seven parameters is called."""

    #: A direction with so much of its length in one parameter, or in one kind of them, is that one.
    one_parameter: float = 0.95
    one_kind: float = 0.99
    #: Parts of a combination that are named.
    named: float = 0.1
    #: A weak direction has something of a parameter, and advice for it, from this part on.
    concerned: float = 0.3
    #: A component of the rotation is determined where the data alone tell it to this.
    known_deg: float = 5.0
    #: A parameter of a sensor this many of its sigmas from that of an ideal one is said to be off.
    off_sigmas: float = 3.0


@dataclass(frozen=True, slots=True)
class Parts:
    """How a recording is taken apart, and when its parts disagree."""

    #: Of noise alone, so many recordings of a thousand stay below.
    confidence: float = 0.999
    #: Of the recording's length: each still holds seconds of motion, and eight pulls tell a covariance from noise.
    time_blocks: int = 8
    #: Walls are bent over metres, panels and doors are about one wide.
    cell_m: float = 1.0
    #: Digits worth keeping of what a part answers, beside its standard deviation.
    digits: int = 5


@dataclass(frozen=True, slots=True)
class ClockSteps:
    """When stretches of time answer two time offsets."""

    #: A line, a step and a stretch of its own take four: two are left to say whether they fit.
    fewest_blocks: int = 6
    #: Weighted squares about a line: of eight stretches 40 is chance in one recording of two million. Recordings as they are,
    #: shaken and with the faults of cheap sensors too, had 1 to 8; with a step of 1 ms 58, of 5 ms 240 and more.
    misfit: float = 40.0
    #: A step leaves less than this share of what a line leaves: with steps it was 0.04 to 0.24.
    unexplained: float = 0.4


PLAUSIBLE, WORDING, PARTS, CLOCK_STEP = Plausible(), Wording(), Parts(), ClockSteps()
