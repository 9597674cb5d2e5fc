"""Traps in point times: each bag's twin without the trap is the oracle, instant by instant."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calib_core.errors import PointTimeError
from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.load import load
from calib_core.readers.scans import make_scan
from calib_core.readers.timing.point_time import detect_point_time
from calib_core.readers.timing.synthesise import plan_synthesis, point_timing, synthesised_times_s
from calib_core.settings import ReadSettings
from tests.core.readers import build
from tests.core.readers.timed_cloud import FREE, N, cloud, expected


def instants(clouds: list[RawCloud], settings: ReadSettings | None = None) -> list[NDArray[np.int64]]:
    """Absolute times of each scan's points as they are read."""
    timing, _ = detect_point_time(clouds, settings or ReadSettings(), topic="/p")
    out = []
    for k, c in enumerate(clouds):
        scan, _ = make_scan(c, k, timing, 0.3, 200.0)
        assert scan is not None
        out.append(scan.stamp_ns + scan.points["offset_ns"].astype(np.int64))
    return out


TRAPS: dict[str, tuple[str, str, Callable[[NDArray[np.float64], int], NDArray[np.float64]], int, int]] = {
    # name: field, type, values, header after the sweep's start, tolerance
    "plain": ("time", "<f4", lambda t, s: t, 0, 8),
    "negative": ("time", "<f4", lambda t, s: t - 0.1, 100_000_000, 8),
    "header in the middle": ("time", "<f4", lambda t, s: t - 0.05, 50_000_000, 8),
    "milliseconds in float32": ("time", "<f4", lambda t, s: t * 1e3, 0, 8),
    "microseconds in float32": ("time", "<f4", lambda t, s: t * 1e6, 0, 8),
    "absolute nanoseconds in float64": ("timestamp", "<f8", lambda t, s: s + np.rint(t * 1e9), 0, 257),
    "absolute seconds in float64": ("timestamp", "<f8", lambda t, s: s // 10**9 + ((s % 10**9) / 1e9 + t), 0, 121),
    "absolute, stamp at the end": (
        "timestamp",
        "<f8",
        lambda t, s: s // 10**9 + ((s % 10**9) / 1e9 + t),
        100_000_000,
        121,
    ),
    "absolute microseconds": ("timestamp", "<f8", lambda t, s: s // 1000 + t * 1e6, 0, 251),
    "behaves like a time, has no name": ("w", "<f4", lambda t, s: t, 0, 8),
}


@pytest.mark.parametrize("name", TRAPS)
def test_traps_read_as_their_plain_twin(name: str) -> None:
    """Mutation: a factor of ten in NS_PER_UNIT["ms"]; `absolute = False` in `_timing`."""
    field, kind, values, header_after, tolerance = TRAPS[name]
    clouds = [cloud(k, field, kind, values, build.EPOCH_NS + k * 100_000_000 + header_after) for k in range(N)]
    for k, got in enumerate(instants(clouds)):
        assert np.abs(got - expected(k)).max() <= tolerance


def test_absolute_times_of_another_epoch_move_by_one_constant() -> None:
    """Mutation: add each scan's own header difference instead of the median (jitter enters the points)."""
    rng = np.random.default_rng(0)
    jitter = rng.integers(-3_000_000, 3_000_000, N)
    boot_ns = 1_234_567_890_123  # the sensor counts from its start

    def values(t: NDArray[np.float64], s: int) -> NDArray[np.float64]:
        return (s - build.EPOCH_NS + boot_ns) + np.rint(t * 1e9)

    clouds = [cloud(k, "timestamp", "<f8", values, build.EPOCH_NS + k * 100_000_000 + int(jitter[k])) for k in range(N)]
    _, findings = detect_point_time(clouds, ReadSettings(), topic="/p")
    assert any(f.code == "points.epoch" for f in findings)
    shifts = [got - expected(k) for k, got in enumerate(instants(clouds))]
    assert max(np.ptp(s) for s in shifts) <= 2
    medians = [int(np.median(s)) for s in shifts]
    assert max(medians) - min(medians) <= 2
    assert abs(medians[0]) < 3_500_000


def test_garbage_times_are_left_out_and_counted() -> None:
    """Mutation: a window (`window_ns`) of a thousand periods."""
    clouds = [cloud(k, "time", "<f4", lambda t, s: t) for k in range(N)]
    damaged = clouds[20].points.copy()
    damaged["time"][::10] = 3.6
    damaged["time"][5] = np.nan
    clouds[20] = RawCloud(clouds[20].header_ns, 0, "lidar", damaged, damaged.size, 1)
    timing, _ = detect_point_time(clouds, ReadSettings(), topic="/p")
    scan, counts = make_scan(clouds[20], 20, timing, 0.3, 200.0)
    assert scan is not None
    bad = np.zeros(damaged.size, bool)
    bad[::10] = bad[5] = True
    assert counts.out_of_time == np.count_nonzero(bad)
    np.testing.assert_array_equal(scan.points["xyz"][:, 0], damaged["x"][~bad])


def test_overrides_win() -> None:
    """Mutation: ignore settings.point_time_reference (or _unit, or _field) in `detect_point_time`."""
    clouds = [cloud(k, "time", "<f4", lambda t, s: t) for k in range(N)]
    got = instants(clouds, ReadSettings(point_time_reference="header-last"))
    last = expected(3).max()
    assert abs((got[3] - expected(3)).mean() + (last - (build.EPOCH_NS + 300_000_000))) < 3_000_000
    timing, _ = detect_point_time(clouds, ReadSettings(point_time_field="time", point_time_unit="s"), topic="/p")
    assert (timing.field, timing.unit) == ("time", "s")
    with pytest.raises(PointTimeError, match="in ns, as asked; leave --point-time-unit ns out"):
        detect_point_time(clouds, ReadSettings(point_time_unit="ns"), topic="/p")
    with pytest.raises(PointTimeError, match="no field 'nope'"):
        detect_point_time(clouds, ReadSettings(point_time_field="nope"), topic="/p")


@pytest.mark.parametrize(
    ("field", "values", "sentence"),
    [
        (None, lambda t, s: t, r"carry no per-point time \(fields: x, y, z, intensity, ring\)"),
        ("time", lambda t, s: t * 0, "'time' is the same for all points"),
        ("time", lambda t, s: t * 1e4, "is no scan of 0.100 s"),
        ("noise_like", lambda t, s: np.random.default_rng(1).uniform(0, 100, t.size), "no usable per-point time"),
    ],
)
def test_unusable_times_are_refused(
    field: str | None, values: Callable[..., NDArray[np.float64]], sentence: str
) -> None:
    """Mutation: drop `_MIN_ORDER` (the noise is then taken for milliseconds)."""
    clouds = [cloud(k, field, "<f4", values) for k in range(N)]
    with pytest.raises(PointTimeError, match=sentence) as caught:
        detect_point_time(clouds, ReadSettings(), topic="/p")
    assert "or pass --synthesise-point-time" in str(caught.value)
    is_of_an_instant = field is None or "same for all" in sentence
    assert ("or --points-at-once for a lidar that takes them all at once." in str(caught.value)) == is_of_an_instant
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("plain", "which is the first point's time."),
        ("negative", "which is the last point's time."),
        ("header in the middle", "which is amid the sweep."),
        ("absolute, stamp at the end", "in s, absolute."),
    ],
)
def test_where_the_header_is_in_its_sweep_is_said(name: str, said: str) -> None:
    """Mutation: the nearer end named wherever it is."""
    field, kind, values, header_ns, _ = TRAPS[name]
    clouds = [cloud(k, field, kind, values, build.EPOCH_NS + k * 100_000_000 + header_ns) for k in range(N)]
    finding = detect_point_time(clouds, ReadSettings(), topic="/p")[1][0]
    assert finding.text.endswith(said)


