"""Numbers of the joint estimation beside its schedule (`schedule.py`), each with its unit and its reason."""

from __future__ import annotations

from dataclasses import dataclass

from calib_core.planes.segment import SegmentSettings


@dataclass(frozen=True, slots=True)
class Chain:
    """What keeps the chain of knots and the shared unknowns solvable where no data hold them."""

    #: Information [1/rad2, 1/m2, s2/m2] that holds the map's frame by one knot,
    gauge: float = 1e8
    #: or where planes hold it but were not all in view: to a radian, a metre, a metre a second.
    loose_gauge: float = 1.0
    #: Of every knot: a kilometre, a kilometre a second; velocity between two silences stays put.
    knot: float = 1e-6
    #: Of every plane, to a hundred metres: one that no point sees stays where it is.
    plane: float = 1e-4
    #: A prior of gravity that is exact is this wide (1 sigma).
    exact_gravity_m_s2: float = 1e-7
    #: No IMU that works starts with a larger bias (1 sigma: 11 deg/s, a tenth of gravity).
    gyro_bias_std_rad_s: float = 0.2
    accel_bias_std_m_s2: float = 1.0
    #: Every node of the biases is six columns along the whole chain: without a limit memory would grow with the square of a
    #: recording's length, and time faster still. Biases of minutes are as smooth to a longer spacing.
    most_nodes: int = 24
    #: A recording shorter than so many spacings has one node.
    one_node: float = 1.5
    #: An instant belongs to its nearest knot: half a spacing away, and a little for rounding.
    reach_knots: float = 0.51
    #: The accelerometer is read anew where its delay has moved by so much: to there the first order is good to 1e-4.
    delay_moved_s: float = 2e-5


@dataclass(frozen=True, slots=True)
class Holding:
    """Which directions of the calibration the data leave open, to be held by priors of their own."""

    #: Spread along any parameter beyond which a direction is open: far from zero, as the noise of the motion that the
    #: information is evaluated at looks like excitation; a lever arm that is truly unknown seems known to half a metre.
    open_deg: float = 2.0
    open_m: float = 0.1
    open_s: float = 0.01
    #: What was held is let go where its spread is less than this part of that.
    let_go: float = 0.3
    #: Directions whose part beyond one another is less than this are one.
    same_direction: float = 0.3
    #: A direction with so much of its length in the lever arm is held at zero, others where they are,
    shift_share: float = 0.98
    #: to this part of a unit (1 deg, 10 mm, 1 ms; 1 sigma).
    held_std: float = 0.01


@dataclass(frozen=True, slots=True)
class Measuring:
    """The lidar's noise, from how far points lie off their planes."""

    #: Room of the gate, wide enough to see the tails,
    gate_sigmas: float = 6.0
    #: and how far the weights taper to zero, in standard deviations of what they find.
    taper_sigmas: float = 4.0
    #: Bands of the squared cosine of incidence, by which range and surface are told apart.
    bands: int = 12
    #: Fewer points tell no noise, of all, of a band, of a plane in a scan whose mean is taken out.
    fewest_points: int = 500
    fewest_in_band: int = 100
    fewest_on_plane: int = 20
    #: Passes until variance and weights agree to round-off.
    passes: int = 30
    #: No lidar is better than this, and no more digits are known of it.
    least_std_m: float = 1e-4
    digits: int = 3


@dataclass(frozen=True, slots=True)
class Surveying:
    """Where planes are, from the returns on them and beside them."""

    #: Points that are worth a call of their own.
    batch_points: int = 20_000
    #: Returns this near are looked at for what lies beside a plane.
    beside_m: float = 0.3
    #: Returns of a cell are another surface's, a door's in its wall, where their mean is further from the plane than this
    #: many standard deviations of one of them.
    off_sigmas: float = 2.0


@dataclass(frozen=True, slots=True)
class Straying:
    """What the propagated motion may be wrong by when it begins, and what a plane in view leaves of that."""

    #: What a solve of the whole leaves of the last knot's position and velocity.
    position_std_m: float = 0.02
    velocity_std_m_s: float = 0.05
    #: Of the acceleration before anything is known of it,
    acceleration_std_m_s2: float = 0.1
    #: and at the least: what a wrong scale or axis of a good sensor makes of gravity itself.
    least_acceleration_std_m_s2: float = 0.005
    #: What a piece's points leave of a plane's distance: the calibration's and the map's error, not the noise of points.
    seen_std_m: float = 0.015
    #: After the last plane in view, knots are kept for so long: what the IMU alone adds in it is less than the gate.
    kept_s: float = 0.5
    #: A scan counts for a piece that begins up to half a sweep later.
    half_sweep_s: float = 0.05
    #: New planes are looked for among so many of the last scans at the least.
    fewest_scans: int = 5


@dataclass(frozen=True, slots=True)
class Regaining:
    """A lost plane known again in one scan."""

    #: Points of the scan that are cut into planes, and the fewest that are worth it.
    points: int = 4000
    fewest_points: int = 200
    #: A lost plane may be seen by its edge alone.
    segments: SegmentSettings = SegmentSettings(min_points=100, min_share=0.03)  # noqa: RUF009  frozen


@dataclass(frozen=True, slots=True)
class Doubting:
    """Whether a plane is one, and whether the chosen ones hold a pose."""

    #: Places on a plane: a hand's breadth and a half.
    cell_m: float = 0.3
    #: Normals hold three directions where the smallest singular value of three orthogonal ones would be one.
    least_spread: float = 0.2
    #: What has moved farthest is told by this percentile: a bin at a plane's edge tells nothing of the rest.
    moved_percent: float = 95.0
    #: Surveys that go to and fro have done so in so many of them.
    to_and_fro: int = 4


@dataclass(frozen=True, slots=True)
class Watching:
    """What whoever watches is told; nothing depends on it."""

    #: How far along the estimation is, as a share of its usual time: the motion is known, and of that the coarse rounds are
    #: done; a part of the points has settled.
    motion_share: float = 0.6
    coarse_share: float = 0.3
    settled_share: float = 0.75
    #: Sweeps that are shown, and instants of each: within half of it the twist hardly changes, as far as the eye can tell.
    sweeps: int = 12
    instants: int = 3
    #: Scans between two reports.
    told_every_scans: int = 20


CHAIN, HOLDING, MEASURING, SURVEYING = Chain(), Holding(), Measuring(), Surveying()
STRAYING, REGAINING, DOUBTING, WATCHING = Straying(), Regaining(), Doubting(), Watching()
