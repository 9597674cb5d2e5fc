"""What one laser says against the others: a laser that reads long is found by its ring, and nothing is where none does."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from calib_core.api import calibrate
from calib_core.full import attempts
from calib_core.full.assess.confidence import Confidence
from calib_core.full.assess.verdict import weigh
from calib_core.full.joint import by_laser as room
from calib_core.full.joint.by_laser import ByLaser, by_laser
from calib_core.full.joint.estimation import Solved
from calib_core.full.run import Run
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import Recording, Scan

LONG_RING, LONG_M = 5, 0.04


def _long(scan: Scan) -> Scan:
    """One ring reads long."""
    points = scan.points.copy()
    mine = points["ring"] == LONG_RING
    xyz = points["xyz"][mine].astype(np.float64)
    points["xyz"][mine] = xyz * (1.0 + LONG_M / np.linalg.norm(xyz, axis=1, keepdims=True))
    return replace(scan, points=points)


def _nameless(scan: Scan) -> Scan:
    """Without a ring field readers leave zeros."""
    points = scan.points.copy()
    points["ring"] = 0
    return replace(scan, points=points)


@dataclass
class Weighed:
    """The end of a solve and what is thought of it. said: codes and texts."""

    solved: Solved
    trust: Confidence
    said: dict[str, str]

    def pulls(self) -> dict[str, bool]:
        """Whether each way of taking it apart is beyond noise."""
        return {each.name: each.is_beyond_noise for each in self.trust.found}


def weighed(recording: Recording, intrinsics: Any, **more: Any) -> Weighed:
    """A solve, watched as it is weighed."""
    kept: list[tuple[Solved, Confidence]] = []

    def watched(run: Run, solved: Solved, *, is_choice: bool) -> Confidence:
        trust = weigh(run, solved, is_choice=is_choice)
        kept.append((solved, trust))
        return trust

    settings = CalibrateSettings(intrinsics=intrinsics, crispness=False, **more)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(attempts, "weigh", watched)
        result = calibrate(recording, settings).result
    return Weighed(*kept[-1], {message.code: message.text for message in result.messages})


@pytest.fixture(scope="module")
def ideal(noisy: tuple[Recording, Truth]) -> Weighed:
    """Lasers taken for ideal, which they are."""
    return weighed(noisy[0], "off")


@pytest.fixture(scope="module")
def spoilt(noisy: tuple[Recording, Truth]) -> Weighed:
    """Taken for ideal, and one is not."""
    return weighed(replace(noisy[0], scans=[_long(scan) for scan in noisy[0].scans]), "off")


def test_a_laser_that_reads_long_disagrees_with_the_others(ideal: Weighed, spoilt: Weighed) -> None:
    """Mutations: lasers no way of taking a recording apart; another ring's points in a cluster; the pulls' sign alone kept."""
    assert spoilt.pulls()["lasers"]
    assert "lasers that read short or long" in spoilt.said["solve.disagreement"]
    lasers, joint = spoilt.trust.apart.clusters["lasers"], spoilt.trust.apart.covariance
    squares = np.einsum("ki,ij,kj->k", lasers.moved, np.linalg.inv(joint), lasers.moved)
    assert int(np.argmax(squares)) == LONG_RING
    (beyond,) = (each for each in spoilt.trust.found if each.name == "lasers")
    # Widened along what the laser pulls at, and by about as much: its own pull is there and not in the noise's.
    pull = lasers.moved[LONG_RING]
    assert pull @ np.linalg.solve(joint, beyond.excess) @ np.linalg.solve(joint, pull) > 0.5 * squares[LONG_RING] ** 2
    assert not any(ideal.pulls().values())
    assert "solve.disagreement" not in ideal.said
    assert len(ideal.trust.apart.clusters["lasers"].moved) == 16


def test_the_budget_of_a_solve_is_what_its_answer_states(ideal: Weighed, spoilt: Weighed) -> None:
    """Where nothing was given and nothing is open. Mutations: what parts disagree about left out of either; noise twice."""
    for each, there in ((ideal, ["noise"]), (spoilt, ["noise", "disagreement"])):
        budget, covariance = each.trust.budget, each.trust.knowledge.covariance
        assert [part.name for part in budget.parts if part.is_there] == there
        size = np.sqrt(np.diag(covariance))
        np.testing.assert_allclose(budget.total / size / size[:, None], covariance / size / size[:, None], atol=1e-4)


def test_lasers_told_apart_afterwards_have_the_points_of_the_solve(
    ideal: Weighed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All lasers' together are the bins', as they were laid out last and laid out once more. Mutations: another gate; a part of
    the scans twice, or left out; the lasers' numbers one on.
    """
    again = replace(ideal.solved, observations=replace(ideal.solved.observations, apart=None))
    assert ideal.solved.observations.apart is not None
    for solved in (ideal.solved, again):
        lasers_are_the_bins(solved, list(by_laser(solved)))
    # A scan has some sixty knots and planes of sixteen lasers each.
    for clusters, at_least in ((10, len(ideal.solved.state.positions)), (5000, 3)):
        monkeypatch.setattr(room, "SURVEYING", replace(room.SURVEYING, clusters=clusters))
        parts = list(by_laser(ideal.solved))
        assert at_least <= len(parts) <= len(ideal.solved.state.positions)
        lasers_are_the_bins(ideal.solved, parts)


