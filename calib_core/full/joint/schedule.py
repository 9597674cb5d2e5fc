"""In which rounds the joint problem is solved, and every number that steers them.

Coarse to fine: the first rounds use the scans that could be tracked by the lidar alone and a part of their points, within
a hand's breadth of a plane; then the estimate itself is propagated over the rest of the recording; the last rounds use
every point within four standard deviations, until nothing moves. A forecast is another schedule: it ends with the motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, log2


@dataclass(frozen=True, slots=True)
class Round:
    """One round: points gathered under the present estimate, and a descent."""

    #: Room in the gate beyond the noise, for what the motion may be wrong by.
    gate_m: float
    #: Most steps of the descent.
    iterations: int
    #: It ends where the next step would lower the cost by less than this: a third of a standard deviation, which the next
    #: association would not feel.
    least_decrease: float = 0.05
    #: Whether the planes' support is surveyed first.
    survey: bool = True
    #: Whether what the data leave open is held from there on.
    hold: bool = True
    #: Whether the calibration stays as it is.
    motion_alone: bool = False
    #: Every so many-th point; 0 for as many as `Sampling` has it.
    stride: int = 0
    #: Whether hits near two planes are told by the lidar's noise; else by the gate's own fixed margin.
    margin_by_noise: bool = True


@dataclass(frozen=True, slots=True)
class Sampling:
    """Which points the coarse rounds and the surveys use."""

    #: Points in all, but within the bounds a scan below: with them planes and motion are known to a tenth of what all
    #: points tell, which is what the last rounds start from.
    points: int = 800_000
    points_per_scan: tuple[int, int] = (800, 4000)
    #: So many scans tell the size of a typical one.
    typical_scans: int = 20
    #: And so many the lidar's noise: each holds thousands of points.
    noise_scans: int = 16
    #: Hits nearer to another plane than this are ambiguous, in standard deviations of the range: a point within half of
    #: it may be nearer to the wrong plane. Twice the gate: with less, one plane loses the tail of its noise to another, behind
    #: which that one then seems to go on (at 6 a corner's floor was off by a quarter of its sigma, always the same way).
    margin_sigmas: float = 8.0
    #: The least and the most of it: a centimetre's lidar tells planes 3 cm apart, no lidar needs more than a hand.
    margins_m: tuple[float, float] = (0.03, 0.3)


@dataclass(frozen=True, slots=True)
class Propagation:
    """How the estimate is propagated by the IMU over what the lidar alone could not follow."""

    #: Knots predicted at a time: a hand moves by decimetres in it, an IMU drifts by millimetres.
    piece_s: float = 0.3
    #: Knots solved again with each piece: older ones feel nothing of new points.
    window_s: float = 1.2
    #: Room in a gate beyond the noise and three standard deviations of the predicted drift.
    gate_m: float = 0.05
    #: The second pass gates by so much of it.
    tightened: float = 0.8
    #: A gate wider than this could take clutter for the plane: the plane has to be known again by its normal.
    widest_gate_m: float = 0.2
    #: Its normal has to agree to this: gyroscopes keep directions to a degree for a minute.
    same_normal_deg: float = 3.0
    #: And its distance to three standard deviations of the drift and this, a wall's thickness.
    same_place_m: float = 0.1
    #: Points of a lost plane may lie so far from where it is predicted, beyond three standard deviations of the drift.
    regained_gate_m: float = 0.3
    #: A plane with fewer points in a piece has not been seen.
    fewest_points: int = 20
    #: A plane may go on so far beyond what was seen of it: three cells.
    join_on_m: float = 0.6
    #: With no plane in view for so long, even directions are lost.
    blind_limit_s: float = 40.0
    #: A plane out of view for so long has come back when it is seen again: the whole is solved then.
    away_s: float = 1.5
    #: New planes are looked for where the known ones explain less than this share of what they did at first,
    explained: float = 0.6
    #: but not more often than this.
    fresh_look_s: float = 1.5
    #: The whole is solved again when so many times as much of it is covered; at its end even for a little more.
    doubled: float = 2.0
    little_more: float = 1.05
    #: A rest of the recording shorter than this is not worth going after.
    least_rest_s: float = 0.0
    #: Most steps of the descents: of a piece, of a window back to where a regained plane was last seen, of the whole.
    piece_iterations: int = 6
    regained_iterations: int = 10
    whole_iterations: int = 6
    #: They end where the next step would lower the cost by less than this.
    least_decrease: float = 1e-3

    def most_rounds(self, tracked_s: float, total_s: float) -> int:
        """Rounds over the whole that a propagation may take, by what it is for.

        One each time the span has doubled, one at the end, and one for every time that a plane can have been away for
        `away_s`; each in two passes.
        """
        rest_s = max(total_s - tracked_s, 0.0)
        if rest_s <= 0.0:
            return 0
        doublings = ceil(log2(max(total_s / max(tracked_s, self.piece_s), 1.0)))
        return 2 * (doublings + 1 + ceil(rest_s / self.away_s))


@dataclass(frozen=True, slots=True)
class PlaneSet:
    """Which planes join on the way, and which are dropped."""

    #: A plane is none that scatters so many times as much as others, or whose averages wander so: walls stay below three.
    worst_scatter: float = 5.0
    worst_wandering: float = 4.0
    #: While the motion is rough a plane may be that far off from place to place and be none the worse.
    rough_m: float = 0.008
    #: What bends the motion hides what bends less: planes are left out in so many turns at the most.
    turns: int = 3
    #: Fewer planes do not hold a pose.
    fewest: int = 3
    #: New ones are looked for among so many points of so many scans that lie this far from every plane.
    scans: int = 60
    points_per_scan: int = 1500
    away_m: float = 0.15
    #: Fewer of these are no plane.
    fewest_points: int = 1000
    #: A find that faces the same way as a known plane, and lies so near, is that plane: doors lie before their walls.
    same_normal_deg: float = 8.0
    same_place_m: float = 0.25
    #: A plane that is left out and faces the same way as one that stays is that one seen again, if it lies so near.
    same_surface_m: float = 0.5
    #: What joins has to fill a share of what was searched, be so broad and so flat.
    least_share: float = 0.03
    least_points: int = 300
    least_breadth_m: float = 0.25
    most: int = 6
    flat_m: float = 0.05
    #: The round that lets new planes settle.
    settle_in: Round = Round(gate_m=0.05, iterations=8, hold=False)


@dataclass(frozen=True, slots=True)
class Settling:
    """To where support, noise, gates and motion no longer change one another: first a part of the points, then all."""

    #: Room in the gates while the planes' support is learnt, and while the motion settles.
    learning_m: float = 0.02
    settling_m: float = 0.01
    #: Settled: points moved across their gates by less than this part of their own standard deviation. Nothing that matters
    #: depends on the last of those moves, but whether two starts end at the same cost to a millionth does: a point more or
    #: less is a ten-millionth of it.
    unmoved: float = 2e-6
    #: All points are gated anew where the solve has moved planes by more than this: a gate laid about a wrong motion keeps
    #: those points that confirm it.
    settled: float = 0.3
    #: Most rounds of either kind.
    rounds: int = 12
    #: Most steps of a descent with all points, and where the next one counts as nothing: a twentieth of a sigma.
    iterations: int = 15
    fixed_point: float = 1e-3
    #: The descent's own end.
    least_decrease: float = 1e-6
    #: What still moves by more than this part of its own standard deviation after the last round has not settled.
    unsettled_sigmas: float = 1.0

    def descents(self, most_fixed_point: int) -> int:
        """Most descents with all points. most_fixed_point: under one association."""
        return self.rounds + most_fixed_point


@dataclass(frozen=True, slots=True)
class Steadying:
    """How often a coarse round is gone through again."""

    #: It has done its work where points move by less than this part of their own scatter: most recordings are there at once
    #: (0.2 to 0.6); one with a poor start takes four or five rounds more,
    steady: float = 1.0
    #: but no more than this.
    patience: int = 10


@dataclass(frozen=True, slots=True)
class Surfaces:
    """Where walls are off flat, the heights of their patches are unknowns too."""

    #: Of a patch, one standard deviation: walls are off flat by 2 to 5 mm over a few metres.
    height_std_m: float = 0.003
    #: So much from place to place, beyond chance by so many standard deviations, is worth it. Of a bend of 1.5 mm the motion and
    #: sixteen lasers' angles have been seen to take up all but 0.4 mm; flat walls show 0.
    least_m: float = 0.0002
    sigmas: float = 6.0
    #: A patch so many prior standard deviations (9 cm) off its plane is another surface's: shapes are left alone then. Skirting
    #: boards and a door ajar stand out by 10 to 50 mm; a patch that followed a box went on to 130.
    most_sigmas: float = 30.0
    #: Knots times lasers: each takes three clusters of moments then. Beyond, error bars alone count what is bent.
    most_clusters: int = 400_000


@dataclass(frozen=True, slots=True)
class Tones:
    """Where the IMU was shaken faster than it samples, sines in its readings are unknowns too."""

    #: The score's periodogram stands out by so much beside its mean by chance: over six channels and thousands of frequencies
    #: chance makes 20 once in ten thousand recordings. Walls that bend by 5 mm, once settled, make 4 to 6.
    stands_out: float = 20.0
    #: The same before planes are judged: two persons who walk among them have made 20 and more.
    stands_out_in_company: float = 100.0
    #: The same while the sensors are still taken for ideal: cheap ones make 50 to 850 of the motion itself,
    #: persons who are still among the planes some thousands; a tone that carries the motion off hundreds of thousands.
    shouts: float = 10_000.0
    #: The same before the lidar's noise is known and planes are judged: bent walls make 58 then, a tone that would have planes
    #: thrown out thousands.
    stands_out_at_once: float = 200.0
    #: Most tones at a time: so many unknowns more still leave the motion to be told.
    most: int = 8
    #: Rounds of settling between one search and the next.
    settling_rounds: int = 3
    #: Fewer turns in the recording are the biases' own drift; above this part of the knots' highest frequency nothing is left
    #: of a tone once it is integrated.
    fewest_turns: float = 2.0
    highest: float = 0.6
    #: The periodogram is read at so many points for each that is independent.
    padded: int = 4
    #: Turns at rest with all points, which show what a part of them does not.
    turns: int = 2
    #: Of a tone's frequency, beforehand, and how near two of them may lie: in units of one turn in the recording. Nearer, their
    #: amplitudes in the room and with the IMU say the same of a rig that turns: three turns apart, two have been seen to part.
    resolution: float = 0.25
    apart: float = 4.0

    @property
    def most_rounds(self) -> int:
        """Bound on the rounds until all are found: two for each to be told, and those of settling."""
        return (self.most + self.turns) * (2 + self.settling_rounds)


@dataclass(frozen=True, slots=True)
class Limits:
    """Where an answer has left what the stages before have found, and no descent brings it back."""

    #: From the offset at which both sensors' turning agrees, in sweeps: further off, points would be laid out by the motion
    #: of another sweep.
    offset_sweeps: float = 1.0
    #: A lever arm longer than this (the standing prior's own standard deviation) that claims to be known to less than
    #: `lever_arm_std_m` is the length of no machine, but of a motion that points do not lie on.
    lever_arm_m: float = 10.0
    lever_arm_std_m: float = 0.1
    #: So many times its prior's standard deviation no parameter of a working sensor is: lasers off by a decimetre. A few
    #: times is a sensor worse than its data sheet, which the solve may well find.
    sensor_sigmas: float = 12.0


@dataclass(frozen=True, slots=True)
class Schedule:
    """All rounds. propagation: None where the estimate stays within what was tracked.   planes: None where they are given.

    instead: rounds where there is nothing to propagate to.   settling: None where the motion alone was asked for.
    """

    motion: Round
    coarse: tuple[Round, ...]
    propagation: Propagation | None
    planes: PlaneSet | None
    settling: Settling | None
    instead: tuple[Round, ...] = ()
    steadying: Steadying = Steadying()
    #: The first round in which the sensors' own parameters are unknowns: with them in place, planes are told from clutter.
    sensors: Round = Round(gate_m=0.05, iterations=8, hold=False)
    surfaces: Surfaces = Surfaces()
    tones: Tones = Tones()
    sampling: Sampling = Sampling()
    limits: Limits = Limits()

    def most_rounds(self, tracked_s: float, total_s: float, most_fixed_point: int) -> int:
        """Bound on the rounds in all. most_fixed_point: descents to a fixed point under the same association."""
        rounds = 2 + len(self.coarse) + 2 * self.steadying.patience + len(self.instead) + self.tones.most_rounds
        if self.propagation is not None:
            rounds += self.propagation.most_rounds(tracked_s, total_s)
        if self.planes is not None:
            rounds += 1
        if self.settling is not None:
            rounds += self.settling.rounds * (3 if self.planes is None else 3 + self.planes.turns)
            rounds += (1 + self.tones.turns) * self.settling.descents(most_fixed_point)
        return rounds


#: The calibration's. First the motion alone: which directions the data determine is judged before the calibration can
#: wander off along one that they do not.
FULL = Schedule(
    motion=Round(gate_m=0.12, iterations=4, survey=False, motion_alone=True),
    coarse=(Round(gate_m=0.12, iterations=10), Round(gate_m=0.06, iterations=10)),
    propagation=Propagation(),
    planes=PlaneSet(),
    settling=Settling(),
)

#: The forecast's. Start values are off by what is noise in a start; those along an open direction may lie anywhere, and a
#: solve holds them at zero: either would pass for noise of the lidar, or bend what is known of the rest.
FORECAST = Schedule(
    motion=Round(
        gate_m=0.12, iterations=2, least_decrease=1e-6, survey=False, motion_alone=True, stride=2, margin_by_noise=False
    ),
    coarse=(),
    propagation=Propagation(least_rest_s=1.0),
    planes=None,
    settling=None,
    tones=Tones(most=0),
    instead=(
        Round(
            gate_m=0.06, iterations=3, least_decrease=1e-6, survey=False, hold=False, stride=2, margin_by_noise=False
        ),
    ),
)
