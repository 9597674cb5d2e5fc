"""Every number of the lidar odometry, with its unit and its reason."""

from __future__ import annotations

from dataclasses import dataclass

from calib_core.planes.settings import SegmentSettings


@dataclass(frozen=True, slots=True)
class TrackSettings:
    """How one scan is registered to the planes, and when the next one is lost."""

    #: judged: points of a scan that are looked at, and of them in the least squares: a pose to a centimetre in some
    #: milliseconds. More cost time; the joint estimation uses all.
    sample: int = 5000
    points: int = 1500
    #: judged: with fewer points there is no scan to speak of. A lidar has hundreds of times as many.
    fewest_points: int = 60
    #: judged: points of the reference scan, by which the planes' reach begins: all of a sparse lidar's. What they miss is
    #: reached as scans follow.
    reference_points: int = 20_000
    #: derived: a rate that changes by 1.2 rad/s (the tie below) moves points at 3 m by 0.36 m in a tenth of a second. Width
    #: of the redescending weight, iteration by iteration, from there to what a lidar's noise and a sweep's bend leave. The
    #: way to the optimum, not the optimum, depends on all but the last.
    scales_m: tuple[float, ...] = (0.4, 0.3, 0.2, 0.15, 0.1, 0.07, 0.05, 0.05)
    #: judged: the same from three times as far off, where that has found nothing: a lurch between two scans.
    wide_scales_m: tuple[float, ...] = (1.2, 0.8, 0.6, 0.4, 0.3, 0.2, 0.15, 0.1, 0.07, 0.05, 0.05)
    #: derived: the same where the way to the scan is known: to centimetres, three of which a sweep's bend leaves.
    near_scales_m: tuple[float, ...] = (0.15, 0.1, 0.07, 0.05, 0.05)
    #: derived: two widths of the last weight, at which it is 1/25 of one. A point this near to its plane lies on it.
    inlier_m: float = 0.1
    #: judged: a point off the known part of its plane counts as this much further away: half a cell of the planes' reach.
    #: Doubtful returns give way where another plane is as near.
    outside_m: float = 0.2
    #: judged: 1 sigma of constant velocity over a tenth of a second, what hands do, of turn, place, rate and velocity: 12
    #: rad/s2 and 4 m/s2 of change. It holds what planes leave open, and little where they do not.
    tie_rotation_rad: float = 0.06
    tie_position_m: float = 0.05
    tie_rate_rad_s: float = 1.2
    tie_velocity_m_s: float = 0.4
    #: derived: the time that those are for is a usual sweep's; a fifth of it is the least that counts, as scans that repeat
    #: a stamp would be tied at no width.
    tie_s: float = 0.1
    least_tie_steps: float = 0.2
    #: derived: information [1/rad2, 1/m2] of a tenth of a milliradian and of a millimetre, far below what a track is right
    #: to. It holds a pose: the reference scan's is the map's.
    held: float = 1e8
    #: judged: the reference scan's velocities are anything that is carried: 1 sigma of a brisk turn and of a run.
    first_rate_rad_s: float = 2.0
    first_velocity_m_s: float = 2.0
    #: judged: 1 sigma of a point against the tie, in the least squares: points of one plane share its errors, of some
    #: centimetres while a sweep is bent. The more, the more the tie holds.
    fit_std_m: float = 0.05
    #: judged: 1 sigma of a point in the judgement of a pose: a lidar's noise (2 cm on data sheets) and the sweep's bend.
    #: Which poses count depends on it.
    lidar_std_m: float = 0.03
    #: judged: a plane counts for no more points than this in the least squares, and than that in the judgement, for its own
    #: error stays: 5 cm / sqrt(150) and 3 cm / sqrt(9) are what a plane is off by then, 4 mm and 1 cm.
    plane_points: float = 150.0
    sure_points: float = 9.0
    #: judged: with fewer points a plane may be anything that happens to be there. It then does not take part in a scan's
    #: pose.
    least_points: int = 10
    #: derived: ten radians and ten metres are beyond any pose in view: the judgement knows nothing of it beforehand.
    unknown_std: float = 10.0
    #: judged: a pose less certain than this (1 sigma along its worst direction) does not count; it is the tie's own turn,
    #: and twice its place, in a tenth of a second.
    trusted_rad: float = 0.06
    trusted_m: float = 0.1
    #: judged: a residual so many times the usual, and this beyond, is doubtful: the scan is tried from other starts. Time
    #: depends on it.
    trusted_rms: float = 1.7
    rms_slack_m: float = 0.01
    #: judged: what is usual lies between a good lidar's noise and so many times the first scan's, which stood still.
    least_rms_m: float = 0.015
    most_rms: float = 1.5
    #: derived: weights of 0.8^k have a memory of 1 / 0.2 = five scans: half a second, in which surroundings change little.
    newest: float = 0.2
    #: judged: shares of the points that lie on planes: lost below these, the latter of the usual; doubtful below that of
    #: the usual. Where a track ends depends on it, and what comes after is reached by the IMU.
    least_share: float = 0.15
    lost_share: float = 0.5
    doubtful_share: float = 0.85
    #: judged: another start is believed where it explains so many times as many points: more than chance gives one of two
    #: equal ones,
    better_share: float = 1.05
    #: judged: with the tie's standard deviations so many times as wide, as the tie is what is doubted.
    loosened: float = 5.0
    #: judged: other starts, where a scan would be lost: turns and steps of this size along each axis: about half of what a
    #: scan may jump, so that the wide weights reach the rest.
    other_turn_rad: float = 0.25
    other_step_m: float = 0.4
    #: judged: no hand, car or drone leaves its prediction by more in a tenth of a second, ten times the tie; a box looks
    #: the same after a half turn. A scan beyond is not taken.
    jump_rotation_rad: float = 0.6
    jump_position_m: float = 0.6
    least_jump_steps: float = 0.5
    #: judged: scans that tell no orientation are bridged for so long; a position unknown in some direction for so long, as
    #: planes that are in view hold the rest,
    bridge_s: float = 0.5
    coast_s: float = 2.0
    #: judged: at a velocity that fades within this, about half a swing of a hand;
    damping_s: float = 0.7
    #: derived: one missing scan, and half a period of jitter, is bridged whatever its period.
    bridged_periods: float = 1.5
    #: judged: new planes are looked for where fewer of the points lie on known ones, or after so much of a turn. Time
    #: depends on it, and how soon a new wall helps.
    grow_share: float = 0.93
    grow_turn_rad: float = 0.4
    #: judged: among so many points of the last scans: as many as a plane is searched in in any cloud.
    grow_points: int = 4000
    grow_scans: int = 3
    #: judged: not more often than every so many scans, and less and less often where nothing is found. A search takes as
    #: long as some scans.
    grow_every: int = 5
    grow_rarely: int = 40
    #: judged: 1 sigma of a turn from scan to scan and of the rate in a sweep, where they come from a gyroscope whose
    #: mounting is only roughly known: a tenth of a radian off, of 0.1 rad and of 1 rad/s.
    turning_rad: float = 0.01
    turning_rate_rad_s: float = 0.1
    #: derived: no less than this where it is well known: a lag that is right to 5 ms, while the rate changes by 4 rad/s2 over a
    #: tenth of a second; and by 6 rad/s2 within the sweep.
    known_turning_rad: float = 0.002
    known_turning_rate_rad_s: float = 0.03
    #: measured on drawn rigs: 1 sigma of a step from scan to scan that an accelerometer has felt, under a linear start; and of
    #: the velocity in a sweep, for which the mean over the step is taken: at 4 m/s2 half a tenth of a second away.
    step_m: float = 0.015
    step_m_s: float = 0.2
    #: derived: a scan whose points pull it further than so many of these standard deviations from such a step, or from the turn
    #: that came with it, is not taken: somebody fills its view.
    felt_step_sigmas: float = 3.0
    felt_turn_sigmas: float = 2.0


