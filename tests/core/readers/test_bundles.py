"""Readings that a driver stamped together, against the instants at which they were taken."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib_core import api
from calib_core.readers.imu.bundles import spread, told_apart
from calib_core.readers.imu.messages import RawImu
from calib_core.readers.imu.readings import clean_imu
from calib_core.readers.imu.repeats import as_sensed
from calib_core.readers.timing.stamps import never_set
from calib_core.settings import ReadSettings
from calib_core.simulate import generate, parse_faults, simulate
from calib_core.types import IntArray
from tests.core.readers import build

PERIOD_NS = 5_000_000


def _instants(count: int = 6000, *, lost: float = 0.0) -> IntArray:
    rng = np.random.default_rng(3)
    t = build.EPOCH_NS + PERIOD_NS * np.arange(count, dtype=np.int64)
    return np.asarray(t[rng.random(count) >= lost], dtype=np.int64)


def _emptied_every(t: IntArray, every_ns: int, *, late_ns: float = 0.0, apart_ns: int = 0) -> IntArray:
    """Stamps of a driver that looks so often, is late by an exponential law of that mean, and reads one after the other."""
    number = -((build.EPOCH_NS + 1_300_000 - t) // every_ns)
    _, first, bundle = np.unique(number, return_index=True, return_inverse=True)
    late = np.rint(late_ns * np.random.default_rng(4).exponential(size=bundle.max() + 1)).astype(np.int64)
    read = build.EPOCH_NS + 1_300_000 + number * every_ns + late[bundle]
    return np.asarray(read + apart_ns * (np.arange(len(t)) - first[bundle]), dtype=np.int64)


@pytest.mark.parametrize("every_ms", [8, 10, 16, 50, 100])
@pytest.mark.parametrize("late_ms", [0.0, 0.3])
@pytest.mark.parametrize("lost", [0.0, 0.01])
def test_each_reading_of_a_bundle_gets_its_own_time(every_ms: int, late_ms: float, lost: float) -> None:
    """None is later than the newest, which waited for a period at most; in the middle nothing is off by more than that and
    the host's lateness. Mutations: the median step as the period; the last stamp of a bundle for its oldest reading (off by
    the bundle's length); bundles counted by the mean step of two (a timer's bundles differ by one).
    """
    t = _instants(lost=lost)
    stamps = _emptied_every(t, every_ms * 1_000_000, late_ns=1e6 * late_ms, apart_ns=20_000)
    found = spread(stamps)
    assert found is not None
    assert found.period_ns == pytest.approx(PERIOD_NS, rel=1e-3 if lost == 0.0 else 0.02)
    assert found.size == pytest.approx((1.0 - lost) * every_ms / 5.0, rel=0.02)
    assert np.all(np.diff(found.stamps_ns) > 0)
    off_ms = (found.stamps_ns - t) * 1e-6
    wait = off_ms - np.median(off_ms)
    assert np.sqrt(np.mean(wait**2)) < 0.31 * 5.0 + late_ms + 10.0 * np.sqrt(lost)
    assert np.percentile(off_ms, 1) > -1.0
    assert np.percentile(off_ms, 95) < 5.0 + 3.0 * late_ms + (5.0 if lost else 0.1)


@pytest.mark.parametrize("law", ["even", "jitter of a third of a period", "late hosts", "losses", "a pause", "too few"])
def test_stamps_one_by_one_are_left_alone(law: str) -> None:
    """Mutation: call it a bundle where any two are close."""
    rng = np.random.default_rng(5)
    t = _instants()
    match law:
        case "jitter of a third of a period":
            t = np.sort(t + rng.integers(-1_600_000, 1_600_000, len(t)))
        case "late hosts":
            stalled = np.where(rng.random(len(t)) < 0.01, rng.uniform(5e6, 2e7, len(t)), 0.0)
            late = t + np.rint(rng.exponential(5e5, len(t)) + stalled).astype(np.int64)
            t = np.maximum.accumulate(late - 20_000 * np.arange(len(t))) + 20_000 * np.arange(len(t))
        case "losses":
            t = _instants(lost=0.1)
        case "a pause":
            t = t + np.where(np.arange(len(t)) > 3000, 5_000_000_000, 0)
        case "too few":
            t = _emptied_every(t[:60], 50_000_000, apart_ns=1)
        case _:
            pass
    assert spread(np.unique(t)) is None


def test_a_pause_between_bundles_stays_one() -> None:
    """Mutation: the mean step of the whole recording as the period."""
    t = _instants()
    t = t + np.where(np.arange(len(t)) > 3000, 5_000_000_000, 0)
    found = spread(_emptied_every(t, 20_000_000, apart_ns=1))
    assert found is not None
    assert found.period_ns == pytest.approx(PERIOD_NS, rel=1e-3)
    assert np.max(np.diff(found.stamps_ns)) == pytest.approx(5e9, rel=0.01)


def test_readings_of_one_stamp_are_kept_unless_they_were_sent_twice() -> None:
    """Mutations: keep the first of each stamp; keep what repeats it; compare with the one before only."""
    stamps = np.array([30, 10, 10, 20, 10, 10, 20], dtype=np.int64)
    values = np.array([[3.0], [1.0], [1.5], [2.0], [1.0], [1.7], [2.0]])
    kept, at = told_apart(stamps, values)
    np.testing.assert_array_equal(values[kept, 0], [1.0, 1.5, 1.7, 2.0, 3.0])
    np.testing.assert_array_equal(at, [10, 11, 12, 20, 30])
    crowd, at = told_apart(np.zeros(100_000, dtype=np.int64), np.arange(1e5)[:, None])
    assert len(crowd) == 100_000
    assert np.all(np.diff(at) == 1)


def test_bundles_are_said_with_what_they_rest_on_and_can_be_left() -> None:
    """Mutations: spread whatever is asked; throw away all but the first of a stamp; gaps counted between bundles."""
    rng = np.random.default_rng(6)
    t = _instants()
    at_once = _emptied_every(t, 20_000_000, apart_ns=20_000)
    given = RawImu(
        at_once, at_once + 1_000_000, rng.normal(size=(len(t), 3)), rng.normal(9.8, 0.1, (len(t), 3)), "imu", 0
    )
    cleaned = clean_imu(given, ReadSettings(), "/imu")
    assert len(cleaned.imu.stamps_ns) == len(t)
    off = cleaned.imu.stamps_ns - t
    # The recording ends within a bundle.
    assert np.ptp(off[:-4]) < 10
    said = {finding.code: finding for finding in cleaned.findings}
    assert "bundles of 4 readings" in said["imu.stamped_in_bundles"].text
    assert {e.name: e.value for e in said["imu.stamped_in_bundles"].evidence} == {
        "readings a bundle": 4.0,
        "most in a bundle": 4,
        "longest wait": 0.015,
        "period": 0.005,
    }
    assert not {"imu.gaps", "imu.jitter", "imu.duplicates"} & set(said)
    left = clean_imu(given, ReadSettings(imu_bundles="as-stamped"), "/imu")
    assert len(left.imu.stamps_ns) == len(t)
    assert np.abs(left.imu.stamps_ns - at_once).max() < 10
    assert "imu.stamped_in_bundles" not in {finding.code for finding in left.findings}


def test_one_cause_is_told_once() -> None:
    """A timer empties the buffer every 16 ms: what is left is uneven, and why is told. Mutation: jitter told beside it."""
    at_s = np.ceil(np.arange(1, 2001) * 0.01 / 0.016) * 0.016
    stamps_ns = 10**18 + np.rint(at_s * 1e9).astype(np.int64) + np.arange(2000)
    readings = np.random.default_rng(1).normal(0.0, 0.01, (2000, 3))
    given = RawImu(stamps_ns, stamps_ns + 100, readings, readings + np.array([0.0, 0.0, 9.8]), "imu", 0)
    told = {f.code for f in clean_imu(given, ReadSettings(), "/imu").findings}
    assert "imu.stamped_in_bundles" in told
    assert "imu.jitter" not in told


def test_a_bag_of_bundles_is_read_as_the_simulator_knows_them(tmp_path: Path) -> None:
    """Mutation: the newest reading at the bundle's last stamp (40 microseconds late)."""
    faults = parse_faults("stamp-bundles=0.05")
    simulate("paper-normal", tmp_path / "b.bag", duration_s=6.0, faults=faults)
    known, _ = generate("paper-normal", duration_s=6.0, faults=faults)
    read = api.load(tmp_path / "b.bag")
    assert any(finding.code == "imu.stamped_in_bundles" for finding in read.findings)
    assert len(read.imu.stamps_ns) == len(known.imu.stamps_ns)
    inside = slice(20, -20)
    assert np.abs(read.imu.stamps_ns - known.imu.stamps_ns)[inside].max() < 10_000


