"""What every round is made of: who is told of its progress, what is read, which columns are held."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, overload

import numpy as np
import pytest

from calib_core.errors import Cancelled, Refused
from calib_core.events import StageEvent
from calib_core.factors.lidar_plane import Gate, LidarNoise, SlicePoses, find_hits, select
from calib_core.full.joint import round as rounds
from calib_core.full.joint.policies import Sampling
from calib_core.full.joint.round import associate, coarse_stride, descend, gate_of
from calib_core.full.joint.schedule import FULL
from calib_core.full.joint.state_views import problem_of
from calib_core.full.joint.thinning import across_lasers
from calib_core.full.joint.view import View
from calib_core.settings import CalibrateSettings, ImuNoise
from calib_core.solver.levenberg import SharedEquations
from calib_core.types import Scan
from tests.core.full.joint.conftest import Half


def test_progress_is_told_from_the_callers_thread(half: Half) -> None:
    """Whoever listens need not be safe against several threads at once. Four threads work; one tells.

    Mutation: call `on_scans` in the job that the threads run.
    """
    told: list[tuple[int, float]] = []

    def listen(event: object) -> None:
        if isinstance(event, StageEvent):
            told.append((threading.get_ident(), event.fraction))

    run = replace(half.data.run, on_event=listen, threads=4)
    associate(replace(half.data, run=run), half.state, Gate(), stride=1)
    assert {thread for thread, _ in told} == {threading.get_ident()}
    assert [fraction for _, fraction in told] == sorted(fraction for _, fraction in told)


def test_a_cancel_is_heard_between_batches(half: Half) -> None:
    """Mutation: tell progress without asking."""
    run = replace(half.data.run, should_cancel=lambda: True)
    with pytest.raises(Cancelled):
        associate(replace(half.data, run=run), half.state, Gate(), stride=1)


class Unreadable(Sequence[Scan]):
    """Scans that must not be read."""

    @overload
    def __getitem__(self, place: int) -> Scan: ...
    @overload
    def __getitem__(self, place: slice) -> Sequence[Scan]: ...
    def __getitem__(self, place: int | slice) -> Scan | Sequence[Scan]:
        raise AssertionError("a scan was read")

    def __len__(self) -> int:
        return 60

    def __iter__(self) -> Iterator[Scan]:
        raise AssertionError("scans were read")


def test_the_thinning_reads_no_scan_again(half: Half) -> None:
    """How many points a scan has was seen when its clock was read. Oracle: counted here.

    Mutation: take the length of the scans' points at each call: twenty scans read from the store, thrice a piece.
    """
    scans = half.data.run.recording.scans
    run = replace(half.data.run, recording=replace(half.data.run.recording, scans=Unreadable()))
    sampling = Sampling(points=24_000, points_per_scan=(100, 4000))
    counts = [len(scans[i].points) for i in half.state.positions]
    expected = across_lasers(int(np.median(counts) // (24_000 / len(counts))))
    assert coarse_stride(replace(half.data, run=run), half.state, sampling) == expected > 1


def test_hits_near_two_planes_are_told_by_the_noise_within_bounds(half: Half) -> None:
    """By hand. Mutations: leave out either bound; measure in the gate's own sigmas."""
    sampling = Sampling()
    for range_std_m, margin_m in ((0.02, 0.16), (0.001, 0.03), (0.2, 0.3)):
        state = replace(half.state, lidar_noise=replace(half.state.lidar_noise, range_std_m=range_std_m))
        assert gate_of(state, 0.05, sampling).margin_m == pytest.approx(margin_m)


def test_next_to_a_corner_no_plane_takes_the_tail_of_anothers_noise() -> None:
    """Floor and wall seen from 1.7 m, range noise of 2 cm; which of them a ray ended on is known.

    A point given to the wrong plane is three standard deviations off its own, always to the same side.
    Mutation: `margin_sigmas` of 6 (one in 6,000).
    """
    std_m, rng, rays = 0.02, np.random.default_rng(2), 400_000
    where_m, lidar_m = rng.uniform(-0.6, 0.6, rays), np.array([1.5, 0.0, 0.8])
    on_wall = where_m > 0.0
    ends_m = np.stack([np.maximum(-where_m, 0.0), rng.uniform(-1.5, 1.5, rays), np.maximum(where_m, 0.0)], axis=1)
    ray_m = ends_m - lidar_m
    stretched = 1.0 + std_m * rng.normal(size=rays) / np.linalg.norm(ray_m, axis=1)
    still = np.zeros((1, 3))
    poses = SlicePoses(np.eye(3)[None], lidar_m[None], still, still, np.ones(1, bool))
    sampling, normals = Sampling(), np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    gate = Gate(margin_m=sampling.margin_sigmas * std_m)
    points_m = (ray_m * stretched[:, None]).astype(np.float32)
    hits = find_hits(points_m, np.full(rays, 0.001), poses, normals, np.zeros(2), gate)
    keep, _ = select(hits, LidarNoise(std_m, 0.0), gate, None)
    wrong = keep & (hits.plane != on_wall)
    assert np.count_nonzero(keep) > 0.85 * rays
    assert np.count_nonzero(wrong) < np.count_nonzero(keep) / 20_000


