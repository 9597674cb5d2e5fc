"""The motions of the scenarios, as data. Positions in metres, world axes; angles in radians, body axes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.simulate.motion import Pose, Start, Sway, Turn, Wave

#: 1.2 m from both walls of the corner at the origin, 0.9 m up, looking 35 degrees down into the corner.
FACING_THE_CORNER = Pose(rpy_deg=(0.0, 35.0, -135.0), position_m=(1.2, 1.2, 0.9))
_TWELVE_DEG = float(np.deg2rad(12.0))


def faster(motion: Sway, factor: float) -> Sway:
    """The same motion with every frequency times `factor`, amplitudes and the still start unchanged."""
    x, y, z = (tuple(_faster(wave, factor) for wave in waves) for waves in motion.position)
    turns = tuple(replace(turn, waves=tuple(_faster(wave, factor) for wave in turn.waves)) for turn in motion.turns)
    return replace(motion, position=(x, y, z), turns=turns)


def _faster(wave: Wave, factor: float) -> Wave:
    return replace(wave, frequency_hz=wave.frequency_hz * factor)


PAPER_NORMAL = Sway(
    base=FACING_THE_CORNER,
    position=((Wave(0.10, 0.23, 0.4),), (Wave(0.07, 0.37, 1.9),), (Wave(0.05, 0.53, 4.1),)),
    turns=(
        Turn((0.0, 0.0, 1.0), (Wave(_TWELVE_DEG, 0.31, 0.0),)),
        Turn((0.0, 1.0, 0.0), (Wave(_TWELVE_DEG, 0.43, 2.2),)),
        Turn((1.0, 0.0, 0.0), (Wave(_TWELVE_DEG, 0.53, 5.0),)),
    ),
    start=Start(static_s=1.0, ramp_s=1.5),
)
PAPER_FAST = faster(PAPER_NORMAL, 1.53 / 0.53)