def _sent(
    count: int, repeats: int, buffer_ms: float, apart_ms: float = 10.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What a driver sends every 10 ms, or as far apart as said, each reading so often, and hands over when it empties its buffer.

    Returns readings (Q, 3), stamps (Q,) [ns] and when each reading was taken (Q,) [ns].
    """
    number = np.arange(count) // repeats
    gyro = np.random.default_rng(5).normal(size=(number[-1] + 1, 3))[number]
    sent_ms = (
        np.arange(count) * 10.0 if apart_ms == 10.0 else number * 10.0 * repeats + np.arange(count) % repeats * apart_ms
    )
    stamped_ms = sent_ms if buffer_ms == 0.0 else np.ceil(sent_ms / buffer_ms) * buffer_ms
    order = np.zeros(count) if buffer_ms == 0.0 else 0.02 * _place_within(stamped_ms)
    # No multiples of anything: those would be a clock's ticks.
    stamps_ns, taken_ns = 1e6 * (stamped_ms + order) + 5_300_123, 1e7 * repeats * number + 5_300_123
    return gyro, np.rint(stamps_ns).astype(np.int64), np.rint(taken_ns).astype(np.int64)


def _place_within(stamps: np.ndarray) -> np.ndarray:
    """Which of its bundle each is, from 0."""
    begins = np.append(True, np.diff(stamps) > 0)
    first = np.maximum.accumulate(np.where(begins, np.arange(len(stamps)), 0))
    return np.arange(len(stamps)) - first


@pytest.mark.parametrize(("repeats", "buffer_ms"), [(2, 16.0), (3, 16.0), (2, 50.0), (3, 37.0), (1, 16.0)])
def test_what_a_driver_repeats_and_hands_over_in_bundles_is_put_where_it_was_taken(
    repeats: int, buffer_ms: float
) -> None:
    """Late by what the newest of a bundle waits, less than 10 ms; by up to a whole bundle and more where repeats go first.

    Mutations: repeats always taken out first; of both ways the less even one; the row that was sent handed on.
    """
    gyro, stamps_ns, taken_ns = _sent(4000, repeats, buffer_ms)
    fresh, bundles, placed_ns = as_sensed(gyro, np.zeros_like(gyro), stamps_ns)
    assert bundles is not None
    first = np.arange(4000) % repeats == 0
    assert (fresh is None) == (repeats == 1)
    assert fresh is None or np.array_equal(fresh, first)
    late_ms = 1e-6 * (placed_ns - taken_ns[first])[50:-50]
    assert late_ms.min() > -0.1
    assert late_ms.max() < 10.1


@pytest.mark.parametrize("apart_ms", [10.0, 0.02])
def test_what_is_only_sent_more_than_once_keeps_its_stamps(apart_ms: float) -> None:
    """Evenly, or twice at once: those seem to come in bundles of two, of which the one that counts would be put half a period
    before its stamp. Mutation: bundles always told by all that were sent.
    """
    gyro, stamps_ns, taken_ns = _sent(4000, 2, 0.0, apart_ms)
    fresh, bundles, placed_ns = as_sensed(gyro, np.zeros_like(gyro), stamps_ns)
    assert fresh is not None
    assert bundles is None
    np.testing.assert_array_equal(placed_ns, taken_ns[::2])


@pytest.mark.parametrize(("repeats", "buffer_ms"), [(2, 16.0), (2, 50.0), (3, 37.0)])
def test_bundles_of_repeats_are_seen_beside_a_gap_and_losses(repeats: int, buffer_ms: float) -> None:
    """Six seconds lost, and one message of a hundred. Mutation: a gap's own length counted in how even a row is."""
    gyro, stamps_ns, taken_ns = _sent(4000, repeats, buffer_ms)
    there = np.random.default_rng(1).random(4000) > 0.01
    there[1500:2100] = False
    fresh, bundles, placed_ns = as_sensed(gyro[there], np.zeros_like(gyro[there]), stamps_ns[there])
    assert bundles is not None
    assert fresh is not None
    late_ms = 1e-6 * (placed_ns - taken_ns[there][fresh])
    as_stamped_ms = 1e-6 * (stamps_ns[there][fresh] - taken_ns[there][fresh])
    assert np.percentile(late_ms, 98.0) < 10.1
    assert np.std(late_ms) < 0.8 * np.std(as_stamped_ms)


@pytest.mark.parametrize(
    ("header_ns", "unset"),
    [
        (np.zeros(600, np.int64), True),
        (np.full(600, 1_700_000_000_000_000_000), True),
        (np.arange(600) // 100 * 1_000_000_000, True),  # whole seconds
        (np.arange(600) // 10 * 50_000_000, False),
        (np.arange(600) // 20 * 100_000_000, False),
        (np.arange(600) * 5_000_000, False),
        (np.zeros(3, np.int64), False),
    ],
)
def test_readings_that_are_sent_ten_at_once_have_their_stamps(header_ns: IntArray, unset: bool) -> None:
    """Seen: bundles of ten taken for headers that nobody set, and the recorder's latency for part of the time offset: 5.8 ms with
    0.03 stated. Mutations: how many differ alone; whether they go on alone.
    """
    assert never_set(header_ns) is unset