@pytest.mark.parametrize(
    ("settings", "held"),
    [
        (CalibrateSettings(), []),
        (CalibrateSettings(estimate_time_offset=False), ["offset"]),
        (CalibrateSettings(estimate_planes=False), ["planes"]),
    ],
)
def test_what_the_settings_hold_does_not_move(half: Half, settings: CalibrateSettings, held: list[str]) -> None:
    """Mutations: hold gravity's column for the offset's; hold all planes but the last one's offset."""
    data = replace(half.data, run=replace(half.data.run, settings=settings))
    off = replace(
        half.state.estimate,
        time_offset_s=half.state.estimate.time_offset_s + 1e-3,
        offsets_m=half.state.estimate.offsets_m + 1e-3,
        gravity=half.state.estimate.gravity + 0.01,
    )
    state = associate(data, replace(half.state, estimate=off), Gate(), stride=4)
    after, problem = descend(data, state, iterations=2, tolerance=1e-6)
    assert len(problem.frozen) == len(problem_of(data, state).frozen)
    assert (after.estimate.time_offset_s == off.time_offset_s) == ("offset" in held)
    assert (after.estimate.offsets_m == off.offsets_m).all() == ("planes" in held)
    assert not (after.estimate.offsets_m == off.offsets_m).any() or "planes" in held
    assert (after.estimate.gravity != off.gravity).any()


@pytest.mark.parametrize(("points", "held"), [(8, True), (9, False)])
def test_a_plane_that_hardly_any_point_lies_on_stays_where_it_is(half: Half, points: int, held: bool) -> None:
    """Nothing else says where it is, and a step would turn it by a radian. Others move, whose columns follow its own.

    Mutations: none held; all held; the offset free; one that nothing lies on counted.
    """
    off = replace(half.state.estimate, offsets_m=half.state.estimate.offsets_m + 1e-3)
    state = associate(half.data, replace(half.state, estimate=off), Gate(), stride=4)
    seen = state.observations
    assert seen is not None
    few = int(seen.plane[0])
    first = seen.plane != few
    first[0] = True
    count = seen.count[first].copy()
    count[0] = points
    state = replace(state, observations=replace(seen.part(first), count=count))
    after, problem = descend(half.data, state, iterations=1, tolerance=1e-6)
    columns = range(problem.layout(off).plane(few).start, problem.layout(off).plane(few).stop)
    assert set(problem.frozen) == set(columns if held else ())
    moved = np.column_stack([after.estimate.normals - off.normals, after.estimate.offsets_m - off.offsets_m])
    stays = np.abs(moved).max(axis=1) < 1e-12
    assert stays.tolist() == [held and j == few for j in range(len(stays))]


