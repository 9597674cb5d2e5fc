"""Every number of the start values, with its unit and its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Lags:
    """At which lags the turns of lidar and gyroscope are compared."""

    #: Rates are laid on a grid as fine as hands are quick, and refined later.
    grid_hz: float = 50.0
    #: The lidar's turns between scans so many apart, beside those within sweeps: more scans, less noise, slower motion.
    apart_scans: tuple[int, ...] = (1, 3)
    #: Spans above so many times this percentile are cut off: a few leaps of a track would outweigh all the rest.
    top_percent: float = 90.0
    top_times: float = 2.0
    #: Recordings overlap at a lag by so much at least, or that share of the lidar's, or half of the shorter one.
    overlap_s: float = 8.0
    overlap_share: float = 0.3
    half_overlap: float = 0.5
    #: So many best lags go on, so far apart: a hand's to and fro repeats itself after half a second.
    candidates: int = 6
    apart_s: float = 0.25
    #: Variances below this share of the whole are none: a stretch of standstill correlates with anything.
    least_variance: float = 1e-3
    #: A track's rate holds so far before and beyond a scan's start.
    before_s: float = 0.2
    beyond_s: float = 0.3


@dataclass(frozen=True, slots=True)
class Vectors:
    """At which lags the turns of pairs of scans are compared with the gyroscope's, on all three axes."""

    #: Lags that are tried lie this far apart: a quarter of the quickest swing of a hand would be five times as much.
    step_s: float = 0.02
    #: Lags closer to one another than this are one; so many best ones go on.
    apart_s: float = 0.1
    candidates: int = 6
    #: Compared at once: memory, not the answer.
    lags_at_once: int = 200
    #: Rates are cut off above this percentile.
    top_percent: float = 95.0
    #: At a lag with fewer turns in common, or with less than this share of them, nothing is compared.
    fewest_turns: int = 20
    least_share: float = 0.5
    #: How alike the turns have to be. Sines of one or two tempos on each axis are alike to 0.8 by chance, at one lag of many.
    alike: float = 0.9
    #: A pair's turn is told no better than this, however many points tell it: its planes are those of one scan.
    pair_std_rad: float = 0.003


@dataclass(frozen=True, slots=True)
class Profile:
    """Around an answer's time offset, how alike the turns of lidar and gyroscope are."""

    #: So far to each side: a hand's to and fro repeats itself within it. In such steps: a parabola tells between them.
    reach_s: float = 0.5
    step_s: float = 0.01


@dataclass(frozen=True, slots=True)
class Agreeing:
    """Whether the track's turning is the gyroscope's."""

    #: Rates are cut off above this percentile, the lidar's and the gyroscope's alike.
    top_percent: float = 95.0
    #: Spans below this share of the fastest tell nothing of a ratio.
    fast_share: float = 0.4
    #: With fewer spans nothing is concluded.
    fewest_spans: int = 10
    #: A rate over a shorter span, between stamps that repeat, is none.
    shortest_span_s: float = 1e-3
    #: Rates of a good track and the gyroscope correlate by 0.95 and more, those of a lost one by 0.6 at the most; with the
    #: former nothing is looked into, below the latter nothing is believed.
    trusted: float = 0.9
    believed: float = 0.6
    #: Of a rotation between two streams of turns: what it leaves over what there is. Noise alone leaves one.
    fits: float = 0.6
    #: A track this whole is not worth another, and another is worth so many times as much.
    whole: float = 0.95
    better: float = 1.05
    #: Less turning than this (rms), of the gyroscope or of the lidar, says nothing of the rotation.
    least_turning_rad_s: float = 0.03
    #: Beyond this a gyroscope has turned whatever its bias.
    surely_turned_deg: float = 20.0
    #: So many orientations tell the farthest turn.
    orientations: int = 500
    #: A given plane within these of a found one is that plane.
    same_deg: float = 5.0
    same_m: float = 0.15
    #: Planes face another way where the normals' singular value is this share of the first.
    another_way: float = 0.2


