"""A report's pictures: each a self-contained SVG with axes, units and nothing that needs a network or a script.

matplotlib is imported here only, when a report is made; its windows and its state machine (pyplot) never.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from app.schemas.evidence import Binned, ImuComparison, Picture, Step
from app.schemas.results import ScanQuality, Thickness
from calib_core.result import PlaneQuality

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Width of the page between its margins, and of half of it [inches].
FULL, HALF = 7.0, 3.4
BEFORE, AFTER, SERIES = "#c2550a", "#0b6e8f", ("#c0392b", "#2e7d32", "#1f5fa8")
#: Of two ticks nobody can read a third value.
FEWEST_TICKS = 3
#: One thread draws for the whole process, in which a server makes several reports at once. matplotlib's style is one for all
#: threads; and it keeps the fonts that each thread has opened, files and all, for the next 64, so that reports drawn by any
#: thread that is free held more files each time.
_DRAWER = ThreadPoolExecutor(1, thread_name_prefix="report")

T = TypeVar("T")


def drawn(draw: Callable[[], T]) -> T:
    """What `draw` makes of the functions here, in the report's style; after whoever draws now."""
    return _DRAWER.submit(_in_style, draw).result()


def _in_style(draw: Callable[[], T]) -> T:
    import matplotlib as mpl

    with mpl.rc_context():
        mpl.rcParams.update({"font.size": 7.5, "font.family": "DejaVu Sans", "svg.hashsalt": "unsweep"})
        mpl.rcParams.update({"axes.spines.top": False, "axes.spines.right": False, "axes.linewidth": 0.6})
        mpl.rcParams.update({"axes.grid": True, "grid.color": "#e3e5e8", "grid.linewidth": 0.5, "axes.axisbelow": True})
        mpl.rcParams.update({"lines.linewidth": 1.0, "legend.frameon": False})
        return draw()


class Canvas:
    """A figure in the report's style; `svg` is its address in a page."""

    def __init__(self, width: float, height: float) -> None:
        from matplotlib.figure import Figure

        self.figure: Figure = Figure(figsize=(width, height), layout="constrained")

    def axes(self, rows: int, columns: int, *, sharex: bool = False) -> NDArray[np.object_]:
        """(rows, columns) axes."""
        made: NDArray[np.object_] = self.figure.subplots(rows, columns, squeeze=False, sharex=sharex)
        return made

    def svg(self) -> str:
        """The figure as a data address: <img src=...> keeps its names apart from other figures'."""
        from matplotlib.ticker import AutoLocator

        for axes in self.figure.axes:
            for axis in (axes.xaxis, axes.yaxis):
                locator = axis.get_major_locator()
                if isinstance(locator, AutoLocator):
                    locator.set_params(min_n_ticks=FEWEST_TICKS)
        return _address(self.figure)


def _address(figure: Figure) -> str:
    out = io.BytesIO()
    figure.savefig(out, format="svg", metadata={"Date": None, "Creator": "unsweep"})
    return "data:image/svg+xml;base64," + base64.b64encode(out.getvalue()).decode()


def room(picture: Picture) -> str:
    """Before and after, side by side."""
    canvas = Canvas(FULL, 2.65)
    (row,) = canvas.axes(1, 2)
    for axes, cells, title in zip(row, (picture.before, picture.after), ("raw", "de-skewed"), strict=True):
        _plan(axes, picture, cells)
        axes.set_title(title, fontsize=8)
    return canvas.svg()


def _plan(axes: Axes, picture: Picture, cells: str) -> None:
    shown = np.frombuffer(base64.b64decode(cells), np.uint8).reshape(picture.height, picture.width)
    right_m, top_m = picture.left_m + picture.width * picture.cell_m, picture.bottom_m + picture.height * picture.cell_m
    extent = (picture.left_m, right_m, picture.bottom_m, top_m)
    axes.imshow(255 - shown, cmap="gray", vmin=0, vmax=255, origin="lower", extent=extent, interpolation="nearest")
    axes.set_xlabel("along the first wall's normal [m]")
    axes.set_ylabel("across [m]")
    axes.grid(visible=False)


