"""The lidar's factors with lasers told apart: what one laser says of a recording can then be held against what the others say.

Where the lasers' own parameters are unknowns, the moments of their points are there. Where lasers are taken for ideal, points
collapse without them, and where each laser's lie was summed beside that when all points were laid on planes last. Where it was
not (walls that are bent, points of which only some are used), they are laid out once more, at the estimate where the solve came
to rest.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from calib_core.full.joint.association import associate
from calib_core.full.joint.estimation import Solved, view_of
from calib_core.full.joint.lidar_factors import LidarFactors
from calib_core.full.joint.moments import LaserMicro, gather, gather_lasers
from calib_core.full.joint.policies import Sampling
from calib_core.full.joint.round import gate_of
from calib_core.full.joint.sensors import SensorColumns, laser_places
from calib_core.full.joint.settings import SURVEYING
from calib_core.full.joint.state import Bins
from calib_core.full.prepare.nuisance import NuisanceBlock, named_lasers
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
    lasers = named_lasers(solved.data.run.recording.scans)
    if not lasers:
        return
    yield from _laid_out_again(solved, lasers) if solved.observations.apart is None else _laid_out(solved, lasers)


def _laid_out(solved: Solved, lasers: int) -> Iterator[ByLaser]:
    """As they were laid out last. What their errors would do is not asked where none is in play: a 1 alone is their feature."""
    micro, estimate, problem = solved.observations, solved.estimate, solved.problem
    assert micro.apart is not None
    motion, places = problem.motion(estimate), SensorColumns().laser_places
    sensors = replace(problem.sensors, laser_places=np.repeat(places, lasers, axis=0))
    for apart in _in_parts(micro.apart):
        knot = motion.nearest_knot(apart.time_s - micro.time_offset_s)
        keys = np.unique(knot * len(estimate.normals) + apart.sums.plane)
        moments = gather_lasers(apart, motion, estimate, micro.time_offset_s, keys)
        knot, plane = np.divmod(keys, len(estimate.normals))
        none, offset_s = np.zeros(0, np.int64), estimate.time_offset_s
        bins = Bins(knot, plane, np.zeros((0, 5, 5)), none, offset_s, moments, micro.laid_out_at)
        yield ByLaser(replace(problem.lidar, bins=bins, sensors=sensors), lasers)


def _in_parts(apart: LaserMicro) -> Iterator[LaserMicro]:
    """Some scans' at a time, but for what of one lies among the next one's, at a knot that they share."""
    begins = np.flatnonzero(np.append(True, np.diff(np.maximum.accumulate(apart.scan)) != 0)).tolist()
    first = 0
    for begin, end in pairwise([*begins, len(apart.scan)]):
        if end - first > SURVEYING.clusters and begin > first:
            yield apart.part(slice(first, begin))
            first = begin
    yield apart.part(slice(first, len(apart.scan)))


def _laid_out_again(solved: Solved, lasers: int) -> Iterator[ByLaser]:
    """As if their offsets, which are zero, were in play: that tells lasers apart, and changes nothing else."""
    problem, state, estimate, size = solved.problem, solved.state, solved.estimate, solved.nuisance.size
    offsets = NuisanceBlock("laser_range_offset", tuple(map(str, range(lasers))), np.zeros(lasers))
    told_apart = replace(state.nuisance, blocks=(*state.nuisance.blocks, offsets))
    with_offsets = replace(estimate, sensors=estimate.sensors.onto(told_apart))
    places = laser_places(told_apart)
    sensors = replace(problem.sensors, laser_places=np.where(places < size, places, -1))
    motion, gate = problem.motion(estimate), gate_of(state, 0.0, Sampling())
    view = view_of(solved.data.run, motion, with_offsets)
    at_once = MOST_THREADS * view.most_as_one(state.positions)
    for first in range(0, len(state.positions), at_once):
        micro = associate(view, state.positions[first : first + at_once], state.lidar_noise, gate, state.support)
        bins = gather(micro, motion, with_offsets)
        yield ByLaser(replace(problem.lidar, bins=bins, sensors=sensors), lasers)
