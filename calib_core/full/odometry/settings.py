"""Every number of the lidar odometry, with its unit and its reason."""

from __future__ import annotations

from dataclasses import dataclass

from calib_core.planes.segment import SegmentSettings


@dataclass(frozen=True, slots=True)
class TrackSettings:
    """How one scan is registered to the planes, and when the next one is lost."""

    #: Points of a scan that are looked at, and of them in the least squares: a pose to a centimetre in some milliseconds.
    sample: int = 5000
    points: int = 1500
    #: With fewer points there is no scan to speak of.
    fewest_points: int = 60
    #: Points of the reference scan, by which the planes' reach begins.
    reference_points: int = 20_000
    #: Width of the redescending weight, iteration by iteration: from what constant velocity misses in a tenth of a second
    #: to what a lidar's noise and a sweep's bend leave,
    scales_m: tuple[float, ...] = (0.4, 0.3, 0.2, 0.15, 0.1, 0.07, 0.05, 0.05)
    #: and from further off where that has found nothing.
    wide_scales_m: tuple[float, ...] = (1.2, 0.8, 0.6, 0.4, 0.3, 0.2, 0.15, 0.1, 0.07, 0.05, 0.05)
    #: A point this near to its plane lies on it: two widths of the last weight.
    inlier_m: float = 0.1
    #: A point off the known part of its plane counts as this much further away.
    outside_m: float = 0.2
    #: 1 sigma of constant velocity over a tenth of a second: what hands do, of turn, place, rate and velocity.
    tie_rotation_rad: float = 0.06
    tie_position_m: float = 0.05
    tie_rate_rad_s: float = 1.2
    tie_velocity_m_s: float = 0.4
    #: The time that those are for, and the least of it that counts.
    tie_s: float = 0.1
    least_tie_steps: float = 0.2
    #: Information [1/rad2, 1/m2] that holds a pose: the reference scan's is the map's; its velocities are anything carried.
    held: float = 1e8
    first_rate_rad_s: float = 2.0
    first_velocity_m_s: float = 2.0
    #: 1 sigma of a point against the tie, in the least squares: points of one plane share its errors.
    fit_std_m: float = 0.05
    #: 1 sigma of a point in the judgement of a pose: a lidar's noise and the sweep's bend.
    lidar_std_m: float = 0.03
    #: A plane counts for no more points than this in the least squares, and than that in the judgement: its own error stays.
    plane_points: float = 150.0
    sure_points: float = 9.0
    #: With fewer points a plane may be anything that happens to be there.
    least_points: int = 10
    #: What the judgement knows of a pose beforehand: ten radians and ten metres, which is nothing.
    unknown_std: float = 10.0
    #: A pose less certain than this (1 sigma along its worst direction) does not count.
    trusted_rad: float = 0.06
    trusted_m: float = 0.1
    #: A residual so many times the usual, and this beyond, is doubtful: the scan is tried from other starts.
    trusted_rms: float = 1.7
    rms_slack_m: float = 0.01
    #: What is usual lies between this and so many times the first scan's.
    least_rms_m: float = 0.015
    most_rms: float = 1.5
    #: Weight of the newest scan in what is usual: five scans' memory.
    newest: float = 0.2
    #: Shares of the points that lie on planes: lost below these, the latter of the usual; doubtful below that of the usual.
    least_share: float = 0.15
    lost_share: float = 0.5
    doubtful_share: float = 0.85
    #: Another start is believed where it explains so many times as many points,
    better_share: float = 1.05
    #: with the tie's standard deviations so many times as wide.
    loosened: float = 5.0
    #: Other starts, where a scan would be lost: turns and steps of this size along each axis.
    other_turn_rad: float = 0.25
    other_step_m: float = 0.4
    #: No hand, car or drone leaves its prediction by more in a tenth of a second; a box looks the same after a half turn.
    jump_rotation_rad: float = 0.6
    jump_position_m: float = 0.6
    least_jump_steps: float = 0.5
    #: Scans that tell no orientation are bridged for so long, a position unknown in some direction for so long,
    bridge_s: float = 0.5
    coast_s: float = 2.0
    #: at a velocity that fades within this; one missing scan is bridged whatever its period.
    damping_s: float = 0.7
    bridged_periods: float = 1.5
    #: New planes are looked for where fewer of the points lie on known ones, or after so much of a turn,
    grow_share: float = 0.93
    grow_turn_rad: float = 0.4
    #: among so many points of the last scans,
    grow_points: int = 4000
    grow_scans: int = 3
    #: not more often than every so many scans, and less and less often where nothing is found.
    grow_every: int = 5
    grow_rarely: int = 40
    #: 1 sigma of a turn from scan to scan and of the rate in a sweep, where they come from a gyroscope whose mounting is only
    #: roughly known.
    turning_rad: float = 0.01
    turning_rate_rad_s: float = 0.1


