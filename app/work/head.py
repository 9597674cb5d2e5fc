"""A cloud from the recording's first seconds, and planes where those say as much as the whole: something to see at once.

The map is the cloud of the first standstill. A recording that begins with one, which is what people are told to do,
shows it whole within seconds, and reading the other gigabytes can wait until somebody looks at the planes.
"""

from __future__ import annotations

import numpy as np

from app.arrays.first_cloud import first_cloud_file, write_first_cloud
from app.arrays.recording import relative_s
from app.jobs.orders import Order
from app.recordings.timeline import still_windows
from calib_core import api
from calib_core.errors import InputError
from calib_core.events import Event, LogEvent, OnEvent, ShouldCancel, StageEvent
from calib_core.types import POINT_DTYPE, PlaneProposals, PointArray, Recording

#: Two seconds of scans at 10 Hz are merged into the cloud; the rest is margin.
HEAD_S = 3.0
#: Smallest eigenvalue of the mean n n^T over planes with which the first scans are as good as any later ones.
LEAST_SPREAD = 0.02


#: Scans merged into the first cloud, as many as the search for planes merges.
CLOUD_SCANS = 20
#: What a job says once the first cloud can be looked at.
CLOUD = "planes.cloud"


def propose_from_head(order: Order, on_event: OnEvent, should_cancel: ShouldCancel) -> PlaneProposals | None:
    """The planes of the whole recording, found in its first seconds; None where the rest may have better ones."""
    begin_s = order.read_settings.start_s or 0.0
    end_s = order.read_settings.end_s
    if end_s is not None and end_s <= begin_s + HEAD_S:
        return None
    settings = order.read_settings.model_copy(update={"end_s": begin_s + HEAD_S})
    on_event(StageEvent(stage="read", fraction=0.0, text="reading the first seconds"))

    def about_planes(event: Event) -> None:
        # The whole is still to be read and told of: until it is, reading is what is being done.
        if isinstance(event, StageEvent) and event.stage == "planes":
            on_event(event.model_copy(update={"stage": "read", "fraction": 0.0}))

    try:
        head = api.load(order.source, settings, fingerprint=False, on_event=about_planes, should_cancel=should_cancel)
        write_first_cloud(first_cloud_file(order.cache), first_cloud(head))
        on_event(LogEvent(level="info", code=CLOUD, text="The first cloud can be looked at."))
        proposals = api.propose_planes(head, order.request.settings, on_event=about_planes, should_cancel=should_cancel)
    except InputError:
        return None  # too little in the first seconds; what is wrong with the whole is said when that is read
    return proposals if is_final(proposals, len(head.scans)) else None


def first_cloud(head: Recording) -> PointArray:
    """The points of the first scans while nothing moves; of the first scan alone where it moves from the start."""
    scans = head.scans
    if len(scans) == 0:
        return np.zeros(0, dtype=POINT_DTYPE)
    stamps_ns = np.array([scan.stamp_ns for scan in scans[:CLOUD_SCANS]], dtype=np.int64)
    imu_s = relative_s(head.imu.stamps_ns + head.coarse_offset_ns, int(stamps_ns[0]))
    still = still_windows(imu_s, head.imu.gyro_rad_s, head.imu.accel_m_s2)
    # The first span of rest counts if it has begun by the first scan.
    end_s = still[0].end_s if still and still[0].start_s <= 0.0 else 0.0
    ends_s = relative_s(stamps_ns, int(stamps_ns[0])) + head.lidar.period_s
    count = max(1, int(np.searchsorted(ends_s, end_s, side="right")))
    merged: PointArray = np.concatenate([scan.points for scan in scans[:count]])
    return merged


def is_final(proposals: PlaneProposals, n_scans: int) -> bool:
    """Whether more scans than the `n_scans` looked at would leave the proposals as they are.

    They do where the search ended at one of the first scans because its planes determine a pose, and the standstill
    ended, or was long enough, before the scans did. That the planes of the merged scans determine one is not enough: the
    search goes by single scans, and in the whole recording would end at a later one, in another frame.
    """
    if not proposals.determined:
        return False
    normals = np.array([patch.plane.normal for patch in proposals.patches], dtype=np.float64).reshape(-1, 3)
    if not proposals.static or len(normals) < 3 or proposals.reference_scans[-1] >= n_scans - 1:
        return False
    return float(np.linalg.eigvalsh(normals.T @ normals / len(normals))[0]) >= LEAST_SPREAD