def rig(R_imu_lidar: NDArray[np.float64], p_imu_lidar: NDArray[np.float64], names: tuple[str, str]) -> str:
    """Both sensors' axes where they are, in the IMU's frame.   names: the IMU's and the lidar's frame."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator
    from mpl_toolkits.mplot3d import Axes3D

    figure = Figure(figsize=(HALF, 3.0))
    axes = cast(Axes3D, figure.add_axes((0.0, 0.1, 0.82, 0.88), projection="3d"))
    reach = 0.45 * max(float(np.linalg.norm(p_imu_lidar)), 0.05)
    drawn = [np.zeros(3), p_imu_lidar]
    upper = 1 if p_imu_lidar[2] >= 0.0 else -1
    for title, R, p, frame, side in (
        ("IMU", np.eye(3), np.zeros(3), names[0], -upper),
        ("lidar", R_imu_lidar, p_imu_lidar, names[1], upper),
    ):
        for axis, color in enumerate(SERIES):
            end = p + reach * R[:, axis]
            axes.plot(*np.stack([p, end], axis=1), color=color, linewidth=2.0)
            axes.text(*(p + 1.15 * reach * R[:, axis]), "xyz"[axis], color=color, fontsize=7)
            drawn.append(end)
        place = p + np.array([0.0, 0.0, side * (1.6 if side > 0 else 0.4) * reach])
        label = title if frame in {"", title} else f"{title} ({frame[:24]})"
        axes.text(*place, label, fontsize=7, weight="bold", horizontalalignment="center")
    axes.plot(*np.stack([np.zeros(3), p_imu_lidar], axis=1), color="#555555", linestyle=":", linewidth=1.2)
    low, high = np.min(drawn, axis=0), np.max(drawn, axis=0)
    middle, half = 0.5 * (low + high), 0.55 * float((high - low).max())
    for axis, name in enumerate("xyz"):
        getattr(axes, f"set_{name}lim")(middle[axis] - half, middle[axis] + half)
        getattr(axes, f"set_{name}label")(f"{name} of the IMU [m]", fontsize=6, labelpad=-6)
        getattr(axes, f"{name}axis").set_major_locator(MaxNLocator(4))
    axes.tick_params(labelsize=5.5, pad=-2)
    axes.set_box_aspect((1, 1, 1), zoom=1.1)
    axes.view_init(elev=22, azim=-58)
    return _address(figure)


def convergence(steps: Sequence[Step]) -> str:
    """How far each step was from the last one, on a scale of logarithms."""
    canvas = Canvas(FULL, 1.9)
    (row,) = canvas.axes(1, 3)
    last = steps[-1]
    numbers = np.arange(1, len(steps) + 1)
    turns = [np.abs(np.subtract(step.euler_xyz_deg, last.euler_xyz_deg)).max() for step in steps]
    shifts = [1e3 * float(np.linalg.norm(np.subtract(step.translation_m, last.translation_m))) for step in steps]
    clocks = [1e3 * abs(step.time_offset_s - last.time_offset_s) for step in steps]
    units = (("rotation", "deg"), ("position", "mm"), ("time offset", "ms"))
    for axes, values, (name, unit) in zip(row, (turns, shifts, clocks), units, strict=True):
        axes.semilogy(numbers, np.maximum(values, 1e-5), marker="o", markersize=2.5, color=AFTER)
        axes.set_xlabel("accepted step of the solve")
        axes.set_ylabel(f"distance from the end [{unit}]")
        axes.set_title(name, fontsize=8)
    return canvas.svg()


def planes(found: Sequence[PlaneQuality], walls: Thickness | None) -> str:
    """Spread of each plane's points: what the solve left, and before and after over the same points."""
    canvas = Canvas(FULL, 0.7 + 0.17 * len(found))
    ((axes,),) = canvas.axes(1, 1)
    rows = np.arange(len(found))
    axes.barh(rows, [1e3 * plane.rms_m for plane in found], height=0.55, color="#b9c4cc", label="left by the solve")
    measured = {} if walls is None else {wall.name: wall for wall in walls.walls if wall.points}
    pairs = [(row, measured[plane.name]) for row, plane in enumerate(found) if plane.name in measured]
    if pairs:
        at = [row for row, _ in pairs]
        axes.plot([1e3 * w.before_rms_m for _, w in pairs], at, "o", markersize=4, color=BEFORE, label="raw")
        axes.plot([1e3 * w.after_rms_m for _, w in pairs], at, "o", markersize=4, color=AFTER, label="de-skewed")
    axes.set_yticks(rows, [plane.name[:28] for plane in found])
    axes.set_ylim(len(found) - 0.4, -0.6)
    axes.set_xlim(left=0)
    axes.set_xlabel("spread of the points about the plane, rms [mm]")
    axes.legend(loc="lower right", ncols=3, bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
    return canvas.svg()


def over_time(scans: ScanQuality) -> str:
    """Spread of each scan about the planes, and how much of it lies on planes."""
    canvas = Canvas(FULL, 1.9)
    (row,) = canvas.axes(1, 2)
    rms_mm = [np.nan if rms is None else 1e3 * rms for rms in scans.rms_m]
    row[0].plot(scans.t_s, rms_mm, ".", markersize=2.5, color=AFTER)
    row[0].set_ylabel("spread, rms [mm]")
    row[0].set_ylim(bottom=0)
    row[1].plot(scans.t_s, [np.nan if s is None else 100 * s for s in scans.share], ".", markersize=2.5, color="#666")
    row[1].set_ylabel("points on planes [%]")
    row[1].set_ylim(0, 103)
    for axes in row:
        axes.set_xlabel("time after the first scan [s]")
    return canvas.svg()


def by_value(binned: Binned, name: str) -> str:
    """Mean and spread of distances from planes, over something named with its unit."""
    canvas = Canvas(HALF, 2.0)
    ((axes,),) = canvas.axes(1, 1)
    at, mean_mm, rms_mm = (np.array(values) for values in (binned.at, binned.mean_m, binned.rms_m))
    axes.axhline(0.0, color="#888888", linewidth=0.6)
    axes.plot(at, 1e3 * rms_mm, marker="o", markersize=2.5, color="#8a97a0", label="spread, rms")
    error_mm = 2e3 * rms_mm / np.sqrt(binned.points)
    axes.errorbar(at, 1e3 * mean_mm, error_mm, marker="o", markersize=2.5, linewidth=0.9, color=AFTER, label="mean")
    axes.set_xlabel(name)
    axes.set_ylabel("distance from planes [mm]")
    # Above: however the two curves run, they run under nothing.
    axes.legend(loc="lower right", ncols=2, bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
    return canvas.svg()


def imu(compared: ImuComparison) -> str:
    """Measured and predicted readings, and their differences ten times as large."""
    canvas = Canvas(FULL, 4.2)
    grid = canvas.axes(4, 1, sharex=True)[:, 0]
    rates = [np.degrees(np.array(values)) for values in (compared.gyro_rad_s, compared.gyro_predicted_rad_s)]
    forces = [np.array(values) for values in (compared.accel_m_s2, compared.accel_predicted_m_s2)]
    for (top, below), (measured, foretold), unit in ((grid[:2], rates, "deg/s"), (grid[2:], forces, "m/s$^2$")):
        for axis, color in enumerate(SERIES):
            top.plot(compared.t_s, measured[axis], color=color, linewidth=0.9, label=f"{'xyz'[axis]} measured")
            top.plot(compared.t_s, foretold[axis], color="black", linewidth=0.5, linestyle=(0, (3, 2)))
            below.plot(compared.t_s, measured[axis] - foretold[axis], color=color, linewidth=0.5)
        top.set_ylabel(unit)
        below.set_ylabel(f"difference\n[{unit}]")
    grid[0].set_title("turning (gyroscope); dashed: predicted", fontsize=7.5, loc="left")
    grid[2].set_title("specific force (accelerometer)", fontsize=7.5, loc="left")
    grid[0].legend(loc="lower right", ncols=3, bbox_to_anchor=(1.0, 1.1), borderaxespad=0.0)
    grid[-1].set_xlabel("time after the first scan [s]")
    return canvas.svg()


def thickness(walls: Thickness) -> str:
    """All walls' points about their planes, before and after."""
    canvas = Canvas(HALF, 2.0)
    ((axes,),) = canvas.axes(1, 1)
    edges_mm = 1e3 * np.array(walls.edges_m)
    for color, name, rows in (
        (BEFORE, "raw", [wall.before_histogram for wall in walls.walls]),
        (AFTER, "de-skewed", [wall.after_histogram for wall in walls.walls]),
    ):
        counts = np.sum(rows, axis=0, dtype=np.float64)
        axes.stairs(100 * counts / max(counts.sum(), 1.0), edges_mm, color=color, label=name, linewidth=1.1)
    axes.set_xlabel("signed distance from the plane [mm]")
    axes.set_ylabel("points [%]")
    axes.set_ylim(bottom=0)
    axes.legend(loc="upper right")
    return canvas.svg()