@dataclass(frozen=True, slots=True)
class MapSettings:
    """Where planes are known to be, and which new ones join."""

    #: Cells of a plane's reach: two rings of sixteen at 10 m are 0.35 m apart; and how many a side: 128 m.
    cell_m: float = 0.4
    cells: int = 320
    #: A point this near lies on a plane, and so much more a metre away, where rings are rough;
    near_m: float = 0.07
    near_per_m: float = 0.003
    #: in the reference scan, whose sweep may be bent, this near.
    seed_m: float = 0.12
    #: One farther off than this from every plane lies on none.
    stray_m: float = 0.12
    #: A plane reaches one cell beyond its points, and one more every so many cells' widths away, where rings are sparse;
    widen_cells: float = 20.0
    #: with one scan from cell to cell in so many passes.
    spread_passes: int = 6
    #: More planes than this say nothing new of a pose.
    most_planes: int = 24
    #: A fit within these of a known plane is that plane.
    same_deg: float = 3.0
    same_m: float = 0.1
    #: One outside of those but within these is a doubtful copy, so near that what lies between would be ambiguous: a hedge
    #: would take its wall along.
    alike_deg: float = 8.0
    alike_m: float = 0.35
    #: A scan has seen a plane with so many points on it; a found plane is one that so many scans have seen.
    seen_points: int = 12
    seen_scans: int = 5
    #: The segmentation among points that lie on no plane, scan after scan: broader, flatter and cheaper than the first.
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

    #: Covering more of the scans than this is enough to look no further.
    enough: float = 0.6
    #: Elsewhere to look from, as shares of the recording: the middle first, then between what was looked at.
    elsewhere: tuple[float, ...] = (0.5, 0.25, 0.75, 0.12, 0.88, 0.38, 0.62, 0.97)
    #: So many of those are tried, and one has to be so many times as good.
    starts: int = 5
    better: float = 1.2
    #: A plane tells no more for having more points than this: its own error stays.
    plane_points: float = 400.0
    #: So much motion settles the start values of a solve;
    settled_s: float = 3.0
    #: motion is what exceeds either of these.
    moving_rad_s: float = 0.1
    moving_m_s: float = 0.1
    #: Of the scans beyond the track a solve gets this share by its IMU.
    later: float = 0.5
    #: A reference scan that turned or moved by more than this during its sweep is straightened: 3 cm at 3 m, and 2 cm.
    bent_rad: float = 0.01
    bent_m: float = 0.02
    #: A lidar that turned and moved by less in a whole recording stood still.
    stood_deg: float = 1.0
    stood_m: float = 0.05
    #: A lidar followed over less than this share of the scans was lost rather than standing.
    followed_share: float = 0.5


@dataclass(frozen=True, slots=True)
class Standstill:
    """The cloud around the reference scan."""

    #: Most scans that are merged: two seconds, dense enough for any eye.
    scans: int = 20
    #: How far a registration of one scan may stray by noise alone.
    still_deg: float = 0.25
    still_m: float = 0.012
    #: 1 sigma of pose [rad, m] and rates [rad/s, m/s] about rest, which is the hypothesis: left free, rates would take up
    #: the noise of the pose.
    rest_std: float = 0.03
    #: Points that are kept to be looked at,
    cloud_points: int = 200_000
    #: and of them those in which planes are looked for: more would tell the planes apart no better.
    searched_points: int = 60_000
    #: A person places something by the cloud from so many scans on.
    fewest_scans: int = 3


@dataclass(frozen=True, slots=True)
class Pairs:
    """Turns between neighbouring scans, each pair by itself."""

    #: Pairs that are looked at: a lag and a rotation follow from some tens of them.
    pairs: int = 120
    #: Points of each scan.
    points: int = 2500
    #: The segmentation of one scan among so few.
    segments: SegmentSettings = SegmentSettings(hypotheses=350, subsample=2000, min_points=60)  # noqa: RUF009  frozen
    #: 1 sigma of the next scan about this one: what a hand does in a tenth of a second, and no more.
    step_rad: float = 0.2
    step_m: float = 0.2
    #: A turn told worse than this, or by less than this share of the points, is none.
    told_rad: float = 0.03
    told_share: float = 0.4


MAP, FOLLOWING, STANDSTILL, PAIRS = MapSettings(), Following(), Standstill(), Pairs()
