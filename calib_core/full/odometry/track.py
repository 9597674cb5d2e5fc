"""Lidar-only motion: each scan registered to the planes, its own sweep straightened at constant velocity.

The start of everything that follows (the paper's eq. 13, without its motionless-sweep assumption): no IMU, no guess.
Each scan is registered to the planes (register.py). Scans are followed outwards from a reference scan, forward and
backward. On the way the planes' known parts spread and new planes join. A scan is trusted by what its points say: that
they determine all six directions, and that enough of them lie on planes. One that is not is tried from other starts,
then bridged; half a second of such scans ends the track.

Where the lidar's turns are known from elsewhere (motion_prior.py), each scan starts from them and hardly leaves them: what is
left to the points is where it is, and a few flat things tell that. The track then ends only where the position is lost.
A guide, where there is one, looks at each motion as it is found; from the first one that is not the lidar's, turns and steps
are its guide's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calib_core.full.odometry.motion_prior import Guide, Turning, rate_within, steadied, steady_sample
from calib_core.full.odometry.plane_map import PlaneMap
from calib_core.full.odometry.prediction import other_places, other_starts, predict
from calib_core.full.odometry.prefetch import Ahead
from calib_core.full.odometry.register import (
    PLACE,
    RATE,
    TURN,
    VELOCITY,
    Registered,
    ScanMotion,
    is_determined,
    is_held,
    is_oriented,
    register,
    straighten,
)
from calib_core.full.odometry.settings import MAP, TrackSettings
from calib_core.geometry import exp, log
from calib_core.types import FloatArray, Plane, Scan


def track(
    scans: Sequence[Scan],
    planes: Sequence[Plane] | PlaneMap,
    reference: int,
    *,
    settings: TrackSettings | None = None,
    turning: Turning | None = None,
    guide: Guide | None = None,
    within: range | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> list[ScanMotion]:
    """The motion over the longest unbroken run of scans around the reference, in order of time.

    planes: map frame = the lidar frame at the reference scan's first point. A PlaneMap is grown on the way.   within: the
    positions that are followed, default all.   guide: who looks whether the lidar has gone so.
    Raises Misled where the guide wants it followed anew.
    """
    s = settings or TrackSettings()
    known = planes if isinstance(planes, PlaneMap) else PlaneMap.of(planes)
    first = _first(scans, known, reference, s, turning)
    runs: list[list[ScanMotion]] = []
    ahead = Ahead(scans, s.sample, within or range(len(scans)))
    for direction in (1, -1):
        tracker = _Tracker(scans, ahead, known, s, direction, first, turning, guide)
        for done in tracker.run():
            if on_progress is not None:
                on_progress(min(1.0, (done + sum(map(len, runs))) / len(scans)))
        runs.append(tracker.marched[1:])
        turning = tracker.turning  # a guide's, where it led
    return [*reversed(runs[1]), first, *runs[0]]


def _first(
    scans: Sequence[Scan], known: PlaneMap, reference: int, s: TrackSettings, turning: Turning | None
) -> ScanMotion:
    """The reference scan's velocities, and how far the planes reach in it."""
    points, tau = steady_sample(scans[reference], s.reference_points, turning)
    known.seed(points, MAP.seed_m)
    still = ScanMotion(reference, np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3))
    loose = np.repeat([s.held, s.held, 1 / s.first_rate_rad_s**2, 1 / s.first_velocity_m_s**2], 3)
    rate = rate_within(scans[reference], turning)
    if rate is not None:
        still = replace(still, omega_rad_s=rate)
        loose[RATE] = 1 / s.turning_rate_rad_s**2
    few = steady_sample(scans[reference], s.sample, turning)
    first = register(*few, known, still, tie=loose, settings=s, position=reference).motion
    known.seed(straighten(points, tau, first))
    return first


