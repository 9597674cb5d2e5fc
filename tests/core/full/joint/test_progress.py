"""What a solve says of how far it is keeps pace with the work that it does."""

from __future__ import annotations

import numpy as np

from calib_core.calibrate import calibrate
from calib_core.events import IterationEvent, StageEvent
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import Recording


def test_the_bar_is_where_the_rounds_are(noisy: tuple[Recording, Truth]) -> None:
    """The first of many rounds do not fill half of the bar, no round fills a fifth of it, and it never goes back.

    Oracle: rounds counted. Mutations: the coarse rounds taken for six tenths, as they were; each round for half of what is left.
    """
    recording, _ = noisy
    fraction = 0.0
    told: list[float] = []
    rounds: list[int] = []

    def listen(event: object) -> None:
        nonlocal fraction
        if isinstance(event, StageEvent) and event.stage == "solve":
            assert event.fraction >= fraction
            fraction = event.fraction
        if isinstance(event, IterationEvent):
            told.append(fraction)
            rounds.append(event.round)

    calibrate(recording, CalibrateSettings(crispness=False), on_event=listen)
    after = dict(zip(rounds, told, strict=True))
    bars = np.array([after[round_] for round_ in sorted(after)])
    assert len(bars) > 7
    assert bars[2] < 0.25, "three of the many rounds are no half of the work"
    assert np.diff(bars, prepend=0.0).max() < 0.2
    assert bars[-1] > 0.7