def test_what_no_plane_sees_is_decided_with_the_points_and_kept_for_the_next(
    half: Half, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A descent's own problem has it, the state after it hands it on, and the next one's is asked beside it.

    Mutations: the bins without it; the state after without it; asked beside nothing.
    """
    asked: list[tuple[int, ...]] = []

    def counts(bins: object, estimate: object, readings: object, before: tuple[int, ...]) -> tuple[int, ...]:
        asked.append(before)
        return (1, 1)

    monkeypatch.setattr("calib_core.full.joint.round.unseen_counts", counts)
    state = associate(half.data, half.state, Gate(), stride=4)
    after, problem = descend(half.data, state, iterations=1, tolerance=1e-6)
    assert problem.unseen(state.estimate).everywhere.shape == (3, 1)
    descend(half.data, after, iterations=1, tolerance=1e-6)
    assert asked == [half.state.unseen, (1, 1)]


def test_links_about_one_estimate_are_made_once_and_about_another_anew(half: Half) -> None:
    """With the priors and the frame of who asks. Mutations: what was made last given for any estimate; made each time; the priors
    of who asked first; the noise of another run left out of what it is of.
    """
    data, state = half.data, half.state
    first = problem_of(data, state)
    priors = replace(state.priors, held=())
    again = problem_of(replace(data, gauge=data.gauge + 1), replace(state, priors=priors, rounds=7))
    assert again.links is first.links
    assert again.priors is priors
    assert again.gauge_knot == data.gauge + 1
    e = state.estimate
    turned = replace(state, estimate=replace(e, gyro_bias=e.gyro_bias + 0.01))
    other = problem_of(data, turned)
    assert np.abs(other.links.DR - first.links.DR).max() > 1e-6
    np.testing.assert_array_equal(problem_of(data, state).links.DR, first.links.DR)
    density = data.run.noise.density
    twice = replace(density, gyro_rad_s_sqrt_hz=2.0 * density.gyro_rad_s_sqrt_hz)
    noisy = replace(data, run=replace(data.run, noise=replace(data.run.noise, density=twice)))
    assert np.abs(problem_of(noisy, state).links.sqrt_info - first.links.sqrt_info).max() > 0.0


@pytest.mark.parametrize("along_valleys", [False, True])
def test_a_descent_goes_along_valleys_where_it_is_asked_to(
    half: Half, monkeypatch: pytest.MonkeyPatch, along_valleys: bool
) -> None:
    """And by the equations at hand, roughly where that is asked for. Mutations: not handed on, each; always."""
    asked: list[Any] = []
    minimise = rounds.minimise

    def watched(*args: Any, **kinds: Any) -> Any:
        asked.extend(kinds[name] for name in ("along_valleys", "shared", "roughly"))
        return minimise(*args, **kinds)

    monkeypatch.setattr(rounds, "minimise", watched)
    state = associate(half.data, half.state, Gate(), stride=4)
    descend(half.data, state, iterations=1, tolerance=1e-6, along_valleys=along_valleys)
    own, *others = asked
    assert (own, others[-1]) == (along_valleys, False)
    assert isinstance(others[0], SharedEquations)
    asked.clear()
    by = SharedEquations()
    descend(half.data, state, iterations=1, tolerance=1e-6, shared=by, roughly=along_valleys)
    assert asked[1] is by
    assert asked[::2] == [False, along_valleys]


def test_a_descent_without_a_point_is_refused(half: Half) -> None:
    """Seen: a ship that rolls ended in an IndexError. Mutation: not asked."""
    state = associate(half.data, half.state, Gate(), stride=8)
    points = state.observations
    assert points is not None
    none = replace(state, observations=points.part(np.zeros(len(points.count), np.bool_)))
    with pytest.raises(Refused, match="no point lies on "):
        descend(half.data, none, iterations=1, tolerance=0.0)


def test_noise_is_told_by_so_many_points_of_a_scan(half: Half, monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutations: by all of them; by as many as a coarse round has."""
    asked: list[int] = []

    def measured(
        _view: View, _some: object, start: LidarNoise, *_: object, stride: int, range_std_m: object
    ) -> LidarNoise:
        asked.append(stride)
        assert range_std_m is None
        return start

    monkeypatch.setattr(rounds, "measure_noise", measured)
    typical = int(np.median(half.data.run.clocks.scan_points))
    for most in (typical, typical // 3, typical // 7):
        rounds.measure(half.data, half.state, Gate(), replace(FULL.sampling, noise_points=most))
    assert asked == [1, 3, 7]


def test_range_noise_that_somebody_gives_counts(half: Half) -> None:
    """Seen: `range_std_m` of a noise file was read and forgotten. Mutation: that again."""
    noise = ImuNoise(
        gyroscope_noise_density_rad_s_sqrt_hz=1e-4, accelerometer_noise_density_m_s2_sqrt_hz=1e-3, range_std_m=0.05
    )
    told = replace(half.data.run, settings=half.data.run.settings.model_copy(update={"imu_noise": noise}))
    after = rounds.measure(replace(half.data, run=told), half.state, Gate(), FULL.sampling)
    assert after.lidar_noise.range_std_m == 0.05
    assert rounds.measure(half.data, half.state, Gate(), FULL.sampling).lidar_noise.range_std_m != 0.05
