"""Every number of the search for planes and of the judgement of one, with its unit and its reason."""

from __future__ import annotations

from dataclasses import dataclass

from calib_core.planes.segment import SegmentSettings


@dataclass(frozen=True, slots=True)
class Search:
    """Which scan is the reference."""

    #: Smallest eigenvalue of the mean of n n' over a reference's planes, where 1/3 is best: 0.02 is the third way faced by
    #: one plane of fifty, or by planes 8 deg off the others'.
    least_determinacy: float = 0.02
    #: Planes that can hold a pose at all; one scan with fewer is better than another by its planes' number alone.
    fewest_planes: int = 3
    #: A standing start shows within the first scans, each looked at;
    first_scans: int = 3
    #: then every fifth, or as many over the whole recording as half a minute of work allows.
    step_scans: int = 5
    scans: int = 40


@dataclass(frozen=True, slots=True)
class Patches:
    """What a plane is to a person: told apart from others, its area, and how it grows around a point that is pointed at."""

    #: Of planes that face the same way within this and lie nearer than this, the smaller is a door proud of its wall: both
    #: would make each other's points ambiguous.
    distinct_deg: float = 8.0
    distinct_m: float = 0.25
    #: Area is counted in cells that a sparse lidar's rings still fill at 10 m.
    cell_m: float = 0.2
    #: The neighbourhood widens until its points lie on a plane: the seat of a chair first, a wall's patch between rings last.
    radii_m: tuple[float, ...] = (0.3, 0.6, 1.0, 1.6)
    #: Fewer points tell no plane from chance.
    fewest_near: int = 40
    fewest_points: int = 30
    #: A plane around a point passes it: the segmentation's own band and a hand that points.
    seed_m: float = 0.08
    #: It grows over cells that touch: two rings of sixteen at 10 m are 0.35 m apart.
    joined_m: float = 0.4
    #: The segmentation in so small a neighbourhood: less of everything is asked for.
    around: SegmentSettings = SegmentSettings(min_points=30, min_share=0.2, min_breadth_m=0.04, max_planes=3)  # noqa: RUF009  frozen


@dataclass(frozen=True, slots=True)
class Judgement:
    """When a plane is none: it moved, it is bent, it is several surfaces."""

    #: At fault is so many times the usual on: twice what differs between honest walls of one room.
    times: float = 4.0
    #: But not below what plaster does anyway (a wall is flat to some 2 mm in a metre),
    least_m: float = 0.0025
    #: and beyond what nothing that is called flat does, whatever the others are like.
    most_m: float = 0.008
    #: Returns that scatter so many times as much (squared) as others lie on more than one surface: walls stay below three.
    mixed_times: float = 5.0
    #: A person or a door differs from second to second.
    block_s: float = 1.0
    #: A group with fewer averages is not judged: its mean has hardly an error of its own.
    fewest: int = 3


SEARCH, PATCHES, JUDGEMENT = Search(), Patches(), Judgement()
