"""Every number of the start values, with its unit and its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Lags:
    """At which lags the turns of lidar and gyroscope are compared."""

    #: derived: rates are laid on a grid of 20 ms: a hand's swings of up to 5 Hz have ten of its steps, and a parabola
    #: refines the lag later.
    grid_hz: float = 50.0
    #: judged: the lidar's turns between scans so many apart, beside those within sweeps: more scans, less noise, slower
    #: motion. Each gives lags of its own, of which the best goes on.
    apart_scans: tuple[int, ...] = (1, 3)
    #: judged: spans above so many times this percentile are cut off: a few leaps of a track would outweigh all the rest. An
    #: honest motion is hardly cut at all.
    top_percent: float = 90.0
    top_times: float = 2.0
    #: judged: recordings overlap at a lag by so much at least, or that share of the lidar's, or half of the shorter one. A
    #: shorter overlap correlates by chance; lags that are further off are not found.
    overlap_s: float = 8.0
    overlap_share: float = 0.3
    half_overlap: float = 0.5
    #: judged: so many best lags go on, so far apart: a hand's to and fro repeats itself after half a second. Each is tried
    #: by its rotation, so that too many cost time alone.
    candidates: int = 6
    apart_s: float = 0.25
    #: judged: what a machine does over and over is as good a match after each of its rounds. So many lags nearest to the stamps'
    #: own, one and its neighbours, go on beside the best ones where their correlation lacks so many times as much of 1, or this
    #: little.
    nearest: int = 3
    nearly: float = 2.0
    nearly_share: float = 0.02
    #: judged: variances below this share of the whole are none: a stretch of standstill correlates with anything. Lags at
    #: which only a standstill overlaps drop out by it.
    least_variance: float = 1e-3
    #: judged: a track's rate holds so far before and beyond a scan's start: a sweep, and as much again where scans are
    #: missing.
    before_s: float = 0.2
    beyond_s: float = 0.3


@dataclass(frozen=True, slots=True)
class Vectors:
    """At which lags the turns of pairs of scans are compared with the gyroscope's, on all three axes."""

    #: derived: lags that are tried lie this far apart: a quarter of a swing of 2.5 Hz, quick for a hand, would be five
    #: times as much. A parabola tells between them.
    step_s: float = 0.02
    #: judged: lags closer to one another than this, five steps, are one; so many best ones go on, each tried by its
    #: rotation.
    apart_s: float = 0.1
    candidates: int = 6
    #: judged: compared at once; memory, not the answer, depends on it.
    lags_at_once: int = 200
    #: judged: rates are cut off above this percentile: the few turns of pairs that went wrong would outweigh the rest.
    top_percent: float = 95.0
    #: judged: at a lag with fewer turns in common, or with less than this share of them, nothing is compared: sixty
    #: components tell three of a rotation and a lag from chance.
    fewest_turns: int = 20
    least_share: float = 0.5
    #: measured on simulated motions: sines of one or two tempos on each axis are alike to 0.8 by chance, at one lag of
    #: many. Turns have to be more so.
    alike: float = 0.9
    #: measured on ten recordings of an independent simulator: of the gyroscope's own turns a rotation leaves 0.03 to 0.22, and
    #: 0.4 where the rig was shaken; of readings in another order 0.34 and more, at the best of all lags. Well below that.
    left: float = 0.2
    #: judged: a pair's turn is told no better than this, however many points tell it: its planes are those of one scan. It
    #: evens the weights of pairs.
    pair_std_rad: float = 0.003


@dataclass(frozen=True, slots=True)
class Profile:
    """Around an answer's time offset, how alike the turns of lidar and gyroscope are."""

    #: judged: so far to each side: a hand's to and fro repeats itself within it. In such steps: a parabola tells between
    #: them. A picture alone depends on it.
    reach_s: float = 0.5
    step_s: float = 0.01
    #: derived: from the three digits that are said of a likeness: what falls by less has not fallen, whatever the noise.
    least_fall: float = 0.001


