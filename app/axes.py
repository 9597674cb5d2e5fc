"""The axes in short, and the limit of each where it is weak in the forecast's unit: for page, report and terminal."""

from __future__ import annotations

from calib_core.result import WEAK_DEG, WEAK_M, WEAK_S

#: The axes of a calibration in the covariance's order, as people read them.
AXIS_NAMES: dict[str, str] = {
    "rx": "Turn x",
    "ry": "Turn y",
    "rz": "Turn z",
    "tx": "Position x",
    "ty": "Position y",
    "tz": "Position z",
    "dt": "Time offset",
}
#: In the units that the doctor's forecast is in.
WEAK_IN = {"deg": WEAK_DEG, "m": WEAK_M, "s": WEAK_S}
