"""The words of the command line's options as settings: what needs more than a type."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, get_args

from pydantic import ValidationError

from calib_core.api import read_imu_noise
from calib_core.errors import SettingsError
from calib_core.intrinsics import UNITS, Block
from calib_core.presets import named_imu, named_lidar
from calib_core.settings import (
    LATITUDE_GRAVITY_STD_M_S2,
    LEAST_GRAVITY_M_S2,
    MOST_GRAVITY_M_S2,
    PAPER_FIELD_OF_VIEW_DEG,
    PAPER_POINTS_PER_PLANE_PER_SCAN,
    Axis,
    CalibrateSettings,
    Gravity,
    ImuNoise,
    Prior,
    ReadSettings,
    gravity_at_latitude_m_s2,
)
from calib_core.validation_messages import misfit

Method = Literal["full", "paper"]
Intrinsics = Literal["auto", "consider", "off"] | tuple[Block, ...]
_INTRINSICS: dict[str, Literal["auto", "consider", "off"]] = {"auto": "auto", "consider": "consider", "off": "off"}
_AXIS_UNITS: dict[str, dict[str, float]] = {
    "r": {"": 1.0, "rad": 1.0, "deg": math.radians(1.0)},
    "t": {"": 1.0, "m": 1.0, "mm": 1e-3},
    "d": {"": 1.0, "s": 1.0, "ms": 1e-3},
}
#: What is called otherwise on the command line.
_OPTIONS = {"priors": "prior"}
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_PRIOR = re.compile(rf"(?P<axis>[a-z]+)=(?P<value>{_NUMBER})(?:\+-|\+/-|±)(?P<std>{_NUMBER})(?P<unit>[a-z]*)")


def read_settings(chosen: argparse.Namespace) -> ReadSettings:
    """The options of the groups of `add_reading`, which have the names of the settings."""
    words = vars(chosen)
    try:
        return ReadSettings.model_validate({name: words[name] for name in ReadSettings.model_fields if name in words})
    except ValidationError as error:
        raise _unfit(error) from error


def solve_settings(chosen: argparse.Namespace) -> CalibrateSettings:
    """The options of a solve, each in the words of the command line."""
    try:
        return CalibrateSettings(
            method=chosen.method,
            points_per_plane_per_scan=parse_points(chosen.points_per_plane_per_scan, chosen.method),
            field_of_view_deg=parse_field_of_view(chosen.field_of_view_deg, chosen.method),
            gravity=parse_gravity(chosen.gravity),
            imu_noise=parse_imu_noise(chosen.imu_noise),
            intrinsics=parse_intrinsics(chosen.intrinsics),
            lidar=parse_lidar(chosen.lidar),
            estimate_time_offset=not chosen.fix_time_offset,
            estimate_planes=not chosen.fix_planes,
            bias_model=chosen.bias_model,
            imu_sampling=chosen.imu_sampling,
            lidar_sampling=chosen.lidar_sampling,
            cloud=chosen.cloud,
            priors=parse_priors(chosen.prior),
            random_seed=chosen.random_seed,
            max_rounds=chosen.max_rounds,
            excluded_spans_s=parse_spans(chosen.exclude),
        )
    except ValidationError as error:
        raise _unfit(error) from error


def _unfit(error: ValidationError) -> SettingsError:
    first = error.errors()[0]
    option = "-".join(_OPTIONS.get(part, part) for part in map(str, first["loc"])).replace("_", "-")
    what = f"The option --{option} does" if option else "These options do"
    return SettingsError(f"{what} not fit: {misfit(first)}; correct it")


def parse_points(text: str | None, method: Method) -> int | None:
    """`--points-per-plane-per-scan`: a number, or None for all."""
    if text is None:
        return PAPER_POINTS_PER_PLANE_PER_SCAN if method == "paper" else None
    if text == "all":
        return None
    if not text.isdecimal() or int(text) == 0:
        raise SettingsError(
            f"Expected a number above 0 or `all` for --points-per-plane-per-scan, but found `{text}`; give either."
        )
    return int(text)


def parse_field_of_view(angle_deg: float | None, method: Method) -> float | None:
    """`--field-of-view-deg`: half angle, or None for all directions."""
    if angle_deg is None:
        return PAPER_FIELD_OF_VIEW_DEG if method == "paper" else None
    if not 0.0 < angle_deg <= 180.0:
        raise SettingsError(
            f"Expected an angle above 0 and up to 180 for --field-of-view-deg, but found {angle_deg:g}; "
            "azimuths within plus and minus that angle are kept."
        )
    return None if angle_deg == 180.0 else angle_deg


def parse_gravity(text: str) -> Gravity:
    """`--gravity`: `free`, a magnitude in m/s2 (then exact), or `latitude:DEG`."""
    if text == "free":
        return Gravity()
    place, colon, number = text.rpartition(":")
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if colon and place == "latitude" and abs(value) <= 90.0:
        return Gravity(magnitude_m_s2=gravity_at_latitude_m_s2(value), std_m_s2=LATITUDE_GRAVITY_STD_M_S2)
    if not colon and LEAST_GRAVITY_M_S2 < value < MOST_GRAVITY_M_S2:
        return Gravity(magnitude_m_s2=value, std_m_s2=0.0)
    raise SettingsError(
        f"Expected `free`, a magnitude between {LEAST_GRAVITY_M_S2:g} and {MOST_GRAVITY_M_S2:g} m/s², or `latitude:DEG` for "
        f"--gravity, but found `{text}`; give one of these."
    )


def parse_imu_noise(text: str | None) -> ImuNoise | str | None:
    """`--imu-noise`: a file with densities, else the name of a preset; None: measured.

    What looks like a file's path is one: words of a path that is mistyped (`rig/mti30.yaml`) may name a preset.
    """
    if text is None:
        return None
    path = Path(text)
    if path.is_file() or len(path.parts) > 1 or path.suffix[1:].isalpha():
        return read_imu_noise(path)
    named_imu(text)
    return text


def parse_intrinsics(text: str) -> Intrinsics:
    """`--intrinsics`: one of three words, or the blocks to estimate, with commas between them."""
    if text in _INTRINSICS:
        return _INTRINSICS[text]
    words = [word.strip() for word in text.split(",")]
    unknown = [word for word in words if word not in UNITS]
    if unknown:
        raise SettingsError(
            f"Expected auto, consider, off, or names of {', '.join(UNITS)} with commas between them for --intrinsics, "
            f"but found `{unknown[0]}`; give one of these."
        )
    return tuple(block for block in UNITS if block in words)


def parse_lidar(text: str | None) -> str | None:
    """`--lidar`: the preset of the lidar that is named; None: as recognised."""
    return None if text is None else named_lidar(text).name


def parse_prior(text: str) -> Prior:
    """`--prior`, e.g. `tz=0.31+-0.005`, `rx=0+-0.5deg`, `dt=0+-1ms`; without a unit rad, m and s."""
    found = _PRIOR.fullmatch(text.replace(" ", ""))
    axes = get_args(Axis)
    if found is None or found["axis"] not in axes:
        raise SettingsError(
            f"Expected AXIS=VALUE+-STD with AXIS one of {', '.join(axes)} for --prior, but found `{text}`; "
            "for example `--prior tz=0.31+-0.005`."
        )
    units = _AXIS_UNITS[found["axis"][0]]
    scale = units.get(found["unit"])
    if scale is None:
        allowed = " or ".join(unit for unit in units if unit)
        raise SettingsError(f"Expected {allowed} after the numbers of --prior, but found `{text}`; change the unit.")
    std = float(found["std"]) * scale
    if not std > 0.0:
        raise SettingsError(f"Expected a standard deviation above 0 in --prior, but found `{text}`; give a small one.")
    axis: Axis = next(name for name in axes if name == found["axis"])
    return Prior(axis=axis, value=float(found["value"]) * scale, std=std)


def parse_numbers(text: str, count: int, option: str, example: str) -> list[float]:
    """`count` finite numbers with commas between them."""
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(math.isfinite(number) for number in numbers):
        raise SettingsError(
            f"Expected {count} numbers with commas between them for {option}, but found `{text}`; give e.g. {example}."
        )
    return numbers


def parse_priors(texts: Sequence[str]) -> tuple[Prior, ...]:
    """All `--prior` options."""
    return tuple(parse_prior(text) for text in texts)


def parse_spans(texts: Sequence[str]) -> tuple[tuple[float, float], ...]:
    """All `--exclude` options, e.g. `12.5:14`: seconds after the first scan."""
    spans = []
    for text in texts:
        found = re.fullmatch(rf"(?P<start>{_NUMBER}):(?P<end>{_NUMBER})", text.replace(" ", ""))
        if found is None or not float(found["start"]) < float(found["end"]):
            raise SettingsError(
                f"Expected START:END in seconds with START before END for --exclude, but found `{text}`; "
                "for example `--exclude 12.5:14`."
            )
        spans.append((float(found["start"]), float(found["end"])))
    return tuple(spans)


def parse_mounting(text: str | None) -> tuple[float, float, float, float, float, float, float] | None:
    """`--mounting`: x, y, z in metres and a unit quaternion, the real part last; None: the scenario's own."""
    if text is None:
        return None
    x, y, z, qx, qy, qz, qw = parse_numbers(text, 7, "--mounting", "0.1,0,0.05,0,0,0,1")
    return x, y, z, qx, qy, qz, qw
