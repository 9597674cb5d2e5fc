"""An engine that runs: the whole rig is really shaken, along and about every axis, from the first instant to the last."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.simulate import jets
from calib_core.simulate.motion import Kinematics, Motion, Wave, turned, waves_jet
from calib_core.types import FloatArray

_BAND_HZ = (25.0, 120.0)
_LINES_AN_AXIS = 3
#: A mount that is shaken turns as well: as if about a point this far away.
_ARM_M = 0.3

AxisWaves = tuple[tuple[Wave, ...], tuple[Wave, ...], tuple[Wave, ...]]


@dataclass(frozen=True, slots=True)
class Shaken:
    """A motion with waves [m] along the world's axes and [rad] about the body's on top."""

    motion: Motion
    shifts: AxisWaves
    turns: AxisWaves

    def kinematics(self, t_s: FloatArray) -> Kinematics:
        """Kinematics of the body at t_s: (N,) [s]."""
        calm = self.motion.kinematics(t_s)
        t = jets.time(np.asarray(t_s, dtype=np.float64))
        shifts = [waves_jet(waves, t) for waves in self.shifts]
        turn = calm.R_world, calm.omega_rad_s, calm.alpha_rad_s2
        for unit, waves in zip(np.eye(3), self.turns, strict=True):
            turn = turned(*turn, unit, waves_jet(waves, t))
        return Kinematics(
            turn[0],
            calm.p_m + np.stack([jet.f for jet in shifts], axis=1),
            calm.v_m_s + np.stack([jet.df for jet in shifts], axis=1),
            calm.a_m_s2 + np.stack([jet.ddf for jet in shifts], axis=1),
            turn[1],
            turn[2],
        )


def shaken(motion: Motion, rms_m_s2: float, rng: np.random.Generator) -> Shaken:
    """The motion with an engine on. rms_m_s2: of the acceleration's norm; lines within the band, drawn."""
    amplitude = rms_m_s2 * np.sqrt(2.0 / (3 * _LINES_AN_AXIS))
    return Shaken(motion, _lines(amplitude, rng), _lines(amplitude / _ARM_M, rng))


def _lines(acceleration: float, rng: np.random.Generator) -> AxisWaves:
    x, y, z = (
        tuple(
            Wave(acceleration / (2.0 * np.pi * hz) ** 2, float(hz), float(phase))
            for hz, phase in zip(
                rng.uniform(*_BAND_HZ, _LINES_AN_AXIS), rng.uniform(0, 2 * np.pi, _LINES_AN_AXIS), strict=True
            )
        )
        for _ in range(3)
    )
    return x, y, z
