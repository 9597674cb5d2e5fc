"""Functions of time together with their exact first and second derivatives.

A `Jet` is the triple (f, f', f'') sampled at the same instants. Sums, products, quotients, sines and angles of jets are
jets again by the rules of calculus, so a motion written as an expression of t carries its velocity and acceleration
exactly: nothing in the simulator is differenced.

    (fg)'' = f''g + 2f'g' + fg''        (sin f)'' = f'' cos f - f'^2 sin f
    (1/g)' = -g'/g^2                    (atan2(y, x))' = (x y' - y x') / (x^2 + y^2)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.types import FloatArray


@dataclass(frozen=True, slots=True)
class Jet:
    """A function's values and its first two time derivatives, each (N,)."""

    f: FloatArray
    df: FloatArray
    ddf: FloatArray

    def __add__(self, other: Jet) -> Jet:
        return Jet(self.f + other.f, self.df + other.df, self.ddf + other.ddf)

    def __sub__(self, other: Jet) -> Jet:
        return Jet(self.f - other.f, self.df - other.df, self.ddf - other.ddf)

    def __mul__(self, other: Jet) -> Jet:
        return Jet(
            self.f * other.f,
            self.df * other.f + self.f * other.df,
            self.ddf * other.f + 2.0 * self.df * other.df + self.f * other.ddf,
        )

    def scaled(self, factor: float) -> Jet:
        """The function times a constant."""
        return Jet(factor * self.f, factor * self.df, factor * self.ddf)

    def shifted(self, offset: float) -> Jet:
        """The function plus a constant."""
        return Jet(self.f + offset, self.df, self.ddf)


def time(t_s: FloatArray) -> Jet:
    """The function t itself. t_s: (N,) [s]."""
    return Jet(t_s, np.ones_like(t_s), np.zeros_like(t_s))


def constant(value: float, like: Jet) -> Jet:
    """A constant, sampled where `like` is."""
    zero = np.zeros_like(like.f)
    return Jet(zero + value, zero, zero)


def sin(a: Jet) -> Jet:
    """The sine of a jet [rad]."""
    s, c = np.sin(a.f), np.cos(a.f)
    return Jet(s, c * a.df, c * a.ddf - s * a.df**2)


def cos(a: Jet) -> Jet:
    """The cosine of a jet [rad]."""
    s, c = np.sin(a.f), np.cos(a.f)
    return Jet(c, -s * a.df, -s * a.ddf - c * a.df**2)


def atan2(y: Jet, x: Jet) -> Jet:
    """The angle of (x, y), unwrapped along the samples [rad]."""
    r2 = x.f**2 + y.f**2
    dr2 = 2.0 * (x.f * x.df + y.f * y.df)
    turn = x.f * y.df - y.f * x.df
    dturn = x.f * y.ddf - y.f * x.ddf
    return Jet(np.unwrap(np.arctan2(y.f, x.f)), turn / r2, dturn / r2 - turn * dr2 / r2**2)


def smooth_step(t: Jet, start_s: float, length_s: float) -> Jet:
    """0 before `start_s`, 1 after `start_s + length_s`, between them a polynomial of degree 7.

    Three derivatives are continuous. A length of 0 means: 1 everywhere, the motion has no beginning.
    """
    if length_s <= 0.0:
        return constant(1.0, t)
    u = np.clip((t.f - start_s) / length_s, 0.0, 1.0)
    step = u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3)
    slope = 140.0 * u**3 * (1.0 - u) ** 3 / length_s
    bend = 420.0 * u**2 * (1.0 - u) ** 2 * (1.0 - 2.0 * u) / length_s**2
    return Jet(step, slope * t.df, bend * t.df**2 + slope * t.ddf)


def smooth_start(t: Jet, start_s: float, length_s: float) -> Jet:
    """The integral of `smooth_step`, a clock that starts gently: 0 at first, t minus a constant after the ramp."""
    if length_s <= 0.0:
        return t
    step = smooth_step(t, start_s, length_s)
    u = np.clip((t.f - start_s) / length_s, 0.0, 1.0)
    integral = length_s * u**5 * (7.0 - 14.0 * u + 10.0 * u**2 - 2.5 * u**3)
    after = np.maximum(t.f - start_s - length_s, 0.0)
    return Jet(integral + after, step.f * t.df, step.df * t.df + step.f * t.ddf)
