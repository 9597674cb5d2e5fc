"""The lidar's own parameters in the factors of points on planes: all points still collapse, and each keeps its laser.

A parameter v changes a point's residual by f v, with c = -cos > 0 the incidence, r the range, e the direction of rising
elevation (signs: calib_core/intrinsics.py):

    range offset  f = c        elevation  f = r n . e        azimuth  f = n . (z x point)
    range scale   f = c r      incidence  f = 1 - c          eccentricity  f = azimuth's, times sine and cosine of the azimuth
    grazing       f = -r sqrt(1 - c^2)

where walls are bent by minus its share of each of the four heights of the surface that it lies between (patches.py), and by the
incidence's f once more for its plane's material: a range that is b longer on one wall is c b = b - (1 - c) b beside it, of which
the wall's place takes the first.

Beside the scatter matrix M of [x, 1, d] (factors/lidar_plane.py), what the normal equations ask for are first moments of the
features with it, sum w f [x, 1, d]', and their own products, sum w f f', laser by laser: 104 numbers for a laser's points on a
plane within ten milliseconds, whatever their number. The blocks couple through the state alone, so that 128 lasers cost
128 columns, not 128 problems. Ranges are corrected by the present values before points are asked where they lie.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from calib_core.factors.laser_assembly import features_crossed_kernel
from calib_core.factors.laser_kernels import (
    FEATURES,
    MORE_PRODUCTS,
    OF_COLUMN,
    PRODUCTS,
    SHARES,
    SIGN,
    Clusters,
    LaserTable,
    collapse_features_kernel,
    correct_kernel,
    features_kernel,
    share_products_kernel,
    sum_grams_kernel,
)
from calib_core.factors.lidar_plane import Hits, SlicePoses
from calib_core.factors.patches import Between
from calib_core.paged import heed_pages
from calib_core.threads import in_parts
from calib_core.types import BoolArray, Float32Array, FloatArray, IntArray, LaserArray

#: To look a key up takes a fiftieth of the time in which one is sorted in, and the table has to be emptied first.
_LOOKED_UP = 32
#: Clusters whose products are summed at a time: some megabytes of them.
_AT_ONCE = 65536


@dataclass(frozen=True, slots=True)
class LaserErrors:
    """Of each laser (L,): range_offset_m, range_scale, elevation_rad, azimuth_rad. Of each plane (P,): incidence_m, its
    material's share included. Of all: eccentricity_rad (2,), grazing_rad.
    """

    range_offset_m: FloatArray
    range_scale: FloatArray
    elevation_rad: FloatArray
    azimuth_rad: FloatArray
    incidence_m: FloatArray
    eccentricity_rad: FloatArray = field(default_factory=lambda: np.zeros(2))
    grazing_rad: float = 0.0

    def any(self) -> bool:
        """Whether there is anything to correct."""
        return bool(any(part.any() for part in self.table()))

    def table(self) -> LaserTable:
        """All but what the surface's slant makes, as the kernels take them."""
        return LaserTable(
            self.range_offset_m, self.range_scale, self.elevation_rad, self.azimuth_rad, self.eccentricity_rad
        )

    def slant(self) -> FloatArray:
        """(1 + P,) grazing [rad], and incidence of each plane [m]: what a point is off by for the surface it lies on."""
        return np.append(self.grazing_rad, self.incidence_m)

    def straightened(
        self, d: FloatArray, cosine: FloatArray, x_hit: FloatArray, plane: IntArray | int = 0
    ) -> FloatArray:
        """Distances (N,) as they would be without it. cosine: (N,) of the incidence, negative.   x_hit: (N, 3).   plane: (N,)."""
        out = d + self.incidence_m[plane] * (1.0 + cosine)
        depth_m = np.linalg.norm(x_hit, axis=1) * np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
        return np.asarray(out - self.grazing_rad * depth_m)

    def corrected(self, xyz: Float32Array, laser: LaserArray) -> Float32Array:
        """(N, 3) points as they would be without their laser's errors."""
        out = np.empty(xyz.shape, xyz.dtype)
        correct_kernel(np.array(xyz, order="C"), np.array(laser, order="C"), self.table(), out)
        return out


