"""Numbers of the server's own that a page needs, from where each of them lives."""

from __future__ import annotations

from app.planes.operations import MERGE_OFFERED_DEG, MERGE_OFFERED_M
from app.schemas.recordings import UsualNumbers
from app.schemas.view import LARGEST_POINTS, SMALLEST_POINTS
from calib_core.settings import (
    LATITUDE_GRAVITY_STD_M_S2,
    PAPER_FIELD_OF_VIEW_DEG,
    PAPER_POINTS_PER_PLANE_PER_SCAN,
    CalibrateSettings,
)

#: Ten sweeps of a usual lidar: with fewer a solve has nothing to compare, and says so.
SHORTEST_SPAN_S = 1.0


def usual_numbers() -> UsualNumbers:
    """All of them."""
    return UsualNumbers(
        max_rounds=CalibrateSettings().max_rounds,
        paper_points_per_plane_per_scan=PAPER_POINTS_PER_PLANE_PER_SCAN,
        paper_field_of_view_deg=PAPER_FIELD_OF_VIEW_DEG,
        latitude_gravity_std_m_s2=LATITUDE_GRAVITY_STD_M_S2,
        shortest_span_s=SHORTEST_SPAN_S,
        merge_within_deg=MERGE_OFFERED_DEG,
        merge_within_m=MERGE_OFFERED_M,
        smallest_points=SMALLEST_POINTS,
        largest_points=LARGEST_POINTS,
    )
