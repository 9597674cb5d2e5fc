"""Runs of faults, drawn."""

from __future__ import annotations

import numpy as np

from bench.fault_runs import FaultRun

ORDER = ["rx", "ry", "rz", "tx", "ty", "tz", "dt"]


def drawn(shift: float = 0.0, scale: float = 1.0, n: int = 200) -> list[FaultRun]:
    """Runs whose errors have the stated sigmas, but for a shift along ty and a factor."""
    rng = np.random.default_rng(3)
    stds = np.array([1e-4, 2e-4, 3e-4, 1e-3, 2e-3, 3e-3, 1e-5])
    runs = []
    for seed in range(n):
        scaled = scale * rng.standard_normal(7) + shift * np.eye(7)[4]
        runs.append(
            FaultRun(
                *("handheld", "industrial", 30.0, "", "test"),
                seed,
                "calibrated",
                "",
                tuple(scaled * stds),
                tuple(stds),
                float(scaled @ scaled),
                1.0,
            )
        )
    return runs