@pytest.mark.parametrize(("seen_deg", "sure"), [(150.0, True), (360.0, False)])
def test_a_rotor_that_looks_to_one_side_is_done_sooner(seen_deg: float, sure: bool) -> None:
    """Seen: of lidars that see 150 deg the time was a warning without a reason. Of one that sees all around, two fifths of a turn
    are odd, and it is said what is. Mutations: what is seen left out; the reason left out; another one.
    """
    share = 150.0 / 360.0

    def made(k: int) -> RawCloud:
        one = cloud(k, "time", "<f4", lambda t, s: share * t)
        azimuth = np.radians(seen_deg) * np.linspace(-0.5, 0.5, len(one.points))
        one.points["x"], one.points["y"] = 5.0 * np.cos(azimuth), 5.0 * np.sin(azimuth)
        return one

    finding = detect_point_time([made(k) for k in range(N)], ReadSettings(), topic="/p")[1][0]
    assert (finding.level == "info") is sure
    assert (finding.confidence > 0.5) is sure
    said = finding.text.partition("first point's time.")[2].strip()
    assert said == ("" if sure else "It is not sure: it spans 0.42 of the time from scan to scan.")


@pytest.mark.parametrize("off_s", [0.0, 1000.0])
def test_the_headers_own_clock_is_sure_whatever_part_of_a_sweep_is_seen(off_s: float) -> None:
    """Seen: a rosette cut to one side, of which each sweep shows another third: nanoseconds since 1970 were "5 % sure". Another
    clock's tell no more than before, but that they run as one does. Mutations: from scan to scan alone; any clock's are sure.
    """
    begins = np.tile([0.0, 0.03, 0.07], N)[:N]

    def made(k: int) -> RawCloud:
        values = lambda t, s: s + np.rint(1e9 * (off_s + begins[k] + 0.3 * t))  # noqa: E731
        return cloud(k, "timestamp", "<f8", values)

    finding = detect_point_time([made(k) for k in range(N)], ReadSettings(), topic="/p")[1][0]
    assert "are field 'timestamp' in ns, absolute." in finding.text
    assert finding.confidence == pytest.approx(0.4 if off_s else 1.0, abs=0.05)


