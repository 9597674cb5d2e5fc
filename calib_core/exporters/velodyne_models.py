"""Velodynes as their manuals and the drivers' own calibration files have them: angles of each laser in firing order."""

from __future__ import annotations

from dataclasses import dataclass

_VLP_32C_ELEVATION_DEG = (
    -25.0, -1.0, -1.667, -15.639, -11.31, 0.0, -0.667, -8.843, -7.254, 0.333, -0.333, -6.148, -5.333, 1.333,
    0.667, -4.0, -4.667, 1.667, 1.0, -3.667, -3.333, 3.333, 2.333, -2.667, -3.0, 7.0, 4.667, -2.333, -2.0, 15.0,
    10.333, -1.333,
)  # fmt: skip
_VLP_32C_AZIMUTH_DEG = (
    -1.4, 4.2, -1.4, 1.4, -1.4, 1.4, -4.2, 1.4, -1.4, 4.2, -1.4, 1.4, -4.2, 1.4, -4.2, 1.4, -1.4, 4.2, -1.4,
    4.2, -4.2, 1.4, -1.4, 1.4, -1.4, 1.4, -1.4, 4.2, -4.2, 1.4, -1.4, 1.4,
)  # fmt: skip
_VLS_128_ELEVATION_DEG = (
    -11.742, -1.99, 3.4, -5.29, -0.78, 4.61, -4.08, 1.31, -6.5, -1.11, 4.28, -4.41, 0.1, 6.48, -3.2, 2.19,
    -3.86, 1.53, -9.244, -1.77, 2.74, -5.95, -0.56, 4.83, -2.98, 2.41, -6.28, -0.89, 3.62, -5.07, 0.32, 7.58,
    -0.34, 5.18, -3.64, 1.75, -25.0, -2.43, 2.96, -5.73, 0.54, 9.7, -2.76, 2.63, -7.65, -1.55, 3.84, -4.85,
    3.18, -5.51, -0.12, 5.73, -4.3, 1.09, -16.042, -2.21, 4.06, -4.63, 0.76, 15.0, -3.42, 1.97, -6.85, -1.33,
    -5.62, -0.23, 5.43, -3.53, 0.98, -19.582, -2.32, 3.07, -4.74, 0.65, 11.75, -2.65, 1.86, -7.15, -1.44, 3.95,
    -2.1, 3.29, -5.4, -0.01, 4.5, -4.19, 1.2, -13.565, -1.22, 4.17, -4.52, 0.87, 6.08, -3.31, 2.08, -6.65, 1.42,
    -10.346, -1.88, 3.51, -6.06, -0.67, 4.72, -3.97, 2.3, -6.39, -1.0, 4.39, -5.18, 0.21, 6.98, -3.09, 4.98,
    -3.75, 1.64, -8.352, -2.54, 2.85, -5.84, -0.45, 8.43, -2.87, 2.52, -6.17, -1.66, 3.73, -4.96, 0.43,
)  # fmt: skip
#: Eight columns of lasers, one after the other.
_VLS_128_AZIMUTH_DEG = (-6.354, -4.548, -2.732, -0.911, 0.911, 2.732, 4.548, 6.354) * 16


@dataclass(frozen=True, slots=True)
class VelodyneModel:
    """elevation_deg, azimuth_deg: of each laser in firing order, upwards and as the driver's rot_correction."""

    name: str
    elevation_deg: tuple[float, ...]
    azimuth_deg: tuple[float, ...]
    distance_resolution_m: float

    @property
    def laser_of_ring(self) -> tuple[int, ...]:
        """The firing order of each ring; rings count upwards."""
        return tuple(sorted(range(len(self.elevation_deg)), key=self.elevation_deg.__getitem__))


#: Pairs of a lower and an upper laser. A Puck Hi-Res fires in the same order at other angles; its preset is a VLP-16's.
VLP_16 = VelodyneModel(
    "VLP-16", tuple(e for k in range(8) for e in (2.0 * k - 15.0, 2.0 * k + 1.0)), (0.0,) * 16, 0.002
)
VLP_32C = VelodyneModel("VLP-32C", _VLP_32C_ELEVATION_DEG, _VLP_32C_AZIMUTH_DEG, 0.004)
_HDL_32E_DEG = tuple(round((4.0 * k + first) / 3.0, 2) for k in range(16) for first in (-92.0, -28.0))
HDL_32E = VelodyneModel("HDL-32E", _HDL_32E_DEG, (0.0,) * 32, 0.002)
VLS_128 = VelodyneModel("VLS-128", _VLS_128_ELEVATION_DEG, _VLS_128_AZIMUTH_DEG, 0.004)

#: Lidar presets -> the models that they may stand for, told apart by their number of lasers.
_OF_PRESET = {
    "velodyne-vlp16": (VLP_16,),
    "velodyne-vlp32c": (VLP_32C,),
    "velodyne-hdl32e": (HDL_32E,),
    "velodyne": (VLP_16, VLS_128),
}


def velodyne_model(preset: str, lasers: int) -> VelodyneModel | None:
    """The model that a lidar preset's name and a number of lasers leave; None where they leave several, or none."""
    return next((model for model in _OF_PRESET.get(preset, ()) if len(model.elevation_deg) == lasers), None)
