"""Every number of the search for planes and of the judgement of one, with its unit and its reason."""

from __future__ import annotations

from dataclasses import dataclass

from calib_core.planes.settings import SegmentSettings


@dataclass(frozen=True, slots=True)
class Search:
    """Which scan is the reference."""

    #: derived: smallest eigenvalue of the mean of n n' over a reference's planes, where 1/3 is best: 0.02 is the third way
    #: faced by one plane of fifty, or by planes 8 deg off the others' (sin^2 8 deg).
    least_determinacy: float = 0.02
    #: derived: three planes that face three ways hold three coordinates of a place; one scan with fewer is better than
    #: another by its planes' number alone.
    fewest_planes: int = 3
    #: judged: a standing start shows within the first scans, each looked at; the third comes after a fifth of a second.
    first_scans: int = 3
    #: judged: then every fifth, or as many over the whole recording as half a minute of work allows. Which scan is the
    #: reference changes the map's frame, not the answer.
    step_scans: int = 5
    scans: int = 40
    #: derived: of the tens of thousands of points of so many scans, spread over all, the median range is known to a per cent:
    #: it tells whether coordinates can be metres.
    looked_at: int = 5


@dataclass(frozen=True, slots=True)
class Patches:
    """What a plane is to a person: told apart from others, its area, and how it grows around a point that is pointed at."""

    #: judged: of planes that face the same way within this and lie nearer than this, the smaller is a door proud of its
    #: wall: both would make each other's points ambiguous. What a person is shown depends on it.
    distinct_deg: float = 8.0
    distinct_m: float = 0.25
    #: judged: planes that somebody gives and that are as near as a wall's points scatter about it, turned by no more than a scan
    #: tells a small wall, are one. Whether the second counts depends on it.
    twice_deg: float = 3.0
    twice_m: float = 0.05
    #: derived: a sparse lidar's points along a ring are 0.035 m apart at 10 m, its rings 0.35: cells hold one at least
    #: along every ring. Area is counted in them, and shown.
    cell_m: float = 0.2
    #: judged: the neighbourhood widens until its points lie on a plane: the seat of a chair first, a wall's patch between
    #: rings (0.35 m apart at 10 m) last. A plane that is pointed at depends on it.
    radii_m: tuple[float, ...] = (0.3, 0.6, 1.0, 1.6)
    #: judged: fewer points tell no plane from chance. A plane that is pointed at is refused with that reason.
    fewest_near: int = 40
    fewest_points: int = 30
    #: judged: a plane around a point passes it within the segmentation's own band (0.06 m and 2 mm a metre) and a hand that
    #: points. A plane that is pointed at depends on it.
    seed_m: float = 0.08
    #: derived: it grows over cells that touch, and two rings of sixteen at 10 m are 10 m tan 2 deg = 0.35 m apart.
    joined_m: float = 0.4
    #: judged: the segmentation in so small a neighbourhood, of which less of everything is asked. A plane that is pointed
    #: at depends on it.
    around: SegmentSettings = SegmentSettings(  # noqa: RUF009  frozen
        min_points=30, min_share=0.2, min_breadth_m=0.04, piece_breadth_m=0.04, max_planes=3
    )


@dataclass(frozen=True, slots=True)
class Judgement:
    """When a plane is none: it moved, it is bent, it is several surfaces."""

    #: judged: at fault is so many times the usual on, twice what differs between honest walls of one room. Which planes are
    #: left out by themselves depends on it: below, bent walls go, above, doubtful boxes stay.
    times: float = 4.0
    #: judged: not below what plaster does anyway, a wall being flat to some 2 mm in a metre. Walls within it are never left
    #: out.
    least_m: float = 0.0025
    #: judged: beyond what nothing that is called flat does, whatever the others are like: four times plaster. Where all
    #: planes are bad it alone decides.
    most_m: float = 0.008
    #: measured: returns of walls scatter (squared) less than three times as much as others. So many times lie on more than
    #: one surface.
    mixed_times: float = 5.0
    #: judged: a person or a door differs from second to second; ten scans give each second's mean enough points to show
    #: millimetres.
    block_s: float = 1.0
    #: derived: a group's mean is weighed by its own scatter; of fewer averages than this it has hardly an error of its own.
    fewest: int = 3
    #: derived: noise makes less in 999 planes of a thousand, however few places they were seen at.
    confidence: float = 0.999


@dataclass(frozen=True, slots=True)
class Curved:
    """When what was taken for a plane is curved."""

    #: derived: curvature times distance. A motor that turns a lidar once a second does a tenth of a round in a sweep of 10 Hz,
    #: and makes 0.2 of a flat wall; one that goes round the lidar has 1. Between the two.
    of_distance: float = 0.45
    #: derived: what is called flat is off by no more (Judgement): the curved part of what points are off a plane, rms.
    least_m: float = 0.008


SEARCH, PATCHES, JUDGEMENT, CURVED = Search(), Patches(), Judgement(), Curved()