@dataclass(frozen=True, slots=True)
class Rotating:
    """The rotation at each lag."""

    #: Around a lag the rotation is tried so far to each side, in such steps; between them a parabola tells.
    around_s: float = 0.06
    step_s: float = 0.005
    #: Fewer turns tell no rotation.
    fewest_turns: int = 10
    #: Passes of the weights against outliers, whose scale is so many median residuals, not below this rate.
    passes: int = 4
    outlier_times: float = 3.0
    least_residual_rad_s: float = 1e-4
    #: A second axis is told by turning beyond this, and beyond so many times what the fit leaves.
    second_axis_rad_s: float = 0.02
    second_axis_noise: float = 1.5
    #: Of a platform that does not turn: its accelerations smoothed over this, in recordings of so much at least,
    smoothed_s: float = 0.12
    least_s: float = 4.0
    #: that overlap by so much, at so many lags.
    overlap_s: float = 5.0
    lags: int = 5
    #: A candidate that leaves so many times as much as the best, or this much more of the whole, is none.
    worse_times: float = 2.0
    worse_share: float = 0.1
    #: A guessed time offset takes the rotation of a lag this near.
    guess_s: float = 0.05
    #: Turns about the only axis that are tried where it stays open.
    open_turns: int = 24


@dataclass(frozen=True, slots=True)
class Linear:
    """Gravity, lever arm and accelerometer bias."""

    #: 1 sigma of a step between two scans, by position and by velocity: what a track is wrong by.
    position_std_m: float = 0.015
    velocity_std_m_s: float = 0.02
    #: Scans further apart than this say nothing: integrals drift.
    most_gap_s: float = 0.35
    #: Passes, as gravity's size is told along its own direction, to this.
    passes: int = 3
    gravity_std_m_s2: float = 0.02
    #: A gravity below this has no direction yet.
    least_gravity_m_s2: float = 1.0
    #: Priors that keep undetermined directions finite, 1 sigma: any velocity, any gravity, a lever arm of metres, a usual bias.
    any_velocity_m_s: float = 1e3
    any_gravity_m_s2: float = 1e4
    lever_arm_m: float = 2.0
    bias_m_s2: float = 0.3


@dataclass(frozen=True, slots=True)
class Signs:
    """An IMU with axes turned round, or in another unit."""

    #: Linear starts of right axes stay well below this (whitened); nothing is tried, and no time spent, unless one does not.
    suspicious_rms: float = 1.0
    #: A sign pattern must leave less than this share of the misfit as sent.
    explains: float = 0.35
    #: Radians taken for degrees are 57 times off. The ratio of rates is good to a few per cent where they correlate so well;
    together: float = 0.9
    #: it is steady within this (natural logarithm, and quartiles over the middle),
    steady: float = 0.3
    #: of a lidar whose fast spans, at this percentile, turn so fast.
    fast_percent: float = 90.0
    moving_rad_s: float = 0.1
    #: A lag found through a rotation where there is a reflection is off by up to this; tried in such steps,
    around_s: float = 0.12
    step_s: float = 0.01
    #: with so many spans.
    fewest_spans: int = 10


@dataclass(frozen=True, slots=True)
class Upright:
    """The turn about the only axis."""

    #: Turns that the accelerations fit so nearly as well as the best one are all the same to them, from so many on.
    alike: float = 1.05
    fewest_alike: int = 3
    #: Walls and floors are plumb and level to about this; a plane further off both is a slope and says nothing.
    plumb_deg: float = 3.0
    #: Turns between those tried, by gravity's harmonic.
    fine_deg: float = 0.5
    #: The turn that the accelerations like best is left only for one at which half a plane more is plumb or level.
    worth_a_turn: float = 0.5


LAGS, VECTORS, PROFILE, AGREEING, ROTATING = Lags(), Vectors(), Profile(), Agreeing(), Rotating()
LINEAR, SIGNS, UPRIGHT = Linear(), Signs(), Upright()
