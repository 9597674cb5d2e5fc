"""What the recording says about each calibration parameter: measured here, said in words by weak_sentences.py.

Knots, biases, gravity and planes are eliminated; what remains, 7 x 7 in the contract's order, is the calibration's
information. Priors on the calibration itself are diagonal and are taken out exactly: the verdict is the data's. Its
eigenvectors, in units of 1 deg, 10 mm and 1 ms, are the directions that are known well or badly together.

    I    what the data say: information without priors          A    what it knows nothing of (error_budget.py)
    J    (I^-1 + A)^-1, nothing along what is open              P    priors, on the diagonal

    data_std     of J                  covariance    (J + P)^-1; where a person gave something, as it was weighed
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.full.assess.settings import WORDING
from calib_core.full.joint.priors import Priors
from calib_core.full.joint.state import CALIBRATION, ROTATION, TIME_OFFSET
from calib_core.full.joint.undetermined import (
    LIMITS,
    STANDING,
    UNITS,
    data_information,
    is_open,
    still_undetermined,
)
from calib_core.result import COVARIANCE_ORDER
from calib_core.settings import Axis
from calib_core.solver.arrow import FROZEN
from calib_core.types import FloatArray


@dataclass(frozen=True, slots=True)
class Direction:
    """Along which the data leave the calibration weak. vector: (7,), scaled units, of length 1, either way round.

    spread: its standard deviation, scaled units.   is_open: whether that counts as nothing known.
    """

    vector: FloatArray
    spread: float
    is_open: bool


@dataclass(frozen=True)
class Knowledge:
    """covariance: (7, 7) with priors, SI. data_std: (7,) without priors, SI, at most the standing prior's size.

    weak: directions the data leave weak. rotation_known: whether the data determine any component of the rotation.
    """

    covariance: FloatArray
    data_std: FloatArray
    weak: tuple[Direction, ...]
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
        root = _lessened(root, added)
    data = np.asarray(root @ root.T)
    if frozen_offset:
        _freeze(data)
    # What is held to the end is where it was said to be, however well it seems known.
    open_directions = still_undetermined(data, [held.vector * UNITS for held in priors.held])
    outside = np.eye(CALIBRATION) - open_directions @ open_directions.T
    data = outside @ data @ outside
    vectors, spread = _directions(data)
    data_std = np.sqrt((vectors**2) @ spread**2) * UNITS
    prior = _on_diagonal(priors)
    if added is not None and priors.given:
        covariance = _weighed_as_solved(plain, added, prior, outside, free=not frozen_offset)
    else:
        covariance = _held(data, prior)
    covariance = covariance * UNITS[:, None] * UNITS[None, :]
    if not frozen_offset:
        data_std[TIME_OFFSET] = np.hypot(data_std[TIME_OFFSET], offset_std_s)
        covariance[TIME_OFFSET, TIME_OFFSET] += offset_std_s**2
    return Knowledge(covariance, data_std, _weak(vectors, spread), _is_turn_known(data))


def _root(data: FloatArray) -> FloatArray:
    """W (7, 7) with W W' the information, without what is below zero.

    That comes of other unknowns of which nothing is known: they take away more than there is. Left in, it would make what is open
    seem known, as would what is added to a covariance through it (`_lessened`).
    """
    values, vectors = np.linalg.eigh(data)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _lessened(root: FloatArray, added: FloatArray) -> FloatArray:
    """The root of (I^-1 + A)^-1 = W (1 + W' A W)^-1 W'. root: (7, 7) W.   added: (7, 7) A."""
    seen = root.T @ added @ root
    values, vectors = np.linalg.eigh(0.5 * (seen + seen.T))
    return np.asarray(root @ (vectors / np.sqrt(1.0 + np.maximum(values, 0.0))))


def _freeze(data: FloatArray) -> None:
    """Makes the time offset one that was given, and beyond doubt."""
    data[TIME_OFFSET, :] = data[:, TIME_OFFSET] = 0.0
    data[TIME_OFFSET, TIME_OFFSET] = FROZEN


def _directions(data: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What is known together: vectors (7, 7), a column each, and their standard deviations (7,), at most the standing prior's."""
    values, vectors = np.linalg.eigh(0.5 * (data + data.T))
    # What is left of an undetermined direction after subtracting the prior is round-off, of either sign.
    spread = 1.0 / np.sqrt(np.maximum(values, 1e-16))
    longest = 1.0 / np.sqrt(np.sum((vectors / STANDING[:, None]) ** 2, axis=0))
    return vectors, np.minimum(spread, longest)


def _weak(vectors: FloatArray, spread: FloatArray) -> tuple[Direction, ...]:
    """Those that reach beyond the contract's limits along some parameter."""
    opened, beyond = is_open(vectors, spread), (np.abs(vectors) * spread > LIMITS[:, None]).any(axis=0)
    return tuple(Direction(vectors[:, k], float(spread[k]), bool(opened[k])) for k in np.flatnonzero(beyond))


def _is_turn_known(data: FloatArray) -> bool:
    """Whether any component of the rotation is."""
    return bool(np.linalg.eigvalsh(data[ROTATION, ROTATION])[-1] > 1.0 / WORDING.known_deg**2)


def _on_diagonal(priors: Priors) -> FloatArray:
    """(7,) information of all that is said of single parameters, scaled units."""
    total = np.zeros(CALIBRATION)
    for row in priors.rows:
        total[row.column] += 1.0 / row.std**2
    return total * UNITS**2


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
        lacking[TIME_OFFSET, :] = lacking[:, TIME_OFFSET] = 0.0
        _freeze(data)
    data = outside @ data @ outside
    together = _held(data, prior)
    gain = together @ data
    return np.asarray(together + gain @ lacking @ gain.T)