@dataclass(frozen=True, slots=True)
class MapSettings:
    """Where planes are known to be, and which new ones join."""

    #: derived: cells of a plane's reach: two rings of sixteen at 10 m are 0.35 m apart; 320 of them a side are 128 m,
    #: farther than walls are seen.
    cell_m: float = 0.4
    cells: int = 320
    #: judged: a point this near lies on a plane, and so much more a metre away, where rings are rough: three times a
    #: lidar's noise, and 3 mm a metre of turn within a sweep. Only where planes are known to be depends on it;
    near_m: float = 0.07
    near_per_m: float = 0.003
    #: judged: in the reference scan, whose sweep may be bent, this near: twice as much.
    seed_m: float = 0.12
    #: judged: one farther off than this from every plane lies on none, and new planes are looked for there. Nearer ones
    #: would give the same plane twice.
    stray_m: float = 0.12
    #: derived: a plane reaches one cell beyond its points, and one more every so many cells' widths (8 m) away, where rings
    #: of 2 deg are 0.28 m further apart, two thirds of one;
    widen_cells: float = 20.0
    #: derived: with one scan from cell to cell in so many passes: what that asks for at 40 m.
    spread_passes: int = 6
    #: judged: more planes than this say nothing new of a pose: three would. Time grows with them.
    most_planes: int = 24
    #: judged: a fit within these of a known plane is that plane. Less would let one wall join twice.
    same_deg: float = 3.0
    same_m: float = 0.1
    #: judged: one outside of those but within these is a doubtful copy, so near that what lies between would be ambiguous:
    #: a hedge would take its wall along. It then does not join.
    alike_deg: float = 8.0
    alike_m: float = 0.35
    #: judged: a scan has seen a plane with so many points on it; a found plane is one that so many scans have seen, half a
    #: second. A chance plane does not last.
    seen_points: int = 12
    seen_scans: int = 5
    #: judged: the segmentation among points that lie on no plane, scan after scan: broader, flatter and cheaper than the
    #: first, as a false plane does harm and a late one none.
    new_planes: SegmentSettings = SegmentSettings(  # noqa: RUF009  frozen
        min_share=0.04,
        min_points=120,
        min_breadth_m=0.25,
        max_planes=4,
        distance_m=0.05,
        subsample=2000,
        hypotheses=350,
    )


