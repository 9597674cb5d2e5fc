"""Numbers of the joint estimation beside its steps' policies (`policies.py`), each with its unit and its reason."""

from __future__ import annotations

from dataclasses import dataclass

from calib_core.planes.settings import SegmentSettings


@dataclass(frozen=True, slots=True)
class Chain:
    """What keeps the chain of knots and the shared unknowns solvable where no data hold them."""

    #: derived: information [1/rad2, 1/m2, s2/m2] of a tenth of a milliradian and of a millimetre holds the map's frame by
    #: one knot: far beyond what data say of it, and far from round-off,
    gauge: float = 1e8
    #: derived: or where planes hold it but were not all in view: to a radian, a metre, a metre a second.
    loose_gauge: float = 1.0
    #: derived: (1 km)^-2 of every knot, a kilometre, a kilometre a second; velocity between two silences stays put.
    knot: float = 1e-6
    #: derived: planes that all together tell a run's place along a direction to no better than six centimetres do not see it:
    #: links say nothing of it then, and knots are held along it, to a centimetre and a centimetre a second of where the readings
    #: have them, which nobody feels: ten metres off along it, walls of 1e10 are 2 mm off. Of a decimetre, a street of which
    #: floors alone were left, seen to 7 cm across, had no digits left.
    unseen: float = 3e2
    #: derived: what was not seen is seen again where it is told twice as well, to three centimetres: next to the limit, what
    #: walls tell of the way up by how they lean would come and go with every gathering.
    seen_again: float = 1.2e3
    unseen_held: float = 1e4
    #: derived: of a magnitude g a part g_u across leaves g - g_u^2 / 2 g for the rest: where bias and scale of the accelerometer
    #: are known to 0.05 m/s2, it tells nothing of a g_u below sqrt(2 * 9.81 * 0.05).
    level_m_s2: float = 1.0
    #: derived: (100 m)^-2 of every plane: one that no point sees stays where it is.
    plane: float = 1e-4
    #: derived: three points make a plane, and nine tell it from what they scatter. One that fewer lie on is held where it is:
    #: nothing else says where, and a step turned one by a radian, where no descent finds what it predicts.
    fewest_points: int = 9
    #: derived: a prior of gravity that is exact is this wide (1 sigma): far below what a solve knows it to (0.01), and far
    #: from round-off.
    exact_gravity_m_s2: float = 1e-7
    #: derived: knots whose links' and bins' Jacobians are there at the same time on one thread: ten seconds of them, some
    #: megabytes. Memory, not the answer, depends on it.
    knots_at_once: int = 1024
    #: derived: clusters of points, or instants, that are gone through at a time, ten megabytes of them. Memory, not the answer,
    #: depends on it.
    clusters_at_once: int = 65_536
    #: data sheets: the worst parts in use (MPU-6050, unconfirmed) start up to 20 deg/s and 0.08 g off, within two of these:
    #: 11 deg/s, a tenth of gravity (1 sigma).
    gyro_bias_std_rad_s: float = 0.2
    accel_bias_std_m_s2: float = 1.0
    #: judged: every node of the biases is six columns along the whole chain: without a limit memory would grow with the
    #: square of a recording's length, and time faster still; 24 are two minutes at 5 s. Biases of minutes are as smooth to
    #: a longer spacing.
    most_nodes: int = 24
    #: derived: a recording shorter than so many spacings has one node: two of them would be nearer to one another than a
    #: half.
    one_node: float = 1.5
    #: derived: an instant belongs to its nearest knot: half a spacing away, and a little for rounding.
    reach_knots: float = 0.51
    #: derived: the accelerometer is read anew where its delay has moved by so much: what swings at 100 Hz is followed by
    #: the first order to (2 pi 100 x 2e-5)^2 / 2 = 1e-4 of its amplitude.
    delay_moved_s: float = 2e-5


@dataclass(frozen=True, slots=True)
class Hearing:
    """Whether the IMU has read a tone that would be taken out of its readings (`tone_heard.py`)."""

    #: judged: a tone's size is known to a few per cent, and what the IMU truly does at that frequency is less than itself: three
    #: times what was read is no tone of it. Seen: 2,800 times.
    times: float = 3.0
    #: judged: a tone of the room turns with the IMU, by whose turns it is found beside its frequency.
    around_hz: float = 1.0
    #: derived: of a normal law one in 16,000 is beyond: so many standard deviations of chance may hide a tone in a standstill.
    sigmas: float = 4.0


@dataclass(frozen=True, slots=True)
class Wandering:
    """When biases wander faster than they are said to (`bias_walks.py`)."""

    #: derived: chance makes as much of steps of a true walk in one recording of two hundred and fifty, and it costs little there:
    #: with walks nine times as fast, error bars were an eighth to a fifth wider in rotation. Of parts that warmed up by 0.05
    #: deg/s and 0.02 m/s2 behind a sparse lidar, held to walk as warm ones do, chance makes as much in one of three
    #: thousand to one of two hundred thousand, and answers were off by 22 squares of their sigmas.
    chance: float = 1e-3
    #: measured: walls bent by 10 mm have the accelerometer wander up to 3 times as fast, a part that warms up 6 to 16 times.
    least: float = 4.0
    #: judged: twice what a part does that warms up by 3 mg in twenty seconds. What is faster has another reason, and its own
    #: words: a lift that starts was 37 times.
    most: float = 30.0


