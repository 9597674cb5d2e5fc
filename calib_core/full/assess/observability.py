"""What the recording says about each calibration parameter, and what to record where it says too little.

Knots, biases, gravity and planes are eliminated; what remains, 7 x 7 in the contract's order, is the calibration's
information. Priors on the calibration itself are diagonal and are taken out exactly: the verdict is the data's. Its
eigenvectors, in units of 1 deg, 10 mm and 1 ms, are the directions that are known well or badly together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.full.assess.settings import WORDING
from calib_core.full.joint.priors import Priors
from calib_core.full.joint.state import CALIBRATION, ROTATION, TIME_OFFSET, TRANSLATION
from calib_core.full.joint.undetermined import (
    LIMITS,
    NAMES,
    STANDING,
    UNITS,
    data_information,
    is_open,
    still_undetermined,
)
from calib_core.result import COVARIANCE_ORDER, WeakDirection
from calib_core.settings import Axis
from calib_core.sigmas import std_text
from calib_core.solver.arrow import FROZEN
from calib_core.types import FloatArray

_SHORT = (*(f"turn {a}" for a in "xyz"), *(f"translation {a}" for a in "xyz"), "time offset")


@dataclass(frozen=True)
class Knowledge:
    """covariance: (7, 7) with priors, SI. data_std: (7,) without priors, SI, at most the standing prior's size.

    weak: directions the data leave weak. rotation_known: whether the data determine any component of the rotation.
    """

    covariance: FloatArray
    data_std: FloatArray
    weak: tuple[WeakDirection, ...]
    rotation_known: bool

    @property
    def is_weak(self) -> bool:
        """Whether some standard deviation of the data alone exceeds the contract's limits."""
        return bool(self.weak_axes) or bool(self.weak)

    @property
    def weak_axes(self) -> tuple[Axis, ...]:
        """The parameters that the data alone leave beyond the contract's limits: what every table, sentence and advice names."""
        return tuple(axis for axis, weak in zip(COVARIANCE_ORDER, self.data_std > LIMITS * UNITS, strict=True) if weak)


def assess(
    information: FloatArray,
    priors: Priors,
    *,
    inflation: float = 1.0,
    frozen_offset: bool = False,
    offset_std_s: float = 0.0,
    added: FloatArray | None = None,
) -> Knowledge:
    """From the shared parameters' information (S, S), priors included. inflation: factor on all standard deviations.

    offset_std_s: an error of the time offset that no residual knows of, added to its variance unless it is frozen.
    added: (7, 7) covariance, scaled units, of what the information knows nothing of.
    """
    plain = data_information(information, priors)
    root = _root(plain) / inflation
    if added is not None:
        seen = root.T @ added @ root
        values, vectors = np.linalg.eigh(0.5 * (seen + seen.T))
        root = root @ (vectors / np.sqrt(1.0 + np.maximum(values, 0.0)))
    data = np.asarray(root @ root.T)
    if frozen_offset:
        data[TIME_OFFSET, :] = data[:, TIME_OFFSET] = 0.0
        data[TIME_OFFSET, TIME_OFFSET] = FROZEN
    # What is held to the end is where it was said to be, however well it seems known.
    open_directions = still_undetermined(data, [held.vector * UNITS for held in priors.held])
    outside = np.eye(CALIBRATION) - open_directions @ open_directions.T
    data = outside @ data @ outside
    values, vectors = np.linalg.eigh(0.5 * (data + data.T))
    # What is left of an undetermined direction after subtracting the prior is round-off, of either sign.
    spread = 1.0 / np.sqrt(np.maximum(values, 1e-16))
    longest = 1.0 / np.sqrt(np.sum((vectors / STANDING[:, None]) ** 2, axis=0))
    spread = np.minimum(spread, longest)
    data_std = np.sqrt((vectors**2) @ spread**2) * UNITS
    if not frozen_offset:
        data_std[TIME_OFFSET] = np.hypot(data_std[TIME_OFFSET], offset_std_s)
    weak: list[WeakDirection] = []
    opened = is_open(vectors, spread)
    for k in range(CALIBRATION):
        along = np.abs(vectors[:, k]) * spread[k]
        if (along > LIMITS).any():
            weak.append(_describe(vectors[:, k], float(spread[k]), data_std, undetermined=bool(opened[k])))
    rows = np.zeros(CALIBRATION)
    for row in priors.rows:
        rows[row.column] += 1.0 / row.std**2
    covariance = _held(data, rows * UNITS**2)
    if added is not None and len(priors.rows) > CALIBRATION:
        covariance = _weighed_as_solved(plain, added, rows * UNITS**2, outside, free=not frozen_offset)
    covariance = covariance * UNITS[:, None] * UNITS[None, :]
    if not frozen_offset:
        covariance[TIME_OFFSET, TIME_OFFSET] += offset_std_s**2
    rotation = np.linalg.eigvalsh(data[ROTATION, ROTATION])
    return Knowledge(covariance, data_std, tuple(weak), bool(rotation[-1] > 1.0 / WORDING.known_deg**2))


def _root(data: FloatArray) -> FloatArray:
    """W (7, 7) with W W' the information, without what is below zero.

    That comes of other unknowns of which nothing is known: they take away more than there is. Left in, it would make what is open
    seem known, as would what is added to a covariance through it: (I^-1 + A)^-1 = W (1 + W' A W)^-1 W'.
    """
    values, vectors = np.linalg.eigh(data)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _held(data: FloatArray, prior: FloatArray) -> FloatArray:
    """Covariance of what the data say together with a diagonal prior, (7, 7), positive definite.

    Priors of 10 m and less hold what the data leave open. In their units no direction is less certain than they are: an
    information that seems to be less than nothing is round-off beside what is known best.
    """
    std = 1.0 / np.sqrt(prior)
    values, vectors = np.linalg.eigh(data * std[:, None] * std)
    spread = std[:, None] * vectors
    return np.asarray((spread / (1.0 + np.maximum(values, 0.0))) @ spread.T, dtype=np.float64)


