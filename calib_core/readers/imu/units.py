"""Units and signs of an IMU from its own readings.

Accelerometer: at rest it shows gravity, so the usual norm in the quietest seconds is 9.8 in m/s2 and 1.0 in g.

Gyroscope: gravity, seen in the IMU, turns against the IMU's rotation. Over a window of dt,
    g(t + dt) = Exp(-s integral omega dt) g(t)
with s = 1 for rad/s and pi/180 for deg/s. Whichever s predicts the accelerometer's slow turning better is the unit;
flipping the sign of single gyroscope axes and seeing the prediction improve tells mirrored axes. Rotation about the
vertical, or no motion, leaves the test without evidence: then only plausibility is left (nobody turns a rig at more
than 35 rad/s for seconds), and the confidence says so.
"""

from __future__ import annotations

from itertools import product
from typing import Literal, NamedTuple

import numpy as np

from calib_core.errors import InputError
from calib_core.readers.imu.rotation import rotation_matrices
from calib_core.settings import ReadSettings
from calib_core.types import ARE_IN_G, Clue, Finding, FloatArray, IntArray

AccelerometerUnit = Literal["m_s2", "g"]
GyroscopeUnit = Literal["rad_s", "deg_s"]
_RAD_PER_DEG = np.pi / 180.0
_WINDOW_S = 0.5
_AVERAGE_S = 0.25
_MAX_WINDOWS = 2000
#: The quietest seconds are this part of all. What shakes a rig adds to the norm of each reading (15 m/s2 beside an engine),
#: hardly to that of their mean over so long, in which a rig hardly turns.
_QUIET_SHARE, _UNSHAKEN_NS = 0.1, 100_000_000
_IMPOSSIBLE_RAD_S = 35.0
#: Accelerations without gravity average to the speed that was gained over the time: half a metre a second in two, by hand.
#: Gravity averages to 1 in the smaller of its units, less what the rig turns meanwhile.
_GAINING_S, _LEAST_GRAVITY = 2.0, 0.35
#: Three times gravity in the larger of its units is neither.
_MOST_GRAVITY = 30.0
#: Gravity must turn by this in the most turning windows for the test to say anything; below is noise.
_TURNS_RAD = 0.02
#: A prediction explains the turning where it leaves less than this of it (shaking is not predicted).
_EXPLAINED = 0.75
#: Flipped axes must beat the axes as sent by this, and in more than this share of the windows: in six windows of a slow motion
#: the rig's own accelerations may halve the median by chance. Of 640 motions of an independent world whose axes are right four
#: were called flipped, three of them in 0.50 to 0.57 of their windows; flipped ones, but for one of 405, are nearer in 0.64.
_BETTER, _NEARER = 0.6, 0.6
#: An axis is named only where its flip leaves less than this, and the next best pattern more by this factor.
_NAMES_RAD, _NAMES_TIMES = 0.15, 1.1
#: A flip is told by gravity's turning where the gyroscope sees at least half of that turning about axes that tilt the rig. A car
#: or a robot hardly tilts, and its accelerations turn as it steers: of 56 drawn ones whose axes are right two were called
#: flipped, at 0.21 and 0.40; of 32 held by hand or worn, 20 are above 0.7, and those below 0.5 tell no flip anyway.
_TILTING = 0.5


class _Windows(NamedTuple):
    """before, after: (W, 3) unit, gravity's direction as it is felt on both sides of each window.   level: (W, 3) unit, that over
    some seconds about its middle.   angles: of each (n, 3), readings of angle, rate times step.
    """

    before: FloatArray
    after: FloatArray
    level: FloatArray
    angles: list[FloatArray]


def quiet_seconds(stamps_ns: IntArray, gyro: FloatArray, accel: FloatArray) -> IntArray:
    """Indices of the readings in the quietest seconds: the share of all whole seconds that varies least."""
    second = (stamps_ns - stamps_ns[0]) // 1_000_000_000
    bounds = np.flatnonzero(np.diff(second, prepend=-1, append=second[-1] + 1))
    sizes = np.diff(bounds)
    enough = sizes >= max(3, int(np.median(sizes) * 0.5))
    starts = bounds[:-1]
    unrest = np.zeros(sizes.size)
    for channels in (gyro, accel):
        mean = np.add.reduceat(channels, starts, axis=0) / sizes[:, None]
        square = np.add.reduceat(channels**2, starts, axis=0) / sizes[:, None]
        variance = np.maximum(square - mean**2, 0.0).sum(axis=1)
        unrest += variance / max(float(np.median(variance)), 1e-12)
    order = np.argsort(np.where(enough, unrest, np.inf), kind="stable")
    chosen = order[: max(1, int(_QUIET_SHARE * sizes.size))]
    return np.concatenate([np.arange(starts[c], starts[c] + sizes[c]) for c in np.sort(chosen)])


