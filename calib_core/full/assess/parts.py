"""What each part of a recording would answer by itself: the shift of the seven that it alone asks for, and how sure it is.

At the optimum a part k has pulled the seven by u_k, of covariance P_k (influence.py). A shift d of the seven, all else
following it, is felt by the part as the pull P_k C^-1 d: so its own answer, and its own information, are

    d_k = C P_k^-1 u_k = I_k^-1 C^-1 u_k,      I_k = C^-1 P_k C^-1,      sum I_k = C^-1,      sum I_k d_k = 0

over all parts, priors among them: weighted by their information, the parts' answers are the joint one. What a part says
nothing of is kept finite by the standing prior S about the joint answer: I_k + S^-2 in the place of I_k.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calib_core.full.assess.disagreement import Apart
from calib_core.full.assess.influence import Influences
from calib_core.full.assess.settings import PARTS
from calib_core.full.joint.state import ROTATION, TIME_OFFSET, TRANSLATION, Estimate
from calib_core.full.joint.undetermined import STANDING, UNITS
from calib_core.full.run import Clocks
from calib_core.result import OwnAnswer, Parts, PlaneAnswer, RangeAnswer, TimeBlock
from calib_core.solver.information import covariance
from calib_core.types import FloatArray


@dataclass(frozen=True)
class OwnAnswers:
    """Of K parts, from the joint answer, in units of 1 deg, 10 mm, 1 ms. shift: (K, 7).   covariance: (K, 7, 7)."""

    shift: FloatArray
    covariance: FloatArray


def own_answers(parts: Influences, joint: FloatArray) -> OwnAnswers:
    """Of every part. joint: (7, 7) covariance, the priors' share included, in the parts' units; zero where held fixed.

    Raises ArithmeticError or LinAlgError where that comes to no number.
    """
    count = joint.shape[0]
    free = np.flatnonzero(np.diag(joint) > 0.0)
    inverse = np.zeros((count, count))
    inverse[np.ix_(free, free)] = covariance(joint[np.ix_(free, free)]).matrix
    information = inverse @ parts.allowed @ inverse
    information = 0.5 * (information + np.swapaxes(information, 1, 2)) + np.diag(STANDING**-2.0)
    own = np.array([covariance(each).matrix for each in information]).reshape(-1, count, count)
    shift = (own @ (parts.moved @ inverse)[..., None])[..., 0]
    if not (np.isfinite(shift).all() and np.isfinite(own).all()):
        raise ArithmeticError("what parts of the recording answer is no number")
    return OwnAnswers(shift, own)


def parts_of(apart: Apart, estimate: Estimate, clocks: Clocks, rate_ppm: float, planes: Sequence[str]) -> Parts:
    """What stretches of time, planes and near and far points answer, for the document. planes: names, in the solve's order."""
    edges_s = clocks.as_stamped(apart.edges_s + estimate.time_offset_s, rate_ppm) - clocks.scan_s[0]
    blocks, bands = pairwise(edges_s.tolist()), pairwise(apart.ranges_m.tolist())
    return Parts(
        time_blocks=[
            TimeBlock(t_start_s=_short(start), t_end_s=_short(end), **own.model_dump())
            for (start, end), own in zip(blocks, _told(apart, "time"), strict=True)
        ],
        planes=[
            PlaneAnswer(name=name, **own.model_dump()) for name, own in zip(planes, _told(apart, "planes"), strict=True)
        ],
        ranges=[
            RangeAnswer(from_m=_short(low), to_m=_short(high), **own.model_dump())
            for (low, high), own in zip(bands, _told(apart, "range"), strict=True)
        ],
    )


def _told(apart: Apart, way: str) -> list[OwnAnswer]:
    own = own_answers(apart.clusters[way], apart.covariance)
    stds = np.sqrt(np.diagonal(own.covariance, axis1=1, axis2=2))
    return [_own_answer(shift * UNITS, std * UNITS) for shift, std in zip(own.shift, stds, strict=True)]


def _own_answer(shift: FloatArray, std: FloatArray) -> OwnAnswer:
    return OwnAnswer(
        rotation_shift_deg=[_short(value) for value in np.degrees(shift[ROTATION])],
        translation_shift_m=[_short(value) for value in shift[TRANSLATION]],
        time_offset_shift_s=_short(shift[TIME_OFFSET]),
        rotation_std_deg=[_short(value) for value in np.degrees(std[ROTATION])],
        translation_std_m=[_short(value) for value in std[TRANSLATION]],
        time_offset_std_s=_short(std[TIME_OFFSET]),
    )


def _short(value: float) -> float:
    return float(f"{value:.{PARTS.digits}g}")
