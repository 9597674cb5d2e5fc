"""The result as other programs want it: one function for each, text in that program's own form.

Directions differ from program to program, and so does the sign of the time offset; each module says which it writes
and why. Every text begins with a sentence about the direction and a self-check that a reader can redo by hand; a table for
programs alone has nothing but its rows. Beside the extrinsic there is what was found of the sensors themselves.
"""

from __future__ import annotations

from collections.abc import Callable

from calib_core.errors import InputError
from calib_core.exporters import (
    autoware,
    fast_lio,
    glim,
    kalibr,
    kalibr_imu,
    lasers,
    li_init,
    lio_sam,
    plain,
    rko_lio,
    ros,
    velodyne,
)
from calib_core.exporters.extrinsic import Extrinsic, extrinsic_of
from calib_core.result import CalibrationResult

__all__ = ["EXTRINSIC_NAMES", "NAMES", "SENSOR_NAMES", "Extrinsic", "export", "extrinsic_of"]

_OF_EXTRINSIC: dict[str, Callable[[Extrinsic], str]] = {
    "matrix": plain.matrix,
    "tum": plain.tum,
    "tf2-ros1": ros.tf2_ros1,
    "tf2-ros2": ros.tf2_ros2,
    "urdf": ros.urdf,
    "fast-lio": fast_lio.fast_lio,
    "point-lio": fast_lio.point_lio,
    "fast-livo2": fast_lio.fast_livo2,
    "lio-sam": lio_sam.lio_sam,
    "glim": glim.glim,
    "rko-lio": rko_lio.rko_lio,
    "li-init": li_init.li_init,
    "kalibr-style": kalibr.kalibr_style,
    "autoware": autoware.autoware,
}

_OF_SENSORS: dict[str, Callable[[CalibrationResult], str]] = {
    "velodyne-calibration": velodyne.velodyne_calibration,
    "lasers-csv": lasers.lasers_csv,
    "kalibr-imu": kalibr_imu.kalibr_imu,
}

EXTRINSIC_NAMES: tuple[str, ...] = tuple(_OF_EXTRINSIC)
SENSOR_NAMES: tuple[str, ...] = tuple(_OF_SENSORS)
#: The names that `export` knows, in the order in which they are offered.
NAMES = EXTRINSIC_NAMES + SENSOR_NAMES


def export(result: CalibrationResult, name: str) -> str:
    """Text for the program called `name`. Raises InputError for an unknown name, and for a result that lacks what it takes."""
    if name in _OF_EXTRINSIC:
        return _OF_EXTRINSIC[name](extrinsic_of(result))
    if name in _OF_SENSORS:
        return _OF_SENSORS[name](result)
    raise InputError(
        f"Expected the name of an export format, but found `{name}`; choose one of {', '.join(NAMES)}.",
        code="export.format",
    )
