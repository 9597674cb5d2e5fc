"""A small joint problem at its solution."""

from __future__ import annotations

from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.state import Estimate
from calib_core.solver.levenberg import minimise
from tests.core.full.joint.sensor_case import Case


def solved_problem() -> tuple[JointProblem, Estimate]:
    """A small problem at its optimum; where points hardly fit, that is far from nothing."""
    case = Case(1)
    return case.problem, minimise(case.problem, case.estimate, max_iterations=2000, tolerance=1e-14).estimate
