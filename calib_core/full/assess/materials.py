"""What the planes' materials do to ranges, in a sentence: dark walls, and those that let light in, read long or short."""

from __future__ import annotations

import numpy as np

from calib_core.full.assess.considered import beyond_noise
from calib_core.full.assess.disagreement import unexplained_variance
from calib_core.full.assess.settings import WORDING
from calib_core.full.joint.estimation import Solved
from calib_core.full.prepare.nuisance import MATERIAL
from calib_core.sigmas import two_digits
from calib_core.types import FloatArray, IntArray


def told_materials(solved: Solved) -> tuple[tuple[str, str], ...]:
    """Code and text of the plane that stands out the most; none where none does, or none was asked.

    A material's incidence term is minus its range offset (factors/laser_features.py): a wall that reads b long is b nearer where
    it is met at a slant.
    """
    place = solved.nuisance.places.get(MATERIAL)
    if place is None:
        return ()
    start = solved.problem.layout(solved.estimate).nuisance().start + place.start
    long_m = -solved.estimate.sensors.of(MATERIAL)
    off = beyond_noise(solved, slice(start, start + len(long_m)), long_m)
    if len(off):
        off = off[np.abs(long_m[off]) > WORDING.off_sigmas * _std_m(solved, start + off)]
    if len(off) == 0:
        return ()
    worst = off[np.argmax(np.abs(long_m[off]))]
    how = "long" if long_m[worst] > 0 else "short"
    more = "" if len(off) == 1 else f" ({len(off) - 1} more {'is' if len(off) == 2 else 'are'} off)"
    text = (
        f"{solved.planes[worst].name} reads {two_digits(abs(long_m[worst]) * 1e3)} mm {how} compared with the other planes, as "
        f"dark or soft walls may{more}; ranges were corrected for it"
    )
    return (("planes.material", text),)


def _std_m(solved: Solved, columns: IntArray) -> FloatArray:
    """Of the materials in these columns, with what parts of the recording disagree about each: one plane has many places."""
    assert solved.minimum.solution is not None
    by_noise = np.diag(solved.minimum.solution.covariance.matrix)[columns]
    return np.sqrt(np.maximum(by_noise, 0.0) + unexplained_variance(solved.problem, solved.estimate, columns, ()))
