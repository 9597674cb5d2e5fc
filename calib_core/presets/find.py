"""Presets by the names that people, topics and frames give."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TypeVar

from calib_core.errors import SettingsError
from calib_core.intrinsics import UNKNOWN_IMU, UNKNOWN_LIDAR, ImuPrior, LidarPrior
from calib_core.presets.imu import IMU_PRESETS
from calib_core.presets.lidar import LIDAR_MAKERS, LIDAR_PRESETS
from calib_core.presets.records import ImuPreset, LidarPreset
from calib_core.presets.walks import USUAL_WALK
from calib_core.settings import CalibrateSettings, ImuNoise

_Preset = TypeVar("_Preset", "ImuPreset", "LidarPreset")
#: What stands between a name and its number: `bmi-088`, `VLP 16`.
_BEFORE_NUMBER = re.compile(r"(?<=[a-z])[-_\s]+(?=\d)")
_SHORT = 3


def find_imu_preset(*texts: str) -> ImuPreset | None:
    """The preset that one of the texts (a preset's name, topic, frame id) names, or None. Earlier texts win."""
    return _find(IMU_PRESETS, texts)


def named_imu(text: str) -> ImuPreset:
    """The preset of the IMU that a person names. Raises SettingsError where there is none."""
    found = find_imu_preset(text)
    if found is None:
        raise _unknown("an IMU", IMU_PRESETS, text)
    return found


def named_lidar(text: str) -> LidarPreset:
    """The preset of the lidar that a person names. Raises SettingsError where there is none.

    A topic is content with its maker's usual lidar; a number beside a maker's name means one model, which is not guessed.
    """
    found = find_lidar_preset(text)
    if found is None or not (_names_a_model(found, text) or not re.search(r"\d", text)):
        raise _unknown("a lidar", LIDAR_PRESETS, text)
    return found


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


def by_preset_names(settings: CalibrateSettings) -> CalibrateSettings:
    """The settings with each sensor by its preset's name, however it was written: `vlp16` and `VLP 16` are one request.

    Raises SettingsError for a sensor that no preset is of: it would count as any sensor, in silence.
    """
    names: dict[str, str] = {}
    if isinstance(settings.imu_noise, str):
        names["imu_noise"] = named_imu(settings.imu_noise).name
    if settings.lidar is not None:
        names["lidar"] = named_lidar(settings.lidar).name
    return settings.model_copy(update=names)


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


def _unknown(kind: str, presets: Sequence[ImuPreset | LidarPreset], text: str) -> SettingsError:
    names = ", ".join(preset.name for preset in presets)
    return SettingsError(f"Expected the name of {kind}, one of {names}, but found `{text}`; give the nearest of these.")


def _spellings(text: str) -> tuple[str, ...]:
    """The ways in which `VLP 16` or `bmi-088` may be among a preset's words: in one, by a hyphen, as written."""
    lowered = text.strip().lower()
    return tuple(dict.fromkeys((_BEFORE_NUMBER.sub("", lowered), re.sub(r"\s+", "-", lowered), lowered)))


def _names_a_model(preset: LidarPreset, text: str) -> bool:
    spellings = _spellings(text)
    models = [word for word in preset.words if word not in LIDAR_MAKERS]
    return preset.name in spellings or any(_is_in(word, spelling) for word in models for spelling in spellings)


def _is_in(word: str, lowered: str) -> bool:
    """Words count only where no letter or digit runs on before them: "os1" is not in "pos1"; short ones of letters alone, as they
    may begin any other, where no letter does behind them either: "hap" is not in "happy"."""
    # Few words are in it at all, and each expression takes a millisecond to compile.
    behind = "(?![a-z])" if len(word) <= _SHORT and word.isalpha() else ""
    return word in lowered and re.search(rf"(?<![a-z0-9]){re.escape(word)}{behind}", lowered) is not None


def _find(presets: tuple[_Preset, ...], texts: tuple[str, ...]) -> _Preset | None:
    for text in texts:
        spellings = _spellings(text)
        named = next((preset for preset in presets if preset.name in spellings), None)
        if named is not None:
            return named
        for preset in presets:
            if any(_is_in(word, spelling) for word in preset.words for spelling in spellings):
                return preset
    return None