@dataclass(frozen=True, slots=True)
class Following:
    """From where the planes are followed, and what a track is worth."""

    #: judged: covering more of the scans than this is enough to look no further; the rest is reached by the IMU. Time
    #: depends on it.
    enough: float = 0.6
    #: derived: elsewhere to look from, as shares of the recording: the middle first, then halves of what lies between those
    #: that were looked at.
    elsewhere: tuple[float, ...] = (0.5, 0.25, 0.75, 0.12, 0.88, 0.38, 0.62, 0.97)
    #: judged: so many of those are tried, and one has to be so many times as good. Each costs a track.
    starts: int = 5
    better: float = 1.2
    #: judged: a plane tells no more for having more points than this, for its own error stays: 1 cm of noise / sqrt(400) is
    #: half a millimetre, below what a plane is flat to.
    plane_points: float = 400.0
    #: judged: so much motion settles the start values of a solve: some swings of a hand about each axis;
    settled_s: float = 3.0
    #: judged: motion is what exceeds either of these. Which tracks are thought long enough depends on it.
    moving_rad_s: float = 0.1
    moving_m_s: float = 0.1
    #: judged: of the scans beyond the track a solve gets this share by its IMU. It weighs tracks against each other, and
    #: nothing else.
    later: float = 0.5
    #: derived: a reference scan that turned or moved by more than this during its sweep is straightened: a hundredth of a
    #: radian is 3 cm at 3 m, and 2 cm, both about a lidar's noise.
    bent_rad: float = 0.01
    bent_m: float = 0.02
    #: judged: its motion is told by the next scans to either side, of which one may be lost; and straightened, a scan that
    #: leads over more than this share of the recording needs no comparison. Time depends on both.
    around_scans: int = 3
    whole: float = 0.95
    #: measured: points of so many scans are taken at once ahead of the march: 0.57 ms, of which handing over is 0.01. Nothing
    #: but time depends on it.
    ahead_scans: int = 8
    #: derived: a gyroscope's turn within a sweep is looked up so often: between two of them a shaken rig that gains 30 rad/s in a
    #: second is off a steady rate by 30 (0.01)^2 / 8, half a milliradian.
    turning_s: float = 0.01
    #: derived: planes face another way where the normals' singular value is this share of the first: of two normals 23 deg
    #: between them.
    another_way: float = 0.2
    #: judged: a lidar that turned and moved by less in a whole recording stood still: four times what registrations stray
    #: by (Standstill). Only which reason is told depends on it.
    stood_deg: float = 1.0
    stood_m: float = 0.05
    #: judged: a lidar followed over less than this share of the scans was lost rather than standing. Only which reason is
    #: told depends on it.
    followed_share: float = 0.5


