"""Beyond which standard deviation an axis is weak, as the contract says it: one home for page, report and terminal."""

from __future__ import annotations

WEAK_DEG = 0.5
WEAK_M = 0.020
WEAK_S = 0.002
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
