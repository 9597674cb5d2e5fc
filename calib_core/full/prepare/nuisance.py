"""The sensors' own parameters as unknowns of the joint problem: which, in which columns, with which priors.

A block is a row of a table: its owner, unit and names (`calib_core/intrinsics.py`), its prior and where its columns begin (here).
Its effect on the readings is written once, in `imu/intrinsics.py` for the IMU's and in `factors/laser_features.py` for the
lidar's; everything between here and there (columns, priors, the covariance that is marginal over them) goes by the table.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from calib_core.factors.patches import SurfacePatches
from calib_core.full.prepare.settings import LASERS, TONES
from calib_core.full.run import Run
from calib_core.intrinsics import (
    AXES,
    CLOCK_RATE_STD_PPM,
    KINDS,
    NAMES,
    UNKNOWN_IMU,
    UNKNOWN_LIDAR,
    Block,
    ImuPrior,
    LidarPrior,
    Sensor,
    blocks_of,
)
from calib_core.presets import find_imu_prior, find_lidar_prior
from calib_core.settings import CalibrateSettings
from calib_core.types import BoolArray, FloatArray, PointArray, Recording, Scan

IMU_BLOCKS, LASER_BLOCKS, LIDAR_BLOCKS = blocks_of("imu"), blocks_of("laser"), blocks_of("lidar")
#: Of the room, not of the sensors: how far patches of planes lie before them. Admitted where walls turn out to be bent.
SURFACE: Literal["surface"] = "surface"
#: Of the IMU's surroundings: shaking faster than it samples. Admitted where the lidar's motion contradicts the readings so.
TONE: Literal["tone"] = "tone"
#: Of the room, too: by how much each plane's material lengthens ranges, beside what all do. Admitted with the sensors.
MATERIAL: Literal["material"] = "material"
AnyBlock = Block | Literal["surface", "tone", "material"]
#: Of the IMU, but no unknowns before they show (assess/late_parameters.py): where its accelerometers are, how their lines bend,
#: and what its low-pass filter does beside delaying.
SIZE_EFFECT: Literal["size_effect"] = "size_effect"
QUADRATIC: Literal["accelerometer_quadratic"] = "accelerometer_quadratic"
SPREAD: Literal["low_pass_spread"] = "low_pass_spread"
SKEW: Literal["low_pass_skew"] = "low_pass_skew"
LOW_PASS: tuple[Literal["low_pass_spread", "low_pass_skew"], ...] = (SPREAD, SKEW)
LATE: tuple[Block, ...] = (SIZE_EFFECT, QUADRATIC, *LOW_PASS)
#: In the order in which they come after the sensors' own.
_OF_NO_SENSOR = (MATERIAL, TONE, SURFACE)
_TONE_NAMES = (
    *(
        f"{sensor} {axis} {part}{where}"
        for where in ("", " in the room")
        for part in ("sine", "cosine")
        for sensor in ("gyroscope", "accelerometer")
        for axis in AXES
    ),
    "frequency",
)


@dataclass(frozen=True, slots=True)
class NuisanceBlock:
    """One kind of parameter. names: of its members.   prior_std: (n,) about zero, each in the block's unit.

    whitener: (n, n) that makes them white where they are correlated; None where they are independent.
    """

    block: AnyBlock
    names: tuple[str, ...]
    prior_std: FloatArray
    whitener: FloatArray | None = None

    def some(self, keep: BoolArray) -> NuisanceBlock:
        """Some of its parameters (n,), independent ones, by the names they had."""
        names = tuple(name for name, kept in zip(self.names, keep, strict=True) if kept)
        return replace(self, names=names, prior_std=self.prior_std[keep])

    def wider(self, times: float) -> NuisanceBlock:
        """The same with priors so many times as wide."""
        whitener = None if self.whitener is None else self.whitener / times
        return replace(self, prior_std=times * self.prior_std, whitener=whitener)


@dataclass(frozen=True)
class Nuisance:
    """The blocks in play, one after the other; their values are one vector (N,) in this order, in the blocks' units.

    The values themselves lie beside them in a `SensorState` (joint/sensor_state.py), which moves them from one set to another.
    surface: where the patches are whose heights are in play, None where none is.   tones_hz: of the tones in play (imu/tones.py),
    each of 25 values; their phases are counted from tones_zero_s, IMU clock.
    """

    blocks: tuple[NuisanceBlock, ...] = ()
    surface: SurfacePatches | None = field(default=None, compare=False)
    tones_hz: tuple[float, ...] = ()
    tones_zero_s: float = 0.0

    @cached_property
    def size(self) -> int:
        """Number of parameters."""
        return sum(len(each.names) for each in self.blocks)

    @cached_property
    def prior_std(self) -> FloatArray:
        """(N,) of all, in order."""
        return np.concatenate([np.zeros(0), *(each.prior_std for each in self.blocks)])

    @cached_property
    def places(self) -> dict[str, slice]:
        """Where each block's values lie in the vector."""
        ends = np.cumsum([0, *(len(each.names) for each in self.blocks)])
        return {each.block: slice(int(a), int(b)) for each, a, b in zip(self.blocks, ends, ends[1:], strict=False)}

    @cached_property
    def index(self) -> dict[tuple[AnyBlock, str], int]:
        """Where in the vector each parameter lies, by its block and its name there. Raises ValueError where two have one name."""
        every = [(each.block, name) for each in self.blocks for name in each.names]
        index = {name: k for k, name in enumerate(every)}
        if len(index) < len(every):
            raise ValueError("expected parameters that are told apart by block and name, found two of one name")
        return index

    def start(self, block: AnyBlock) -> int:
        """Where a block's values begin; -1 where it is not in play."""
        place = self.places.get(block)
        return -1 if place is None else place.start

    def values(self, vector: FloatArray, block: AnyBlock) -> FloatArray:
        """A block's part of a vector (N,); zeros where it is not in play (lasers: none)."""
        place = self.places.get(block)
        return np.zeros(0 if block in _OF_NO_SENSOR else len(NAMES.get(block, ()))) if place is None else vector[place]

    def with_room(self, block: Block, times: float) -> Nuisance:
        """The same with a block that may be so many times as far off."""
        return replace(self, blocks=tuple(each.wider(times) if each.block == block else each for each in self.blocks))

    @property
    def patches(self) -> int:
        """Patches of planes whose height is unknown; they come last."""
        place = self.places.get(SURFACE)
        return 0 if place is None else place.stop - place.start

    @property
    def sensors(self) -> Nuisance:
        """Without what is the room's, and what the IMU's surroundings do."""
        return Nuisance(tuple(each for each in self.blocks if each.block not in _OF_NO_SENSOR))

    @cached_property
    def prior_root(self) -> FloatArray:
        """(N, N) R of the prior's covariance R R'; without correlations the diagonal of prior_std."""
        root = np.diag(self.prior_std)
        for place, whitener in self.whiteners:
            root[place, place] = np.linalg.inv(whitener)
        return root

    @cached_property
    def whiteners(self) -> tuple[tuple[slice, FloatArray], ...]:
        """Of each block whose members are correlated: its place, and (n, n) that makes them white."""
        return tuple((self.places[each.block], each.whitener) for each in self.blocks if each.whitener is not None)

    def with_surface(self, surface: SurfacePatches, std_m: float, alike_m: float) -> Nuisance:
        """With the heights of patches as unknowns, after all others: so large, and alike so far along a wall. In the place of
        those that were there."""
        std = np.full(surface.count, std_m)
        block = NuisanceBlock(SURFACE, surface.names, std, surface.whitener(std_m, alike_m))
        return replace(self._with(block), surface=surface)

    def with_tone(self, hz: float, resolution_hz: float, zero_s: float) -> Nuisance:
        """With one more tone, after all others but what is the room's. resolution_hz: standard deviation of its frequency.

        zero_s: t0 of the first one.
        """
        std = np.concatenate(
            [
                np.resize(np.repeat([TONES.gyro_std_rad_s, TONES.accel_std_m_s2], 3), len(_TONE_NAMES) - 1),
                [resolution_hz],
            ]
        )
        names = tuple(f"{hz} Hz {name}" for name in _TONE_NAMES)  # in full: two that are near are told apart by it
        before = next((each for each in self.blocks if each.block == TONE), NuisanceBlock(TONE, (), np.zeros(0)))
        block = NuisanceBlock(TONE, (*before.names, *names), np.concatenate([before.prior_std, std]))
        first = zero_s if not self.tones_hz else self.tones_zero_s
        return replace(self._with(block), tones_hz=(*self.tones_hz, hz), tones_zero_s=first)

    def with_materials(self, planes: int) -> Nuisance:
        """With what each of so many planes adds to the incidence, as much as that itself may be, after the sensors' own.

        The same where the incidence is not in play, or they are already.
        """
        place = self.places.get("incidence")
        if place is None or self.materials:
            return self
        return self._with(
            NuisanceBlock(MATERIAL, tuple(map(str, range(planes))), np.repeat(self.prior_std[place], planes))
        )

    def with_late(self, block: Block, std: float) -> Nuisance:
        """With one of LATE among the unknowns, so large each, after the sensors' own; instead of what was there of it."""
        return self._with(NuisanceBlock(block, NAMES[block], np.full(len(NAMES[block]), std)))

    def with_sensors(self, sensors: Nuisance) -> Nuisance:
        """With those for the sensors' own, and what else there is as it is. sensors: nothing but those."""
        return replace(self, blocks=(*sensors.blocks, *(each for each in self.blocks if each.block in _OF_NO_SENSOR)))

    def _with(self, block: NuisanceBlock) -> Nuisance:
        """With one more block, after the others of its kind: the sensors' own, then the rest in their order. Instead of what was
        there of it."""
        others = (each for each in self.blocks if each.block != block.block)
        return replace(self, blocks=tuple(sorted((*others, block), key=_rank)))

    def of_planes(self, keep: BoolArray) -> Nuisance:
        """Of some of the planes (P,) alone, each with the name it had. The patches of surfaces have to be found anew."""
        if not self.materials:
            return self
        return replace(self, blocks=tuple(q.some(keep) if q.block == MATERIAL else q for q in self.blocks))

    @property
    def materials(self) -> int:
        """Planes whose material's own effect is unknown; 0 where it is not in play."""
        place = self.places.get(MATERIAL)
        return 0 if place is None else place.stop - place.start

    def without_tones(self) -> Nuisance:
        """The same but for what shakes the IMU."""
        return Nuisance(tuple(each for each in self.blocks if each.block != TONE), self.surface)

    @property
    def lasers(self) -> int:
        """Lasers that are told apart; 0 where none are."""
        return max((len(self.values(self.prior_std, block)) for block in LASER_BLOCKS), default=0)


