"""A report's pictures of what parts of a recording answer by themselves, and of the turning over the time offset.

To be called within `plots.drawn`, as the others are.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from app.results.plots import AFTER, BEFORE, FULL, HALF, SERIES, Canvas
from calib_core.result import OffsetProfile, OwnAnswer, PlaneAnswer, RangeAnswer, TimeBlock

#: Bars longer than so many times the shorter ones (their quartile) may leave their axes.
LONGEST_BAR = 5.0
_POINT: dict[str, str | float] = {"fmt": "o", "markersize": 2.5, "elinewidth": 0.9, "capsize": 1.5}


def time_blocks(blocks: Sequence[TimeBlock]) -> str:
    """Each stretch's own answer less the joint one, with a standard deviation to each side."""
    middle = [0.5 * (block.t_start_s + block.t_end_s) for block in blocks]
    width_s = min((block.t_end_s - block.t_start_s for block in blocks), default=1.0)
    canvas = Canvas(FULL, 2.1)
    (row,) = canvas.axes(1, 3)
    for axes, (name, unit, shift, std) in zip(row, own_answers(blocks), strict=True):
        axes.axhline(0.0, color="#444444", linewidth=0.7)
        for axis, color, label in _axis_looks(shift.shape[1]):
            at = np.array(middle) + 0.18 * width_s * (axis - 0.5 * (shift.shape[1] - 1))
            axes.errorbar(at, shift[:, axis], std[:, axis], **_POINT, color=color, label=label)
        ends = reach(shift, std)
        axes.set_ylim(-ends, ends)
        axes.set_xlabel("time after the recording began [s]")
        axes.set_ylabel(f"minus the joint answer [{unit}]")
        axes.set_title(name, fontsize=8)
    row[0].legend(loc="upper right", ncols=3, fontsize=6.5, handletextpad=0.1, columnspacing=0.8)
    return canvas.svg()


def planes_and_ranges(planes: Sequence[PlaneAnswer], ranges: Sequence[RangeAnswer]) -> str:
    """The own answers of each plane, and of the nearer and the farther half of the points, less the joint one."""
    names = [plane.name[:24] for plane in planes] + [f"{part.from_m:.1f} to {part.to_m:.1f} m" for part in ranges]
    canvas = Canvas(FULL, 0.75 + 0.21 * len(names))
    (row,) = canvas.axes(1, 3)
    places = np.arange(len(names), dtype=np.float64)
    for axes, (name, unit, shift, std) in zip(row, own_answers([*planes, *ranges]), strict=True):
        axes.axvline(0.0, color="#444444", linewidth=0.7)
        for axis, color, _ in _axis_looks(shift.shape[1]):
            at = places + 0.2 * (axis - 0.5 * (shift.shape[1] - 1))
            axes.errorbar(shift[:, axis], at, xerr=std[:, axis], **_POINT, color=color)
        ends = reach(shift, std)
        axes.set_xlim(-ends, ends)
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.set_yticks(places, names if axes is row[0] else [""] * len(names))
        axes.set_xlabel(f"minus the joint answer [{unit}]")
        axes.set_title(name, fontsize=8)
    return canvas.svg()


def own_answers(
    parts: Sequence[OwnAnswer],
) -> tuple[tuple[str, str, NDArray[np.float64], NDArray[np.float64]], ...]:
    """Name, unit, shifts and standard deviations (K, 3 or 1)."""
    turn, turn_std = ([part.rotation_shift_deg for part in parts], [part.rotation_std_deg for part in parts])
    move, move_std = ([part.translation_shift_m for part in parts], [part.translation_std_m for part in parts])
    late, late_std = ([[part.time_offset_shift_s] for part in parts], [[part.time_offset_std_s] for part in parts])
    return (
        ("rotation", "deg", np.array(turn), np.array(turn_std)),
        ("position", "mm", 1e3 * np.array(move), 1e3 * np.array(move_std)),
        ("time offset", "ms", 1e3 * np.array(late), 1e3 * np.array(late_std)),
    )


def _axis_looks(count: int) -> list[tuple[int, str, str]]:
    """Number, colour and name of each axis; of the clocks there is one."""
    if count == 1:
        return [(0, AFTER, "")]
    return [(axis, color, "xyz"[axis]) for axis, color in enumerate(SERIES)]


def reach(shift: NDArray[np.float64], std: NDArray[np.float64]) -> float:
    """Half an axis: all bars but those far longer than others, of parts that say next to nothing."""
    telling = std <= LONGEST_BAR * np.percentile(std, 25.0)
    return 1.1 * float(np.max(np.abs(shift[telling]) + std[telling]))


def offset_profile(profile: OffsetProfile) -> str:
    """How alike the turning of both sensors is, over the time offset around the answer's."""
    canvas = Canvas(HALF, 2.0)
    ((axes,),) = canvas.axes(1, 1)
    values = [np.nan if value is None else value for value in profile.likeness]
    at_ms = 1e3 * (profile.first_s + profile.step_s * np.arange(len(values)))
    axes.axvline(0.0, color=BEFORE, linewidth=0.9, label="answer")
    axes.plot(at_ms, values, color=AFTER)
    axes.set_xlabel("time offset minus the answer's [ms]")
    axes.set_ylabel("match of the rates of turn (0 to 1)")
    axes.set_ylim(0.0, 1.05)
    axes.legend(loc="upper right")
    return canvas.svg()