@dataclass(frozen=True, slots=True)
class Within:
    """Whether what turns within the sweeps is what turns between them."""

    #: judged: a hundredth of a radian in a tenth of a second is 3 cm at 3 m, a lidar's noise, of which a sweep has thousands;
    #: so many spans that turn as much, two seconds of them.
    turning_rad_s: float = 0.1
    fewest_spans: int = 20
    #: measured: of a track led by the gyroscope so many scans are asked: twelve corridors told 1 and less than a third apart
    #: by more than eight sigmas.
    freed_scans: int = 80
    #: judged: a scan that was lost in between makes a span of more than one turn. Such spans are left out.
    longest_periods: float = 1.5
    #: derived: a sweep that is this short a part of the time between two shows the same part of the turn, at five times the
    #: noise.
    least_sweep: float = 0.2
    #: derived: a rate over a shorter span, between stamps that repeat, is none.
    shortest_s: float = 1e-3
    #: derived: of a normal law one in sixteen thousand is beyond.
    sigmas: float = 4.0
    #: measured on simulated clouds: raw ones show 0.97 to 1.00 of the turn, straightened ones 0.04 to 0.06, those with times
    #: that run backwards -0.77. Half-way between the former two, and beyond the latter two.
    straightened: float = 0.5
    backwards: float = 0.5
    #: measured on a dozen corridors and rooms of drawn rigs that were led by the gyroscope: raw ones show 0.85 and more,
    #: straightened ones 0.54 and less. Between the two.
    led_straightened: float = 0.75
    #: measured on the worst of recordings of an independent generator that were led: raw clouds showed 0.62, 0.36, 0.40, 0.35 and
    #: 0.12 beside a misfit of 0.37, 0.66, 0.93, 0.98 and 1.7; straightened ones 0.16, 0.41 and 0.16 beside 0.43, 0.54 and 0.55.
    #: So many times the misfit the share may be too small. Times are called off beyond twice the misfit, which is what bent them.
    led_misfit_share: float = 0.6
    led_misfit_off: float = 2.0
    #: measured: of fifteen raw recordings, up to 112 deg/s, all are within 0.03 of one but those that scatter by more; three
    #: times that.
    least_off: float = 0.1
    #: measured on 38 raw recordings of an independent generator, of 23 to 343 spans: the share is off one by 0.23 times the
    #: misfit (rms), 0.59 times at most. So many times it is beyond four of those standard deviations, of a normal law one in
    #: sixteen thousand. With times 0.88 to 1.25 times as long it was 0.9 to 2.6 times it, but behind three rough tracks of eight,
    #: which tell nothing.
    misfit_share: float = 1.0


@dataclass(frozen=True, slots=True)
class Standstill:
    """The cloud around the reference scan."""

    #: judged: most scans that are merged: two seconds, dense enough for any eye.
    scans: int = 20
    #: judged: how far a registration of one scan may stray by noise alone. More scans would blur the cloud that a person
    #: looks at by as much.
    still_deg: float = 0.25
    still_m: float = 0.012
    #: judged: 1 sigma of pose [rad, m] and rates [rad/s, m/s] about rest, which is the hypothesis: left free, rates would
    #: take up the noise of the pose.
    rest_std: float = 0.03
    #: judged: points that are kept to be looked at; drawing takes longer with more,
    cloud_points: int = 200_000
    #: judged: and of them those in which planes are looked for: fifteen times what a plane is drawn among, more would tell
    #: the planes apart no better.
    searched_points: int = 60_000
    #: judged: a person places something by the cloud from so many scans on. Fewer are shown as they are.
    fewest_scans: int = 3


@dataclass(frozen=True, slots=True)
class Pairs:
    """Turns between neighbouring scans, each pair by itself."""

    #: judged: pairs that are looked at; a lag and a rotation follow from some tens of them, as each has three components.
    pairs: int = 120
    #: judged: points of each scan: the segmentation draws among 2000.
    points: int = 2500
    #: judged: the segmentation of one scan among so few: half the draws, planes of sixty points, and the six of a room.
    #: A missed plane costs one pair of many.
    segments: SegmentSettings = SegmentSettings(  # noqa: RUF009  frozen
        hypotheses=350, subsample=2000, min_points=60, max_planes=6
    )
    #: judged: 1 sigma of the next scan about this one: what a hand does in a tenth of a second, 2 rad/s and 2 m/s, and no
    #: more.
    step_rad: float = 0.2
    step_m: float = 0.2
    #: judged: a turn told worse than this, or by less than this share of the points, is none; in a lift's cabin turns are told to
    #: 0.045, and where there are fewer better ones than this, those count that are told as well as a track's poses must be.
    #: Where there are enough, worse ones spoil them: of stairs seen by a shaken lidar.
    told_rad: float = 0.03
    fewest: int = 30
    told_at_least_rad: float = 0.06
    told_share: float = 0.4


MAP, FOLLOWING, WITHIN, STANDSTILL, PAIRS = MapSettings(), Following(), Within(), Standstill(), Pairs()
