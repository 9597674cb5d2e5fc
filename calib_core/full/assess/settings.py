"""Every number of the last stage, with its unit and its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Plausible:
    """Beyond what an answer cannot be true."""

    #: judged: how far averaged distances may stray from what noise allows: squared, in standard deviations, and in metres;
    #: both at once, as a fine lidar shows what a wall is bent by. Bent walls of 5 mm are answered
    #: (bench/results/faults.md), a motion that is wrong is off by centimetres.
    worst_misfit: float = 30.0
    worst_away_m: float = 0.008
    #: judged: how far the mean squared residual of single points may stray before the solve has not explained the data:
    #: twice the noise that was found in that very recording.
    worst_chi2: float = 4.0
    #: judged: fewer points are no recording of planes. A single scan has more.
    fewest_points: int = 1000
    #: derived: a plane with less than this share of the points moves nothing by a hundredth of what the others know.
    unseen_share: float = 1e-4
    #: judged: 14 deg/s and a fifth of gravity, beyond the limits on sheets of all but the worst parts; no working IMU is
    #: off by more than this. What is, is refused with that reason.
    worst_gyro_bias_rad_s: float = 0.25
    worst_accel_bias_m_s2: float = 2.0
    #: derived: gravity is nowhere so many standard deviations away, of what is given and of what is found: one in five
    #: hundred million of a normal law.
    gravity_sigmas: float = 6.0


@dataclass(frozen=True, slots=True)
class Wording:
    """How a direction of the seven parameters is called."""

    #: derived: a direction with so much of its length in one parameter is within 18 deg of it, in one kind of them within 8
    #: deg, and is called that one. Words alone depend on it.
    one_parameter: float = 0.95
    one_kind: float = 0.99
    #: judged: parts of a combination that are named. Words alone depend on it.
    named: float = 0.1
    #: judged: a component of the rotation is determined where the data alone tell it to this: ten times the limit of weak.
    #: Beyond, with no component, the answer is refused.
    known_deg: float = 5.0
    #: derived: a parameter of a sensor this many of its sigmas from that of an ideal one, one in 370 of a normal law, is
    #: said to be off. Words alone depend on it.
    off_sigmas: float = 3.0
    #: judged: of a weak answer from less than this share of the scans it is said what the others lacked, and not how to turn. The
    #: advice alone depends on it.
    most_scans: float = 0.5
    #: judged: what the sensors' own errors cost is said where some error bar is half as wide again for them, of all that are a
    #: twentieth wider; what one kind of them that was not estimated could do, where a bar is a twentieth wider for it. Words
    #: alone depend on it.
    costly: float = 1.5
    counted: float = 1.05


@dataclass(frozen=True, slots=True)
class Parts:
    """How a recording is taken apart, and when its parts disagree."""

    #: derived: of noise alone, 999 recordings of a thousand stay below: a warning in one good recording of a thousand for
    #: each kind of part.
    confidence: float = 0.999
    #: judged: of the recording's length: each still holds seconds of motion, and eight pulls tell a covariance from noise.
    #: How widened error bars are, where parts disagree, depends on it.
    time_blocks: int = 8
    #: measured: stretches of time that disagree by more times what noise allows contradict each other. With a shaken IMU (8.4
    #: times) and with cheap sensors taken for ideal (6.3) answers were off by squares of 120 and 97 where 7 is usual, for all the
    #: widening.
    torn: float = 5.0
    #: judged: walls are bent over metres, panels and doors are about one wide. How widened error bars are, where walls are
    #: bent, depends on it.
    cell_m: float = 1.0
    #: derived: parameters of sensors that are asked at once: each column is as long as the recording, half a megabyte a minute.
    parameters_at_once: int = 16
    #: derived: digits worth keeping of what a part answers: its standard deviation is known to one or two, and three more
    #: are of no loss to whoever adds parts up.
    digits: int = 5


@dataclass(frozen=True, slots=True)
class Given:
    """When the recording contradicts what a person gave."""

    #: derived: one in two million of a normal law; what a person gives is not known better than that.
    sigmas: float = 5.0
    #: derived: a descent ends within a seven-hundredth of the answer's sigma: of what the recording says of a value that was
    #: given a thousand times as sharply (the root of this), it is off by one and a half of its own, and may not pass for five.
    least_told: float = 1e-6
    #: derived: a prior of gravity that tells nothing: a hundred times what a solve knows it to (0.01).
    loose_gravity_m_s2: float = 1.0
    #: derived: turns and shifts by which planes move as one, which nothing tells of them.
    frame: int = 6


@dataclass(frozen=True, slots=True)
class ClockSteps:
    """When stretches of time answer two time offsets."""

    #: derived: a line, a step and a stretch of its own take four: two are left to say whether they fit.
    fewest_blocks: int = 6
    #: derived: weighted squares about a line: of eight stretches, two of them taken by the line, 40 is chance in one
    #: recording of two million. Measured beside it: recordings as they are, shaken and with the faults of cheap sensors
    #: too, had 1 to 8; with a step of 1 ms 58, of 5 ms 240 and more.
    misfit: float = 40.0
    #: measured: with steps, a step left 0.04 to 0.24 of what a line leaves; it has to leave less than this share.
    unexplained: float = 0.4
    #: derived: a stretch that knows the time so many times worse than the best has a hundredth of its weight or less. That much
    #: it has to say in any line; what it is off by is its own fault.
    telling: float = 10.0
    #: derived: what stretches know of the time goes with the square of their turning, and with how they lie to the walls, which
    #: makes this factor either way; one that seems to know more for its turning than most by more than that has it of noise.
    most_told: float = 4.0
    #: derived: a stretch that asks for more than this is no clock's, but arithmetic that has broken down: a solve ends within
    #: a sweep of where it began.
    most_s: float = 1.0
    #: judged: readings of so long are taken together to see a turning through their noise; hands turn to and fro slower.
    together_s: float = 0.05


@dataclass(frozen=True, slots=True)
class Silence:
    """When an IMU's silence breaks a recording in two."""

    #: derived: of scans further apart than a linear start takes (Linear.most_gap_s) nothing is told by what the IMU felt.
    least_s: float = 0.35