def _rank(of: NuisanceBlock) -> int:
    """Of a block's kind among all."""
    return 1 + _OF_NO_SENSOR.index(of.block) if of.block in _OF_NO_SENSOR else 0


def sensor_block(of: NuisanceBlock) -> Block:
    """The sensors' own block that this is: not the room's."""
    if of.block == SURFACE or of.block == TONE or of.block == MATERIAL:  # noqa: PLR1714  the type checker follows this
        raise ValueError(f"a {of.block} is no sensor's")
    return of.block


def named_lasers(scans: Sequence[Scan]) -> int:
    """How many lasers the points name, 0 where they name none."""
    if not scans:
        return 0
    lasers = int(max((points["ring"].max(initial=0) for points in _some_of(scans)), default=0)) + 1
    return 0 if lasers < 2 or lasers > LASERS.most else lasers


def _some_of(scans: Sequence[Scan]) -> list[PointArray]:
    """The points of a few scans all over a recording."""
    return [scans[int(i)].points for i in np.unique(np.linspace(0, len(scans) - 1, LASERS.scans).astype(np.int64))]


def count_lasers(scans: Sequence[Scan]) -> tuple[int, bool]:
    """How many lasers the points name, 0 where they name none, and whether each has an elevation of its own, as on a rotor."""
    lasers = named_lasers(scans)
    if not lasers:
        return 0, False
    some = _some_of(scans)
    ring = np.concatenate([points["ring"] for points in some]).astype(np.int64)
    xyz = np.concatenate([points["xyz"] for points in some]).astype(np.float64)
    elevation = np.arctan2(xyz[:, 2], np.hypot(xyz[:, 0], xyz[:, 1]))
    spreads = []
    for laser in range(lasers):
        mine = elevation[ring == laser]
        if len(mine) >= LASERS.fewest_points:
            spreads.append(float(np.subtract(*np.percentile(mine, [1e2 - LASERS.tail_percent, LASERS.tail_percent]))))
    if len(spreads) < 2:
        return 0, False
    return lasers, float(np.median(spreads)) < np.radians(LASERS.same_elevation_deg)


