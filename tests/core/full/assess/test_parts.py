"""What parts of a recording answer by themselves: against each part solved alone, and on a simulated recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from calib_core.calibrate import Calibration
from calib_core.full.assess.disagreement import take_apart
from calib_core.full.assess.influence import Influences
from calib_core.full.assess.parts import own_answers
from calib_core.full.joint.state import CALIBRATION
from calib_core.full.joint.undetermined import STANDING
from calib_core.geometry import log
from calib_core.result import OwnAnswer
from calib_core.simulate import Truth
from calib_core.types import FloatArray, Recording
from tests.core.full.joint.sensor_case import Case

PARTS, OWN_UNKNOWNS, ROWS = 6, 5, 40


class _Linear:
    """Parts with residuals A_k x + B_k y_k - b_k of unit noise: x the seven, y_k known to the part alone."""

    def __init__(self, rng: np.random.Generator) -> None:
        size = 10.0 ** rng.uniform(0.0, 1.5, PARTS)
        self.A = [s * rng.normal(size=(ROWS, CALIBRATION)) for s in size]
        self.B = [rng.normal(size=(ROWS, OWN_UNKNOWNS)) for _ in range(PARTS)]
        self.b = [rng.normal(size=ROWS) for _ in range(PARTS)]

    def alone(self, k: int) -> tuple[FloatArray, FloatArray]:
        """What the part says of the seven when nothing else is known, and its covariance."""
        J = np.hstack([self.A[k], self.B[k]])
        covariance = np.linalg.inv(J.T @ J)[:CALIBRATION, :CALIBRATION]
        return np.linalg.lstsq(J, self.b[k])[0][:CALIBRATION], covariance

    def together(self) -> tuple[FloatArray, FloatArray, Influences]:
        """The joint answer, its covariance, and what each part has pulled it by."""
        width = CALIBRATION + PARTS * OWN_UNKNOWNS
        J = np.zeros((PARTS, ROWS, width))
        for k in range(PARTS):
            J[k, :, :CALIBRATION] = self.A[k]
            J[k, :, CALIBRATION + k * OWN_UNKNOWNS :][:, :OWN_UNKNOWNS] = self.B[k]
        every = J.reshape(-1, width)
        answer = np.linalg.lstsq(every, np.concatenate(self.b))[0]
        X = np.linalg.inv(every.T @ every)[:, :CALIBRATION]
        pulls = np.array([-((J[k] @ X).T @ (J[k] @ answer - self.b[k])) for k in range(PARTS)])
        allowed = np.array([(J[k] @ X).T @ (J[k] @ X) for k in range(PARTS)])
        return answer[:CALIBRATION], X[:CALIBRATION], Influences(pulls, allowed)


def test_a_part_answers_as_it_does_when_it_is_solved_alone() -> None:
    """Mutations: the shift's sign, the joint covariance on one side only, P_k where its inverse belongs."""
    case = _Linear(np.random.default_rng(0))
    joint, covariance, pulls = case.together()
    found = own_answers(pulls, covariance)
    for k in range(PARTS):
        answer, own = case.alone(k)
        sigma = np.sqrt(np.diag(own))
        np.testing.assert_allclose((joint + found.shift[k] - answer) / sigma, 0.0, atol=1e-3)
        np.testing.assert_allclose(
            found.covariance[k] / np.outer(sigma, sigma), own / np.outer(sigma, sigma), atol=1e-3
        )


@pytest.mark.parametrize("broken", [np.inf, np.nan])
@pytest.mark.parametrize("what", ["moved", "allowed"])
def test_what_comes_to_no_number_is_no_answer(what: str, broken: float) -> None:
    """A result with a reason then (`solve.broke_down`), and no defect where the document is made. Mutation: not asked."""
    _, covariance, pulls = _Linear(np.random.default_rng(0)).together()
    spoilt = getattr(pulls, what).copy()
    spoilt[2] = broken
    with np.errstate(all="ignore"), pytest.raises((ArithmeticError, np.linalg.LinAlgError)):
        own_answers(replace(pulls, **{what: spoilt}), covariance)


def test_a_part_that_says_nothing_has_the_standing_prior_and_no_shift() -> None:
    """Also of a column held fixed. Mutations: without the standing prior; the joint covariance inverted whole."""
    joint = np.diag([1e-4] * 6 + [0.0])
    allowed = np.zeros((2, 7, 7))
    allowed[0, :6, :6] = 1e-4 * np.eye(6)
    found = own_answers(Influences(np.array([[1e-2] * 6 + [0.0], [0.0] * 7]), allowed), joint)
    np.testing.assert_allclose(found.shift, [[1e-2] * 6 + [0.0], [0.0] * 7], atol=1e-6)
    np.testing.assert_allclose(np.sqrt(np.diagonal(found.covariance[1])), [57.2958] * 3 + [1e3] * 3 + [1e4], rtol=1e-4)
    assert found.covariance[0, 6, 6] == pytest.approx(1e8)


