"""Problems whose minimum, and whose way of failing, are known."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from calib_core.solver.arrow import ArrowSolution
from calib_core.solver.system import ArrowSystem
from calib_core.types import FloatArray

#: Sends the descent of the valley through a wall.
FORBIDDEN = -0.5


@dataclass
class Valley:
    """Rosenbrock's valley, r = [10 (y - x^2), 1 - x]: x in the chain, y on the border. The minimum is at (1, 1)."""

    asked: list[FloatArray] = field(default_factory=list)

    def residual(self, e: FloatArray) -> FloatArray:
        return np.array([10.0 * (e[1] - e[0] ** 2), 1.0 - e[0]])

    def cost(self, estimate: FloatArray) -> float:
        self.asked.append(estimate)
        if estimate[1] < FORBIDDEN:
            return float("nan")
        return 0.5 * float(np.sum(self.residual(estimate) ** 2))

    def linearise(self, estimate: FloatArray) -> ArrowSystem:
        J = np.array([[-20.0 * estimate[0], 10.0], [-1.0, 0.0]])
        H, g = J.T @ J, J.T @ self.residual(estimate)
        return ArrowSystem(H[:1, :1][None], np.zeros((0, 1, 1)), H[:1, 1:][None], H[1:, 1:], g[:1][None], g[1:])

    def moved(self, estimate: FloatArray, solution: ArrowSolution) -> FloatArray:
        return estimate + np.array([solution.step[0, 0], solution.step_shared[0]])


class Bowl(Valley):
    """r = [3 x + y - 4, x - y], with a curvature claimed to be ten times too small: every full step overshoots."""

    def residual(self, e: FloatArray) -> FloatArray:
        return np.array([3.0 * e[0] + e[1] - 4.0, e[0] - e[1]])

    def linearise(self, estimate: FloatArray) -> ArrowSystem:
        J = np.array([[3.0, 1.0], [1.0, -1.0]])
        H, g = 0.1 * J.T @ J, J.T @ self.residual(estimate)
        return ArrowSystem(H[:1, :1][None], np.zeros((0, 1, 1)), H[:1, 1:][None], H[1:, 1:], g[:1][None], g[1:])


class Trade(Valley):
    """r = [1e4 (y - x) - 1.5 x^2, x - 2]: x and y trade with one another, x is held by a hundred-millionth of its curvature."""

    stiff, bend = 1e4, 1.5

    def residual(self, e: FloatArray) -> FloatArray:
        return np.array([self.stiff * (e[1] - e[0]) - self.bend * e[0] ** 2, e[0] - 2.0])

    def linearise(self, estimate: FloatArray) -> ArrowSystem:
        J = np.array([[-self.stiff - 2.0 * self.bend * estimate[0], self.stiff], [1.0, 0.0]])
        H, g = J.T @ J, J.T @ self.residual(estimate)
        return ArrowSystem(H[:1, :1][None], np.zeros((0, 1, 1)), H[:1, 1:][None], H[1:, 1:], g[:1][None], g[1:])
