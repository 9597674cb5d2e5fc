"""A standing recording with faults, and what its truth says of them."""

from __future__ import annotations

from dataclasses import replace

from calib_core.simulate import SCENARIOS, Simulation, parse_faults, prepare

STATIC = replace(SCENARIOS["static"], noise=False, duration_s=1.0)


def made(faults: str, scenario: object = STATIC, **wishes: object) -> Simulation:
    return prepare(scenario, seed=5, faults=parse_faults(faults), **wishes)  # type: ignore[arg-type]


def truth_of(simulation: Simulation, block: str) -> dict[str, float]:
    return {each.name: each.value for each in simulation.truth.intrinsics if each.block == block}
