"""Whether the sensors are as good as the data sheets of their kind have them; where not, what any sensor may be off by.

A sensor that was recognised, or named, has narrow priors. One whose readings contradict them has been worn, bent or put to wrong
use, or is not what its name says. To hold it at its sheet would lay its errors upon the calibration.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from calib_core.full.joint.bounds import SensorsAstray
from calib_core.full.joint.estimation import Solved
from calib_core.full.joint.settings import SHEETS
from calib_core.full.prepare.nuisance import sensor_block, unknowns_of
from calib_core.full.run import Run
from calib_core.intrinsics import KINDS, Block, Sensor
from calib_core.presets import find_imu_preset, find_lidar_preset


@dataclass(frozen=True, slots=True)
class Beyond:
    """A block that is further off than its sheet has it: so many times its standard deviation."""

    block: Block
    times: float

    @property
    def sensor(self) -> Sensor | None:
        """Whose sheet that is; None for the clocks, which have none."""
        owner = KINDS[self.block].owner
        if owner == "clock":
            return None
        return "imu" if owner == "imu" else "lidar"


def beyond_sheets(solved: Solved) -> Beyond | None:
    """Of a solve at rest: the block that is furthest from its sheet, where chance does not put one. None where all are as they
    should be, and where a plane that somebody insists on bends the sensors.

    What is estimated is never further from zero than the truth is in the mean: as sum of squares of normal numbers it is judged
    too mildly, if at all.
    """
    if any(plane.fault for plane in solved.planes):
        return None
    found = []
    for each in solved.nuisance.sensors.blocks:
        scaled = solved.estimate.sensors.of(each.block) / each.prior_std
        square = float(scaled @ scaled)
        if square > scipy.special.chdtri(len(scaled), SHEETS.chance):
            found.append(Beyond(sensor_block(each), float(np.sqrt(square / len(scaled)))))
    return max(found, key=lambda each: each.times, default=None)


def beyond_by(astray: SensorsAstray) -> Beyond:
    """The same of a solve that ended for it."""
    return Beyond(astray.block, astray.times)


def without_sheet(run: Run, beyond: Beyond) -> Run | None:
    """The run with what any sensor may be off by allowed to the one that is beyond its sheet; None where it is allowed already,
    or the sheet has as much."""
    sensor = beyond.sensor
    if sensor is None or sensor in run.beyond_sheets:
        return None
    allowing = replace(run, beyond_sheets=run.beyond_sheets | {sensor})
    before, after = (unknowns_of(each) for each in (run, allowing))
    if after.values(after.prior_std, beyond.block).max() <= before.values(before.prior_std, beyond.block).max():
        return None
    return allowing


def with_room(run: Run, beyond: Beyond) -> Run | None:
    """The run with as much allowed to a parameter that ran away as it was found to be, which is beyond any sheet; None for the
    clocks', and where that was done already.
    """
    if beyond.sensor is None or run.room is not None:
        return None
    return replace(run, beyond_sheets=run.beyond_sheets | {beyond.sensor}, room=(beyond.block, beyond.times))


def say_roomy(run: Run, beyond: Beyond) -> None:
    """That a sensor is worse than any, and why that is believed."""
    whose = "IMU" if beyond.sensor == "imu" else "lidar"
    run.say(
        "warning",
        "sensor.beyond_sheet",
        f"the {whose} is {beyond.times:.0f} times as far off in its {beyond.block.replace('_', ' ')} as any data sheet allows; "
        f"so much is allowed for, and all parts of the recording agree with it; check the {whose}",
    )


def say_beyond(run: Run, beyond: Beyond) -> None:
    """That a sheet is not relied on, and why. run: with it."""
    sensor = beyond.sensor
    assert sensor is not None
    whose = "IMU" if sensor == "imu" else "lidar"
    run.say(
        "warning",
        "sensor.beyond_sheet",
        f"the {whose} is {beyond.times:.0f} times as far off in its {beyond.block.replace('_', ' ')} as the data sheet of "
        f"{_kind(run, sensor)} allows: the data sheet is not used, and errors of any {whose} are allowed for; check which "
        f"{whose} it is",
    )


def _kind(run: Run, sensor: Sensor) -> str:
    settings, recording = run.settings, run.recording
    if sensor == "imu":
        named = settings.imu_noise if isinstance(settings.imu_noise, str) else ""
        found = find_imu_preset(named, recording.imu_model)
        return "its kind" if found is None else found.name
    lidar = find_lidar_preset(settings.lidar or "", recording.lidar.model)
    return "its kind" if lidar is None else lidar.name
