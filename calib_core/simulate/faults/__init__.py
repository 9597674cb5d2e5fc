"""What real sensors and real rooms do that ideal ones do not: faults by name, drawn by seed, each with its truth.

names.py    the faults and profiles, as a caller names them
draw.py     one recording's own draw of what was asked for
lidar.py    lasers that read long or short and look elsewhere
imu.py      scales, axes, delays and filters of inertial readings
clock.py    clocks that run apart, stamps taken late
room.py     walls that are bent, a door ajar, skirting, glass
engine.py   an engine that runs
"""

from __future__ import annotations

from calib_core.simulate.faults.draw import IDEAL, Drawn, draw
from calib_core.simulate.faults.names import FAULTS, PROFILES, Fault, parse_faults

__all__ = ["FAULTS", "IDEAL", "PROFILES", "Drawn", "Fault", "draw", "parse_faults"]