@dataclass
class _Tracker:
    """One direction's march away from the reference. marched: where it came, in that order, from the reference on."""

    scans: Sequence[Scan]
    ahead: Ahead
    known: PlaneMap
    s: TrackSettings
    direction: int
    first: ScanMotion
    turning: Turning | None
    guide: Guide | None
    marched: list[ScanMotion] = field(default_factory=list)
    _share: float = 1.0
    _rms: float = 0.0
    _most_rms_m: float = np.inf
    _since: int = 0
    _wait: int = 0
    _pace_m_s: FloatArray = field(default_factory=lambda: np.zeros(3))
    _grown_R: FloatArray = field(default_factory=lambda: np.eye(3))

    def run(self) -> Iterator[int]:
        """Follow scan after scan; yields how many so far."""
        s = self.s
        self._share, self._rms = self.first.share, max(self.first.rms_m, s.least_rms_m)
        self._most_rms_m = s.most_rms * self._rms
        self._wait, self._grown_R = s.grow_every, self.first.R
        good = held = oriented = previous = self.first
        self.marched = [self.first]
        self._pace_m_s = self.first.v_m_s
        position = self.first.position + self.direction
        while position in self.ahead:
            away_s = self._between_s(held.position, position)
            lost_s = s.bridge_s if self._turned(previous, position) is None else s.coast_s
            if self._between_s(oriented.position, position) > max(lost_s, s.bridged_periods * self._period_s(position)):
                break
            if away_s > max(s.coast_s, s.bridged_periods * self._period_s(position)):
                break
            found = self._guided(previous, position, is_sure=previous is good)
            if found is not None:
                found = self._of_an_instant(previous, found)
                self._bridge(previous, found.motion)
                self.marched.append(found.motion)
                _, self._pace_m_s = self._between(previous, found.motion)
                before, previous = previous, found.motion
                if is_oriented(previous, s):
                    oriented = previous
                if is_determined(previous, s):
                    self._close(good, before, found.motion)
                    good = previous
                if is_determined(previous, s) or (self._coasts and is_held(previous, s)):
                    held = previous
                    self._learn(found)
                yield len(self.marched) - 1
            position += self.direction
        last = abs(held.position - self.first.position)
        del self.marched[last + 1 :]

    def _of_an_instant(self, previous: ScanMotion, found: Registered) -> Registered:
        """With the way from the last motion for its rates, where all its points are of one instant: they tell none."""
        offsets_ns = self.scans[found.motion.position].points["offset_ns"]
        if offsets_ns[-1] or offsets_ns.any():  # of nearly all scans the last point tells
            return found
        omega, v = self._between(previous, found.motion)
        return replace(found, motion=replace(found.motion, omega_rad_s=omega, v_m_s=v))

    @property
    def _coasts(self) -> bool:
        """Whether it may coast in one direction for ever."""
        return self.turning is not None and self.turning.coasts

    def _close(self, good: ScanMotion, before: ScanMotion, after: ScanMotion) -> None:
        """Spread what was found at the end of a stretch that coasted in one direction over that stretch.

        good: the last determined motion before it.   before: its last scan.   after: the first determined one.
        """
        if before is good:
            return
        leap = after.p - (before.p + before.v_m_s * self.ahead.between_s(before.position, after.position))
        whole = self.ahead.between_s(good.position, after.position)
        for k in range(len(self.marched) - 2, -1, -1):
            m = self.marched[k]
            if m.position == good.position:
                break
            if m.unseen.any():
                t = self.ahead.between_s(good.position, m.position)
                along = m.unseen @ leap
                self.marched[k] = replace(m, p=m.p + along * (t / whole), v_m_s=m.v_m_s + along / whole)

    def _between_s(self, one: int, other: int) -> float:
        return abs(self.ahead.between_s(one, other))

    def _period_s(self, position: int) -> float:
        """Time to the neighbouring scan the march comes from."""
        return self._between_s(position, position - self.direction)

    def _guided(self, previous: ScanMotion, position: int, *, is_sure: bool) -> Registered | None:
        """The scan registered; by what its guide has felt where that is not what was found.

        is_sure: whether the one before was determined. Where one was not, coming back to where it is looks like a leap.
        """
        damping_s = None if is_sure else self.s.damping_s
        found = self._register(previous, position, damping_s)
        if self.guide is None or (found is not None and not (is_sure and is_determined(found.motion, self.s))):
            return found
        turning = self.guide.lead(self.marched, None if found is None else found.motion)
        if turning is None or turning is self.turning:
            return found
        self.turning = turning
        return self._register(previous, position, damping_s)

    def _register(self, previous: ScanMotion, position: int, damping_s: float | None) -> Registered | None:
        """The scan registered from where it is predicted, from other starts where that is doubtful; None where it is lost."""
        s = self.s
        points, tau = self.ahead.sample(position, self.direction)
        if len(points) < s.fewest_points:
            return None
        points = steadied(points, tau, self.scans[position], self.turning)
        # Where a direction is seen for a moment of the sweep only, the way from the last scan tells its velocity better.
        mixed = replace(previous, v_m_s=0.5 * (previous.v_m_s + self._pace_m_s))
        dt = self.ahead.between_s(previous.position, position)
        predicted, tie = predict(mixed, position, dt, s)
        turned = self._turned(previous, position)
        known_rad = None
        if turned is not None:
            known_rad, rate_std = self._known_turning(previous, turned)
            predicted = replace(predicted, R=turned.R, omega_rad_s=turned.omega_rad_s)
            tie[TURN], tie[RATE] = 1 / known_rad**2, 1 / rate_std**2
        if damping_s is not None:  # what coasts does not go on for ever; where points tell otherwise this is nothing
            predicted = replace(predicted, v_m_s=predicted.v_m_s * np.exp(-self._period_s(position) / damping_s))
        step = None if self.turning is None else self.turning.step(self.marched, position)
        scales_m = None
        if step is not None:
            predicted = replace(predicted, p=previous.p + step, v_m_s=step / dt)
            tie[PLACE], tie[VELOCITY] = 1 / s.step_m**2, 1 / s.step_m_s**2
            scales_m = s.near_scales_m
        best = register(
            points, tau, self.known, predicted, tie=tie, settings=s, position=position, scales_m=scales_m,
            known_rad=known_rad,
        )  # fmt: skip
        doubtful = best.motion.share < s.doubtful_share * self._share
        rough = best.motion.rms_m > s.trusted_rms * self._rms + 0.5 * s.rms_slack_m
        if step is None and (doubtful or rough):  # it is nowhere else than where the IMU has felt it go
            loose = tie / s.loosened**2
            thorough = self._lost(best.motion, predicted, position)
            starts = other_starts(previous, predicted, s, thorough=thorough)
            if known_rad is not None:
                loose[TURN], loose[RATE] = tie[TURN], tie[RATE]
                starts = other_places(predicted, s, thorough=thorough)
            for start in starts:
                other = register(
                    points, tau, self.known, start, tie=loose, settings=s, position=position, scales_m=s.wide_scales_m,
                    known_rad=known_rad,
                )  # fmt: skip
                far = self._leapt(other.motion, predicted, position)
                if not far and other.motion.share > s.better_share * best.motion.share:
                    best = other
        if step is not None and not self._was_felt(best.motion, predicted, dt):
            return None  # a person who fills the view; what was felt is nearer
        return None if self._lost(best.motion, predicted, position) else best

    def _turned(self, previous: ScanMotion, position: int) -> ScanMotion | None:
        """The last motion turned on to a scan by what else tells of turning; None where nothing does."""
        if self.turning is None:
            return None
        turn = self.turning.between(self.ahead.stamps_ns[previous.position], self.ahead.stamps_ns[position])
        rate = rate_within(self.scans[position], self.turning)
        if turn is None or rate is None:
            return None
        return replace(previous, position=position, R=previous.R @ turn, omega_rad_s=rate)

    def _known_turning(self, previous: ScanMotion, turned: ScanMotion) -> tuple[float, float]:
        """1 sigma of the turn [rad] and of the rate [rad/s] of what else tells of turning."""
        s = self.s
        assert self.turning is not None
        over_s = self._between_s(previous.position, turned.position)
        longer = max(1.0, over_s / s.tie_s) ** 0.5
        turn_rad = float(np.linalg.norm(log(previous.R.T @ turned.R)))
        turn = float(np.hypot(s.known_turning_rad * longer, self.turning.turn_std_rad(turn_rad, over_s)))
        rate_rad_s = float(np.linalg.norm(turned.omega_rad_s))
        rate = float(np.hypot(s.known_turning_rate_rad_s, self.turning.turn_std_rad(rate_rad_s, 1.0)))
        return min(s.turning_rad * longer, turn), min(s.turning_rate_rad_s, rate)

    def _lost(self, motion: ScanMotion, predicted: ScanMotion, position: int) -> bool:
        """Whether a registration is not to be trusted: too few points on planes, or a leap."""
        few = motion.share < max(self.s.lost_share * self._share, self.s.least_share)
        rough = motion.rms_m > self.s.trusted_rms * self._rms + self.s.rms_slack_m
        return few or rough or self._leapt(motion, predicted, position)

    def _leapt(self, motion: ScanMotion, predicted: ScanMotion, position: int) -> bool:
        """Whether a registration is further from its prediction than a hand, a car or a drone accelerates.

        A box looks the same after a half turn: that is likelier than such a motion.
        """
        steps = max(self._period_s(position) / self.s.tie_s, self.s.least_jump_steps)
        turned, moved = _apart(motion, predicted)
        return turned > self.s.jump_rotation_rad * steps or moved > self.s.jump_position_m * steps

    def _was_felt(self, motion: ScanMotion, predicted: ScanMotion, dt: float) -> bool:
        """Whether a registration is about where the lidar was felt to go since the last one, dt [s] before."""
        steps = max(1.0, abs(dt) / self.s.tie_s)
        turned, moved = _apart(motion, predicted)
        most_rad, most_m = self.s.felt_turn_sigmas * self.s.turning_rad, self.s.felt_step_sigmas * self.s.step_m
        return turned < most_rad * steps and moved < most_m * steps

    def _between(self, one: ScanMotion, other: ScanMotion) -> tuple[FloatArray, FloatArray]:
        """Rate [rad/s] and velocity [m/s] that lead from one motion to another, (3,) each."""
        dt = self.ahead.between_s(one.position, other.position)
        return log(one.R.T @ other.R) / dt, (other.p - one.p) / dt

    def _bridge(self, before: ScanMotion, after: ScanMotion) -> None:
        """Motions between two that were found, at constant velocity."""
        omega, v = self._between(before, after)
        for position in range(before.position + self.direction, after.position, self.direction):
            t = self.ahead.between_s(before.position, position)
            turned = self._turned(before, position)
            R, rate = (before.R @ exp(omega * t), omega) if turned is None else (turned.R, turned.omega_rad_s)
            self.marched.append(ScanMotion(position, R, before.p + v * t, rate, v, 0.0, np.inf, np.inf, np.inf))

    def _learn(self, found: Registered) -> None:
        """Let the planes spread over what this scan saw of them, and look for new ones when there is reason to."""
        s, motion = self.s, found.motion
        rough = motion.rms_m > self.s.trusted_rms * self._rms + 0.5 * s.rms_slack_m
        if not rough:
            self._share += s.newest * (motion.share - self._share)
            self._rms += s.newest * (float(np.clip(motion.rms_m, s.least_rms_m, self._most_rms_m)) - self._rms)
        self.known.spread(found.x_map_m, motion.p)
        self.known.count(found.plane[found.plane >= 0])
        self._since += 1
        turned = float(np.linalg.norm(log(self._grown_R.T @ motion.R)))
        if rough:
            return
        wanting = motion.share < s.grow_share and self._since >= self._wait
        if wanting or (turned > s.grow_turn_rad and self._since >= s.grow_every):
            recent = [m for m in self.marched[-s.grow_scans :] if m.share > 0]
            clouds = [
                straighten(*steady_sample(self.scans[m.position], s.grow_points, self.turning), m) for m in recent
            ]
            strays = np.concatenate([c[self.known.strays(c, m.p)] for c, m in zip(clouds, recent, strict=True)])
            changed = self.known.grow(strays, motion.p)
            self._wait = s.grow_every if changed else min(2 * self._wait, s.grow_rarely)
            self._since, self._grown_R = 0, motion.R


def _apart(one: ScanMotion, other: ScanMotion) -> tuple[float, float]:
    """Turn [rad] and way [m] from one pose to another."""
    return float(np.linalg.norm(log(other.R.T @ one.R))), float(np.linalg.norm(one.p - other.p))