def test_chi_square_about_the_joint_answer_is_as_expected() -> None:
    """Seven are taken by the joint answer. Mutation: a part's covariance without the joint one on its right."""
    sums = []
    for seed in range(60):
        _, covariance, pulls = _Linear(np.random.default_rng(100 + seed)).together()
        found = own_answers(pulls, covariance)
        sums.append(sum(s @ np.linalg.solve(c, s) for s, c in zip(found.shift, found.covariance, strict=True)))
    expected = CALIBRATION * (PARTS - 1)
    assert abs(np.mean(sums) - expected) < 4.0 * np.sqrt(2.0 * expected / len(sums))


def _columns(parts: list[OwnAnswer]) -> tuple[FloatArray, FloatArray]:
    """Shifts and standard deviations (K, 7): deg, m, s."""
    shift = [[*p.rotation_shift_deg, *p.translation_shift_m, p.time_offset_shift_s] for p in parts]
    std = [[*p.rotation_std_deg, *p.translation_std_m, p.time_offset_std_s] for p in parts]
    return np.array(shift), np.array(std)


def test_stretches_of_a_recording_answer_as_the_whole_does_within_their_bars(
    noisy: tuple[Recording, Truth], calibrated: Calibration
) -> None:
    """Of eight stretches of a simulated recording, against its truth; the whole is better known than any.

    Planes, biases and gravity are common to all stretches and take some of the 49: 22 to 49 are left, and the law's
    ends are passed once in a thousand. Mutations: UNITS left out, bars half as long or twice, each stretch with the bins of
    the one before.
    """
    result, truth = calibrated.result, noisy[1]
    assert result.evidence is not None
    assert result.T_imu_lidar is not None
    assert result.uncertainty is not None
    blocks = result.evidence.parts.time_blocks
    shift, std = _columns(list(blocks))
    assert chi2.ppf(0.001, 22) < np.sum((shift / std) ** 2) < chi2.ppf(0.999, 49)
    T = np.array(result.T_imu_lidar.matrix)
    off = [np.degrees(log(truth.R_imu_lidar.T @ T[:3, :3])), T[:3, 3] - truth.p_imu_lidar]
    late_s = ((result.time_offset_ns or 0) - truth.time_offset_ns) * 1e-9
    away = (shift + np.concatenate([*off, [late_s]])) / std
    assert np.abs(away).max() < 4.3  # one of 56 in a thousand
    assert np.mean(away**2) > 0.3
    joint = np.concatenate(
        [
            result.uncertainty.rotation_std_deg,
            result.uncertainty.translation_std_m,
            [result.uncertainty.time_offset_std_s],
        ]
    )
    assert (std > joint).all()
    assert (std.min(axis=0) < 5.0 * joint).all()
    # It stands still for a second: the first stretch knows the least of the clocks, by what a gyroscope at rest tells of itself.
    assert std[0, 6] == std[:, 6].max() > 3.0 * np.median(std[:, 6])
    # Each parameter by itself: no more than a diagonal's worth of the weights, but near.
    mean = np.sum(shift / std**2, axis=0) / np.sum(std**-2.0, axis=0)
    assert np.abs(mean * np.sqrt(np.sum(std**-2.0, axis=0))).max() < 2.5
    starts = [block.t_start_s for block in blocks]
    np.testing.assert_allclose(starts[1:], [block.t_end_s for block in blocks[:-1]], atol=1e-3)
    assert abs(starts[0]) < 0.1
    assert abs(blocks[-1].t_end_s - 6.0) < 0.2


def test_planes_and_ranges_answer_too(calibrated: Calibration) -> None:
    """Mutations: planes that no point lies on left out of the count, the middle range for the farthest."""
    result = calibrated.result
    assert result.evidence is not None
    parts = result.evidence.parts
    assert [part.name for part in parts.planes] == [plane.name for plane in result.quality.planes]
    for part in (list(parts.planes), list(parts.ranges)):
        shift, std = _columns(part)
        assert np.abs(shift / std).max() < 4.3
    near, far = parts.ranges
    assert 0.3 < near.from_m < near.to_m == far.from_m < far.to_m < 20.0


def test_a_plane_that_nothing_is_seen_of_answers_nothing() -> None:
    """Mutation: planes numbered as they appear among the bins, or by another order."""
    case = Case(1)
    bins = case.problem.bins
    for unseen in range(len(case.estimate.normals)):
        mine = bins.plane == unseen
        lasers = mine[bins.lasers.bin]
        gone = replace(
            bins,
            scatter=np.where(mine[:, None, None], 0.0, bins.scatter),
            lasers=replace(
                bins.lasers,
                cross=np.where(lasers[:, None, None], 0.0, bins.lasers.cross),
                gram=np.where(lasers[:, None], 0.0, bins.lasers.gram),
                grams=np.where((bins.lasers.of_plane == unseen)[:, None, None], 0.0, bins.lasers.grams),
            ),
        )
        apart = take_apart(replace(case.problem, bins=gone), case.estimate)
        own = own_answers(apart.clusters["planes"], apart.covariance)
        std = np.sqrt(np.diagonal(own.covariance, axis1=1, axis2=2))
        np.testing.assert_allclose(std[unseen], STANDING)
        assert (np.delete(std, unseen, axis=0) < 0.5 * STANDING).any(axis=1).all()