def usual_norm(stamps_ns: IntArray, accel: FloatArray) -> float:
    """Median norm of means over a tenth of a second each, in the unit of the readings (N, 3)."""
    starts = np.flatnonzero(np.diff((stamps_ns - stamps_ns[0]) // _UNSHAKEN_NS, prepend=-1))
    means = np.add.reduceat(accel, starts, axis=0) / np.diff(starts, append=len(stamps_ns))[:, None]
    return float(np.median(np.linalg.norm(means, axis=1)))


def detect_accelerometer_unit(
    stamps_ns: IntArray, gyro: FloatArray, accel: FloatArray, settings: ReadSettings, topic: str
) -> tuple[AccelerometerUnit, Finding]:
    """The unit, from the usual norm in the quietest seconds. Raises InputError where that is no gravity in any unit."""
    quiet = quiet_seconds(stamps_ns, gyro, accel)
    norm = usual_norm(stamps_ns[quiet], accel[quiet])
    _require_gravity(norm, stamps_ns, accel, topic)
    # Distance in log units from either answer; halfway between 1 and 9.8 is 3.1.
    to_g = abs(np.log(max(norm, 1e-9)))
    to_si = abs(np.log(max(norm, 1e-9) / 9.8))
    detected: AccelerometerUnit = "g" if to_g < to_si else "m_s2"
    distance = min(to_g, to_si)
    confidence = float(np.exp(-((distance / 0.4) ** 2)))
    unit = settings.accelerometer_unit or detected
    name = "g" if unit == "g" else "m/s²"
    text = f"Accelerations on {topic}{ARE_IN_G if name == 'g' else f' are in {name}: '}when quietest their norm is {norm:.2f}."
    level: Literal["info", "warning"] = "warning" if unit == "g" or confidence < 0.5 else "info"
    if confidence < 0.5:
        text = (
            f"When quietest the accelerations on {topic} have norm {norm:.2f}, which is gravity neither in m/s²"
            f" nor in g; {name} is assumed."
        )
    elif unit != detected:
        level = "warning"
        text = (
            f"Accelerations on {topic} are taken in {name}, as asked; but when quietest their norm is {norm:.2f}, which is "
            f"gravity in {'g' if detected == 'g' else 'm/s²'}: if the unit is wrong, the solve will find no answer."
        )
    finding = Finding(
        code="imu.accelerometer_unit",
        level=level,
        text=text,
        evidence=(
            Clue("median norm when quietest", round(norm, 2), name),
            Clue("readings examined", int(quiet.size)),
        ),
        confidence=1.0 if settings.accelerometer_unit else round(confidence, 3),
        consequence="readings are multiplied by 9.80665" if unit == "g" else "readings are used as they are",
        override=f"--accelerometer-unit {'m_s2' if unit == 'g' else 'g'}",
    )
    return unit, finding


def _require_gravity(norm: float, stamps_ns: IntArray, accel: FloatArray, topic: str) -> None:
    """Raises InputError where what an accelerometer shows cannot be gravity. norm: in the quietest seconds."""
    stays = _average(stamps_ns, accel)
    if stays >= _LEAST_GRAVITY and _LEAST_GRAVITY <= norm <= _MOST_GRAVITY:
        return
    found = (
        f"they average to {stays:.2f} over {_GAINING_S:.0f} s"
        if stays < _LEAST_GRAVITY
        else f"their norm is {norm:.{0 if norm > _MOST_GRAVITY else 2}f} when quietest"
    )
    raise InputError(
        f"The accelerations on {topic} do not show gravity: {found} where 9.8 (m/s²) or 1.0 (g) was expected; choose the topic of"
        " the sensor's own readings, from which nothing has been taken off, in one of these units.",
        code="imu.no_gravity",
    )


def _average(stamps_ns: IntArray, accel: FloatArray) -> float:
    """Norm of the mean acceleration over _GAINING_S, in the quarter of all such times with the largest."""
    stretch = (stamps_ns - stamps_ns[0]) // round(_GAINING_S * 1e9)
    starts = np.flatnonzero(np.diff(stretch, prepend=-1))
    sizes = np.diff(starts, append=len(stamps_ns))
    means = np.linalg.norm(np.add.reduceat(accel, starts, axis=0) / sizes[:, None], axis=1)
    return float(np.percentile(means[sizes >= 0.5 * np.median(sizes)], 75.0))


def detect_gyroscope(
    stamps_ns: IntArray, gyro: FloatArray, accel_m_s2: FloatArray, settings: ReadSettings, topic: str
) -> tuple[GyroscopeUnit, tuple[Finding, ...]]:
    """The unit, and a finding for mirrored axes, from gravity's turning and plausibility."""
    windows = _windows(stamps_ns, gyro, accel_m_s2)
    still = _misfit(windows, np.zeros(3))
    radians, degrees = _misfit(windows, np.ones(3)), _misfit(windows, np.full(3, _RAD_PER_DEG))
    sustained = float(np.percentile(np.linalg.norm(gyro, axis=1), 95))
    informative = still > _TURNS_RAD and min(radians, degrees) < _EXPLAINED * still
    if informative:
        detected: GyroscopeUnit = "rad_s" if radians < degrees else "deg_s"
        confidence = float(1.0 - min(radians, degrees) / max(radians, degrees, 1e-30))
    else:
        detected = "deg_s" if sustained > _IMPOSSIBLE_RAD_S else "rad_s"
        confidence = 0.9 if detected == "deg_s" else 0.5
    unit = settings.gyroscope_unit or detected
    scale = _RAD_PER_DEG if unit == "deg_s" else 1.0
    name = "deg/s" if unit == "deg_s" else "rad/s"
    finding = Finding(
        code="imu.gyroscope_unit",
        level="warning" if unit == "deg_s" else "info",
        text=f"Angular rates on {topic} are in {name}"
        + ("." if informative else f" ({_unheard(still)}, so this is judged by their size alone)."),
        evidence=(
            Clue("misfit of gravity's turning, rad/s", _rounded(radians), "rad"),
            Clue("misfit of gravity's turning, deg/s", _rounded(degrees), "rad"),
            Clue("gravity's turning itself", _rounded(still), "rad"),
            Clue("95 % of rates below", round(sustained, 4), name),
        ),
        confidence=1.0 if settings.gyroscope_unit else round(confidence, 3),
        consequence="readings are multiplied by pi/180" if unit == "deg_s" else "readings are used as they are",
        override=f"--gyroscope-unit {'rad_s' if unit == 'deg_s' else 'deg_s'}",
    )
    mirrored = _mirrored_axes(windows, scale, still, topic)
    return unit, (finding,) if mirrored is None else (finding, mirrored)


def _unheard(still: float) -> str:
    """Why gravity does not tell the unit.   still: how far its direction turns [rad]."""
    if still > _TURNS_RAD:
        return "the rig's own accelerations hide how gravity turns"
    return "gravity hardly turns in this recording"


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")


def _windows(stamps_ns: IntArray, gyro: FloatArray, accel: FloatArray) -> _Windows:
    """Gravity's direction before and after each window, and the readings of angle (rate times step) inside it."""
    times_s = (stamps_ns - stamps_ns[0]) * 1e-9
    sums = np.vstack([np.zeros(3), np.cumsum(accel, axis=0)])
    n_windows = max(0, int((times_s[-1] - 2 * _AVERAGE_S) / _WINDOW_S))
    chosen = np.linspace(0, n_windows - 1, min(n_windows, _MAX_WINDOWS)).astype(np.int64)
    edges = _AVERAGE_S + chosen * _WINDOW_S
    before, after, level, angles = [], [], [], []

    def direction(at_s: float, within_s: float = _AVERAGE_S) -> FloatArray | None:
        first, last = np.searchsorted(times_s, (at_s - within_s, at_s + within_s))
        mean = (sums[last] - sums[first]) / max(last - first, 1)
        norm = float(np.linalg.norm(mean))
        return mean / norm if last - first >= 3 and norm > 0 else None

    steps = np.diff(times_s, append=times_s[-1])
    for start_s in edges:
        end_s = start_s + _WINDOW_S
        first, last = np.searchsorted(times_s, (start_s, end_s))
        a, b = direction(float(start_s)), direction(float(end_s))
        middle = direction(float(0.5 * (start_s + end_s)), _GAINING_S)
        if a is None or b is None or middle is None or last - first < 2 or float(steps[first:last].max()) > 0.2:
            continue
        before.append(a)
        after.append(b)
        level.append(middle)
        angles.append(gyro[first:last] * steps[first:last, None])
    rows = [np.array(each).reshape(-1, 3) for each in (before, after, level)]
    return _Windows(rows[0], rows[1], rows[2], angles)


def _misfit(windows: _Windows, scale: FloatArray) -> float:
    """Median angle [rad] between predicted and seen direction of gravity over the windows that turn most; 0 if none."""
    errors = _misfits(windows, scale)
    return float(np.median(errors)) if len(errors) else 0.0


def _misfits(windows: _Windows, scale: FloatArray) -> FloatArray:
    """(W,) these angles. scale: (3,) factor per gyroscope axis, zeros for "does not turn"."""
    rows = _most_turning(windows)
    errors = np.empty(rows.size)
    for i, row in enumerate(rows):
        direction = windows.before[row]
        if scale.any():
            for rotation in rotation_matrices(-windows.angles[row] * scale):
                direction = rotation @ direction
        errors[i] = np.linalg.norm(direction - windows.after[row])
    return errors


def _most_turning(windows: _Windows) -> IntArray:
    """Those in which gravity turns most; none where there are too few to tell."""
    if len(windows.angles) < 4:
        return np.zeros(0, np.int64)
    turning = np.linalg.norm(np.cross(windows.before, windows.after), axis=1)
    return np.argsort(-turning)[: max(6, len(windows.angles) // 8)]


def _tilt(windows: _Windows, scale: float) -> float:
    """By how much [rad] the rig tilts in these windows as the gyroscope has it, by their median; 0 if none. Turning about the
    vertical is not counted, whatever the sign of an axis that lies along it.
    """
    rows = _most_turning(windows)
    tilts = [np.linalg.norm(np.cross(windows.level[row], windows.angles[row].sum(axis=0) * scale)) for row in rows]
    return float(np.median(tilts)) if tilts else 0.0


def _mirrored_axes(windows: _Windows, scale: float, still: float, topic: str) -> Finding | None:
    """A finding where flipping gyroscope axes explains gravity's turning much better than taking them as they are."""
    signs = [np.array(s) for s in product((1.0, -1.0), repeat=3)]
    each = [_misfits(windows, s * scale) for s in signs]
    misfits = [float(np.median(errors)) if len(errors) else 0.0 for errors in each]
    best = int(np.argmin(misfits))
    explained = misfits[best] < _EXPLAINED * still and misfits[best] < _BETTER * misfits[0]
    explained = explained and float(np.mean(each[best] < each[0])) > _NEARER
    if best == 0 or still <= _TURNS_RAD or not explained or _tilt(windows, scale) < _TILTING * still:
        return None
    axes = ", ".join(axis for axis, sign in zip("xyz", signs[best], strict=True) if sign < 0)
    rival = sorted(misfits)[1]
    if (
        misfits[best] > _NAMES_RAD or rival < _NAMES_TIMES * misfits[best]
    ):  # the rig's own accelerations blur which of two patterns it is
        text = f"Gyroscope and accelerometer on {topic} contradict each other: the sign of an axis of one of them is flipped."
    else:
        text = f"Gyroscope axis {axes} on {topic} contradicts the accelerometer: its sign seems to be flipped."
    return Finding(
        code="imu.axis_signs",
        level="warning",
        text=text,
        evidence=(
            Clue("misfit as sent", _rounded(misfits[0]), "rad"),
            Clue(f"misfit with {axes} flipped", _rounded(misfits[best]), "rad"),
        ),
        confidence=round(1.0 - misfits[best] / max(misfits[0], 1e-30), 3),
        consequence="a calibration from these readings would be wrong; correct the driver's axes",
    )