@dataclass(frozen=True, slots=True)
class AccelerometersApart:
    """When an IMU's accelerometers are taken to be in different places."""

    #: judged: allowed while they are asked for: boards with a part for each axis have them within it.
    tried_m: float = 0.02
    #: derived: of the six by which three are beside their middle, what is told to less than a quarter of that variance is told by
    #: the data rather than by what is allowed, and two leave a place of one of them open: three tell something of each.
    known: float = 0.25
    fewest: int = 3
    #: derived: the same where they are allowed no more than they turned out to be.
    told: float = 0.9
    #: derived: chance alone makes as much in one recording of a million.
    chance: float = 1e-6
    #: judged: a chip has them within a millimetre.
    least_m: float = 1e-3
    #: data sheets: IMUs of rigs are a decimetre across at most (KVH 1750: 89 mm), so that none has them farther from its middle.
    #: What asks for more is a wall that is no plane or a track that went astray, and takes the lever arm with it.
    most_m: float = 0.05
    #: derived: a size is known to a third at best from six numbers: steps of a fiftieth are finer than that.
    step: float = 1.02


@dataclass(frozen=True, slots=True)
class Bending:
    """When an IMU's accelerometers are taken to bend."""

    #: derived: what the data tell to less than nine tenths of the variance that is allowed beforehand; of the rest they say next
    #: to nothing. One direction is enough.
    known: float = 0.9
    fewest: int = 1
    #: derived: all of them bend by about what is allowed, so that one recording in a thousand in which chance makes as much is
    #: none the worse for it; what is left unseen is off by four standard deviations at the most.
    chance: float = 1e-3


@dataclass(frozen=True, slots=True)
class FirstLook:
    """Whether something may show that is asked at the end of a solve, told while lasers are held."""

    #: derived: as if errors were so many times what is stated: twice the square. Where lasers follow, what an IMU's parts do
    #: explains 1 / (1 - c^2) times as much, c the correlation of the two, which is below 0.7 by far.
    narrower: float = 0.7


@dataclass(frozen=True, slots=True)
class Filtered:
    """When an IMU's low-pass filter is taken to do more than delay."""

    #: derived: allowed while they are asked for: two poles of 7 ms, behind which half of the amplitude is gone at 23 Hz, have a
    #: spread of 1e-4, two of 10 ms a skew of 4e-6.
    spread_s2: float = 1e-4
    skew_s3: float = 4e-6
    #: derived: a pole with a spread v has a skew of 2 v^1.5, two equal ones of 1.4 v^1.5, a mean over a while none.
    skew_of_spread: float = 1.5
    #: derived: as with accelerometers apart: by the data rather than by what is allowed. Slow motion tells nothing of it.
    known: float = 0.25
    fewest: int = 1
    #: derived: every IMU has some of both, so that one recording in a thousand in which chance makes as much is none the worse.
    chance: float = 1e-3


PLAUSIBLE, WORDING, PARTS, GIVEN = Plausible(), Wording(), Parts(), Given()
CLOCK_STEP, SILENCE, APART, BENDING = ClockSteps(), Silence(), AccelerometersApart(), Bending()
FILTERED, LOOK = Filtered(), FirstLook()
