"""The motions of the scenarios, as data. Positions in metres, world axes; angles in radians, body axes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.simulate.motion import FigureEight, Pose, Start, Sway, Turn, Wave

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

STILL = Sway(base=FACING_THE_CORNER)
MOVING_FROM_THE_START = replace(PAPER_NORMAL, start=Start(static_s=0.0, ramp_s=0.0))
SHIFTING = Sway(
    base=FACING_THE_CORNER,
    position=((Wave(0.20, 0.41, 0.4),), (Wave(0.17, 0.53, 1.9),), (Wave(0.14, 0.33, 4.1),)),
)
#: Skew to every axis of the lidar and to gravity.
HINGE = (0.31, -0.22, 0.925)
ONE_AXIS = Sway(
    base=FACING_THE_CORNER,
    position=PAPER_NORMAL.position,
    turns=(Turn(HINGE, (Wave(float(np.deg2rad(22.0)), 0.43, 0.7), Wave(float(np.deg2rad(9.0)), 0.29, 2.0))),),
)
ONE_AXIS_IN_PLACE = replace(ONE_AXIS, position=((), (), ()))


def _deg(*waves: tuple[float, float, float]) -> tuple[Wave, ...]:
    """Waves from (degrees, Hz, phase)."""
    return tuple(Wave(float(np.deg2rad(amplitude)), hz, phase) for amplitude, hz, phase in waves)


def _swing(base: Pose, *, shift: float, turn: float, start: Start) -> Sway:
    """Someone swings the rig about a place: two waves an axis; `shift` and `turn` scale the amplitudes."""
    return Sway(
        base=base,
        position=(
            (Wave(0.20 * shift, 0.47, 0.3), Wave(0.09 * shift, 0.83, 1.1)),
            (Wave(0.18 * shift, 0.41, 2.6), Wave(0.10 * shift, 0.71, 0.4)),
            (Wave(0.15 * shift, 0.53, 4.0), Wave(0.06 * shift, 0.97, 3.3)),
        ),
        turns=(
            Turn((0.0, 0.0, 1.0), _deg((11.0 * turn, 0.27, 0.0), (5.0 * turn, 0.61, 1.3))),
            Turn((0.0, 1.0, 0.0), _deg((8.0 * turn, 0.39, 2.2), (4.0 * turn, 0.73, 0.2))),
            Turn((1.0, 0.0, 0.0), _deg((9.0 * turn, 0.33, 5.0), (4.5 * turn, 0.67, 2.9))),
        ),
        start=start,
    )


#: 0.7 m/s and 26 deg/s in the mean while it moves, as in the paper's own recording.
HANDHELD = _swing(
    Pose((0.0, 33.0, -135.0), (1.30, 1.28, 0.95)), shift=0.897, turn=0.836, start=Start(static_s=3.0, ramp_s=2.0)
)
OUTDOOR = _swing(
    Pose((2.0, -6.0, -138.0), (3.3, 3.0, 1.35)), shift=0.8, turn=1.2, start=Start(static_s=3.0, ramp_s=2.0)
)
ATTIC = _swing(Pose((0.0, 25.0, -125.0), (1.7, 1.5, 1.0)), shift=0.5, turn=1.2, start=Start(static_s=2.0, ramp_s=1.5))
OUSTER = _swing(Pose((0.0, 20.0, -140.0), (1.5, 1.4, 1.1)), shift=0.6, turn=1.1, start=Start(static_s=2.0, ramp_s=1.5))
LIVOX = _swing(Pose((0.0, 10.0, -137.0), (2.7, 2.5, 1.3)), shift=0.8, turn=1.0, start=Start(static_s=2.0, ramp_s=1.5))

#: The world's vertical, in the lidar's axes while it faces the corner: turning about it leaves the tilt alone.
_UPRIGHT = (-float(np.sin(np.deg2rad(35.0))), 0.0, float(np.cos(np.deg2rad(35.0))))
TURNING_AWAY = replace(
    PAPER_NORMAL,
    turns=(Turn(_UPRIGHT, _deg((140.0, 0.06, -1.3))), *PAPER_NORMAL.turns),
    start=Start(static_s=2.0, ramp_s=1.5),
)

_SUSPENSION_DEG = 0.15
CAR_PARK = FigureEight(
    base=Pose(),
    length_m=9.0,
    width_m=5.0,
    lap_s=22.0,
    turns=(
        Turn((0.0, 1.0, 0.0), _deg((_SUSPENSION_DEG, 1.3, 0.5))),
        Turn((1.0, 0.0, 0.0), _deg((_SUSPENSION_DEG, 1.1, 1.7))),
    ),
    start=Start(static_s=3.0, ramp_s=3.0),
)