@dataclass(frozen=True, slots=True)
class Agreeing:
    """Whether the track's turning is the gyroscope's."""

    #: judged: rates are cut off above this percentile, the lidar's and the gyroscope's alike, as a track's few leaps are
    #: the fastest.
    top_percent: float = 95.0
    #: judged: spans below this share of the fastest tell nothing of a ratio: noise and biases are a larger part of them.
    fast_share: float = 0.4
    #: judged: with fewer spans nothing is concluded: a second of scans.
    fewest_spans: int = 10
    #: derived: a rate over a shorter span, between stamps that repeat, is none: a milliradian of a pose's noise in a
    #: millisecond is a radian a second.
    shortest_span_s: float = 1e-3
    #: measured on simulated rooms: rates of a good track and the gyroscope correlate by 0.95 and more, those of a lost one
    #: by 0.6 at the most; with the former nothing is looked into, below the latter nothing is believed.
    trusted: float = 0.9
    believed: float = 0.6
    #: derived: at the right lag the middle of the ratios of a track and the gyroscope is one to some per cent, or that of their
    #: units, 57 apart. What is neither to so many times goes together by chance.
    as_fast: float = 2.0
    #: measured on 45 drawn rigs: turns from scan to scan of sound tracks are within 0.9 deg of the gyroscope's, at one or more
    #: places of tracks that left their planes they were 1.3 to 36 deg off.
    leap_rad: float = 0.02
    #: judged: where less than this share of the faults is left by a track's own rotation, that is right, and steps mend the
    #: rest. Time depends on it: turns from scan to scan, found each by itself, are asked otherwise, for a third of a solve's.
    fewer: float = 0.5
    #: measured on seven recordings of an independent simulator, two of them corridors and four shaken: sweeps straightened by the
    #: gyroscope leave 0.06 to 0.8 of what raw ones leave of the turns from scan to scan, and 1.2 (slow) to 29 times as much where
    #: the clouds had been straightened before. The geometric mean of 0.8 and 4.
    bent: float = 1.8
    #: judged: times that a track is followed again by what the IMU has felt: the second mends what the first one's start
    #: values left. Time depends on it.
    again: int = 2
    #: measured on clouds laid in the world's frame: persons who walk about turn a track by 2 deg/s where the gyroscope turns
    #: by 25. Less than this part of its rate, where that is no bias, is none of the lidar's: medians over the recording.
    standing: float = 0.2
    surely_turning_rad_s: float = 0.1
    #: judged: of a track that is lost in between, such shares are looked at by themselves, overlapping by half, and none that
    #: is shorter: three or four swings of a hand, which at one lag of many are not alike to 0.9 by chance.
    parts: tuple[float, ...] = (0.5, 1.0 / 3.0)
    shortest_part_s: float = 3.0
    #: judged: of a rotation between two streams of turns: what it leaves over what there is. Noise alone leaves one.
    #: Whether another way to follow the lidar is tried depends on it.
    fits: float = 0.6
    #: judged: a track this whole is not worth another, and another is worth so many times as much. Time depends on it.
    whole: float = 0.95
    better: float = 1.05
    #: judged: less turning than this (rms), of the gyroscope or of the lidar, says nothing of the rotation: the solve starts
    #: from the accelerations. Twice as much or half of it starts the same solves.
    least_turning_rad_s: float = 0.03
    #: judged: beyond this a gyroscope has turned whatever its bias. Only which reason is told depends on it.
    surely_turned_deg: float = 20.0
    #: judged: so many orientations tell the farthest turn; of a motion of swings each would nearly do.
    orientations: int = 500
    #: judged: a given plane within these of a found one is that plane: what a person draws by hand or writes from a plan.
    #: One beyond is a plane of its own.
    same_deg: float = 5.0
    same_m: float = 0.15
    #: derived: of planes that a track has carried from another scan at least half have to be among those that this one shows. A
    #: plan has the next room's, too; and a track that coasts, turned by 13 deg, laid floor and ceiling of six rightly.
    carried: float = 0.5