def _weighed_as_solved(
    plain: FloatArray, added: FloatArray, prior: FloatArray, outside: FloatArray, *, free: bool
) -> FloatArray:
    """Covariance of an answer in which a person's priors were weighed against what the data seemed to know, (7, 7).

    The solve knew nothing of what is added: d = (I + P)^-1 (I x + P p), where x is known to I^-1 + A. So it is
    (I + P)^-1 + K A K' with K = (I + P)^-1 I, and no prior makes it surer than it was weighed.

    outside: (7, 7) projection on what is not open.   free: whether the time offset is estimated.
    """
    data, lacking = np.asarray(_root(plain) @ _root(plain).T), added.copy()
    if not free:
        lacking[TIME_OFFSET, :] = lacking[:, TIME_OFFSET] = data[TIME_OFFSET, :] = data[:, TIME_OFFSET] = 0.0
        data[TIME_OFFSET, TIME_OFFSET] = FROZEN
    data = outside @ data @ outside
    together = _held(data, prior)
    gain = together @ data
    return np.asarray(together + gain @ lacking @ gain.T)


def _describe(vector: FloatArray, spread: float, data_std: FloatArray, *, undetermined: bool) -> WeakDirection:
    """One weak direction in words. data_std: (7,) of each parameter, SI, as Knowledge has it."""
    largest = int(np.argmax(np.abs(vector)))
    vector = vector * np.sign(vector[largest])
    alone = bool(abs(vector[largest]) > WORDING.one_parameter)
    what = NAMES[largest] if alone else _mixture(vector)
    if undetermined:
        text = f"The recording does not determine {what}; what is given for it is assumed, not measured."
    else:
        # By a parameter's name it is that parameter's own, as every table has it, to which other directions add their part.
        along = abs(float(vector[largest])) * spread * float(UNITS[largest])
        amount = _amount(float(data_std[largest]) if alone else along, largest)
        text = f"The recording determines {what} only to {amount} (1 sigma)."
    return WeakDirection(
        label=COVARIANCE_ORDER[largest] if alone else None,
        vector=[float(v) for v in vector],
        std_scaled=spread,
        text=text,
    )


def _mixture(vector: FloatArray) -> str:
    """A direction that is none of the seven parameters alone."""
    rotation, lever = (
        ", ".join(f"{round(float(v), 2) + 0.0:+.2f}" for v in vector[part]) for part in (ROTATION, TRANSLATION)
    )
    if np.linalg.norm(vector[TRANSLATION]) > WORDING.one_kind:
        return f"the lever arm along ({lever}) of the IMU's axes"
    if np.linalg.norm(vector[ROTATION]) > WORDING.one_kind:
        return f"the rotation about ({rotation}) of the lidar's axes"
    parts = ", ".join(f"{v:+.2f} {_SHORT[i]}" for i, v in enumerate(vector) if abs(v) > WORDING.named)
    return f"the combination {parts} (in units of 1 deg, 10 mm and 1 ms)"


def _amount(std: float, largest: int) -> str:
    if largest < 3:
        return std_text(float(np.degrees(std)), "deg")
    return std_text(std, "m" if largest < CALIBRATION - 1 else "s")


def named_direction(covariance: FloatArray) -> str:
    """Along what a covariance (7, 7), scaled units, reaches farthest, in words."""
    vector = np.linalg.eigh(covariance)[1][:, -1]
    largest = int(np.argmax(np.abs(vector)))
    vector = vector * np.sign(vector[largest])
    return NAMES[largest] if abs(vector[largest]) > WORDING.one_parameter else _mixture(vector)


@dataclass(frozen=True, slots=True)
class Advice:
    """What to record next. about: places of the parameters in the covariance that it would make known."""

    text: str
    about: tuple[int, ...]


def advice(knowledge: Knowledge, turning_std_rad_s: FloatArray, R_imu_lidar: FloatArray) -> list[Advice]:
    """What to record next, from the weak parameters and from how much the IMU turned about each of its axes.

    turning_std_rad_s: (3,) rms angular rate about the IMU's axes.
    """
    weak = knowledge.weak_axes
    axes = "xyz"
    # By the axis to turn about: what one turning makes known is said once.
    arms: dict[int, list[int]] = {}
    for i in range(3):
        if f"t{axes[i]}" in weak:
            quiet = min((a for a in range(3) if a != i), key=lambda a: turning_std_rad_s[a])
            arms.setdefault(quiet, []).append(i)
    out = [
        Advice(
            f"To determine the lever arm along the IMU's {' and '.join(axes[i] for i in along)} "
            f"{'axes' if along[1:] else 'axis'}, turn to and fro about the IMU's {axes[quiet]} axis (it turned at "
            f"{np.degrees(turning_std_rad_s[quiet]):.1f} deg/s rms; 30 deg/s or more with quick reversals is good).",
            tuple(3 + i for i in along),
        )
        for quiet, along in arms.items()
    ]
    if any(axis.startswith("r") for axis in weak):
        lidar_turning = np.abs(R_imu_lidar.T) @ turning_std_rad_s
        quiet_axis = int(np.argmin(lidar_turning))
        text = (
            "To determine the rotation, turn about two different axes; there is least turning about the lidar's "
            f"{axes[quiet_axis]} axis."
        )
        out.append(Advice(text, (0, 1, 2)))
    if "dt" in weak:
        out.append(Advice("To determine the time offset, turn faster and reverse direction often.", (TIME_OFFSET,)))
    return out
