"""The sweeps of a rotor at the times at which they began, where a host stamped them.

Where the lidar has no clock to go by, its driver stamps a scan when a packet arrives, late by an exponential law and at times
by a stall. The rotor tells: it passes a direction once a turn, and cannot be late by a tenth of a millisecond for a single
turn. Two real ones (VLP-16, HDL-32E) pass it within 8 microseconds from turn to turn by their own clocks, and within 17 of a
line over a second and a half; over minutes its speed wanders (`rotor_wander.py`). So each scan's time of passing is

    c_k = t_k + (phi - phi_k) / omega,

t_k being the middle of the sweep by its stamp and phi_k where the lidar looked then; a line through the c_k
(`imu/sample_rows.py`), bent by what the rotor wanders, has the true times, and what a stamp is off it is taken away. Stamps that
are off a straight line, but from turn to turn by nothing, are right: a rotor that wanders, or a pattern that only nearly goes
round. That drivers cut their sweeps at packets, a millisecond apart, is in phi_k and no error; nor that some cut after so many
packets or so much time, whatever the rotor does: phi then goes round, and what it goes by in a sweep is what the rotor's turn is
shorter or longer than one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_core.errors import Refused
from calib_core.events import LogEvent, OnEvent
from calib_core.full.prepare.clocks import FirstLook
from calib_core.full.prepare.rotor_wander import wander_of
from calib_core.full.prepare.settings import SWEEPS
from calib_core.full.run import LineStd
from calib_core.imu.sample_rows import Row, even_rows, lasting
from calib_core.imu.sampling import mean_lateness, usual_mean
from calib_core.settings import CalibrateSettings
from calib_core.types import BoolArray, FloatArray, IntArray, KeptScans, Recording, Scan


@dataclass(frozen=True, slots=True)
class SweepTimes:
    """late_s: (M,) what each stamp is off the rotor's line, but for what they all are; 0 where the scan is on no line.

    jitter_s: root mean square of that.   most_s: largest.   mean_std_s: how well the mean over all stamps is known, which no
    line takes away.   every_std_s: the same were there nothing but noise in it.   period_s: of a turn.   behind_s: how much the
    mean stamp comes after the most punctual ones, where most of the lateness is to that side; 0 where it is to both.
    """

    late_s: FloatArray
    jitter_s: float
    most_s: float
    mean_std_s: float
    every_std_s: float
    period_s: float
    behind_s: float = 0.0


class _Restamped(KeptScans):
    """Scans at other times. stamps_ns: (M,)."""

    def __init__(self, scans: Recording, stamps_ns: IntArray) -> None:
        self._scans = scans.scans
        self._stamps_ns = stamps_ns

    def __len__(self) -> int:
        return len(self._stamps_ns)

    def scan_at(self, place: int) -> Scan:
        return replace(self._scans[place], stamp_ns=int(self._stamps_ns[place]))


def begun_evenly(
    recording: Recording, seen: FirstLook, settings: CalibrateSettings, on_event: OnEvent
) -> tuple[Recording, FirstLook, LineStd]:
    """The recording and the look at it with the rotor's times, and how well their line is known.

    As they are where nothing rotates, where the stamps follow the rotor, and where that is asked for.
    """
    found = None if settings.lidar_sampling == "as-stamped" else study_sweeps(seen)
    if found is None:
        return recording, seen, LineStd()
    topic = recording.lidar.topic or "the lidar"
    text = (
        f"the stamps of {topic} are off its rotor's even rotation by {1e3 * found.jitter_s:.2g} ms rms "
        f"({1e3 * found.most_s:.2g} ms at most), as if a host had set them: it is taken to turn evenly, once in "
        f"{1e3 * found.period_s:.5g} ms"
    )
    if found.behind_s > 0.0:
        text += (
            f"; stamps are on average {1e3 * found.behind_s:.2g} ms later than the most punctual ones, and this delay is part of "
            "the time offset: without it the offset would be smaller by as much"
        )
    on_event(LogEvent(level="info", code="lidar.sampling", text=text))
    stamps_ns = seen.stamps_ns - np.rint(1e9 * found.late_s).astype(np.int64)
    taken = replace(recording, scans=_Restamped(recording, stamps_ns))
    duration_s = float(seen.stamps_ns[-1] - seen.stamps_ns[0]) * 1e-9
    return taken, replace(seen, stamps_ns=stamps_ns), LineStd.of(found.mean_std_s, found.every_std_s, duration_s)


def late_ns(stamped: FirstLook, taken: FirstLook) -> dict[int, int]:
    """How late scans are stamped, by stamp, where they are."""
    late = stamped.stamps_ns - taken.stamps_ns
    return {int(stamp): int(by) for stamp, by in zip(stamped.stamps_ns, late, strict=True) if by}


def study_sweeps(seen: FirstLook) -> SweepTimes | None:
    """Where stamps are off the rotor's line by more than a rotor can be; None where they are not, or there is no line.

    Raises Refused where the points' times run backwards.
    """
    if len(seen.stamps_ns) < SWEEPS.fewest:
        return None
    known, passing_s = _passing(seen)
    found = _off_their_line(known, passing_s)
    if found is None:
        return None
    rows, t, in_row, off = found
    rms_s = float(np.sqrt(np.mean(off**2)))
    if rms_s < SWEEPS.rotor_s:
        return None
    _require_that_way(seen, rms_s)
    period_s = float(np.median([row.period_s for row in rows]))
    mean = usual_mean(t, off, in_row, period_s)
    usual = np.concatenate([off[row.index][row.used] for row in rows])
    late = np.zeros(len(known))
    late[known] = np.where(in_row, off - mean, 0.0)
    std = float(np.std(usual)) * lasting(rows, t) / np.sqrt(len(usual))
    return SweepTimes(
        late_s=late,
        jitter_s=float(np.sqrt(np.mean(late[known] ** 2))),
        most_s=float(np.abs(late).max()),
        mean_std_s=float(np.hypot(std, mean / np.sqrt(3.0))),
        every_std_s=std,
        period_s=period_s,
        behind_s=mean_lateness(usual, mean),
    )


def _require_that_way(seen: FirstLook, rms_s: float) -> None:
    """Raises Refused where the rotor turns evenly the other way: of points whose times run backwards, what packets cut counts
    twice instead of not at all.

    rms_s: what the times of passing are off a line.
    """
    other = _off_their_line(*_passing(seen, turned=-1.0))
    other_s = np.inf if other is None else float(np.sqrt(np.mean(other[3] ** 2)))
    if other_s < min(SWEEPS.rotor_s, SWEEPS.other_way * rms_s):
        raise Refused(
            "points.times_backwards",
            f"the times of the points run backwards: the lidar's rotor turns evenly to {1e3 * rms_s:.2g} ms as they say, and to "
            f"{1e3 * other_s:.2g} ms if it turns the other way; expected the first to be the smaller; correct the points' times "
            "in the lidar's driver",
        )


def _off_their_line(
    known: BoolArray, passing_s: FloatArray
) -> tuple[list[Row], FloatArray, BoolArray, FloatArray] | None:
    """The rows behind the times of passing that are known, these (K,) themselves, whether each is in a row, what it is off it;
    None where most are in none."""
    if np.count_nonzero(known) < max(SWEEPS.fewest, SWEEPS.least_share * len(known)):
        return None
    t = passing_s[known]
    if not np.all(np.diff(t) > 0.0):
        return None
    rows = [_as_the_rotor_wanders(row, t) for row in even_rows(t, by_order=False, least=SWEEPS.fewest)]
    even, in_row = t.copy(), np.zeros(len(t), dtype=np.bool_)
    for row in rows:
        even[row.index], in_row[row.index] = row.even_s, True
    if np.count_nonzero(in_row) < SWEEPS.least_share * len(t):
        return None
    return rows, t, in_row, np.where(in_row, t - even, 0.0)


def _as_the_rotor_wanders(row: Row, t: FloatArray) -> Row:
    """The row with its line bent to what its rotor wanders by: stamps that follow that are right."""
    return replace(row, even_s=row.even_s + wander_of(row.number, t[row.index] - row.even_s, row.used))


def _passing(seen: FirstLook, *, turned: float = 1.0) -> tuple[BoolArray, FloatArray]:
    """(M,) whether a scan is a turn of a rotor, and when that passed the direction in which middles of sweeps look [s].

    One passing for each scan: where sweeps are no whole turns, one of a turn before or after, as many turns of that from where it
    was as make it the next of the row.   turned: -1 for a rotor that turns the other way than the points' times have it.
    """
    length = np.abs(seen.facing)
    way = int(np.argmax(np.median(length, axis=1)))
    known = np.greater(length[way], SWEEPS.turning)
    if np.count_nonzero(known) < 2:
        return known, np.zeros(len(known))
    # As a rotor that turns from x to y has it.
    facing = (seen.facing[way] if way == 0 else seen.facing[way].conj())[known]
    middle_s = ((seen.stamps_ns - seen.stamps_ns[0]) * 1e-9 + 0.5 * seen.sweep_s)[known]
    once = 2.0 * np.pi / seen.period_s
    rate = _rate(turned * np.angle(facing), middle_s, seen.period_s)
    # Where points were turned back as by a rotor of one turn a sweep, their mean is off by the rest of it, for as long as their
    # mean time is off the middle: half a view that goes round in a sweep looks where it is seen.
    facing = facing * np.exp(-1j * (rate - once) * seen.seen_at_s[known])
    looked = turned * np.angle(facing)
    rate = _rate(looked, middle_s, seen.period_s)
    passing_s, turn_s = middle_s - looked / rate, 2.0 * np.pi / rate
    turn = np.cumsum(np.rint(np.diff(passing_s, prepend=passing_s[0]) / turn_s))
    # Two scans in which it passed once, and so on: the later is the next of the row.
    number = np.maximum.accumulate(turn - np.arange(len(turn))) + np.arange(len(turn))
    out = np.zeros(len(known))
    out[known] = passing_s + (number - turn) * turn_s
    return known, out


def _rate(looked: FloatArray, middle_s: FloatArray, period_s: float) -> float:
    """How fast a rotor turns [rad/s], about once a period.

    looked: (K,) where it looks at these times [rad].   Middles of what is seen of sweeps are no period apart where a view is cut
    and goes round in them, and one that a host stamped late is farther on by its lateness, but no rotor is faster for it.
    """
    apart_s, on = np.diff(middle_s), np.diff(looked) / (2.0 * np.pi)
    apart_s, on = apart_s[apart_s > 0.0], on[apart_s > 0.0]
    if not apart_s.size:
        return 2.0 * np.pi / period_s
    turns = on + np.rint(apart_s / period_s - on)
    each = turns / apart_s
    alike = np.abs(turns - np.median(each) * apart_s) < SWEEPS.alike_rad / (2.0 * np.pi)
    return float(2.0 * np.pi * turns[alike].sum() / apart_s[alike].sum())


def _wrapped(angle_rad: FloatArray) -> FloatArray:
    return np.asarray((angle_rad + np.pi) % (2.0 * np.pi) - np.pi, dtype=np.float64)