@dataclass(frozen=True, slots=True)
class Holding:
    """Which directions of the calibration the data leave open, to be held by priors of their own."""

    #: judged: spread along any parameter beyond which a direction is open: far from zero, as the noise of the motion that
    #: the information is evaluated at looks like excitation; a lever arm that is truly unknown seems known to half a metre.
    #: Five to ten times the weak limits, so that what is merely weak is estimated.
    open_deg: float = 2.0
    open_m: float = 0.1
    open_s: float = 0.01
    #: judged: what was held is let go where its spread is less than this part of that: well below, so that it does not go
    #: to and fro.
    let_go: float = 0.3
    #: derived: directions whose part beyond one another is less than this are one: within 17 deg.
    same_direction: float = 0.3
    #: derived: a direction with so much of its length in the lever arm, within 11 deg of it, is held at zero, others where
    #: they are,
    shift_share: float = 0.98
    #: derived: one with more than half of its square in a turn is that turn: there is no other.
    turn_share: float = 0.5
    #: derived: to this part of a unit (1 deg, 10 mm, 1 ms; 1 sigma): fifty times and more below the limits of weak.
    held_std: float = 0.01
    #: derived: turning is felt over as long as a usual sweep: what is faster shakes the gyroscope and turns no lidar; spans that
    #: lack a tenth of their readings are noisier, and none.
    felt_over_s: float = 0.1
    full_span: float = 0.9
    #: derived: with a variance of twice the noise's, half of what seems to turn the rig is noise, and the lever arm seems known
    #: 1.4 times as well as it is: no less is trusted. Of noise alone one recording of 5 s in ten thousand is beyond it
    #: (a chi-square law of 49), of 12 s one in a billion.
    felt_times: float = 2.0


@dataclass(frozen=True, slots=True)
class Measuring:
    """The lidar's noise, from how far points lie off their planes."""

    #: derived: room of the gate, wide enough to see the tails: one in five hundred million of a normal law is beyond,
    gate_sigmas: float = 6.0
    #: derived: and how far the weights taper to zero, in standard deviations of what they find: one in sixteen thousand is
    #: beyond; what the taper takes of the variance is put back (lidar_noise.py).
    taper_sigmas: float = 4.0
    #: judged: bands of the squared cosine of incidence, by which range and surface are told apart: two unknowns from twelve
    #: values.
    bands: int = 12
    #: derived: fewer points tell no noise: a sigma of N is known to 1 / sqrt(2 N), of all to 3 %, of a band to 7 %, of a
    #: plane in a scan, whose mean is taken out, to 16 %.
    fewest_points: int = 500
    fewest_in_band: int = 100
    fewest_on_plane: int = 20
    #: judged: passes until variance and weights agree to round-off. A bound alone.
    passes: int = 30
    #: derived: of a thinned cloud, until a thousandth of the three digits that are kept no longer changes.
    agreeing: float = 1e-6
    #: derived: steps in which the law's integrals are kept, two thousandths of a standard deviation: a line between them is off
    #: by a millionth.
    steps: int = 4000
    #: judged: no lidar is better than this, a tenth of a millimetre, and of no more than sixteen thousand points is it
    #: known to three digits.
    least_std_m: float = 1e-4
    digits: int = 3


@dataclass(frozen=True, slots=True)
class Surveying:
    """Where planes are, from the returns on them and beside them."""

    #: judged: points that are worth a call of their own. Time alone depends on it.
    batch_points: int = 20_000
    #: derived: tables of so many lasers' moments are 13 MB, on each of four threads. A bound on memory: time alone depends on it.
    clusters: int = 16_000
    #: derived: of thinned points those of so many lasers are taken at once, as a VLP-16 has: of 4000 points of a sweep by 128
    #: lasers next to each is alone in its ten milliseconds, plane and laser, and its moments are twenty times what it is itself.
    #: Time alone depends on it.
    lasers_at_once: int = 16
    #: derived: the points of these are thinned by so much at least, the least stride beside 1 that visits all of them.
    least_stride: int = 3
    #: derived: where so many thinned points meet planes is kept for the next step of the same round, 75 MB, those of two
    #: minutes. Those beyond are asked for anew, a hundredth of a long recording's time.
    kept: int = 1_000_000
    #: judged: returns this near are looked at for what lies beside a plane: a door's frame, a skirting board, a hand's
    #: breadth and a half.
    beside_m: float = 0.3
    #: judged: returns of a cell are another surface's, a door's in its wall, where their mean is further from the plane
    #: than this many standard deviations of one of them. A cell of a hundred points knows its mean to a tenth of one; what
    #: is nearer is estimated as a bend.
    off_sigmas: float = 2.0