@dataclass(frozen=True, slots=True)
class Guiding:
    """By how much of a track what leads it on is told, and from how much of it the next step."""

    #: judged: a track is looked back at from so long on, and every so much later as long as it tells nothing: the lag of a
    #: hand's swings is told by four or five of them. The sooner, the less is followed twice.
    first_s: float = 6.0
    again_s: float = 2.0
    #: measured: 5 cm from where it was said to go next was a sound track's at 3 rad/s; at its end a step is held to so many
    #: times less, and smaller slides are told then.
    times: float = 2.0
    #: judged: over so much: what has led it astray before does not count for ever.
    over_s: float = 8.0
    #: judged: what leads it is told anew, from all of it, whenever it is so many times as long. Each takes as long as ten scans.
    again_times: float = 2.0
    #: derived: standard deviations of what is told anew are no less than this of those before: the root of a half.
    surer: float = 0.71
    #: derived: a velocity by positions to a centimetre over so long is right to 1 cm/s; a gravity wrong by a fifth of a degree
    #: has done 4 cm by then. So many scans are as long as that at 20 Hz, and so few tell a line.
    behind_s: float = 1.5
    most_behind: int = 30
    fewest_behind: int = 5
    #: derived: what changes by 4 m/s2 in such a silence has moved by 5 mm at its end, a third of a step's standard deviation.
    silence_s: float = 0.05


@dataclass(frozen=True, slots=True)
class Rotating:
    """The rotation at each lag."""

    #: judged: passes that fill what no plane tells of an acceleration, at most; and a change of the rotation of so little, a
    #: hundredth of a degree, ends them: a start is right to degrees.
    fillings: int = 100
    filled: float = 2e-4

    #: judged: around a lag the rotation is tried so far to each side, in such steps: three steps of the coarse lags, and
    #: what a grid of 20 ms may miss; between them a parabola tells.
    around_s: float = 0.06
    step_s: float = 0.005
    #: judged: fewer turns tell no rotation: thirty components for its three.
    fewest_turns: int = 10
    #: judged: what is left of turns is alike for no longer than this, and is looked at over such a part of them at most: beyond
    #: that chance makes as much of it. Drifts along a false plane lasted for a second.
    lasts_s: float = 1.0
    parts: int = 4
    #: derived: three median residuals are two sigma of a normal law. Passes of the weights against outliers, whose scale is
    #: so many, not below this rate (0.006 deg/s).
    passes: int = 4
    outlier_times: float = 3.0
    least_residual_rad_s: float = 1e-4
    #: judged: a second axis is told by turning beyond this, a degree a second, and beyond so many times what the fit
    #: leaves. Below, the turn about the only axis is told by plumb walls.
    second_axis_rad_s: float = 0.02
    second_axis_noise: float = 1.5
    #: judged: of a platform that does not turn: its accelerations smoothed over this, a little more than a scan, in
    #: recordings of so much at least,
    smoothed_s: float = 0.12
    least_s: float = 4.0
    #: judged: that overlap by so much, at so many lags. A rig that never turns is weak in rotation anyhow.
    overlap_s: float = 5.0
    lags: int = 5
    #: judged: a candidate that leaves so many times as much as the best, or this much more of the whole, is none. What goes
    #: on costs a linear start each.
    worse_times: float = 2.0
    worse_share: float = 0.1
    #: derived: of lags that leave as much but for this the one nearest to the stamps' own is taken, and the others are said: a
    #: round that comes again within half of what is left anyhow leaves a tenth more.
    alike: float = 1.15
    #: judged: so many lags between two are looked at for whether each is a valley of its own. Time depends on it.
    between: int = 12
    #: judged: a guessed time offset takes the rotation of a lag this near: half a scan.
    guess_s: float = 0.05
    #: derived: priors on the rotation whose three sigmas are below a degree hold it where it is: turning refutes from six on.
    held_rad: float = 0.005
    #: derived: turns about the only axis that are tried where it stays open, 15 deg apart.
    open_turns: int = 24


