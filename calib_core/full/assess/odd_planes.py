"""Small planes that alone are at odds with all others about the calibration, found at the end of a solve.

A table's top has a rim, and what was grown through clutter is a plane by chance: both are flat to millimetres, which is all that
residuals of a few thousand points can say. Against walls of millions a millimetre is many standard deviations. Held against
what noise allows its pull, such a plane stands out, and without it the others agree; a mount that bends, or a clock, has all of
them disagree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib_core.full.assess.disagreement import Apart, Disagreement, judge, roots
from calib_core.full.assess.influence import Influences
from calib_core.full.joint.doubtful_planes import face_three_ways
from calib_core.full.joint.estimation import Solved
from calib_core.full.joint.plane_set import only_planes
from calib_core.full.joint.policies import PlaneSet
from calib_core.full.joint.residuals import plane_chi2
from calib_core.types import BoolArray, FloatArray


def odd_planes(clusters: Influences, covariance: FloatArray, small: BoolArray) -> BoolArray:
    """(P,) which of the small planes (P,) pull by more than noise allows, where all others agree; none where they do not.

    What a plane of a five hundredth of the points is off by may show in its own cells and lasers alone, and hardly among planes.

    clusters: of the planes.   covariance: (7, 7) C of the joint answer, scaled units.
    """
    whiten, root = roots(covariance)
    none = np.zeros(len(small), np.bool_)

    def disagree(which: BoolArray, moved: FloatArray = clusters.moved) -> bool:
        return judge("planes", Influences(moved[which], clusters.allowed[which]), whiten, root).is_beyond_noise

    if whiten.shape[1] == 0:
        return none
    odd = np.array([own and disagree(np.arange(len(small)) == k) for k, own in enumerate(small)], np.bool_)
    # All pulls together are none: the others' are against these. Without them the answer moves, which P_k C^-1 of each has felt.
    pulled = whiten @ (whiten.T @ clusters.moved[odd].sum(axis=0))
    return none if disagree(~odd, clusters.moved + clusters.allowed @ pulled) else odd


def without_odd_planes(solved: Solved, apart: Apart, found: Sequence[Disagreement], rules: PlaneSet) -> Solved | None:
    """The same solve without those that nobody chose, to go on from; None where no parts disagree (found), there are none, or the
    others do not face three ways.
    """
    if not any(each.is_beyond_noise for each in found):
        return None
    _, points = plane_chi2(solved.problem, solved.estimate)
    small = points <= rules.clutter_share * points.sum()
    odd = odd_planes(
        apart.clusters["planes"], apart.covariance, small & ~np.array([plane.chosen for plane in solved.planes])
    )
    if not odd.any() or not face_three_ways(solved.estimate.normals[~odd]):
        return None
    return replace(solved, state=only_planes(solved.state, ~odd, np.ones(len(odd), np.bool_), rules))
