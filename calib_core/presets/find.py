"""Presets by the names that people, topics and frames give."""

from __future__ import annotations

import re
from typing import TypeVar

from calib_core.errors import SettingsError
from calib_core.intrinsics import UNKNOWN_IMU, UNKNOWN_LIDAR, ImuPrior, LidarPrior
from calib_core.presets.imu import IMU_PRESETS
from calib_core.presets.lidar import LIDAR_PRESETS
from calib_core.presets.records import ImuPreset, LidarPreset
from calib_core.presets.walks import USUAL_WALK
from calib_core.settings import ImuNoise

_Preset = TypeVar("_Preset", "ImuPreset", "LidarPreset")


def find_imu_preset(*texts: str) -> ImuPreset | None:
    """The preset that one of the texts (a preset's name, topic, frame id) names, or None. Earlier texts win."""
    return _find(IMU_PRESETS, texts)


def unknown_imu(text: str) -> SettingsError:
    """What is said of a name that no IMU's preset has."""
    names = ", ".join(preset.name for preset in IMU_PRESETS)
    return SettingsError(f"Expected the name of an IMU, one of {names}, but found `{text}`; give the nearest of these.")


def find_lidar_preset(*texts: str) -> LidarPreset | None:
    """The preset that one of the texts (a preset's name, topic, frame id, layout) names, or None."""
    return _find(LIDAR_PRESETS, texts)


def find_imu_prior(*texts: str) -> ImuPrior:
    """What to expect of the scales, axes and delay of the IMU so named; those of a cheap one where it is unknown."""
    preset = find_imu_preset(*texts)
    return UNKNOWN_IMU if preset is None else preset.prior


def find_lidar_prior(*texts: str) -> LidarPrior:
    """What to expect of the lasers of the lidar so named; those of a cheap one where it is unknown."""
    preset = find_lidar_preset(*texts)
    return UNKNOWN_LIDAR if preset is None else preset.prior


def random_walks(imu_noise: ImuNoise | str | None) -> tuple[float, float]:
    """Bias walks of gyroscope [rad/s/sqrt(s)] and accelerometer [m/s2/sqrt(s)] for a solve's setting `imu_noise`.

    A preset's name: that preset's; densities given by the user: theirs; nothing: USUAL_WALK.
    """
    if isinstance(imu_noise, str):
        preset = find_imu_preset(imu_noise)
        imu_noise = None if preset is None else preset.noise
    if imu_noise is None:
        return USUAL_WALK
    return imu_noise.gyroscope_random_walk, imu_noise.accelerometer_random_walk


def _find(presets: tuple[_Preset, ...], texts: tuple[str, ...]) -> _Preset | None:
    for text in texts:
        lowered = text.lower()
        named = next((p for p in presets if p.name == lowered), None)
        if named is not None:
            return named
        # Words count only where no letter or digit runs on before them: "os1" is not in "pos1".
        for preset in presets:
            # Few words are in it at all, and each expression takes a millisecond to compile.
            if any(word in lowered and re.search(rf"(?<![a-z0-9]){re.escape(word)}", lowered) for word in preset.words):
                return preset
    return None