def test_few_scans_mean_less_confidence() -> None:
    """Mutation: leave the number of scans out of the confidence."""
    many = detect_point_time([cloud(k, "time", "<f4", lambda t, s: t) for k in range(N)], ReadSettings(), topic="/p")[1]
    few = detect_point_time([cloud(k, "time", "<f4", lambda t, s: t) for k in range(6)], ReadSettings(), topic="/p")[1]
    assert few[0].confidence < 0.6 < many[0].confidence


@pytest.mark.parametrize("mirror", [1, -1])
def test_synthesised_times_follow_the_azimuth(mirror: int) -> None:
    """Mutation: take the direction as -1 always; start at azimuth 0 instead of the first point's."""
    clouds = []
    for k in range(N):
        c = cloud(k, None, "", lambda t, s: t)
        points = c.points.copy()
        turn = np.deg2rad(70)
        x, y = points["x"].copy(), points["y"] * mirror
        points["x"], points["y"] = np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y
        clouds.append(RawCloud(c.header_ns, c.receive_ns, c.frame_id, points, c.width, c.height))
    plan = plan_synthesis(clouds)
    assert plan.kind == "azimuth"
    assert plan.direction == -mirror  # the sweep of build.py turns clockwise
    made = synthesised_times_s(clouds[7], plan)
    column_s = np.floor(np.arange(made.size) / 16) * 0.1 / 90
    assert np.abs(made - column_s).max() < 2e-4


