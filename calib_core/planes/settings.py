"""Every number of the segmentation of one cloud into planes, with its unit and its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SegmentSettings:
    """Thresholds of the segmentation."""

    #: judged: twice or three times a lidar's noise, and a metre away so much more, as a sweep bends by its angle. A point
    #: this near lies on a plane; the joint estimation gates anew and does not depend on it.
    distance_m: float = 0.06
    distance_per_range: float = 0.002
    #: derived: a plane of a hundredth of the points is missed by the first point of all draws with probability 0.99^700 =
    #: 1e-3; the other two are drawn among its neighbours.
    hypotheses: int = 700
    #: judged: a room has six; more say nothing new of a pose. Time grows with them.
    max_planes: int = 12
    #: derived: two square metres at 10 m are 0.006 of a band of 30 deg. The least of a plane, in points and as a share of
    #: all; smaller ones join later, when the motion lays many scans on one another.
    min_points: int = 150
    min_share: float = 0.006
    #: derived: points spread evenly over a width w have w / sqrt(12); so much (1 sigma) in the narrower direction is a
    #: strip of 0.4 m. A lone ring is narrower.
    min_breadth_m: float = 0.12
    #: derived: the same of a single piece: what is seen without a gap of 5 deg, 0.087 rad, nearly twice the 2.8 deg between the
    #: rings of sixteen lasers that look 22.5 deg up and down. A plane through two poles, or a pole and a person, is as wide as
    #: they are apart, and each of its pieces a strip of 0.3 m.
    piece_breadth_m: float = 0.12
    gap_rad: float = 0.087
    #: derived: told by cells of a quarter of it, a gap of 2.8 deg never parts and one of 7.2 always does.
    gap_cells: float = 4.0
    #: judged: pieces are told among so many points: a wall of 90 deg by 30 deg has one every 1.2 deg. Time grows with them.
    pieced: int = 2000
    #: derived: the sine of 3.4 deg, more than the 2 deg between rings of sixteen lasers. From this cosine of incidence on a
    #: point is seen face on; below, a plane collects whole rings.
    min_incidence: float = 0.06
    #: derived: a cut through fog holds a fifth of the slab around it, a surface all of it: the middle of both. A plane's
    #: points lie in cells where it holds more than this share,
    dominance: float = 0.6
    #: judged: more than this share of them. Clutter that is let through is judged again by how it stands (Judgement).
    dominated_share: float = 0.6
    #: judged: points among which a plane is drawn and scored; one of a hundredth has forty of them. Time grows with it.
    subsample: int = 4000
    #: judged: the other two points are drawn among so many nearest of the first, a 33rd of the sample, but not the nearest
    #: quarter, which are of its own ring; fewer are no cloud.
    neighbours: int = 120
    fewest_neighbours: int = 10
    #: judged: the neighbours are looked for among a sample of the sample, in which so many stand for all of them. Time
    #: grows with it, and what is drawn hardly changes.
    sought: int = 20
    #: derived: the narrowest angle at the first point, 11.5 deg: a normal's error grows as one over its sine, to five
    #: times. What is nearly a line has no normal.
    least_sine: float = 0.2
    #: judged: refits in which the band shrinks to so many robust sigmas, one in 370 of a normal law beyond, but not below
    #: this share of the tolerance. The joint estimation gates anew.
    refits: int = 8
    band_sigmas: float = 3.0
    least_band: float = 0.3
    #: judged: rougher than so many times the typical plane is clutter, unless by less than what the motion of a sweep
    #: bends. What is let through is judged again by how it stands (Judgement).
    roughness: float = 2.0
    bend_m: float = 0.012
    #: derived: planes seen at a slant look smoother by the cosine of incidence; at most by that of 60 deg, beyond which
    #: spots on a wall are smeared along it.
    least_cosine: float = 0.5
    #: derived: a cut through fog fills the band evenly, whose residual is 1 / sqrt(3) = 0.58 of it; a surface of three
    #: sigmas has a third. A surface's is less than this share.
    narrowness: float = 0.5
    #: judged: the slab is so many bands thick, counted in cells of this width; a surface fills so many cells at least.
    #: Rings of 2 deg are one cell apart at 9 m.
    slab_bands: float = 5.0
    cell_m: float = 0.3
    fewest_cells: int = 6
    #: derived: a cut through fog holds a fifth of a slab of five bands, a surface all of it: the geometric mean of both.
    slab_share: float = 0.45
    #: judged: fits that fail one after the other until nothing more is looked for: 700 draws each have missed what is
    #: there.
    failures: int = 3
    #: judged: planes with the same equation are one; in a room of right angles nothing lies between this and 90 deg, and
    #: the band's own width is the least that parts two.
    same_deg: float = 3.0
    same_m: float = 0.06
