"""What a client is told before anything else: names and numbers of the server's own, from where each of them lives."""

from __future__ import annotations

from app.axes import AXIS_NAMES
from app.planes.operations import MERGE_OFFERED_DEG, MERGE_OFFERED_M
from app.schemas.recordings import Sample, ServerFacts, UsualNumbers, WeakLimits
from app.schemas.view import LARGEST_POINTS, SMALLEST_POINTS
from calib_core import __version__, api
from calib_core.presets import IMU_PRESETS, LIDAR_PRESETS
from calib_core.result import WEAK_DEG, WEAK_M, WEAK_S
from calib_core.settings import (
    LATITUDE_GRAVITY_STD_M_S2,
    PAPER_FIELD_OF_VIEW_DEG,
    PAPER_POINTS_PER_PLANE_PER_SCAN,
    CalibrateSettings,
)

#: Scenarios offered as samples, and their titles; the first is the one click away.
SAMPLES = {
    "paper-normal": "A room corner, 20 s",
    "one-axis": "Turning about one axis only",
    "vehicle": "A vehicle in a car park",
}
#: Ten sweeps of a usual lidar: with fewer a solve has nothing to compare, and says so.
SHORTEST_SPAN_S = 1.0


def server_facts(*, max_upload_bytes: int, recordings_folder: bool) -> ServerFacts:
    """All of them. Loads much of the library."""
    texts = api.scenarios()
    return ServerFacts(
        version=__version__,
        recordings_folder=recordings_folder,
        max_upload_bytes=max_upload_bytes,
        upload_suffixes=list(api.recording_suffixes()),
        export_formats=list(api.export_names()),
        limits=WeakLimits(rotation_deg=WEAK_DEG, translation_m=WEAK_M, time_offset_s=WEAK_S),
        usual=usual_numbers(),
        solve_settings=CalibrateSettings(),
        axis_names=AXIS_NAMES,
        imu_presets=[preset.name for preset in IMU_PRESETS],
        lidar_presets=[preset.name for preset in LIDAR_PRESETS],
        samples=[Sample(scenario=name, title=title, text=texts[name]) for name, title in SAMPLES.items()],
    )


def usual_numbers() -> UsualNumbers:
    """What a page fills in, offers by, or keeps to."""
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