def lasers_are_the_bins(solved: Solved, parts: list[ByLaser]) -> None:
    """And each laser's weight is its share of the points."""
    bins = solved.problem.bins
    planes = len(solved.estimate.normals)
    total = np.zeros((len(solved.problem.readings.knots_s) * planes, 5))
    weight = np.zeros(16)
    for part in parts:
        own = part.factors.bins
        sums = own.lasers.cross[:, 0] + (own.lasers.cross[:, 4].astype(float) if own.lasers.features > 1 else 0.0)
        R, p = own.lasers.R[own.lasers.pose], own.lasers.p[own.lasers.pose]
        sums[:, :3] = np.einsum("bij,bj->bi", R, sums[:, :3]) + sums[:, 3:4] * p
        np.add.at(total, (own.knot * planes + own.plane)[own.lasers.bin], sums)
        weight += np.bincount(own.lasers.laser, sums[:, 3], 16)
    mine = total[bins.knot * planes + bins.plane]
    np.testing.assert_allclose(mine, bins.scatter[:, 3], rtol=1e-4, atol=1e-4 * np.abs(bins.scatter[:, 3]).max())
    assert total.sum() == pytest.approx(mine.sum())
    # A ring's share of the weight is that of its points, counted by themselves.
    rings = np.bincount(np.concatenate([scan.points["ring"] for scan in solved.data.run.recording.scans]), minlength=16)
    np.testing.assert_allclose(weight / weight.sum(), rings / rings.sum(), rtol=0.5)


def test_a_recording_that_names_no_laser_has_no_such_way(noisy: tuple[Recording, Truth], ideal: Weighed) -> None:
    """And is answered as it was. Mutations: a single laser as a way of its own; points laid out once more all the same."""
    recording = replace(noisy[0], scans=[_nameless(scan) for scan in noisy[0].scans])
    nameless = weighed(recording, "off")
    assert "lasers" not in nameless.pulls()
    assert list(by_laser(nameless.solved)) == []
    np.testing.assert_array_equal(nameless.trust.knowledge.covariance, ideal.trust.knowledge.covariance)


def test_nothing_is_laid_out_again_but_what_was_not_laid_out_by_laser(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where lasers are unknowns their moments are the solve's own; where an IMU's scale alone is unknown, they were summed beside
    it; where points are capped, they were not. Mutations: always laid out again; never.
    """
    asked: list[int] = []
    laid = room.associate

    def counted(*args: Any, **kinds: Any) -> Any:
        asked.append(1)
        return laid(*args, **kinds)

    monkeypatch.setattr(room, "associate", counted)
    told = weighed(noisy[0], ("laser_range_offset",))
    assert "lasers" in told.pulls()
    assert asked == []
    other = weighed(noisy[0], ("gyroscope_scale",))
    assert "lasers" in other.pulls()
    assert asked == []
    capped = weighed(noisy[0], "off", points_per_plane_per_scan=10**9)
    assert "lasers" in capped.pulls()
    assert len(asked) > 0
    assert not any(pull for each in (told, other, capped) for pull in each.pulls().values())
