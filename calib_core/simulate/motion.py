"""How a rig moves: motions as data, and the exact kinematics that follow from them.

Frames: `world` is the scene's (z up). The motion is of the rig's body; sensors hang on it by constant transforms.

    R_world_body(t) = R_base . Exp(a_1 th_1(t)) . Exp(a_2 th_2(t)) ...      a_k: constant unit axes, th_k: scalar jets
    p_world_body(t) = p_base + (x(t), y(t), z(t))

Angular velocity and acceleration (body axes) follow stage by stage. With S = Exp(a th),
    w <- S^T w + a th'
    b <- S^T b - th' a x (S^T w) + a th''            since d(S^T)/dt = -th' [a]x S^T

A frame fixed to the body at R, p moves with
    p_c = p + R_wb p,   v_c = v + R_wb (w x p),   a_c = a + R_wb (b x p + w x (w x p)).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from calib_core.simulate import jets
from calib_core.simulate.jets import Jet
from calib_core.types import FloatArray, IntArray

Vector = tuple[float, float, float]


def seconds(instants_ns: IntArray) -> FloatArray:
    """Whole nanoseconds after the simulation's zero as float seconds."""
    return np.asarray(instants_ns * 1e-9, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Kinematics:
    """Pose and its derivatives of one frame at N instants.

    R_world: (N, 3, 3).   p_m, v_m_s, a_m_s2: (N, 3), world axes.   omega_rad_s, alpha_rad_s2: (N, 3), own axes.
    """

    R_world: FloatArray
    p_m: FloatArray
    v_m_s: FloatArray
    a_m_s2: FloatArray
    omega_rad_s: FloatArray
    alpha_rad_s2: FloatArray

    def at(self, R_body_frame: FloatArray, p_body_frame: FloatArray) -> Kinematics:
        """Kinematics of a frame fixed to this one. R_body_frame: (3, 3), p_body_frame: (3,) [m]."""
        lever = np.broadcast_to(p_body_frame, self.p_m.shape)
        swing = np.cross(self.omega_rad_s, lever)
        turn = np.cross(self.alpha_rad_s2, lever) + np.cross(self.omega_rad_s, swing)
        return Kinematics(
            self.R_world @ R_body_frame,
            self.p_m + _rotate(self.R_world, lever),
            self.v_m_s + _rotate(self.R_world, swing),
            self.a_m_s2 + _rotate(self.R_world, turn),
            self.omega_rad_s @ R_body_frame,
            self.alpha_rad_s2 @ R_body_frame,
        )


class Motion(Protocol):
    """Anything that can say where the rig's body is, and with which derivatives, at given instants."""

    def kinematics(self, t_s: FloatArray) -> Kinematics:
        """Kinematics of the body at t_s: (N,) [s] after the simulation's zero, lidar clock."""


@dataclass(frozen=True, slots=True)
class Wave:
    """amplitude * sin(2 pi frequency t + phase)."""

    amplitude: float
    frequency_hz: float
    phase_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class Turn:
    """A rotation about a constant axis of the body by a sum of waves [rad]."""

    axis: Vector
    waves: tuple[Wave, ...]


@dataclass(frozen=True, slots=True)
class Start:
    """Standing still for `static_s`, then a smooth ramp of `ramp_s`. ramp_s = 0: moving from the first instant."""

    static_s: float = 1.0
    ramp_s: float = 1.5


@dataclass(frozen=True, slots=True)
class Pose:
    """A constant pose: rotation as (roll, pitch, yaw) in degrees, R = Rz Ry Rx, and a position in metres."""

    rpy_deg: Vector = (0.0, 0.0, 0.0)
    position_m: Vector = (0.0, 0.0, 0.0)

    @property
    def R(self) -> FloatArray:
        """(3, 3)."""
        roll, pitch, yaw = self.rpy_deg
        return np.asarray(Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True).as_matrix())

    @property
    def p(self) -> FloatArray:
        """(3,) [m]."""
        return np.asarray(self.position_m, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Sway:
    """Hand-held motion: sums of sines on every axis about a base pose.

    position: waves [m] along the world's x, y, z.   turns: in order, each about an axis of the body turned so far.
    """

    base: Pose
    position: tuple[tuple[Wave, ...], tuple[Wave, ...], tuple[Wave, ...]] = ((), (), ())
    turns: tuple[Turn, ...] = ()
    start: Start = Start()

    def kinematics(self, t_s: FloatArray) -> Kinematics:
        """Kinematics of the body at t_s: (N,) [s]."""
        t = jets.time(np.asarray(t_s, dtype=np.float64))
        ramp = jets.smooth_step(t, self.start.static_s, self.start.ramp_s)
        position = [waves_jet(waves, t) * ramp for waves in self.position]
        angles = [(turn.axis, waves_jet(turn.waves, t) * ramp) for turn in self.turns]
        return _assemble(self.base, position, angles)


@dataclass(frozen=True, slots=True)
class FigureEight:
    """A vehicle on a figure of eight, its x axis along the path, with small turns on top (the suspension).

    The path is x = length sin(u), y = width sin(2u), u = 2 pi t / lap_s on a clock that starts gently.
    """

    base: Pose
    length_m: float
    width_m: float
    lap_s: float
    turns: tuple[Turn, ...] = ()
    start: Start = Start()

    def kinematics(self, t_s: FloatArray) -> Kinematics:
        """Kinematics of the body at t_s: (N,) [s]."""
        t = jets.time(np.asarray(t_s, dtype=np.float64))
        u = jets.smooth_start(t, self.start.static_s, self.start.ramp_s).scaled(2.0 * np.pi / self.lap_s)
        x, y = jets.sin(u).scaled(self.length_m), jets.sin(u.scaled(2.0)).scaled(self.width_m)
        dx = jets.cos(u).scaled(self.length_m)
        dy = jets.cos(u.scaled(2.0)).scaled(2.0 * self.width_m)
        ramp = jets.smooth_step(t, self.start.static_s, self.start.ramp_s)
        angles = [((0.0, 0.0, 1.0), jets.atan2(dy, dx))]
        angles += [(turn.axis, waves_jet(turn.waves, t) * ramp) for turn in self.turns]
        return _assemble(self.base, [x, y, jets.constant(0.0, t)], angles)


def waves_jet(waves: tuple[Wave, ...], t: Jet) -> Jet:
    """The sum of the waves as a function of time."""
    total = jets.constant(0.0, t)
    for wave in waves:
        phase = t.scaled(2.0 * np.pi * wave.frequency_hz).shifted(wave.phase_rad)
        total = total + jets.sin(phase).scaled(wave.amplitude)
    return total


def _assemble(base: Pose, position: list[Jet], angles: list[tuple[Vector, Jet]]) -> Kinematics:
    n = position[0].f.shape[0]
    R = np.broadcast_to(base.R, (n, 3, 3))
    omega, alpha = np.zeros((n, 3)), np.zeros((n, 3))
    for axis, angle in angles:
        unit = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
        R, omega, alpha = turned(R, omega, alpha, unit, angle)
    return Kinematics(
        R,
        base.p + np.stack([jet.f for jet in position], axis=1),
        np.stack([jet.df for jet in position], axis=1),
        np.stack([jet.ddf for jet in position], axis=1),
        omega,
        alpha,
    )


def turned(
    R: FloatArray, omega: FloatArray, alpha: FloatArray, unit: FloatArray, angle: Jet
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """One stage more: R, omega, alpha after a turn about the unit axis by the angle, as at the top."""
    S = _turn(unit, angle.f)
    omega_turned = np.einsum("nji,nj->ni", S, omega)
    alpha_turned = np.einsum("nji,nj->ni", S, alpha)
    alpha = alpha_turned - angle.df[:, None] * np.cross(unit, omega_turned) + angle.ddf[:, None] * unit
    return R @ S, omega_turned + angle.df[:, None] * unit, alpha


def _turn(unit: FloatArray, angle_rad: FloatArray) -> FloatArray:
    """Rodrigues' formula about one unit axis. Returns (N, 3, 3)."""
    cross = np.array([[0.0, -unit[2], unit[1]], [unit[2], 0.0, -unit[0]], [-unit[1], unit[0], 0.0]])
    s, c = np.sin(angle_rad)[:, None, None], np.cos(angle_rad)[:, None, None]
    rotation: FloatArray = c * np.eye(3) + (1.0 - c) * np.outer(unit, unit) + s * cross
    return rotation


def _rotate(R: FloatArray, vectors: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("nij,nj->ni", R, vectors))
