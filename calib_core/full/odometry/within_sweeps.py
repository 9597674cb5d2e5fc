"""Whether what turns within the sweeps is what turns between them: of points that carry the times at which they were measured,
both are the same motion.

Clouds that another program has straightened show walls that stand still in each sweep while the lidar turns from one to the
next; point times that run backwards show walls that turn the other way; times in a wrong unit ones that turn too fast or too
slowly. The time offset and the whole correction of the sweeps rest on these times, and nothing later tells of it.

A track that was led by the gyroscope has the gyroscope's turning within its sweeps. It is asked by registering some of its scans
once more, with that left to their points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calib_core.errors import Refused
from calib_core.full.odometry.motion_prior import rate_within, steady_sample
from calib_core.full.odometry.plane_map import PlaneMap
from calib_core.full.odometry.prediction import predict
from calib_core.full.odometry.reference import Followed
from calib_core.full.odometry.register import ScanMotion, is_oriented, register
from calib_core.full.odometry.settings import WITHIN, TrackSettings
from calib_core.full.run import Run
from calib_core.geometry import log
from calib_core.types import FloatArray


@dataclass(frozen=True, slots=True)
class WithinSweeps:
    """How much of the turning that is expected within sweeps their points show: 1 for raw clouds, 0 for straightened ones.

    share: shown over expected.   std: its standard deviation, by how spans scatter.   misfit: rms of the rates that no share of
    those expected explains, over the rms of these.   spans: how many turned enough to tell.
    """

    share: float
    std: float
    misfit: float
    spans: int

    def is_off(self, least: float, bent: float) -> bool:
        """Whether wrong times make the share other than one: by so much at least, beyond chance, and beyond what bends a track.

        Wrong times make all rates too large or too small by one factor. Planes that are bent, or hardly hold the lidar, bend the
        rates in every way, and alike from span to span: the share takes its part of that, and its scatter knows nothing. Rates of
        which no factor explains the larger part are none that wrong times make.
        """
        off = abs(self.share - 1.0) > max(least, WITHIN.sigmas * self.std, bent * self.misfit)
        return off and self.share > self.misfit


def turning_within(run: Run, motions: Sequence[ScanMotion]) -> WithinSweeps | None:
    """The turning within the sweeps of a track that its planes alone have told, beside that from one sweep to the next; None
    where too little of it turned.
    """
    clocks = run.clocks
    seen = [
        (one, next_)
        for one, next_ in pairwise(motions)
        if next_.position == one.position + 1 and one.share > 0 and next_.share > 0
    ]
    if not seen:
        return None
    first = np.array([one.position for one, _ in seen])
    period_s = clocks.scan_s[first + 1] - clocks.scan_s[first]
    turns = log(np.array([one.R.T @ next_.R for one, next_ in seen]))
    between = turns / np.maximum(period_s, WITHIN.shortest_s)[:, None]
    within = np.array([one.omega_rad_s for one, _ in seen])
    usual_s = float(np.median(period_s))
    told = (
        (np.linalg.norm(between, axis=1) > WITHIN.turning_rad_s)
        & (period_s < WITHIN.longest_periods * usual_s)
        & (clocks.sweep_s[first] > WITHIN.least_sweep * usual_s)
    )
    return _share(within[told], between[told])


def turning_freed(run: Run, followed: Followed) -> WithinSweeps | None:
    """The turning within the sweeps of a track that took its turns from the gyroscope, beside what the gyroscope felt meanwhile:
    the scans in which that was most are registered once more, their turning left to their points.

    None where too few of them turned, and where the track followed its planes alone.
    """
    turning = followed.turning
    scans, s = run.recording.scans, TrackSettings()
    felt = [(m, rate_within(scans[m.position], turning)) for m in followed.motions if m.share > 0]
    turned = [(m, rate) for m, rate in felt if rate is not None and np.linalg.norm(rate) > WITHIN.turning_rad_s]
    turned.sort(key=lambda each: -float(np.linalg.norm(each[1])))
    planes = PlaneMap.endless(followed.planes)
    shown = []
    for m, rate in turned[: WITHIN.freed_scans]:
        points, tau = steady_sample(scans[m.position], s.sample, turning)
        _, tie = predict(m, m.position, s.tie_s, s)
        found = register(points, tau, planes, m, tie=tie, settings=s, position=m.position).motion
        if is_oriented(found, s):
            shown.append((found.omega_rad_s, rate))
    return _share(*np.array(shown).reshape(-1, 2, 3).swapaxes(0, 1))


def _share(within_rad_s: FloatArray, expected_rad_s: FloatArray) -> WithinSweeps | None:
    """How much of the rates (N, 3) that are expected those within the sweeps (N, 3) are; None where spans are too few."""
    if len(expected_rad_s) < WITHIN.fewest_spans:
        return None
    along = np.sum(within_rad_s * expected_rad_s, axis=1)
    square = np.sum(expected_rad_s**2, axis=1)
    share = float(along.sum() / square.sum())
    std = float(np.sqrt(np.sum((along - share * square) ** 2)) / square.sum())
    misfit = float(np.sqrt(np.sum((within_rad_s - share * expected_rad_s) ** 2) / square.sum()))
    return WithinSweeps(share, std, misfit, len(square))


def require_measured_sweeps(run: Run, motions: Sequence[ScanMotion]) -> None:
    """Raises Refused where the points' times are not those at which they were measured; says where they seem off.

    Of a track that the lidar alone was followed by. Where it went astray, rates within sweeps are as wrong as those between them,
    and nothing is refused that one factor does not explain.
    """
    expected = "the lidar's rotation from one to the next"
    found = turning_within(run, motions)
    _require(
        run, found, WITHIN.straightened, expected, WITHIN.least_off, bent=WITHIN.misfit_share, off=WITHIN.misfit_share
    )


def require_measured_scans(run: Run, followed: Followed) -> None:
    """As `require_measured_sweeps`, of a track that took its turns from the gyroscope.

    Its planes are bent by what was taken out of the sweeps, and make the points show some of it. Nor do raw ones show the whole:
    they are not called off for less than what straightened ones lack.
    """
    least = WITHIN.led_straightened
    expected = "the rotation that the gyroscope measured"
    found, bent, off = turning_freed(run, followed), WITHIN.led_misfit_share, WITHIN.led_misfit_off
    _require(run, found, least, expected, 1.0 - least, bent=bent, off=off)


def _require(
    run: Run, found: WithinSweeps | None, least: float, expected: str, least_off: float, *, bent: float, off: float
) -> None:
    """least: share that raw clouds show.   expected: of what it is.   least_off: how far from one times are called off.
    bent, off: how many times the misfit the share may be too small, or else than one, by what bends the track."""
    if found is None:
        return
    share, wide = found.share, max(WITHIN.sigmas * found.std, bent * found.misfit)
    shown = f"within {found.spans} sweeps the surroundings turn by {share:.2f} times {expected}"
    if share + wide < -WITHIN.backwards:
        raise Refused(
            "points.times_backwards",
            f"the times of the points run backwards: {shown}; expected 1; correct the points' times in the lidar's driver",
        )
    # What stands still within its sweeps turns less than expected, whichever way; what turns as much or more was not followed.
    if share + wide < least and np.hypot(share, found.misfit) < 1.0:
        raise Refused(
            "points.straightened",
            f"the motion was taken out of the clouds before they were recorded, or the points' times are not those of their "
            f"measurement: {shown}; expected 1; record the driver's own clouds, with its motion compensation switched off",
        )
    if found.is_off(least_off, off):
        run.say(
            "warning",
            "points.times_off",
            f"the points' times seem to be {1.0 / share:.2f} times what they should be: {shown}, expected 1; the whole answer "
            "depends on these times: check their unit and rate in the lidar's driver",
        )
