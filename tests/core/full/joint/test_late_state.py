"""What shows only at a solve's end, among the unknowns of its state."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from calib_core.full.assess import late_parameters
from calib_core.full.assess.late_parameters import Told
from calib_core.full.joint.estimation import Estimation
from calib_core.full.joint.sensor_state import SensorState
from calib_core.full.prepare.nuisance import LATE, Nuisance
from calib_core.intrinsics import Block
from tests.core.full.joint.conftest import Half


@dataclass(frozen=True)
class Ended:
    """A solve's end, as far as it is asked."""

    state: Estimation

    @property
    def nuisance(self) -> Nuisance:
        return self.state.nuisance


def test_a_block_that_is_among_the_unknowns_stays_as_it_is_known(half: Half) -> None:
    """And others do. Seen: values of it twice, and of two recordings in fifty a defect at the end of the solve.

    Mutations: its values once more; zeros in their place; those of another.
    """
    state = half.state
    for k, block in enumerate(LATE):
        state = late_parameters.with_late(state, block, 1e-4)
        values = state.estimate.sensors.values.copy()
        values[state.nuisance.places[block]] = 1.0 + k
        state = replace(state, estimate=replace(state.estimate, sensors=SensorState(state.nuisance, values)))
    for again in LATE:
        state = late_parameters.with_late(state, again, 2e-4)
        np.testing.assert_array_equal(state.nuisance.values(state.nuisance.prior_std, again), 2e-4)
        for k, block in enumerate(LATE):
            np.testing.assert_array_equal(state.estimate.sensors.of(block), 1.0 + k)


@pytest.mark.parametrize("shows", [("low_pass_spread",), ("low_pass_spread", "low_pass_skew"), LATE])
def test_whatever_shows_at_once_the_state_is_whole(
    half: Half, monkeypatch: pytest.MonkeyPatch, shows: tuple[Block, ...]
) -> None:
    """A skew is let go with its spread, and by itself. Mutation: the values of a block that is there twice."""

    def told(
        _: object, stds: dict[Block, float], asked: list[Block], *, lasers_follow: bool = True
    ) -> dict[Block, Told | None]:
        return {
            block: Told(np.full(3, stds[block]), np.full(3, 1e-3 * stds[block])) for block in asked if block in shows
        }

    monkeypatch.setattr(late_parameters, "late_told", told)
    after = late_parameters.with_late_blocks(half.data.run, Ended(half.state), ())  # type: ignore[arg-type]
    assert after is not None
    state = after.state
    assert {*shows, "low_pass_skew"} <= set(state.nuisance.places)
    assert (state.estimate.sensors.values == 0.0).all()
