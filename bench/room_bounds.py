"""What is possible in a random room: the bound of each rig, with ideal sensors and with a cheap sensor's faults as unknowns.

`python -m bench.rooms --bounds ...` computes those that are missing for the seeds asked for. The estimator is told of no
sensor there, so that it allows for the faults of cheap ones, a gyroscope that feels forces among them: the second bound is
what its sigmas are held against. What a gyroscope may feel costs most: up to half of what is known of the time offset.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.bound import Assumptions, with_parameters
from bench.bound.model import FloatArray
from bench.fault_bounds import joint, priors_of
from bench.store import RESULTS
from bench.tables import read_rows
from calib_core.simulate import Scenario, parse_faults, prepare

ROWS = "room_bounds.csv"
#: Of a lidar's returns every so many count, each with as much less noise: enough for three digits.
_EVERY = 7
#: Three norms of stds: the root of the rotation's trace, of the translation's, and the offset.
NORMS = ("rotation_rad", "translation_m", "offset_s")
#: 0.1 deg/s a g is what sheets of MEMS gyroscopes have; no profile draws it.
_CHEAP = "consumer,g-sensitivity=1.8e-4"


@dataclass(frozen=True, slots=True)
class RoomBound:
    """One rig's. ideal, cheap: (3,) as in `NORMS`."""

    place: str
    seed: int
    duration_s: float
    ideal: tuple[float, ...]
    cheap: tuple[float, ...]


def compute(place: str, seed: int, scenario: Scenario) -> RoomBound:
    """Both bounds of one rig."""
    triangle, blocks = with_parameters(prepare(scenario, seed=seed), Assumptions(every=_EVERY))
    both = (np.zeros(blocks.size), priors_of(parse_faults(_CHEAP), blocks))
    ideal, cheap = (
        norms(np.sqrt(np.diag(joint(triangle, stds)[blocks.size :, blocks.size :]).copy())) for stds in both
    )
    return RoomBound(place, seed, scenario.duration_s, ideal, cheap)


def norms(stds: FloatArray | tuple[float, ...]) -> tuple[float, float, float]:
    """As in `NORMS`, of (7,) standard deviations in the contract's order."""
    values = np.asarray(stds)
    return float(np.linalg.norm(values[:3])), float(np.linalg.norm(values[3:6])), float(values[6])


def read(folder: Path = RESULTS) -> dict[tuple[str, int], RoomBound]:
    """By place and seed."""
    return {(row.place, row.seed): row for row in read_rows(folder / ROWS, RoomBound, NORMS)}