@dataclass(frozen=True)
class LaserSums:
    """Moments of (group of slices, plane, laser). group, plane, laser: (B,). cross: (B, F, 5), gram: (B, F (F + 1) / 2), float32.

    F: 8 features, 12 with the shares of heights, or a 1 alone where none is asked for.   gram: the upper triangle of their
    products, row by row; of a 1 alone zeros.
    """

    group: IntArray
    plane: IntArray
    laser: IntArray
    cross: Float32Array
    gram: Float32Array

    @staticmethod
    def filled(cross: FloatArray, gram: FloatArray, count: IntArray, n_planes: int, lasers: int) -> LaserSums:
        """Those of a table of sums (groups x planes x lasers, ..) that hold points. count: of each."""
        some = np.flatnonzero(count)
        pair, of = np.divmod(some, lasers)
        return LaserSums(pair // n_planes, pair % n_planes, of, *_moments(cross, gram, some))

    def by_plane(self, lasers: int, beyond: int) -> LaserSums:
        """With planes told apart by "laser", too, from `beyond` on: below, squares between heights tell their plane."""
        return replace(self, laser=np.where(self.laser >= beyond, self.laser + lasers * self.plane, self.laser))


def collapse_features(
    hits: Hits,
    keep: BoolArray,
    weight: FloatArray,
    normals: FloatArray,
    *,
    laser: LaserArray,
    lasers: int,
    group: IntArray,
    middle: IntArray,
    between: Between | None = None,
) -> LaserSums:
    """The kept points' moments. laser: (N,).   group: (S,) of each slice.   middle: (G,) slice in the middle of each group.

    between: where each point lies on surfaces that are bent: then moments are of (group, plane, square, laser), and "laser"
    counts square * lasers + laser.
    """
    n_planes = len(normals)
    n_lidar = normals @ hits.poses.R
    R, p = steps_to_middles(hits.poses, group, middle)
    unit, squares, features, share = group[hits.slice_index] * n_planes + hits.plane, 1, FEATURES, np.zeros((0, SHARES))
    if between is not None:
        squares, features, share = between.squares, FEATURES + SHARES, between.share
        unit = unit * squares + between.square
    mine = keep & (laser < lasers)
    keys, place = numbered((unit * lasers + laser)[mine], len(middle) * n_planes * squares * lasers)
    cluster, cells = np.zeros(len(keep), np.int64), len(keys)
    cluster[mine] = place
    cross, gram, more = (
        np.zeros((cells, features, 5)),
        np.zeros((cells, PRODUCTS)),
        np.zeros((0 if between is None else cells, MORE_PRODUCTS)),
    )
    collapse_features_kernel(
        mine, hits.plane, hits.slice_index, hits.x_hit, hits.d, hits.cosine, weight, cluster, n_lidar, R, p,
        cross, gram, share, more,
    )  # fmt: skip
    pair, of = np.divmod(keys, squares * lasers)
    every = np.arange(cells)
    moments, products = _moments(cross, gram, every)
    if between is not None:
        share_products_kernel(cross, more, every, products)
    return LaserSums(pair // n_planes, pair % n_planes, of, moments, products)


def numbered(key: IntArray, cells: int) -> tuple[IntArray, IntArray]:
    """The different ones in order (K,), and which of them each is (N,), of keys from 0 that are less than `cells`.

    Where most cells hold a key, they are looked up; where hardly any does, sorted.
    """
    if cells > _LOOKED_UP * len(key):
        keys, place = np.unique(key, return_inverse=True)
        return keys, place
    there = np.zeros(cells, np.bool_)
    there[key] = True
    keys = np.flatnonzero(there)
    number = np.empty(cells, np.int32)
    number[keys] = np.arange(len(keys), dtype=np.int32)
    return keys, number[key].astype(np.int64)


def _moments(cross_sums: FloatArray, gram_sums: FloatArray, some: IntArray) -> tuple[Float32Array, Float32Array]:
    """As LaserSums has them, of some of the sums (C, F, 5), (C, 28) of `add_features`; (0, 28): none but those of ones."""
    features = cross_sums.shape[1]
    products = features * (features + 1) // 2
    if len(gram_sums) == 0:
        return cross_sums[some].astype(np.float32), np.zeros((len(some), products), np.float32)
    cross = np.empty((len(some), features, 5), np.float32)
    gram = np.empty((len(some), products), np.float32)
    features_kernel(cross_sums, gram_sums, some, cross, gram)
    return cross, gram


def steps_to_middles(poses: SlicePoses, group: IntArray, middle: IntArray) -> tuple[FloatArray, FloatArray]:
    """R (S, 3, 3), p (S, 3) that take each slice's hits to the middle of its group. group: (S,).   middle: (G,) slices."""
    return poses.seen_from(poses, middle[group])


@dataclass(frozen=True)
class LaserFactors:
    """Moments by knot, plane and laser, as the joint problem takes them.

    bin: (B,) ascending, the bin of all lasers' points on that plane at that knot.   laser: (B,).   cross (B, F, 5), gram (B,
    F (F + 1) / 2): as they were made (LaserSums), which is in the frame of the middle of a group of slices; pose: (B,) which of R
    (T, 3, 3), p (T, 3) takes hits from there to the frame at the bin's knot.   grams: (G, F, F) products summed by plane and
    laser, of those that have points: of_plane, of_laser (G,). Those move with no motion; a cost and its derivatives ask for no
    others.
    """

    bin: IntArray
    laser: IntArray
    cross: Float32Array
    gram: Float32Array
    pose: IntArray
    R: FloatArray
    p: FloatArray
    grams: FloatArray
    of_plane: IntArray
    of_laser: IntArray

    @staticmethod
    def unmoved(
        bins: IntArray, laser: IntArray, cross: Float32Array, gram: Float32Array, plane: IntArray
    ) -> LaserFactors:
        """With hits where they were, and their sums. plane: (Q,) of the bins."""
        pose, R, p = np.zeros(len(bins), np.int64), np.eye(3)[None], np.zeros((1, 3))
        return LaserFactors(bins, laser, cross, gram, pose, R, p, *summed_grams(gram, plane[bins], laser))

    @staticmethod
    def empty() -> LaserFactors:
        """None at all."""
        none, products = np.zeros(0, np.int64), FEATURES * (FEATURES + 1) // 2
        cross, gram = np.zeros((0, FEATURES, 5), np.float32), np.zeros((0, products), np.float32)
        return LaserFactors.unmoved(none, none, cross, gram, none)

    def clusters(self, first: int = 0, last: int | None = None) -> Clusters:
        """Of clusters first..last (exclusive), as the kernels take them; bins keep their numbers."""
        some = slice(first, last)
        heed_pages(self.cross[some].nbytes)
        return Clusters(self.bin[some], self.laser[some], self.pose[some], self.cross[some], self.R, self.p)

    @property
    def features(self) -> int:
        """F."""
        return self.cross.shape[1]

    def within(self, mine: BoolArray, plane: IntArray) -> LaserFactors:
        """Those of some of the bins (Q,) alone, which are counted anew. plane: (Q,) of all bins."""
        some, number = mine[self.bin], np.cumsum(mine) - 1
        bins, laser, gram = number[self.bin[some]], self.laser[some], self.gram[some]
        of = summed_grams(gram, plane[mine][bins], laser)
        return LaserFactors(bins, laser, self.cross[some], gram, self.pose[some], self.R, self.p, *of)


def summed_grams(gram: Float32Array, plane: IntArray, laser: IntArray) -> tuple[FloatArray, IntArray, IntArray]:
    """Products (B, F (F + 1) / 2) summed by plane and laser, (B,) each: (G, F, F), and of which plane and laser each is, (G,)."""
    lasers, planes = int(laser.max(initial=0)) + 1, int(plane.max(initial=0)) + 1
    keys, place = numbered(plane * lasers + laser, planes * lasers)
    features = int(np.sqrt(2 * gram.shape[1]))
    grams = np.zeros((len(keys), features, features))
    for first in range(0, len(gram), _AT_ONCE):
        some = gram[first : first + _AT_ONCE]
        heed_pages(some.nbytes)
        sum_grams_kernel(some, place[first : first + _AT_ONCE], grams)
    return grams, keys // lasers, keys % lasers


def feature_changes(change: FloatArray, features: int) -> FloatArray:
    """(L, F) what the coefficients of so many features change by, from the changes of the columns: (L, 14), or (L, 14, ..)."""
    out = np.zeros((len(change), FEATURES + SHARES, *change.shape[2:]))
    for column, feature in enumerate(OF_COLUMN):
        out[:, feature] += SIGN[column] * change[:, column]
    return np.ascontiguousarray(out[:, :features])  # loops are compiled anew for every layout


def features_squares(factors: LaserFactors, a: FloatArray, change: FloatArray, plane: IntArray) -> FloatArray:
    """What changed parameters add to the sum of squares of each plane's points, (P,).

    a: (Q, 5) of the bins.   change: (L, 14).   plane: (Q,) of the bins.
    """
    planes = int(plane.max(initial=-1)) + 1
    by_feature = feature_changes(change, factors.features)
    crossed = np.empty(len(factors.laser))

    def of_clusters(first: int, last: int) -> None:
        features_crossed_kernel(factors.clusters(first, last), a, by_feature, crossed[first:last])

    in_parts(len(crossed), of_clusters, _AT_ONCE)
    moved = by_feature[factors.of_laser]
    own = np.einsum("gf,gfe,ge->g", moved, factors.grams, moved, optimize=True)
    of_planes = np.bincount(plane[factors.bin], 2.0 * crossed, planes) + np.bincount(factors.of_plane, own, planes)
    return np.asarray(of_planes)