@pytest.mark.parametrize("columns", [92, 90, 87])
@pytest.mark.parametrize("order", ["taken", "rows", "rings"])
def test_sweeps_cut_by_time_begin_where_they_begin(order: str, columns: int) -> None:
    """A head of 90 columns a turn, clouds of more or fewer: each begins farther round, and a long one passes its own start.

    Every tenth return is missing. Within a column's time of the truth. Mutations: one start for all; a turn for a period; the
    order of the message not asked which of two turns it was; only the order as taken known.
    """
    lasers, kept = 16, np.random.default_rng(3).random((N, columns * 16)) > 0.1
    clouds, truth_s = [], []
    period_s = 0.1 * columns / 90
    for k in range(N):
        column, laser = (each.ravel() for each in np.meshgrid(np.arange(columns), np.arange(lasers), indexing="ij"))
        azimuth = np.deg2rad(40.0) - 2 * np.pi / 90 * (k * columns + column)
        points = np.zeros(column.size, np.dtype(FREE if order == "rings" else FREE[:4]))
        points["x"], points["y"], points["z"] = 5.0 * np.cos(azimuth), 5.0 * np.sin(azimuth), laser * 0.1 + 0.1
        points["x"][~kept[k]] = np.nan
        by_row = np.lexsort((column, laser))
        if order == "rings":
            points["ring"] = laser
            by_row = by_row[kept[k][by_row]]  # a dense cloud
        elif order == "taken":
            by_row = np.arange(column.size)
        width, height = (columns, lasers) if order == "rows" else (by_row.size, 1)
        stamp_ns = build.EPOCH_NS + round(k * period_s * 1e9)
        clouds.append(RawCloud(stamp_ns, stamp_ns + 105_000_000, "lidar", points[by_row], width, height))
        truth_s.append((column / columns * period_s)[by_row])
    plan = plan_synthesis(clouds)
    assert plan.order == order
    for k in (0, 7, N - 1):
        made = synthesised_times_s(clouds[k], plan)
        bearing = np.isfinite(clouds[k].points["x"])
        assert np.abs(made - truth_s[k])[bearing].max() < 1.01 * 0.1 / 90


def _written(clouds: Sequence[RawCloud], path: Path) -> Path:
    """A bag of these clouds, and of an IMU at rest."""
    messages = build.in_order(
        [
            (
                "/p",
                "sensor_msgs/msg/PointCloud2",
                c.receive_ns,
                build.pointcloud2(c.points, cdr=False, stamp_ns=c.header_ns),
            )
            for c in clouds
        ],
        build.still_imu(5.6, cdr=False),
    )
    return build.write_ros1(path, messages)


def test_synthesis_is_only_done_when_asked(tmp_path: Path) -> None:
    """Mutation: drop `if not settings.synthesise_point_time: raise`."""
    clouds = [cloud(k, None, "", lambda t, s: t) for k in range(N)]
    with pytest.raises(PointTimeError):
        point_timing(clouds, lambda m: clouds[0], ReadSettings(), topic="/p", help_text="")
    loaded = load(_written(clouds, tmp_path / "r.bag"), ReadSettings(synthesise_point_time=True))
    found = next(f for f in loaded.findings if f.code == "points.time_synthesised")
    assert found.level == "warning"
    assert len(loaded.scans) == N
    assert 0.09e9 < loaded.scans[5].points["offset_ns"].max() < 0.101e9


def test_points_at_once_are_of_the_header_s_instant(tmp_path: Path) -> None:
    """A flash lidar's clouds, whose time is one and the same, or counts something else. Mutations: times by their order; their
    own; nothing said.
    """
    for field, values in (("time", lambda t, s: t * 0), ("time", lambda t, s: t)):
        clouds = [cloud(k, field, "<f4", values) for k in range(N)]
        loaded = load(
            _written(clouds, tmp_path / f"{len(list(tmp_path.iterdir()))}.bag"), ReadSettings(points_at_once=True)
        )
        assert len(loaded.scans) == N
        assert [scan.stamp_ns for scan in loaded.scans] == [c.header_ns for c in clouds]
        assert not any(scan.points["offset_ns"].any() for scan in loaded.scans)
        assert [len(scan.points) for scan in loaded.scans] == [int(np.isfinite(c.points["x"]).sum()) for c in clouds]
        assert [f.level for f in loaded.findings if f.code == "points.at_once"] == ["info"]
