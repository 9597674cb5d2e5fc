"""The published method, whole (`--method paper`)."""

from calib_core.paper.calibrate import calibrate_paper, solve_tracked, track_planes
from calib_core.paper.records import ImuStates, PaperOptions, PaperSolution, PlaneFitQuality

__all__ = [
    "ImuStates",
    "PaperOptions",
    "PaperSolution",
    "PlaneFitQuality",
    "calibrate_paper",
    "solve_tracked",
    "track_planes",
]
