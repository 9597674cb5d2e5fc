"""Raw IMU readings -> ImuData: sorted, duplicates removed, in SI units, everything odd reported."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.errors import InputError
from calib_core.intrinsics import STANDARD_GRAVITY_M_S2
from calib_core.phrasing import counted
from calib_core.readers.imu.bundles import Bundles, told_apart
from calib_core.readers.imu.dead import require_both_sensors
from calib_core.readers.imu.messages import RawImu
from calib_core.readers.imu.order import Came, as_they_came
from calib_core.readers.imu.repeats import as_sensed
from calib_core.readers.imu.spikes import spikes
from calib_core.readers.imu.stuck import stuck_axis
from calib_core.readers.imu.units import AccelerometerUnit, GyroscopeUnit, detect_accelerometer_unit, detect_gyroscope
from calib_core.readers.timing.clocks import HeaderTimes
from calib_core.readers.timing.stamps import plausible_stamps, unset_finding
from calib_core.settings import ReadSettings
from calib_core.stamp_rate import GAP_PERIODS, usual_step_ns
from calib_core.types import BoolArray, Clue, Finding, FloatArray, ImuData, IntArray

#: No gyroscope shows this in deg/s, no accelerometer in m/s2: damaged bytes do. NaN fails the comparison as well.
_IMPOSSIBLE_READING = 1e5


@dataclass(frozen=True, slots=True)
class StampStatistics:
    """Regularity of a row of stamps, before it was sorted and cleaned; of the steps, as it is used.

    period_s: usual step.   jitter_s: robust spread (1.48 median absolute deviation) of the steps.   n_gaps: longer than
    GAP_PERIODS periods.   bundled_share: share of readings received together with the one before.
    """

    count: int
    period_s: float
    jitter_s: float
    n_duplicates: int
    n_rewinds: int
    n_gaps: int
    longest_gap_s: float
    bundled_share: float

    @property
    def rate_hz(self) -> float:
        """Readings per second where none is missing."""
        return 1.0 / self.period_s if self.period_s > 0 else 0.0


@dataclass(frozen=True, slots=True)
class CleanedImu:
    """Readings in SI units, the units they were sent in, and what was found.

    headers: of all readings that are no damaged bytes and bear no damaged stamp, as they came: what is asked of a clock is asked
    of these.
    """

    imu: ImuData
    headers: HeaderTimes
    accelerometer_unit: AccelerometerUnit
    gyroscope_unit: GyroscopeUnit
    findings: tuple[Finding, ...]


def stamp_statistics(stamps_ns: IntArray, receive_ns: IntArray, *, taken_ns: IntArray | None = None) -> StampStatistics:
    """Regularity of stamps in receive order. taken_ns: increasing, those that are used where they are others."""
    if stamps_ns.size < 2:
        return StampStatistics(int(stamps_ns.size), 0.0, 0.0, 0, 0, 0, 0.0, 0.0)
    in_order = np.diff(stamps_ns)
    used_ns = np.unique(stamps_ns) if taken_ns is None else taken_ns
    steps = np.diff(used_ns).astype(np.float64)
    period = usual_step_ns(used_ns)
    jitter = 1.4826 * float(np.median(np.abs(steps - np.median(steps)))) if steps.size else 0.0
    gaps = steps[steps > GAP_PERIODS * period]
    bundled = np.count_nonzero(np.diff(receive_ns) < 0.1 * period) / (receive_ns.size - 1)
    return StampStatistics(
        count=int(stamps_ns.size),
        period_s=period * 1e-9,
        jitter_s=jitter * 1e-9,
        n_duplicates=int(np.count_nonzero(np.diff(np.sort(stamps_ns)) == 0)),
        n_rewinds=int(np.count_nonzero(in_order < 0)),
        n_gaps=int(gaps.size),
        longest_gap_s=float(gaps.max(initial=0)) * 1e-9,
        bundled_share=float(bundled),
    )


def clean_imu(raw: RawImu, settings: ReadSettings, topic: str, *, start_ns: int | None = None) -> CleanedImu:
    """The readings in SI units, and what was found. Raises InputError where nothing usable is left.

    start_ns: the recording's start, receive time, from which what is told counts; None: the first reading's.
    """
    require_both_sensors(raw.gyro, raw.accel, topic)
    stamps_ns = raw.receive_ns if settings.stamps == "receive" else raw.header_ns
    good = (
        plausible_stamps(stamps_ns, raw.receive_ns)
        & (np.abs(raw.gyro) < _IMPOSSIBLE_READING).all(axis=1)
        & (np.abs(raw.accel) < _IMPOSSIBLE_READING).all(axis=1)
    )
    stamps_ns, readings = stamps_ns[good], np.hstack([raw.gyro, raw.accel])[good]
    kept, taken_ns = told_apart(stamps_ns, readings)
    n_sent_twice = len(stamps_ns) - len(kept)
    came = as_they_came(kept, readings)
    if came is not None:
        kept = came.kept
    fresh, bundles = None, None
    if settings.imu_bundles == "spread":
        fresh, bundles, taken_ns = as_sensed(readings[kept, :3], readings[kept, 3:], taken_ns)
        kept = kept if fresh is None else kept[fresh]
    statistics = stamp_statistics(stamps_ns, raw.receive_ns[good], taken_ns=taken_ns)
    findings = list(_stamp_findings(statistics, topic, n_repeated=n_sent_twice, came=came))
    if fresh is not None:
        findings.append(_repeats_finding(fresh, statistics, topic))
    if bundles is not None:
        # What is left of the jitter is how the bundles come: one cause is told once, with the cure that it has.
        findings = [*(f for f in findings if f.code != "imu.jitter"), _bundles_finding(bundles, topic)]
    if raw.unset:
        findings.insert(0, unset_finding(topic))
    n_bad = int(np.count_nonzero(~good)) + raw.n_malformed
    if n_bad:
        findings.append(_bad_readings(n_bad, good.size + raw.n_malformed, topic))
    usable = len(np.unique(stamps_ns))
    if usable < 2:
        raise InputError(
            f"The IMU topic {topic} holds {usable} usable readings, at least 2 are needed; pick"
            f" another topic or recording.",
            code="imu.empty",
        )
    gyro, accel = raw.gyro[good][kept], raw.accel[good][kept]
    accel_unit, finding = detect_accelerometer_unit(taken_ns, gyro, accel, settings, topic)
    findings.append(finding)
    accel = accel * (STANDARD_GRAVITY_M_S2 if accel_unit == "g" else 1.0)
    gyro_unit, more = detect_gyroscope(taken_ns, gyro, accel, settings, topic)
    findings.extend(more)
    gyro = gyro * (np.pi / 180.0 if gyro_unit == "deg_s" else 1.0)
    leapt = spikes(gyro, accel)
    if leapt.any():
        findings.append(_spikes_finding(leapt, gyro, accel, topic))
        taken_ns, gyro, accel = taken_ns[~leapt], gyro[~leapt], accel[~leapt]
    headers = HeaderTimes(raw.header_ns[good], raw.receive_ns[good])
    begin_ns = int(taken_ns[0]) if start_ns is None else start_ns - int(np.median(headers.receive_ns - stamps_ns))
    stuck = stuck_axis(taken_ns, gyro, accel, topic, begin_ns=begin_ns)
    if stuck is not None:
        findings.append(stuck)
    data = ImuData(taken_ns, gyro, accel, topic, raw.frame_id, 0 if bundles is None else bundles.tick_ns)
    return CleanedImu(data, headers, accel_unit, gyro_unit, tuple(findings))


def _bad_readings(n_bad: int, total: int, topic: str) -> Finding:
    return Finding(
        code="imu.bad_readings",
        level="warning",
        text=f"{n_bad} of {total} readings on {topic} are not finite, impossible or malformed and were left out.",
        evidence=(Clue("bad readings", n_bad), Clue("readings", total)),
        consequence="the motion between their neighbours is interpolated",
    )


def _spikes_finding(leapt: BoolArray, gyro: FloatArray, accel: FloatArray, topic: str) -> Finding:
    n_leapt = int(np.count_nonzero(leapt))
    return Finding(
        "imu.spikes",
        "warning",
        f"{n_leapt} of {len(leapt)} readings on {topic} leap away from their neighbours for a single reading, as damaged ones"
        " do; they were left out.",
        (
            Clue("spikes", n_leapt),
            Clue("readings", len(leapt)),
            Clue("fastest of them", round(float(np.abs(gyro[leapt]).max()), 3), "rad/s"),
            Clue("strongest of them", round(float(np.abs(accel[leapt]).max()), 2), "m/s²"),
        ),
        consequence="the motion between their neighbours is interpolated; look for what damages them",
    )


def _bundles_finding(bundles: Bundles, topic: str) -> Finding:
    period_s = bundles.period_ns * 1e-9
    if bundles.tick_ns:
        return Finding(
            "imu.stamped_by_ticks",
            "warning",
            f"Stamps on {topic} are multiples of {1e-6 * bundles.tick_ns:.4g} ms, while {bundles.size:.2g} readings come in that"
            f" time (at most {bundles.largest}): readings with one stamp are taken to be sampled every {1e3 * period_s:.4g} ms,"
            " the first of them at the stamp.",
            (
                Clue("readings a tick", round(bundles.size, 2)),
                Clue("tick", bundles.tick_ns * 1e-9, "s"),
                Clue("period", round(period_s, 9), "s"),
            ),
            consequence="the time offset is unsure by about half a tick; let the driver stamp to microseconds",
            override="--imu-bundles as-stamped",
        )
    return Finding(
        "imu.stamped_in_bundles",
        "warning",
        f"Stamps on {topic} come in bundles of {bundles.size:.2g} readings (at most {bundles.largest}), as from a driver"
        f" that empties a buffer: the newest of each bundle keeps its stamp, the others are taken to be sampled every"
        f" {1e3 * period_s:.4g} ms before it.",
        (
            Clue("readings a bundle", round(bundles.size, 2)),
            Clue("most in a bundle", bundles.largest),
            Clue("longest wait", round(bundles.waited_s, 6), "s"),
            Clue("period", round(period_s, 9), "s"),
        ),
        consequence="the time offset is that of the newest reading of each bundle",
        override="--imu-bundles as-stamped",
    )


def _repeats_finding(fresh: BoolArray, statistics: StampStatistics, topic: str) -> Finding:
    share = 1.0 - float(np.mean(fresh))
    return Finding(
        "imu.repeats",
        "warning",
        f"{share:.0%} of the readings on {topic} repeat the angular rate of the one before, as from a driver that sends"
        f" faster than the sensor measures: only the first of each is kept, {statistics.rate_hz:.4g} per second.",
        (
            Clue("repeats", int(np.count_nonzero(~fresh))),
            Clue("readings", len(fresh)),
            Clue("period", round(statistics.period_s, 9), "s"),
        ),
        consequence="the time offset is that of the first reading of each; kept as they were sent, the repeats would add half"
        " of the time by which they lag",
        override="--imu-bundles as-stamped",
    )


def _stamp_findings(statistics: StampStatistics, topic: str, *, n_repeated: int, came: Came | None) -> list[Finding]:
    period_ms = statistics.period_s * 1e3
    found: list[Finding] = []
    if n_repeated:
        found.append(
            Finding(
                "imu.duplicates",
                "warning",
                f"{counted(n_repeated, 'reading')} on {topic} {'was' if n_repeated == 1 else 'were'} sent twice; "
                "the first of each was kept.",
                (Clue("duplicates", n_repeated), Clue("readings", statistics.count)),
            )
        )
    shared = statistics.n_duplicates - n_repeated
    if shared > 0:
        found.append(
            Finding(
                "imu.shared_stamps",
                "info",
                f"{counted(shared, 'reading')} on {topic} {'has' if shared == 1 else 'have'} the stamp of another with "
                "different values; all were kept.",
                (Clue("shared stamps", shared), Clue("readings", statistics.count)),
            )
        )
    backwards = f"Stamps on {topic} step backwards {counted(statistics.n_rewinds, 'time')}"
    if came is not None:
        found.append(
            Finding(
                "imu.out_of_order",
                "warning",
                f"{backwards}: readings keep the order in which they arrived, because the motion is smoother in it, and take the"
                " sorted stamps in that order.",
                (
                    Clue("backward steps", statistics.n_rewinds),
                    Clue("readings with another's stamp", came.moved),
                    Clue("times as rough by stamp", round(came.rougher, 2)),
                ),
            )
        )
    elif statistics.n_rewinds:
        found.append(
            Finding(
                "imu.out_of_order",
                "warning",
                f"{backwards}; readings were sorted by stamp.",
                (Clue("backward steps", statistics.n_rewinds),),
            )
        )
    if statistics.n_gaps:
        found.append(
            Finding(
                "imu.gaps",
                "warning",
                f"{topic} has {statistics.n_gaps} gaps, the longest {statistics.longest_gap_s:.3f} s,"
                f" where a reading comes every {period_ms:.2f} ms.",
                (Clue("gaps", statistics.n_gaps), Clue("longest", statistics.longest_gap_s, "s")),
                consequence="scans are not used where readings are lost for 60 ms, or six in a row; a late stamp only looks like "
                "a gap",
            )
        )
    return found + _pace_findings(statistics, topic)


def _pace_findings(statistics: StampStatistics, topic: str) -> list[Finding]:
    period_ms = statistics.period_s * 1e3
    found: list[Finding] = []
    if statistics.jitter_s > 0.1 * statistics.period_s > 0:
        found.append(
            Finding(
                "imu.jitter",
                "warning",
                f"Stamps on {topic} jitter: the step from one to the next is {period_ms:.2f} ± {statistics.jitter_s * 1e3:.2f} "
                "ms, as for an IMU stamped by the host.",
                (
                    Clue("spread of the steps", statistics.jitter_s, "s"),
                    Clue("period", statistics.period_s, "s"),
                ),
                consequence="readings that were sampled evenly get even stamps; the stamps' mean delay is part of the time "
                "offset",
            )
        )
    if statistics.bundled_share > 0.5:
        found.append(
            Finding(
                "imu.bundled",
                "info",
                f"Readings on {topic} arrive in bundles ({statistics.bundled_share:.0%} together with the one before).",
                (Clue("bundled share", round(statistics.bundled_share, 3)),),
                consequence="receive times of this topic say little; headers are used",
            )
        )
    if 0 < statistics.rate_hz < 95:
        found.append(
            Finding(
                "imu.rate",
                "warning",
                f"{topic} runs at {statistics.rate_hz:.1f} Hz; 100 Hz or more is advised.",
                (Clue("rate", round(statistics.rate_hz, 2), "Hz"),),
                consequence="fast motion between readings is interpolated",
            )
        )
    return found