@dataclass(frozen=True, slots=True)
class Straying:
    """What the propagated motion may be wrong by when it begins, and what a plane in view leaves of that."""

    #: judged: what a solve of the whole leaves of the last knot's position and velocity, where planes hold it to a
    #: centimetre. It widens the first gates, and seeing a plane ends it.
    position_std_m: float = 0.02
    velocity_std_m_s: float = 0.05
    #: judged: of the acceleration before anything is known of it: a hundredth of gravity, half a degree of its direction.
    #: It widens the first gates,
    acceleration_std_m_s2: float = 0.1
    #: derived: and at the least: what a wrong scale or axis of a good sensor, 0.05 %, makes of gravity itself.
    least_acceleration_std_m_s2: float = 0.005
    #: judged: what a piece's points leave of a plane's distance: the calibration's and the map's error, not the noise of
    #: points. It keeps gates from closing on a plane that is a little wrong.
    seen_std_m: float = 0.015
    #: derived: after the last plane in view, knots are kept for so long: what the IMU alone adds in it, half of 0.1 m/s2
    #: times its square, is 12 mm, less than the gate.
    kept_s: float = 0.5
    #: data sheets: spinning lidars turn ten times a second as they come. A scan counts for a piece that begins up to half a
    #: sweep later.
    half_sweep_s: float = 0.05
    #: judged: new planes are looked for among so many of the last scans at the least: half a second, as a single one has a
    #: ring or two on a far wall.
    fewest_scans: int = 5


@dataclass(frozen=True, slots=True)
class Regaining:
    """A lost plane known again in one scan."""

    #: judged: points of the scan that are cut into planes, as many as a plane is drawn among in any cloud, and the fewest
    #: that are worth it.
    points: int = 4000
    fewest_points: int = 200
    #: judged: a lost plane may be seen by its edge alone: fewer points do, but a larger share. What is found has still to
    #: agree in normal and place.
    segments: SegmentSettings = SegmentSettings(min_points=100, min_share=0.03)  # noqa: RUF009  frozen


@dataclass(frozen=True, slots=True)
class Doubting:
    """Whether a plane is one, and whether the chosen ones hold a pose."""

    #: judged: places on a plane: a hand's breadth and a half. Smaller ones have too few points for a mean, larger ones blur
    #: a door's frame into its wall.
    cell_m: float = 0.3
    #: derived: normals hold three directions where the smallest singular value of three orthogonal ones would be one: a
    #: fifth is a third way 11 deg off the others'.
    least_spread: float = 0.2
    #: judged: what has moved farthest is told by this percentile: a bin at a plane's edge tells nothing of the rest.
    moved_percent: float = 95.0
    #: judged: surveys that go to and fro have done so in so many of them: two cycles of two, which chance does not make.
    to_and_fro: int = 4
    #: measured: rounds on the way to rest move points by a third to a half of what the one before did, in one a little more
    #: while the noise is learnt; a box whose cells come and go has led twelve rounds about. So many in a row do not move less.
    wandering: int = 2


@dataclass(frozen=True, slots=True)
class Watching:
    """What whoever watches is told; nothing depends on it."""

    #: judged: how far along the estimation is, as a share of its usual time (five recordings of 12 to 60 s): the motion is known,
    #: and of that the coarse rounds are done; a part of the points has settled. A bar alone depends on it.
    motion_share: float = 0.26
    coarse_share: float = 0.8
    settled_share: float = 0.62
    #: judged: nobody knows how many rounds there will be; a part of the points settles in two to four, of which each is taken
    #: for so much of what is left, and all of them in one, whose first part this is. A bar alone depends on it.
    settling_round: float = 0.5
    resting_round: float = 0.25
    #: judged: sweeps that are shown, and instants of each: within half of one the twist hardly changes, as far as the eye
    #: can tell. A picture alone depends on it.
    sweeps: int = 12
    instants: int = 3
    #: derived: told to microseconds, instants of a sweep that lasts no time are still apart.
    shortest_s: float = 1e-3
    #: judged: scans between two reports: two seconds of recording, a tenth of a second of work. Words alone depend on it.
    told_every_scans: int = 20


CHAIN, HEARING, HOLDING, MEASURING, WANDERING = Chain(), Hearing(), Holding(), Measuring(), Wandering()
SURVEYING, STRAYING, REGAINING, DOUBTING, WATCHING = Surveying(), Straying(), Regaining(), Doubting(), Watching()


@dataclass(frozen=True, slots=True)
class Sheets:
    """When a sensor is not what its data sheet has."""

    #: derived: chance puts the parameters of a block so far from what a true sheet has in one block of a million: with a dozen
    #: blocks to judge, in one recording of a hundred thousand.
    chance: float = 1e-6


SHEETS = Sheets()
