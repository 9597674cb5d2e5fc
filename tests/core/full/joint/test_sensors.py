"""The sensors' own parameters in the joint problem: every residual written out point by point, and differenced numerically."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.full.joint.priors import prior_rows
from calib_core.full.joint.sensor_state import SensorState
from calib_core.full.joint.sensors import sensor_columns
from calib_core.full.prepare import settings
from calib_core.full.prepare.nuisance import SURFACE, Nuisance
from calib_core.imu import tones as imu_tones
from calib_core.imu.preintegration import preintegrate
from calib_core.imu.tones import attitudes, tone_columns
from calib_core.intrinsics import UNKNOWN_LIDAR
from calib_core.solver.arrow import solve_arrow
from calib_core.solver.system import ArrowSystem
from tests.core.full.joint import misfit_problem as plain
from tests.core.full.joint.sensor_case import (
    BENT,
    BENT_MADE,
    IMU,
    MADE,
    NUISANCE,
    ROOT_WEIGHT,
    Case,
    written_out,
)

AZIMUTH_TOGETHER = settings.LASERS.azimuth_together


@pytest.mark.parametrize("nuisance", [NUISANCE, BENT, BENT_MADE])
def test_parts_and_the_borders_columns_are_those_of_the_whole(nuisance: Nuisance) -> None:
    """As without sensors (test_problem.py). Mutations: a part's clusters counted from the first of all; what lasers share with
    one another in each part too; a parameter's column off by the nodes that a part has not; lasers left out of the border times
    columns, or the IMU's parameters, or the clocks' rate; and of the gradient alone.
    """
    case = Case(1, nuisance)
    equations = case.problem.linearise(case.estimate)
    whole = ArrowSystem.of(equations)
    corner, shared = equations.common()
    for first, last in ((0, 3), (3, plain.KNOTS)):
        part = equations.part(first, last)
        border = np.zeros((last - first, 9, whole.shared))
        border[:, :, part.columns] = part.border
        corner[np.ix_(part.columns, part.columns)] += part.corner
        shared[part.columns] += part.gradient_shared
        np.testing.assert_allclose(border, whole.border[first:last], atol=1e-12 * np.abs(whole.border).max())
        expected = whole.gradient[first:last]
        np.testing.assert_allclose(part.gradient, expected, atol=1e-12 * np.abs(expected).max())
    np.testing.assert_allclose(corner, whole.corner, atol=1e-12 * np.abs(whole.corner).max())
    np.testing.assert_allclose(shared, whole.gradient_shared, atol=1e-12 * np.abs(whole.gradient_shared).max())
    columns = np.random.default_rng(6).normal(size=(whole.shared, 2))
    columns *= (1.0 / np.sqrt(np.diag(whole.corner)))[:, None]
    expected = whole.border @ columns
    np.testing.assert_allclose(equations.border_times(columns), expected, atol=1e-12 * np.abs(expected).max())
    along = np.random.default_rng(7).normal(size=(plain.KNOTS, 9))
    unit = 1.0 / np.sqrt(np.diag(whole.corner))
    for moved in (None, along):
        expected, found = whole.pulls(moved), equations.pulls(moved)
        if moved is None:
            np.testing.assert_allclose(found[0], expected[0], atol=1e-12 * np.abs(expected[0]).max())
        np.testing.assert_allclose(unit * found[1], unit * expected[1], atol=1e-11 * np.abs(unit * expected[1]).max())


@pytest.mark.parametrize("nuisance", [NUISANCE, BENT])
def test_lasers_that_are_held_have_no_columns_and_are_what_they_are(nuisance: Nuisance) -> None:
    """The step of all else is that of the whole system without their rows and columns: what they changed before is in it.

    Mutations: the columns held counted from the first of all shared ones; of held lasers no change; nobody's held.
    """
    case = Case(1, nuisance)
    layout, places = case.problem.layout(case.estimate), np.unique(case.problem.sensors.laser_places)
    frozen = layout.nuisance().start + places[places >= 0]
    held = replace(case.problem, frozen=tuple(frozen.tolist())).linearise(case.estimate)
    assert not held.part(0, plain.KNOTS).border[:, :, frozen].any()
    H, g = written_out(case)
    unit = 1.0 / np.sqrt(np.diag(H))
    free = np.setdiff1d(np.arange(len(g)), plain.KNOTS * 9 + frozen)
    step = np.zeros(len(g))
    step[free] = unit[free] * np.linalg.solve(unit[free, None] * H[np.ix_(free, free)] * unit[free], -(unit * g)[free])
    solution = solve_arrow(held)
    found = np.concatenate([solution.step.ravel(), solution.step_shared])
    np.testing.assert_allclose(found / unit, step / unit, atol=1e-6 * np.abs(step / unit).max())


@pytest.mark.parametrize(("seed", "nuisance"), [(0, NUISANCE), (1, NUISANCE), (0, BENT), (0, MADE), (0, BENT_MADE)])
def test_normal_equations_are_those_of_single_points_with_their_lasers(seed: int, nuisance: Nuisance) -> None:
    """Mutations: the incidence's feature read for the scale's column, grazing's for the eccentricity's, the rate's lever
    without the middle, a parameter's
    change left out of the gradient, the gyroscope's columns exchanged with the accelerometer's; a height with the other sign, its
    corner exchanged with another, or without what two heights share; a material read for another plane's, in a square or in none,
    or for the range's feature."""
    case = Case(seed, nuisance)
    r, J = case.stacked(case.estimate), case.numerical_jacobian()
    assert case.problem.cost(case.estimate) == pytest.approx(0.5 * r @ r, rel=1e-9)
    H, g = written_out(case)
    # What keeps the frame in place is no residual.
    H -= plain.frame_held(case.problem, case.estimate)
    unit = 1.0 / np.linalg.norm(J, axis=0)
    np.testing.assert_allclose(unit[:, None] * H * unit, unit[:, None] * (J.T @ J) * unit, atol=3e-4)
    np.testing.assert_allclose(unit * g, unit * (J.T @ r), atol=3e-4 * np.abs(unit * g).max())