def priors_of(
    recording: Recording, settings: CalibrateSettings, beyond_sheets: frozenset[Sensor] = frozenset()
) -> tuple[ImuPrior, LidarPrior]:
    """What to expect of a recording's sensors: as they are named by the settings, else as they were recognised.

    beyond_sheets: those that are further off than that: what a sensor of which nobody knows the kind may be off by, too.
    """
    named = settings.imu_noise if isinstance(settings.imu_noise, str) else ""
    imu, lidar = (
        find_imu_prior(named, recording.imu_model),
        find_lidar_prior(settings.lidar or "", recording.lidar.model),
    )
    return (
        imu.or_wider(UNKNOWN_IMU) if "imu" in beyond_sheets else imu,
        lidar.or_wider(UNKNOWN_LIDAR) if "lidar" in beyond_sheets else lidar,
    )


def unknowns_of(run: Run) -> Nuisance:
    """The parameters of a run's own sensors that are unknowns beside the calibration."""
    found = nuisance_of(run.recording, run.settings, run.beyond_sheets, run.clock_rate_std_ppm)
    return found if run.room is None else found.with_room(*run.room)


def nuisance_of(
    recording: Recording,
    settings: CalibrateSettings,
    beyond_sheets: frozenset[Sensor] = frozenset(),
    clock_rate_std_ppm: float = CLOCK_RATE_STD_PPM,
) -> Nuisance:
    """The same by settings and presets.

    beyond_sheets: sensors that are further off than the sheets of their kind have them.   clock_rate_std_ppm: beyond what
    crystals do where the clocks have shown to part by more; then their rate is an unknown whatever the settings say of sensors.
    """
    parts = clock_rate_std_ppm > CLOCK_RATE_STD_PPM
    if settings.intrinsics == "off" and not parts:
        return Nuisance()
    lasers, spins = count_lasers(recording.scans)
    imu, lidar = priors_of(recording, settings, beyond_sheets)
    if not spins:
        lidar = replace(lidar, eccentricity_std_rad=0.0)
    wanted = None if isinstance(settings.intrinsics, str) else settings.intrinsics
    if settings.intrinsics == "off":
        wanted = ("clock_rate",)
    elif wanted is not None and parts:
        wanted = (*wanted, "clock_rate")
    return choose_nuisance(
        imu,
        lidar,
        lasers=lasers,
        clock_rate_std_ppm=clock_rate_std_ppm,
        wanted=wanted,
    )