@dataclass(frozen=True, slots=True)
class ClockRates:
    """Whether the clocks run at rates that differ by more than crystals do."""

    #: derived: five standard deviations of `CLOCK_RATE_STD_PPM`; the joint estimation's prior allows less.
    least: float = 2e-4
    #: derived: neighbouring turns share the errors of the scans between them, by which a scatter of their residuals is up to
    #: twice too small; beyond three times that nothing is by chance.
    sigmas: float = 6.0
    unsure: float = 2.0
    #: derived: what its prior has let the joint estimation find of a rate is short by less than half of it.
    pulled: float = 0.5
    #: derived: what a central difference of a rate that changes within 50 ms takes for its slope.
    difference_s: float = 2e-3
    #: derived: a motion that changes within 0.1 to 0.3 s is linear over this much; a rate of one per cent in a minute is
    #: 0.3 s at its ends, as many steps away.
    most_step_s: float = 0.05
    rests_s: float = 1e-5
    passes: int = 30
    #: derived: within so much one per cent parts the clocks by less than a motion changes in, and it has enough turns for a lag.
    part_s: float = 8.0
    #: derived: beyond this the squares of what turns tell have half of a double's digits.
    condition: float = 1e14
    #: derived: a step is told from a line by five stretches or more, of which those count that tell a tenth of the median's.
    stretches: int = 8
    fewest_stretches: int = 5
    telling: float = 0.1
    #: derived: a step in the middle of eight stretches leaves a line a quarter of its squares, a line leaves such a step a
    #: quarter.
    nearer: float = 0.5
    #: derived: how often a solve begins again: turns tell a rate to some hundred millionths, points what is left, and no more is.
    stretched: int = 2


@dataclass(frozen=True, slots=True)
class Rigid:
    """Whether both sensors are fixed to one another."""

    #: judged: turns over so much are compared: a track's noise is small beside it, and a gyroscope's drift is none yet. Only
    #: which reason is told depends on it, and when.
    span_s: float = 1.0
    #: derived: over a gap of the track a span is longer; beyond this it is another thing.
    longest: float = 1.5
    #: derived: farther turns than this, 115 deg, may be taken for those the other way round.
    most_rad: float = 2.0
    #: measured on 38 recordings of an independent generator: sound tracks and gyroscopes turn alike to 0.05 to 1.3 deg in a
    #: second, and to a fifteenth of what they turn; a lidar that a motor turns to and fro by 17 deg in seven seconds is off by
    #: 5.9, a fifth of it. Below either nothing is said.
    least_rad: float = 0.04
    share: float = 0.12
    #: derived: spans that overlap: those of five seconds tell a map of twelve numbers.
    fewest: int = 50
    #: derived: three medians are two sigma of a normal law; in so many passes what leapt has lost its weight. Below a hundredth
    #: of a degree nothing is an outlier.
    outlier_times: float = 3.0
    passes: int = 5
    least_left_rad: float = 2e-4


@dataclass(frozen=True, slots=True)
class Linear:
    """Gravity, lever arm and accelerometer bias."""

    #: measured: 1 sigma of a step between two scans, by position and by velocity, of a track at hand speeds (the picture of
    #: stage 3: a centimetre). They weigh positions against velocities, and the start is right to centimetres either way.
    position_std_m: float = 0.015
    velocity_std_m_s: float = 0.02
    #: measured on 45 drawn rigs: steps of sound tracks are off by 2 to 6 mm in the middle and 25 mm at most, those that slid or
    #: leapt by 30 to 400. So many times the larger of that standard deviation and the middle's own has gone astray.
    astray_times: float = 3.0
    #: derived: the median of the size of three errors, over which it is their standard deviation: 1 / 0.6745 of one.
    norm_of_median: float = 1.4826
    #: measured: with a quarter of all steps astray the rest gave a lever arm 20 cm off; with a seventh one right to centimetres.
    most_astray: float = 0.2
    #: derived: passes of weights, which halve the pull of what is astray each; offs below this, a tenth of a step's standard
    #: deviation, are none.
    robust_passes: int = 12
    least_off_m: float = 0.0015
    #: derived: scans further apart than this say nothing, as integrals drift: a start wrong by two degrees of gravity's
    #: direction is 0.35 m/s2, 2 cm after that long.
    most_gap_s: float = 0.35
    #: derived: of clouds that come twice a second and less, nothing else is there: 4 cm after half a second are a start, too. So
    #: many usual gaps are one, but not two, where a scan is missing.
    usual_gaps: float = 1.5
    #: derived: passes, as gravity's size is told along its own direction, to 0.2 %.
    passes: int = 3
    gravity_std_m_s2: float = 0.02
    #: judged: a gravity below this, a tenth of the Earth's, has no direction yet.
    least_gravity_m_s2: float = 1.0
    #: derived: priors that keep undetermined directions finite, 1 sigma: any gravity, a thousand times what there is; a lever
    #: arm of metres, a bias of 0.3 m/s2, which is beyond what rigs and sheets have; and a velocity of a car in town. Along a way
    #: that no plane tells, half a minute of it keeps gravity to 0.07 m/s2; at a thousand m/s gravity took up 1.3, and 0.9 m of
    #: lever arm, which the joint solve did not leave again.
    any_velocity_m_s: float = 10.0
    any_gravity_m_s2: float = 1e4
    lever_arm_m: float = 2.0
    bias_m_s2: float = 0.3
    #: derived: a lever arm that is given is held to this, a hundredth of what a linear start is right to.
    held_m: float = 1e-4


