"""The lidar's factors with lasers told apart: what one laser says of a recording can then be held against what the others say.

Where the lasers' own parameters are unknowns, the moments of their points are there. Where lasers are taken for ideal, points
collapse without them, and are laid on their planes once more, at the estimate where the solve came to rest.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib_core.full.joint.association import associate
from calib_core.full.joint.estimation import Solved, view_of
from calib_core.full.joint.lidar_factors import LidarFactors
from calib_core.full.joint.moments import gather
from calib_core.full.joint.policies import Sampling
from calib_core.full.joint.round import gate_of
from calib_core.full.joint.sensors import laser_places
from calib_core.full.prepare.nuisance import NuisanceBlock, count_lasers
from calib_core.threads import MOST_THREADS


@dataclass(frozen=True)
class ByLaser:
    """factors: of some or all scans, with moments laser by laser.   lasers: how many there are; "laser" of the moments counts
    square * lasers + laser where walls are bent (factors/laser_features.py).
    """

    factors: LidarFactors
    lasers: int


def by_laser(solved: Solved) -> Iterator[ByLaser]:
    """A solved recording, in as many parts as memory asks for; none where its points do not name their lasers."""
    if solved.nuisance.lasers:
        yield ByLaser(solved.problem.lidar, solved.nuisance.lasers)
        return
    lasers, _ = count_lasers(solved.data.run.recording.scans)
    if lasers:
        yield from _laid_out_again(solved, lasers)


def _laid_out_again(solved: Solved, lasers: int) -> Iterator[ByLaser]:
    """As if their offsets, which are zero, were in play: that tells lasers apart, and changes nothing else."""
    problem, state, estimate, size = solved.problem, solved.state, solved.estimate, solved.nuisance.size
    offsets = NuisanceBlock("laser_range_offset", tuple(map(str, range(lasers))), np.zeros(lasers))
    told_apart = replace(state.nuisance, blocks=(*state.nuisance.blocks, offsets))
    with_offsets = replace(estimate, nuisance=np.append(estimate.nuisance, np.zeros(lasers)))
    places = laser_places(told_apart)
    sensors = replace(problem.sensors, laser_places=np.where(places < size, places, -1))
    motion, gate = problem.motion(estimate), gate_of(state, 0.0, Sampling())
    view = view_of(solved.data.run, motion, with_offsets, told_apart)
    # With nothing of the lidar in play a laser's points are all that it has to say.
    view = replace(view, first_only=not any(problem.sensors.laser_places.ravel() >= 0))
    at_once = MOST_THREADS * view.most_as_one(state.positions)
    for first in range(0, len(state.positions), at_once):
        micro = associate(view, state.positions[first : first + at_once], state.lidar_noise, gate, state.support)
        bins = gather(micro, motion, with_offsets)
        bins = replace(bins, nuisance=bins.nuisance[:size])
        yield ByLaser(replace(problem.lidar, bins=bins, sensors=sensors), lasers)