def _about_their_mean(lasers: int, std_rad: float) -> FloatArray:
    """(n, n) whitener of the lasers' azimuths: each so uncertain beside the others, all together less.

    That all look to one side is a turn of the lidar's frame, about which nothing else says anything.
    """
    together = np.full((lasers, lasers), 1.0 / lasers)
    return (np.eye(lasers) - together) / std_rad + together / (LASERS.azimuth_together * std_rad)


def choose_nuisance(
    imu: ImuPrior,
    lidar: LidarPrior,
    *,
    lasers: int,
    clock_rate_std_ppm: float,
    wanted: tuple[Block, ...] | None = None,
) -> Nuisance:
    """The blocks of a pair of sensors. lasers: that the points name, 0 for none.   wanted: these alone; None for all.

    A block whose prior leaves it no room is none.
    """
    std: dict[Block, float] = {
        "gyroscope_scale": imu.gyroscope_scale_std,
        "gyroscope_axes": imu.gyroscope_axes_std_rad,
        "gyroscope_rotation": imu.gyroscope_rotation_std_rad,
        "accelerometer_scale": imu.accelerometer_scale_std,
        "accelerometer_axes": imu.accelerometer_axes_std_rad,
        "accelerometer_delay": imu.accelerometer_delay_std_s,
        "accelerometer_quadratic": 0.0,  # what is 0 here is admitted where it shows (assess/late_parameters.py)
        "g_sensitivity": imu.g_sensitivity_std_rad_s_m_s2,
        "size_effect": 0.0,
        "low_pass_spread": 0.0,
        "low_pass_skew": 0.0,
        "clock_rate": clock_rate_std_ppm,
        "laser_range_offset": lidar.laser_range_offset_std_m,
        "laser_elevation": lidar.laser_elevation_std_rad,
        "laser_azimuth": lidar.laser_elevation_std_rad,
        "laser_range_scale": lidar.laser_range_scale_std,
        "eccentricity": lidar.eccentricity_std_rad,
        "range_offset": lidar.range_offset_std_m,
        "incidence": lidar.incidence_std_m,
        "grazing": lidar.grazing_std_rad,
    }
    blocks = []
    for block in KINDS:
        names = tuple(map(str, range(lasers))) if block in LASER_BLOCKS else NAMES[block]
        if std[block] > 0.0 and names and (wanted is None or block in wanted):
            whitener = _about_their_mean(len(names), std[block]) if block == "laser_azimuth" else None
            blocks.append(NuisanceBlock(block, names, np.full(len(names), std[block]), whitener))
    return Nuisance(tuple(blocks))
