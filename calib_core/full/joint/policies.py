"""What each step of the joint estimation goes by: every number that steers it, with its unit and its reason.

A step is a function of what is known and of its policy. Which steps there are, in which rounds, is the schedule's (schedule.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, log2


@dataclass(frozen=True, slots=True)
class Round:
    """One round: points gathered under the present estimate, and a descent."""

    #: judged: room in the gate beyond the noise, for what the motion may be wrong by: 12 cm at the start, as the track is
    #: right to centimetres and half a degree at 10 m is 9 cm; half of it in each coarser round. The end does not depend on
    #: it, as long as it begins wide enough.
    gate_m: float
    #: judged: most steps of the descent; what does not end is taken up by the next round.
    iterations: int
    #: derived: a cost lower by x^2 / 2 is a step of x sigma: it ends where the next step is below a third of a standard
    #: deviation, which the next association would not feel.
    least_decrease: float = 0.05
    #: derived: whether the planes' support is surveyed first, which wants a motion that lays them where they are.
    survey: bool = True
    #: derived: whether what the data leave open is held from there on, which wants a motion whose noise is not taken for
    #: excitation.
    hold: bool = True
    #: derived: whether the calibration stays as it is: before the motion fits, a calibration would take up its errors.
    motion_alone: bool = False
    #: judged: every so many-th point; 0 for as many as `Sampling` has it. Time alone depends on it.
    stride: int = 0
    #: derived: whether hits near two planes are told by the lidar's noise, which has to be known; else by the gate's own
    #: fixed margin.
    margin_by_noise: bool = True


@dataclass(frozen=True, slots=True)
class Sampling:
    """Which points the coarse rounds and the surveys use."""

    #: derived: points in all, but within the bounds a scan below: of a minute's 17 million one in 22, whose sigmas are 4.6
    #: times the last ones; planes and motion are known to them, and that is what the last rounds, with all points, start
    #: from.
    points: int = 800_000
    points_per_scan: tuple[int, int] = (800, 4000)
    #: judged: so many scans tell the size of a typical one. Only how many points a round takes depends on it.
    typical_scans: int = 20
    #: derived: so many points of each of so many scans tell the lidar's noise: of 128,000 in all a sigma is known to
    #: 1 / sqrt(2 x 128000) = 0.2 %, less than its third digit.
    noise_scans: int = 16
    noise_points: int = 8000
    #: measured on partial-views: at 6 a corner's floor was off by a quarter of its sigma, always the same way. Hits nearer
    #: to another plane than this, in standard deviations of the range, are ambiguous: a point within half of it may be
    #: nearer to the wrong plane. Twice the gate: with less, one plane loses the tail of its noise to another, behind which
    #: that one then seems to go on.
    margin_sigmas: float = 8.0
    #: judged: the least and the most of it: a centimetre's lidar tells planes 3 cm apart, no lidar needs more than a hand.
    #: Points beside edges are left out or not by it.
    margins_m: tuple[float, float] = (0.03, 0.3)


@dataclass(frozen=True, slots=True)
class Propagation:
    """How the estimate is propagated by the IMU over what the lidar alone could not follow."""

    #: judged: knots predicted at a time: a hand moves by decimetres in it, an IMU drifts by millimetres (half of 0.1 m/s2
    #: times 0.3 s squared is 5).
    piece_s: float = 0.3
    #: judged: knots solved again with each piece, four of them: older ones feel nothing of new points. The whole is solved
    #: again later in any case.
    window_s: float = 1.2
    #: judged: room in a gate beyond the noise and three standard deviations of the predicted drift: what a calibration of
    #: the coarse rounds is wrong by.
    gate_m: float = 0.05
    #: judged: the second pass gates by so much of it, as the first has taken most of the drift away.
    tightened: float = 0.8
    #: judged: a gate wider than this, a hand's length, could take clutter for the plane: the plane has to be known again by
    #: its normal.
    widest_gate_m: float = 0.2
    #: judged: its normal has to agree to this: gyroscopes keep directions to a degree for a minute, and one scan tells a
    #: small plane's normal to as much.
    same_normal_deg: float = 3.0
    #: judged: and its distance to three standard deviations of the drift and this, a wall's thickness: nearer than its
    #: other side.
    same_place_m: float = 0.1
    #: judged: points of a lost plane may lie so far from where it is predicted, beyond three standard deviations of the
    #: drift. What is found there has still to agree in normal and place.
    regained_gate_m: float = 0.3
    #: judged: a plane with fewer points in a piece has not been seen. What is taken for seen with less may be a passing
    #: hand.
    fewest_points: int = 20
    #: judged: a plane may go on so far beyond what was seen of it: three cells of the survey a piece. Farther, another
    #: surface may lie in its plane.
    join_on_m: float = 0.6
    #: judged: with no plane in view for so long, even directions are lost. Where the recording is left off depends on it.
    blind_limit_s: float = 40.0
    #: derived: a plane out of view for so long has come back when it is seen again: the whole is solved then. A window and
    #: a piece, within which it never left the solve.
    away_s: float = 1.5
    #: judged: new planes are looked for where the known ones explain less than this share of what they did at first. How
    #: soon a new wall helps depends on it,
    explained: float = 0.6
    #: judged: but not more often than this. Time alone depends on it.
    fresh_look_s: float = 1.5
    #: derived: the whole is solved again when so many times as much of it is covered, so that all solves together cost
    #: twice the last; at its end even for a little more.
    doubled: float = 2.0
    little_more: float = 1.05
    #: derived: a rest of the recording shorter than this is not worth going after: none for a solve, a second for a
    #: forecast.
    least_rest_s: float = 0.0
    #: judged: most steps of the descents: of a piece, of a window back to where a regained plane was last seen, of the
    #: whole. What does not end is taken up by the next.
    piece_iterations: int = 6
    regained_iterations: int = 10
    whole_iterations: int = 6
    #: derived: they end where the next step would lower the cost by less than this: a step of sqrt(0.002), a twentieth of a
    #: sigma.
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

    #: measured: returns and averages of walls scatter (squared) less than three times as much as others. A plane is none
    #: that scatters so many times as much, or whose averages wander so, by more than walls are off flat anyway
    #: (Judgement.least_m).
    worst_scatter: float = 5.0
    worst_wandering: float = 4.0
    #: judged: while the motion is rough a plane may be that far off from place to place and be none the worse; afterwards
    #: Judgement decides.
    rough_m: float = 0.008
    #: measured: persons and boxes that are taken for planes hold 0.5 to 5 % of the points of a room, a wall with a door ajar, of
    #: which wide gates see the leaf too, 30 %. Until the sensors are known, what holds more than this part is left to be judged
    #: later: a wall that goes then has to do without its say.
    clutter_share: float = 0.12
    #: judged: what bends the motion hides what bends less: planes are left out in so many turns at the most. More cost
    #: time.
    turns: int = 3
    #: derived: three planes that face three ways hold a pose, fewer do not.
    fewest: int = 3
    #: judged: new ones are looked for among so many points of so many scans that lie this far from every plane: ninety
    #: thousand, of which a plane of three hundredths has thousands.
    scans: int = 60
    points_per_scan: int = 1500
    away_m: float = 0.15
    #: judged: fewer points that lie on no plane are no plane. Nothing is looked for then.
    fewest_points: int = 1000
    #: judged: a find that faces the same way as a known plane, and lies so near, is that plane: doors lie before their
    #: walls. The same as for planes that are shown (Patches).
    same_normal_deg: float = 8.0
    same_place_m: float = 0.25
    #: judged: the same of one that a person has dropped, so many times as far and as much askew: along what the others do not see
    #: the map drifts, and what comes back is bent by it (seen: a floor by 9 deg and 0.3 m in ten seconds, with two walls).
    dropped_apart: float = 3.0
    #: judged: a plane that is left out and faces the same way as one that stays is that one seen again, if it lies so near:
    #: twice as far, as what moved has moved.
    same_surface_m: float = 0.5
    #: judged: of planes that are parallel to this and this near, points may be either's: as for planes that somebody gives
    #: (Patches).
    twin_deg: float = 3.0
    twin_m: float = 0.05
    #: judged: what joins has to fill a share of what was searched, be so broad and so flat. Small planes tell little, and
    #: false ones harm.
    least_share: float = 0.03
    least_points: int = 300
    least_breadth_m: float = 0.25
    most: int = 6
    flat_m: float = 0.05
    #: judged: the round that lets new planes settle, at a gate of what the motion is wrong by then. What follows settles to
    #: the end.
    settle_in: Round = Round(gate_m=0.05, iterations=8, hold=False)


@dataclass(frozen=True, slots=True)
class Settling:
    """To where support, noise, gates and motion no longer change one another: first a part of the points, then all."""

    #: judged: room in the gates while the planes' support is learnt, and while the motion settles: millimetres are what is
    #: left to move. Gates this wide hold all of a wall's points and little of what stands before it.
    learning_m: float = 0.02
    settling_m: float = 0.01
    #: derived: a point more or less is a ten-millionth of the cost; settled is what moved across the gates by less than
    #: this part of the points' own standard deviation. Nothing that matters depends on the last of those moves, but whether
    #: two starts end at the same cost to a millionth does.
    unmoved: float = 2e-6
    #: measured: a round moves points by a twentieth of what the one before it did. So little, under the same cells and the
    #: same noise as in the round before, changes neither in the next one: it is at rest. Gates that noise has moved by no
    #: more are the same. A twentieth of it is 3e-5 of a point's scatter, a thousandth of what the points of a round leave
    #: open of a motion (2000 unknowns of 800,000 points: 0.05).
    still: float = 5e-4
    #: judged: so few of all cells come and go with the points of a round that moved nothing: where a wall ends, not what it is.
    flickering: float = 0.01
    #: judged: where rounds lead each other about, cells and noise are held, and what a held round still moves by is told with all
    #: points: a tenth of what this part of them leaves open.
    led_about: float = 5e-3
    #: derived: rounds that move points by less than this part of their scatter, one or two millimetres, leave planes where
    #: they are to less than what plaster is allowed: those that are none go before the rest is told to the last digit.
    judged: float = 0.1
    #: measured in cluttered rooms: until they are judged, rounds on the way to rest move points by a third to a half of what the
    #: one before did; with a person among the planes by as much again and again.
    stalled: float = 0.7
    #: judged: all points are gated anew where the solve has moved planes by more than this part of their scatter: a gate
    #: laid about a wrong motion keeps those points that confirm it.
    settled: float = 0.3
    #: judged: most rounds of either kind. What has not settled then is refused with what moved.
    rounds: int = 12
    #: derived: most steps of a descent with all points; the next one counts as nothing from a decrease of 0.001 on:
    #: sqrt(0.002), a twentieth of a sigma.
    iterations: int = 15
    fixed_point: float = 1e-3
    #: derived: the descent's own end: a step of a seven-hundredth of a sigma,
    least_decrease: float = 1e-6
    #: derived: or of a thousandth of the first one: what the links were linearised about was off by that one, and what a
    #: thousandth more would find is not the minimum of the next.
    least_share: float = 1e-6
    #: derived: what fifteen steps move the calibration by less than this many sigmas, the descents that they are of could not
    #: move by one in all: a descent that has used up its steps for so little is the last.
    stands_sigmas: float = 0.05
    #: derived: a seventh of a sigma is far within what one step has been seen to find the end of.
    last_decrease: float = 1e-2
    #: judged: what still moves by more than this part of its own standard deviation after the last round has not settled:
    #: it could be wrong by as much again as is stated.
    unsettled_sigmas: float = 1.0
    #: measured: rounds that come to rest move points less and less, or to and fro by a little more and less; one that ran
    #: off along the heights of patches doubled its moves each time. So many in a row that each move points farther, to so
    #: many times the least of them all, go away from rest.
    farther: int = 3
    times_farther: float = 4.0
    #: measured: of recordings that came to rest none took more than four rounds to leave planes where they are, or six with a
    #: person among them. With a hum near half of the IMU's rate, rounds moved points by 0.15 to 0.8 of their scatter for as long
    #: as there were any. So many, after as many, none of which comes nearer to rest, lead nowhere.
    restless: int = 4
    #: measured: descents with all points find 1e4, then 6, then 0.001 where there is a fixed point; in a lift they found 2e5,
    #: 1e6, 2e6, 5e6, and so for 36, in 90 s. So many in a row that all predict more than a step of a sigma, and as much as those
    #: before, lead to none;
    lost: int = 3
    lost_decrease: float = 1.0
    #: derived: nor do those with points given anew where they are lost as well: with those given a third time all is as it was.
    anew: int = 2

    def descents(self, most_fixed_point: int) -> int:
        """Most descents with all points. most_fixed_point: under one association."""
        return self.rounds + most_fixed_point


@dataclass(frozen=True, slots=True)
class Steadying:
    """How often a coarse round is gone through again."""

    #: measured: points move by 0.2 to 0.6 of their own scatter after the first coarse rounds of most recordings; one with a
    #: poor start takes four or five rounds more until it has done its work,
    steady: float = 1.0
    #: judged: but no more than this: twice as many.
    patience: int = 10


@dataclass(frozen=True, slots=True)
class Surfaces:
    """Where walls are off flat, the heights of their patches are unknowns too."""

    #: judged: of a patch, one standard deviation: walls are off flat by 2 to 5 mm over a few metres. What few points tell
    #: of a patch depends on it.
    height_std_m: float = 0.003
    #: judged: and how far along a wall heights are alike: "over a few metres". Tolerances of finished walls (DIN 18202: 5 mm
    #: under a straightedge of 1 m, 10 under 4 m, 20 under 10 m) grow with the root of the length, as what is correlated by
    #: exp(-distance / length) does. Heights that were independent left bends of a whole wall no room, and what makes a cone
    #: of a floor, ranges that read short at grazing incidence, was known three times worse than was stated.
    alike_m: float = 3.0
    #: measured on rooms of two simulators: flat walls show nothing beyond chance by so many standard deviations. Of a bend of
    #: 1.5 mm the motion and sixteen lasers' angles have taken up all but 0.4; where a corridor's walls were off flat by 1 to 3,
    #: and two stairwells', 0.14 to 0.19 mm were left, and the answer 3.5 to 4.1 of its sigmas off, 1.3 to 2 with shapes.
    sigmas: float = 6.0
    #: measured: skirting boards and a door ajar stand out by 10 to 50 mm, a patch that followed a box went on to 130. A
    #: patch so many prior standard deviations (9 cm) off its plane is another surface's: shapes are left alone then.
    most_sigmas: float = 30.0
    #: measured: heights of walls bent by 10 mm, with boards, a door ajar and a window, are 4 to 5 mm in the mean; of a panel
    #: that a door before it passes for, 11 to 13, and the answer up to 4.6 of its sigmas off. So many prior standard deviations
    #: are no wall's, and heights may be as large as they are then.
    rough: float = 3.0
    #: measured: so many rounds after they were let go, heights of bent walls, with boards, a door ajar and glass besides, moved
    #: points by 0.006 to 0.04 of their scatter, those about a box that was chosen by half of it, and so for a dozen rounds. What
    #: still moves by as much as keeps planes from being judged is no wall.
    rounds: int = 3
    #: derived: knots times lasers: each takes three clusters of moments then. A bound on memory; beyond, error bars alone
    #: count what is bent.
    most_clusters: int = 400_000


@dataclass(frozen=True, slots=True)
class Tones:
    """Where the IMU was shaken faster than it samples, sines in its readings are unknowns too."""

    #: derived: by chance twice what a tone lowers the cost is chi-square of 24 degrees: so much is once in ten billion tried.
    #: Measured at rest: walls bent by 5 mm 15 to 18, cheap sensors 15; a tone of 0.05 m/s2 57 to 318.
    explains: float = 50.0
    #: measured before planes are judged: bent walls 71, with boards, a door and a window besides 166; tones that matter 230 to
    #: 6600.
    explains_in_company: float = 200.0
    #: measured where the sensors were just let go: bent walls 29, with the same besides 484, cheap sensors 18; tones that carry
    #: the motion off 630 to 8600. A tone that is none would have planes thrown out.
    explains_at_once: float = 600.0
    #: measured: beside the median over its neighbours nothing stood out by more than 15 to 25 in calm recordings at rest, unseen
    #: shaking by 22 to 300. Tones are looked for from here on; what is one is told by what it explains.
    beside: float = 20.0
    #: measured: the same before, where persons and bent walls make 25 to 40 and tones that matter 77 to 6000.
    beside_in_company: float = 40.0
    #: judged: turns to either side that are neighbours. Nearer, a tone's own foot would be its measure; further, what the
    #: motion takes up changes.
    neighbours: int = 8
    #: measured: how loud the score was of cheap sensors held at what they are meant to be, 50 to 850, of persons who are still
    #: among the planes some thousands; of a tone that carries the motion off hundreds of thousands.
    shouts: float = 10_000.0
    #: measured: so loud was a tone that the sensors' parameters had taken upon themselves, and louder than without them.
    taken: float = 200.0
    #: judged: most tones at a time: so many unknowns more still leave the motion to be told. More lines than that are left
    #: in the readings, and widen the error bars.
    most: int = 8
    #: judged: rounds of settling between one search and the next: a tone that is left shows again in the next.
    settling_rounds: int = 3
    #: measured: a recording shaken by 3 m/s2 was refused at ten turns that is answered with its slow tone; fewer than two
    #: are the biases' own drift,
    fewest_turns: float = 2.0
    #: measured: the same where an engine shakes the IMU: a line within 0.05 Hz of its rate reads as 0.5 m/s2 that come and go
    #: once a recording, 0.6 turns. Taken for the biases' drift, it led two of twenty recordings 1 to 4 deg away.
    fewest_turns_shaken: float = 0.4
    #: derived: above this part of the knots' highest frequency nothing is left of a tone once it is integrated: its shift
    #: is its acceleration over (2 pi f)^2, at 30 Hz a thirty-five-thousandth.
    highest: float = 0.6
    #: derived: the periodogram is read at so many points for each that is independent: a peak between two of them is lower
    #: by 1 - sinc^2(1/8), 5 % at the most.
    padded: int = 4
    #: judged: turns at rest with all points, which show what a part of them does not. Time depends on it.
    turns: int = 3
    #: derived: of a tone's frequency, beforehand, in units of one turn in the recording: the distance of the points at
    #: which the periodogram is read.
    resolution: float = 0.25
    #: derived: half of one turn in the recording is where the foot of a tone has its first zero to either side of where it has
    #: come to: nearer, it is that tone's own. How near two of them may lie, in turns. Seen: of 0.95 and 0.984 Hz in 20 s the
    #: second was left out at one turn, and its image in the lidar's view taken for one of 2.3 m/s2.
    apart: float = 0.5
    #: derived: under the periodogram's taper a line is four turns wide: three in a row, each nearer to the next than that, are no
    #: lines but one hump, what a lift's start or a wall that is no plane leaves. Two there are: motors that turn nearly alike. An
    #: engine's speed makes bands; where nothing else shakes the IMU, no engine does.
    hump: float = 4.0
    hump_of: int = 3
    #: measured: hands, legs and cars move below. Of a lone line that shook the IMU at 0.05 to 1 m/s2 and was read as 0.3 to 0.8
    #: Hz no other frequency as slow and two turns away explained more than a fiftieth of what it did; where ranges bent by
    #: centimetres, fabric sagged or an accelerometer lagged, others explained 0.6 to 0.85 of the best.
    slow_hz: float = 2.0
    foot: float = 2.0
    rivals: float = 0.5
    #: measured: of engines' slow tones in twelve recordings, planes without any one of them told 0.8 and more of what they
    #: should; of those that a floor made that stood for two, 0.31 and 0.09.
    agreed: float = 0.5
    #: measured: bent walls, a door ajar and boards at their feet explained tones of 10, 20, 29.6 and 30 Hz and up to 29 m/s2: a
    #: sweep's harmonics, to either side of which a hand's motion goes up to one or two hertz. What shakes there moves by tenths
    #: of a millimetre.
    view_hz: float = 1.5
    #: judged: so many frequencies of the loudest and as many of those beside their neighbours are tried. Time depends on it.
    tried: int = 3

    @property
    def most_rounds(self) -> int:
        """Bound on the rounds until all are found: two for each to be told, and those of settling."""
        return (self.most + self.turns) * (2 + self.settling_rounds)


@dataclass(frozen=True, slots=True)
class Limits:
    """Where an answer has left what the stages before have found, and no descent brings it back."""

    #: derived: from the offset at which both sensors' turning agrees, in sweeps: further off, points would be laid out by
    #: the motion of another sweep.
    offset_sweeps: float = 1.0
    #: derived: a lever arm longer than this (the standing prior's own standard deviation) that claims to be known to less
    #: than `lever_arm_std_m`, a hundredth of it, is the length of no machine, but of a motion that points do not lie on.
    lever_arm_m: float = 10.0
    lever_arm_std_m: float = 0.1
    #: judged: so many times its prior's standard deviation no parameter of a working sensor is: lasers off by a decimetre.
    #: A few times is a sensor worse than its data sheet, which the solve may well find.
    sensor_sigmas: float = 12.0
