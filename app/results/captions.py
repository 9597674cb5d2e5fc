"""The sentence under each of a report's pictures: what to see in it, and what it says in this run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.schemas.evidence import Binned, ImuComparison, Picture, Step
from app.schemas.results import ScanQuality, Thickness
from calib_core.result import CalibrationResult, OffsetProfile, OwnAnswer, PlaneAnswer, RangeAnswer, TimeBlock

#: A mean beyond this, in millimetres, is more than chance and more than a good lidar's own bias.
STRIKING_MM = 5.0


def room(result: CalibrationResult) -> str:
    """Of the picture from above."""
    seen = (
        "Walls as lines, darker where more points lie over one another; floor and ceiling are left out. A right calibration "
        "draws each wall as one thin line on the right, where the left one is smeared by the motion within each sweep."
    )
    crispness = result.quality.crispness
    return seen if crispness is None else f"{seen} {crispness.text}"


def corner(picture: Picture) -> str:
    """Of the detail."""
    side_m = picture.width * picture.cell_m
    return (
        f"The {side_m:.1f} m around the spot where most points stand over one another, a cell is {1e3 * picture.cell_m:.0f} "
        "mm: what is left of a wall's width on the right is the lidar's own noise."
    )


def thickness(walls: Thickness) -> str:
    """Of the histogram."""
    before, after = 1e3 * walls.before_rms_m, 1e3 * walls.after_rms_m
    times = f", {before / after:.1f} times less" if 0 < after < before else ""
    return (
        f"All points near a plane, by their distance from it. Narrow and centred on zero is good: {before:.1f} mm rms "
        f"raw, {after:.1f} mm de-skewed{times}."
    )


def by_value(binned: Binned, name: str, unit: str = "") -> str:
    """Of distances over range or ring.   unit: of what they are over, with a space before it."""
    worst = int(np.abs(binned.mean_m).argmax())
    off_mm = 1e3 * binned.mean_m[worst]
    what = (
        f"The mean (two standard errors) should stay near zero: the largest is {off_mm:+.1f} mm at {name} "
        f"{binned.at[worst]:.3g}{unit}"
    )
    if abs(off_mm) > STRIKING_MM:
        return f"{what}, more than a good lidar's own error. A slope over {name} is an error of the lidar, not the mounting."
    return f"{what}, which is little. A slope over {name} would be an error of the lidar, not of the mounting."


def planes(result: CalibrationResult) -> str:
    """Of the bars."""
    worst = max(result.quality.planes, key=lambda plane: plane.rms_m)
    return (
        f"Grey: the spread that the solve left on the points it used, surer distances counting more, largest on {worst.name} "
        f"with {1e3 * worst.rms_m:.1f} mm. Dots: all points near the plane alike, which should move left from orange to blue. "
        "One plane far wider than the others is no plane, or has moved."
    )


def over_time(scans: ScanQuality) -> str:
    """Of the scans' spread."""
    known = np.array([rms for rms in scans.rms_m if rms is not None])
    middle_mm, worst_mm = 1e3 * float(np.median(known)), 1e3 * float(known.max())
    return (
        f"Each dot is a scan. The spread should be even: its median is {middle_mm:.1f} mm, the worst scan has "
        f"{worst_mm:.1f} mm. A hill is a stretch that the answer does not explain; few points on planes weigh little."
    )


def time_blocks(blocks: Sequence[TimeBlock]) -> str:
    """Of the stretches' answers."""
    crossing, bars = crossing_zero(blocks)
    return (
        f"What each of {len(blocks)} stretches of the recording would answer alone, less the joint answer; bars are one "
        f"standard deviation, long where little turned. Two thirds of the bars or more should cross zero, without a trend: "
        f"{crossing} of {bars} do. A drift over time is a mount that gives, or clocks that part."
    )


def planes_and_ranges(planes: Sequence[PlaneAnswer], ranges: Sequence[RangeAnswer]) -> str:
    """Of the planes' answers."""
    crossing, bars = crossing_zero([*planes, *ranges])
    return (
        f"The same of each plane, and of the nearer and the farther half of the points: {crossing} of {bars} bars cross zero. "
        "One plane that asks for something else with a short bar is bent or has moved; near against far is the lidar's own "
        "range error. A row without bars says too little to be drawn beside the others."
    )


def crossing_zero(parts: Sequence[OwnAnswer]) -> tuple[int, int]:
    """How many of the bars of one standard deviation hold zero, and how many there are."""
    within = [
        abs(shift) <= std
        for part in parts
        for shift, std in zip(
            [*part.rotation_shift_deg, *part.translation_shift_m, part.time_offset_shift_s],
            [*part.rotation_std_deg, *part.translation_std_m, part.time_offset_std_s],
            strict=True,
        )
    ]
    return sum(within), len(within)


def offset_profile(profile: OffsetProfile) -> str:
    """Of the turning over the time offset."""
    best_ms, step_ms = 1e3 * profile.best_s, 1e3 * profile.step_s
    top = max(value for value in profile.likeness if value is not None)
    seen = (
        "How well the lidar's turning and the gyroscope's go together if the clocks were so much farther apart, without planes "
        f"and mounting. It should have one clear peak at zero: the highest, {top:.3f}, is at {best_ms:+.1f} ms"
    )
    if abs(profile.best_s) > profile.step_s:
        return f"{seen}, more than its step of {step_ms:.0f} ms away: the answer and the turning disagree."
    return f"{seen}, which agrees with the answer."


def imu(compared: ImuComparison) -> str:
    """Of the readings."""
    return (
        "Black dashes, what the solved motion foretells, should lie on the coloured lines, and the differences below should "
        "be noise without the motion's shape. The motion is bound to both sensors, so what is left is what the lidar had to "
        f"bend: {np.degrees(compared.gyro_rms_rad_s):.3g} deg/s and {compared.accel_rms_m_s2:.3g} m/s² rms over the whole "
        "recording."
    )


def convergence(steps: Sequence[Step]) -> str:
    """Of the solve's steps."""
    return (
        f"Distance of each of {len(steps)} steps from the last one, on a scale of logarithms. It should fall and lie flat at "
        "the end, far below the stated standard deviations; steps upwards are where more points or planes came in."
    )
