"""The sentence under each of a report's pictures: what to see in it, and what it says in this run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.results.agreement import zero_crossings_told
from app.results.scans import GATE_M as SCAN_GATE_M
from app.schemas.evidence import Binned, ImuComparison, Picture, Step
from app.schemas.results import ScanQuality, Thickness
from calib_core.intrinsics import KINDS, Block
from calib_core.result import CalibrationResult, OffsetProfile, PlaneAnswer, RangeAnswer, TimeBlock

#: A mean beyond this, in millimetres, is more than chance and more than a good lidar's own bias.
STRIKING_MM = 5.0


def room(result: CalibrationResult) -> str:
    """Of the picture from above."""
    seen = (
        "All scans laid together and seen from above, darker where more points lie on one another; floor and ceiling are left "
        "out. Left, raw: walls are smeared by the motion during each sweep. Right, de-skewed: with that motion taken out, a "
        "correct calibration draws each wall as one thin line."
    )
    crispness = result.quality.crispness
    return seen if crispness is None else f"{seen} {crispness.text}"


def corner(picture: Picture) -> str:
    """Of the detail."""
    side_m = picture.width * picture.cell_m
    return (
        f"The {side_m:.1f} m around the spot where most points lie on one another; one cell is {1e3 * picture.cell_m:.0f} mm "
        "wide. The width that a wall still has on the right is the lidar's own noise."
    )


def thickness(walls: Thickness) -> str:
    """Of the histogram."""
    before, after = 1e3 * walls.before_rms_m, 1e3 * walls.after_rms_m
    times = f", {before / after:.1f} times less" if 0 < after < before else ""
    return (
        f"Distances of all points near a plane from that plane. They should form one narrow peak at zero: {before:.1f} mm (rms) "
        f"raw, {after:.1f} mm de-skewed{times}."
    )


def by_value(binned: Binned, name: str, unit: str = "", *, ranges: str = "") -> str:
    """Of distances over range or ring.   unit: of what they are over, with a space before it.   ranges: as in Evidence."""
    worst = int(np.abs(binned.mean_m).argmax())
    off_mm = 1e3 * binned.mean_m[worst]
    # Kept by an older program, signs are those of the planes' normals, which say nothing of long and short.
    sign = (
        ""
        if ranges == ""
        else ", positive where points lie beyond them and so the lidar reads long, negative where short"
    )
    corrected = (
        " Ranges and angles were corrected by what this answer found of the lidar." if ranges == "corrected" else ""
    )
    what = (
        f"Mean distance of the points from their planes, with bars of two standard errors{sign}.{corrected} It should stay near "
        f"zero: the largest is {off_mm:+.1f} mm at {name} {binned.at[worst]:.3g}{unit}"
    )
    if abs(off_mm) > STRIKING_MM:
        return f"{what}, more than the error of a good lidar. A slope points to an error of the lidar, not of the mounting."
    return f"{what}, which is little. A slope would point to an error of the lidar, not of the mounting."


def planes(result: CalibrationResult) -> str:
    """Of the bars."""
    worst = max(result.quality.planes, key=lambda plane: plane.rms_m)
    return (
        f"Grey bars: spread about each plane of the points that the solve used, precise ones weighted more; it is largest on "
        f"{worst.name} with {1e3 * worst.rms_m:.1f} mm. Dots: spread of all points near the plane, raw (orange) and de-skewed "
        "(blue); blue should lie left of orange. A plane with far more spread than the others is not flat, or has moved."
    )


def over_time(scans: ScanQuality) -> str:
    """Of the scans' spread."""
    known = np.array([rms for rms in scans.rms_m if rms is not None])
    middle_mm, worst_mm = 1e3 * float(np.median(known)), 1e3 * float(known.max())
    return (
        f"Each dot is one scan: the spread about the planes of its points within {SCAN_GATE_M:.1f} m of one. Furniture and "
        "persons so near count, which makes it wider than a wall is thick. It should be even; the median is "
        f"{middle_mm:.1f} mm, the worst scan has {worst_mm:.1f} mm. Where it rises for a while, the answer does not explain the "
        "motion. Scans with few points on planes count little in the solve."
    )


def time_blocks(blocks: Sequence[TimeBlock], *, torn: bool = False) -> str:
    """Of the stretches' answers. torn: whether they contradict each other."""
    return (
        f"The recording is cut into {len(blocks)} stretches. Shown is what each of them alone would answer, minus the joint "
        "answer; bars are one standard deviation and are long where the rig hardly turned. Two thirds of the bars or more should "
        f"cross zero, without a trend: {zero_crossings_told(blocks, torn=torn)}. "
        "A drift over time points to a mount that flexes, or to clocks "
        "that run apart."
    )


def planes_and_ranges(planes: Sequence[PlaneAnswer], ranges: Sequence[RangeAnswer], *, torn: bool = False) -> str:
    """Of the planes' answers. torn: whether they, or near and far points, contradict each other."""
    return (
        "The same for each plane alone, and for the nearer and the farther half of the points alone; two thirds of the bars "
        f"should cross zero: {zero_crossings_told([*planes, *ranges], torn=torn)}. "
        "A plane whose short bar lies far from zero is bent or has moved; a difference "
        "between near and far is an error of the lidar's ranges. A row without bars says too little to be drawn on this scale."
    )


def offset_profile(profile: OffsetProfile) -> str:
    """Of the turning over the time offset."""
    seen = (
        "How well the rates of turn of the lidar and of the gyroscope match (1: perfectly) if the clocks are shifted against the "
        "answer by so much; planes and mounting have no part in it. There should be one clear peak at zero."
    )
    # Without the sentence of its making nothing is concluded: a flat curve's highest value may lie anywhere.
    return f"{seen} {profile.text}" if profile.text else f"{seen} The highest is at {1e3 * profile.best_s:+.1f} ms."


def imu(compared: ImuComparison, result: CalibrationResult) -> str:
    """Of the readings."""
    own = any(KINDS[block].owner in {"imu", "clock"} for block in _estimated(result))
    measured = "what the IMU measured"
    if compared.corrected:
        measured += ", without its own errors that this answer found and took out"
    elif own:
        measured += " as it was sent, with its own errors, though this answer found them and took them out"
    return (
        f"Coloured: {measured}. Black dashes: what the solved motion predicts, which should lie on the coloured lines. "
        "The differences below should look like noise, without the motion's shape. The motion was fitted to both sensors, so "
        f"they show where the lidar disagrees with the IMU: {np.degrees(compared.gyro_rms_rad_s):.3g} deg/s and "
        f"{compared.accel_rms_m_s2:.3g} m/s² (rms) over the whole recording."
    )


def _estimated(result: CalibrationResult) -> set[Block]:
    """The blocks of the sensors' own parameters that the solve took out of what they read."""
    return {block for block in KINDS if any(p.block == block and p.state == "estimated" for p in result.intrinsics)}


def convergence(steps: Sequence[Step]) -> str:
    """Of the solve's steps."""
    return (
        f"How far the answer was from the final one after each of {len(steps)} steps of the solve, on a logarithmic scale. It "
        "should fall, and end flat and far below the stated standard deviations. It may rise where points or planes are added."
    )
