"""What the planes' materials do to ranges, in a sentence: dark walls, and those that let light in, read long or short."""

from __future__ import annotations

import numpy as np

from calib_core.full.assess.considered import parameter_std
from calib_core.full.assess.settings import WORDING
from calib_core.full.joint.estimation import Solved
from calib_core.full.prepare.nuisance import MATERIAL
from calib_core.sigmas import two_digits


def told_materials(solved: Solved) -> tuple[tuple[str, str], ...]:
    """Code and text of the plane that stands out the most; none where none does, or none was asked.

    A material's incidence term is minus its range offset (factors/laser_features.py): a wall that reads b long is b nearer where
    it is met at a slant.
    """
    place = solved.nuisance.places.get(MATERIAL)
    if place is None:
        return ()
    assert solved.minimum.solution is not None
    start = solved.problem.layout(solved.estimate).nuisance().start
    std = parameter_std(solved.minimum.solution.information, slice(start + place.start, start + place.stop))
    long_m = -solved.estimate.sensors.of(MATERIAL)
    off = np.flatnonzero(np.abs(long_m) > WORDING.off_sigmas * std)
    if len(off) == 0:
        return ()
    worst = off[np.argmax(np.abs(long_m[off]))]
    how = "long" if long_m[worst] > 0 else "short"
    more = "" if len(off) == 1 else f" ({len(off) - 1} more {'is' if len(off) == 2 else 'are'} off)"
    text = (
        f"{solved.planes[worst].name} reads {two_digits(abs(long_m[worst]) * 1e3)} mm {how} beside the other planes, as dark or "
        f"soft walls may{more}; ranges were corrected for it"
    )
    return (("planes.material", text),)
