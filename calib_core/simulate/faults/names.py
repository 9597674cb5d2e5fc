"""The faults as a caller names them, e.g. `industrial`, or `laser-offsets=8mm,accel-scale=0.005,clock-rate`.

A size is the standard deviation of what comes many times (a laser, an axis), and the value itself of what comes once.
Without a size the value is drawn, with the standard deviation that the sensor's prior has, or a usual one.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from calib_core.errors import SettingsError


@dataclass(frozen=True, slots=True)
class Kind:
    """A fault that can be asked for. unit: of its size, SI or ppm.   text: what it is, for a person."""

    unit: str
    text: str


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault asked for. size: None for the usual one.   is_drawn: the size is the standard deviation of the draw even
    where the value comes once."""

    name: str
    size: float | None = None
    is_drawn: bool = False

    @property
    def text(self) -> str:
        """As it could be asked for; `~` where the size is that of the draw."""
        return self.name if self.size is None else f"{self.name}{'~' if self.is_drawn else '='}{self.size:.6g}"


FAULTS: dict[str, Kind] = {
    "laser-offsets": Kind("m", "each laser reads long or short by its own amount"),
    "laser-elevation": Kind("rad", "each laser looks higher or lower than it says"),
    "laser-azimuth": Kind("rad", "each laser looks to a side of where it says"),
    "eccentricity": Kind("rad", "the encoder's disc sits off the rotor's axis"),
    "laser-angles": Kind("rad", "laser-elevation and laser-azimuth, and 0.4 of the size as eccentricity"),
    "laser-scale": Kind("1", "each laser reads a share too long or too short"),
    "range-offset": Kind("m", "all lasers read long by the same amount"),
    "materials": Kind("m", "each surface reads long or short by its own amount, for what it is made of"),
    "incidence": Kind("rad", "a beam of this divergence triggers early where it meets a surface slantwise"),
    "gyro-scale": Kind("1", "the gyroscope's axes scale"),
    "accel-scale": Kind("1", "the accelerometer's axes scale"),
    "imu-axes": Kind("rad", "the axes of gyroscope and of accelerometer are not square"),
    "gyro-rotation": Kind("rad", "the gyroscope is turned against the accelerometer"),
    "g-sensitivity": Kind("rad/s/(m/s2)", "the gyroscope feels force"),
    "accel-delay": Kind("s", "the accelerometer is later than the gyroscope"),
    "accel-bend": Kind("s2/m", "the accelerometer's lines bend: so much of an axis' squared reading is read too much"),
    "size-effect": Kind("m", "the accelerometer of each axis sits beside the IMU's place"),
    "low-pass": Kind("Hz", "gyroscope and accelerometer are filtered at this frequency, which the stamps allow for"),
    "poles": Kind(
        "s", "gyroscope and accelerometer are smeared by two poles of this, whose delay the stamps allow for"
    ),
    "clock-rate": Kind("ppm", "the lidar's clock runs faster than the IMU's"),
    "stamp-latency": Kind("s", "the IMU is stamped by the host, late by this in the mean, at times by much more"),
    "stamp-bundles": Kind("s", "the IMU's driver empties a buffer so often and stamps all that waited in it then"),
    "imu-repeats": Kind("1", "the IMU's driver sends each reading so many times, as if it were a new one"),
    "scan-latency": Kind("s", "scans without a clock of their own are stamped by the host, late as with stamp-latency"),
    "stamp-step": Kind(
        "s", "a clock that ticks so often stamps the IMU, and scans without a clock of their own: with its last tick"
    ),
    "gyro-step": Kind("rad/s", "the gyroscope reads whole steps of this"),
    "voxel-grid": Kind("m", "somebody left the first point of each cell of a grid, of this edge"),
    "vibration": Kind("m/s2", "an engine shakes the rig at 25 to 120 Hz"),
    "bent-walls": Kind("m", "walls are off flat by up to this"),
    "door-ajar": Kind("rad", "a door in a wall stands ajar by this angle"),
    "skirting": Kind("m", "a board of this thickness runs along the foot of every wall"),
    "glass": Kind("m", "a window of this width lets the lidar see past a wall"),
}

_DEG = math.pi / 180.0
#: Names that stand for several faults, all drawn. industrial: a VLP-16 as shipped with an individually calibrated IMU (MTi
#: class, 0.03 to 0.1 %).   consumer: lasers as bad as published ones, an IMU as bad as the data sheets of the ICM-20948 and
#: ICM-40609-D allow, two crystals, stamps from the host.
PROFILES: dict[str, tuple[Fault, ...]] = {
    "industrial": (
        Fault("laser-offsets", 0.006),
        Fault("laser-angles", 0.03 * _DEG, is_drawn=True),
        Fault("gyro-scale", 0.0005),
        Fault("accel-scale", 0.0005),
        Fault("imu-axes", 0.02 * _DEG),
        Fault("gyro-rotation", 0.02 * _DEG),
    ),
    "consumer": (
        Fault("laser-offsets", 0.008),
        Fault("laser-angles", 0.05 * _DEG, is_drawn=True),
        Fault("gyro-scale", 0.006),
        Fault("accel-scale", 0.006),
        Fault("imu-axes", 0.5 * _DEG),
        Fault("gyro-rotation", 0.5 * _DEG),
        Fault("accel-delay", 0.001, is_drawn=True),
        Fault("clock-rate", 40.0, is_drawn=True),
        Fault("stamp-latency", 0.0005),
    ),
}

_SUFFIXES = {"deg": ("rad", _DEG), "mm": ("m", 1e-3), "ms": ("s", 1e-3), "%": ("1", 0.01)}
_WORD = re.compile(
    r"(?P<name>[a-z-]+)(?:=(?P<size>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?P<suffix>[A-Za-z0-9/()%]*))?"
)


def parse_faults(text: str) -> tuple[Fault, ...]:
    """The faults of a list with commas; of a fault named twice the last counts. Raises SettingsError."""
    chosen: dict[str, Fault] = {}
    for word in filter(None, (part.strip() for part in text.split(","))):
        found = _WORD.fullmatch(word)
        base, sized, size = word.partition("=")
        if found is None and sized and base in (*FAULTS, *PROFILES):
            raise SettingsError(
                f"expected a number as the size of the fault {base}, found {size!r}; give one, for example {base}=0.008, or none "
                "for the usual size",
                code="simulate.faults",
            )
        name = found["name"] if found else word
        if found is None or (name not in FAULTS and name not in PROFILES):
            raise SettingsError(
                f"expected the name of a fault, found {word!r}; choose some of {', '.join([*PROFILES, *FAULTS])}, "
                "each fault with a size if you like, for example laser-offsets=0.008",
                code="simulate.faults",
            )
        if found["size"] is None:
            chosen |= {fault.name: fault for fault in PROFILES.get(name, (Fault(name),))}
        else:
            chosen[name] = Fault(name, _size(word, name, float(found["size"]), found["suffix"]))
    return tuple(chosen.values())


def _size(word: str, name: str, value: float, suffix: str) -> float:
    if name in PROFILES:
        raise SettingsError(
            f"expected no size after the profile {name}, found {word!r}; add single faults with a size instead",
            code="simulate.faults",
        )
    unit = FAULTS[name].unit
    of, factor = _SUFFIXES.get(suffix, (suffix or unit, 1.0))
    if of != unit:
        allowed = [unit, *(short for short, (long, _) in _SUFFIXES.items() if long == unit)]
        raise SettingsError(
            f"expected a size in {' or '.join(allowed)} for the fault {name}, found {word!r}; change the unit",
            code="simulate.faults",
        )
    return value * factor
