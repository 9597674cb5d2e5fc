"""The tables of sensors known by name, from the presets themselves: `python -m tools.presets` writes them into docs/formats.md.

A test holds the page against the code, so that no preset is missing there and none has another number.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

from calib_core.presets import IMU_PRESETS, LIDAR_PRESETS

PAGE = Path(__file__).resolve().parent.parent / "docs" / "formats.md"
BEGIN, END = "<!-- presets: python -m tools.presets -->", "<!-- end of presets -->"
_MICRO_G = 9.80665e-6


def tables() -> str:
    """Both tables as Markdown, in the units of data sheets."""
    rows = [
        "| `--imu-noise` | gyroscope, deg/s/√Hz | accelerometer, µg/√Hz | known by | from |",
        "| --- | ---: | ---: | --- | --- |",
    ]
    for imu in IMU_PRESETS:
        gyro = math.degrees(imu.noise.gyroscope_noise_density_rad_s_sqrt_hz)
        accel = imu.noise.accelerometer_noise_density_m_s2_sqrt_hz / _MICRO_G
        rows.append(f"| `{imu.name}` | {gyro:.4g} | {accel:.4g} | {_words(imu.words)} | {imu.source} |")
    rows += [
        "",
        "| `--lidar` | a range, mm | one laser beside the others, mm | known by | from |",
        "| --- | ---: | ---: | --- | --- |",
    ]
    for lidar in LIDAR_PRESETS:
        laser_mm = 1e3 * lidar.prior.laser_range_offset_std_m
        rows.append(
            f"| `{lidar.name}` | {1e3 * lidar.range_std_m:.4g} | {laser_mm:.4g} | {_words(lidar.words)} | {lidar.source} |"
        )
    return "\n".join(rows)


def with_tables(page: str) -> str:
    """The page with its tables made anew."""
    before, rest = page.split(BEGIN)
    _, after = rest.split(END)
    return f"{before}{BEGIN}\n{tables()}\n{END}{after}"


def _words(words: tuple[str, ...]) -> str:
    return " ".join(f"`{word}`" for word in words)


def main() -> int:
    """Write the tables into the page."""
    PAGE.write_text(with_tables(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