@dataclass(frozen=True, slots=True)
class Signs:
    """An IMU with axes turned round, or in another unit."""

    #: judged: linear starts of right axes stay well below this, as they are whitened; nothing is tried, and no time spent,
    #: unless one does not.
    suspicious_rms: float = 1.0
    #: judged: a sign pattern must leave less than this share of the misfit as sent; the right one leaves noise. Only the
    #: reason that is told depends on it.
    explains: float = 0.35
    #: measured on recordings of an independent generator: 0.44 where one axis of an accelerometer was flipped, as the right
    #: pattern left 0.9 of noise. Enough where the two sensors contradict one another about gravity as well.
    explains_what_is_doubted: float = 0.6
    #: derived: radians taken for degrees are 57 times off. The ratio of rates is good to sqrt(1 - 0.9^2) over the root of
    #: some hundred spans, a few per cent, where they correlate so well;
    together: float = 0.9
    #: judged: it is steady within this (natural logarithm, and quartiles over the middle), a 13th of the logarithm of 57,
    steady: float = 0.3
    #: judged: of a lidar whose fast spans, at this percentile, turn so fast. Only the reason that is told depends on it.
    fast_percent: float = 90.0
    moving_rad_s: float = 0.1
    #: judged: a lag found through a rotation where there is a reflection is off by up to this, a quarter of a swing; tried
    #: in such steps,
    around_s: float = 0.12
    step_s: float = 0.01
    #: judged: with so many spans: a second of scans. Only the reason that is told depends on it.
    fewest_spans: int = 10
    #: judged: what shakes a rig does so to and fro within a second, so that gravity is what is left. Longer, turns take it away.
    gravity_over_s: float = 1.0


@dataclass(frozen=True, slots=True)
class Upright:
    """The turn about the only axis."""

    #: judged: turns that the accelerations fit so nearly as well as the best one are all the same to them, from so many on.
    #: Below, the turn is known, and walls are not asked.
    alike: float = 1.05
    fewest_alike: int = 3
    #: derived: or that are worse in all by no more than chance makes of what stretches of the track differ by, of so many:
    #: one in a few hundred by Student's law.
    stretches: int = 12
    beyond_chance: float = 3.0
    #: judged: walls and floors are plumb and level to about this, and start values right to as much; a plane further off
    #: both is a slope and says nothing.
    plumb_deg: float = 3.0
    #: judged: turns between those tried, by gravity's harmonic. The joint estimation finds the rest.
    fine_deg: float = 0.5
    #: judged: the turn that the accelerations like best is left only for one at which half a plane more is plumb or level:
    #: more than one doubtful plane weighs.
    worth_a_turn: float = 0.5
    #: judged: turns beside which another makes no more than this share of the planes more plumb or level, and one in any case,
    #: are as plumb: what was grown through clutter is level by chance, and after a track that slid gravity is off by degrees.
    clutter_share: float = 0.2
    #: derived: half of the quarter turn by which turns are apart that make the same planes plumb and level; of those that are
    #: as plumb, the ones at which the lidar leans by no more than this beyond the least are one and the same.
    standing_deg: float = 45.0


LAGS, VECTORS, PROFILE, AGREEING, ROTATING = Lags(), Vectors(), Profile(), Agreeing(), Rotating()
CLOCK_RATES = ClockRates()
LINEAR, SIGNS, UPRIGHT, GUIDING, RIGID = Linear(), Signs(), Upright(), Guiding(), Rigid()
