"""What a campaign's runs amount to: root mean squares, efficiency, consistency. Pure functions of the runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, norm

from bench.bounds import BoundRow
from bench.runs import PARAMETERS, Run, rms

FREEDOM = len(PARAMETERS)
_HALF_95 = float(norm.ppf(0.975))
#: A largest mean error beyond this, in its own sigmas, comes once in a hundred campaigns whose seven are all without bias.
BIAS_SIGMAS = float(norm.ppf(1.0 - 0.005 / FREEDOM))


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Root mean squares over the solved runs of the norms of eq. (15)."""

    rotation_deg: float
    translation_mm: float
    offset_ms: float

    def over(self, other: Accuracy) -> Accuracy:
        """Ratio by ratio."""
        return Accuracy(
            self.rotation_deg / other.rotation_deg,
            self.translation_mm / other.translation_mm,
            self.offset_ms / other.offset_ms,
        )


@dataclass(frozen=True, slots=True)
class Consistency:
    """Whether the stated covariance is true.

    mean_nees, with the 99 % interval that the mean of as many chi-square draws lies in.   coverage: (7,) share of runs
    whose 95 % interval holds the truth.   pooled: over all parameters.
    """

    mean_nees: float
    low: float
    high: float
    coverage: tuple[float, ...]
    pooled: float
    bias: tuple[float, ...]

    @property
    def bias_text(self) -> str:
        """The largest mean error, and whether it is one."""
        return bias_text(self.bias)

    @property
    def nees_holds(self) -> bool:
        """The mean lies in its interval."""
        return self.low <= self.mean_nees <= self.high

    @property
    def coverage_holds(self) -> bool:
        """92 to 98 % pooled, and at least 87 % for each parameter."""
        return 0.92 <= self.pooled <= 0.98 and min(self.coverage) >= 0.87


def accuracy(runs: Sequence[Run]) -> Accuracy:
    """Of the solved among them."""
    solved = [run for run in runs if run.is_solved]
    return Accuracy(
        rms([run.e_R_deg for run in solved]), rms([run.e_p_mm for run in solved]), rms([run.e_dt_ms for run in solved])
    )


def stated(runs: Sequence[Run]) -> Accuracy:
    """What the runs' own sigmas let one expect of `accuracy`."""
    variance = np.mean([np.square(run.stds) for run in runs if run.is_solved], axis=0)
    return Accuracy(
        float(np.degrees(np.sqrt(variance[:3].sum()))),
        float(1e3 * np.sqrt(variance[3:6].sum())),
        float(1e3 * np.sqrt(variance[6])),
    )


def bound_accuracy(bound: BoundRow) -> Accuracy:
    """The bound in the same form."""
    return Accuracy(bound.rotation_deg, bound.translation_mm, bound.offset_ms)


def consistency(runs: Sequence[Run]) -> Consistency:
    """Of the solved among them."""
    solved = [run for run in runs if run.is_solved]
    n = len(solved)
    low, high = chi2.ppf([0.005, 0.995], FREEDOM * n) / n
    inside = np.array([np.abs(run.errors) <= _HALF_95 * np.array(run.stds) for run in solved])
    return Consistency(
        float(np.mean([run.nees for run in solved])),
        float(low),
        float(high),
        tuple(float(share) for share in inside.mean(axis=0)),
        float(inside.mean()),
        mean_errors([run.errors for run in solved], [run.stds for run in solved]),
    )


def mean_errors(errors: Sequence[Sequence[float]], stds: Sequence[Sequence[float]]) -> tuple[float, ...]:
    """(7,) mean of the errors over their stated sigmas, in sigmas of such a mean: standard normal without bias.

    What is wrong alike in every run hardly shows in the mean square; here it grows with the root of their number.
    """
    scaled = np.array(errors) / np.array(stds)
    return tuple(float(value) for value in scaled.mean(axis=0) * np.sqrt(len(scaled)))


def bias_text(bias: Sequence[float]) -> str:
    """The largest of the seven, and whether it is beyond chance."""
    at = int(np.argmax(np.abs(bias)))
    return f"{PARAMETERS[at]} {bias[at]:+.1f}" + ("" if abs(bias[at]) <= BIAS_SIGMAS else " **biased**")


def paired(spoiled: Sequence[Run], clean: Sequence[Run]) -> tuple[list[Run], list[Run]]:
    """The runs of both whose seeds were solved in both, in the order of the seeds."""
    a = {run.seed: run for run in spoiled if run.is_solved}
    b = {run.seed: run for run in clean if run.is_solved}
    seeds = sorted(a.keys() & b.keys())
    return [a[seed] for seed in seeds], [b[seed] for seed in seeds]


def those_solved(*campaigns: Sequence[Run]) -> list[list[Run]]:
    """Those of each campaign that ended with an answer."""
    return [[run for run in runs if run.is_solved] for runs in campaigns]


def seeds_text(seeds: Sequence[int]) -> str:
    """`1-5, 8` from numbers in any order."""
    parts: list[list[int]] = []
    for seed in sorted(set(seeds)):
        if parts and seed == parts[-1][-1] + 1:
            parts[-1].append(seed)
        else:
            parts.append([seed])
    return ", ".join(f"{part[0]}-{part[-1]}" if len(part) > 1 else str(part[0]) for part in parts) or "none"