def test_bins_know_of_what_their_lasers_have_changed() -> None:
    """Mutation: `sums` or `squares` without the lasers' part."""
    case = Case(3)
    links = len(case.problem.links.DR) * 9
    r = case.stacked(case.estimate)[links : links + len(case.pair)]
    bins = len(case.problem.bins.plane)
    np.testing.assert_allclose(
        case.problem.lidar.sums(case.estimate), np.bincount(case.pair, ROOT_WEIGHT * r, bins), rtol=1e-9, atol=1e-8
    )
    of_planes = np.bincount(case.problem.bins.plane[case.pair], r**2, len(case.estimate.normals))
    np.testing.assert_allclose(case.problem.lidar.squares(case.estimate), of_planes, rtol=1e-9)


def test_an_ideal_pair_of_sensors_adds_no_column() -> None:
    """Mutation: a column for the clocks' rate whatever the blocks."""
    problem, e = plain.problem_of(0)
    assert problem.layout(e).size == plain.LAYOUT.size
    assert problem.lidar.bins_seen(e)[1].shape[2] == 19


def test_heights_that_are_correlated_cost_what_their_covariance_says() -> None:
    """By the inverse of that covariance. Mutations: each height beside the others as well; the whitener's transpose."""
    case = Case(3, BENT)
    problem, e = case.problem, case.estimate
    at = BENT.places[SURFACE]
    heights, others = e.sensors.values[at], np.delete(e.sensors.values, at)
    covariance = 0.003**2 * np.exp(-0.8 / 2.0 * np.array([[0.0, 1.0], [1.0, 0.0]]))
    expected = heights @ np.linalg.inv(covariance) @ heights
    expected += float(np.sum((others / np.delete(case.nuisance.prior_std, at)) ** 2))
    azimuths = e.sensors.of("laser_azimuth") / UNKNOWN_LIDAR.laser_elevation_std_rad
    expected += len(azimuths) * float(azimuths.mean() ** 2) * (AZIMUTH_TOGETHER**-2 - 1.0)  # beside what is alone
    layout, without = problem.layout(e), replace(e, sensors=SensorState())
    rest, _ = prior_rows(problem.priors, problem.nodes, without, problem.layout(without))
    residual, jacobian = prior_rows(problem.priors, problem.nodes, e, layout)
    assert residual @ residual - rest @ rest == pytest.approx(expected, rel=1e-9)
    assert len(residual) == len(rest) + BENT.size
    own = jacobian[:, -2:]
    np.testing.assert_allclose(np.linalg.inv(own.T @ own), covariance, rtol=1e-9)


def test_columns_are_the_same_link_by_link_in_parts_and_as_what_a_change_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the IMU's own parameters and of two tones. Oracle: columns of all links at once, times the change.

    Mutations: the tones' attitudes of other links; their columns before the others; what the gyroscope feels of forces left out
    of a change; the last links left out.
    """
    base, e = plain.problem_of(1)
    nuisance = NUISANCE.with_tone(1.4, 0.1, 0.02).with_tone(3.0, 0.1, 0.02)
    rng = np.random.default_rng(4)
    sensors = SensorState(nuisance, 1e-2 * rng.normal(size=nuisance.size))
    columns = sensor_columns(sensors, base.readings, e.states.R, 0.0)
    links, change = plain.KNOTS - 1, rng.normal(size=len(columns.imu_places))
    whole = columns.of_links(0, links)
    monkeypatch.setattr(imu_tones, "_AT_ONCE", links - 1)
    for k, values in enumerate(columns.biases(change)):
        np.testing.assert_allclose(values, whole[k] @ change, rtol=1e-9, atol=1e-9 * np.abs(whole[k]).max())
        parts = [columns.of_links(first, min(first + 2, links))[k] for first in range(0, links, 2)]
        np.testing.assert_array_equal(np.concatenate(parts), whole[k])
        assert whole[k].shape == (links, 3, len(change))
    at = attitudes(base.readings, e.states.R, 0.02)
    np.testing.assert_allclose(whole[0][..., -25:], tone_columns(3.0, sensors.tones()[1], at)[:, :3], rtol=1e-12)


def test_links_integrated_anew_agree_with_their_columns() -> None:
    """Mutations: `links_at` of another linearisation; the delay's column with the other sign."""
    _, e = plain.problem_of(1)
    base = plain.problem_of(1)[0]
    columns = sensor_columns(SensorState().onto(NUISANCE), base.readings, e.states.R, 0.0)
    assert columns.imu_places.tolist() == list(range(IMU))
    assert (columns.links_at.values == 0.0).all()
    problem, late = replace(base, sensors=columns), np.zeros(NUISANCE.size)
    late[NUISANCE.start("accelerometer_delay")] = 1e-4
    gyro, accel = problem.bias_changes(replace(e, sensors=SensorState(NUISANCE, late)))
    np.testing.assert_allclose(gyro, 0.0, atol=1e-12)
    slope = np.diff(base.readings.knot_accel, axis=0) / base.readings.spacing_s
    np.testing.assert_allclose(accel, -1e-4 * slope, atol=1e-12)
    assert preintegrate(base.readings, gyro, accel, plain.DENSITY).DR.shape == (plain.KNOTS - 1, 3, 3)
