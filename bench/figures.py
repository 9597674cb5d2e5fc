"""What is asked of the estimator, as data: the figures that accuracy.md is judged by."""

from __future__ import annotations

from dataclasses import dataclass

from bench.statistics import Accuracy


@dataclass(frozen=True, slots=True)
class Asked:
    """A scenario's figures. over_bound: the most that rms / bound may be (rotation, translation, offset).

    at_most: the most that the rms itself may be; an infinite one is not asked.   is_consistent: NEES and coverage asked.
    like_bound: the bound in a like room, as a landmark.
    """

    scenario: str
    over_bound: Accuracy | None = None
    at_most: Accuracy | None = None
    is_consistent: bool = False
    like_bound: Accuracy | None = None


_ANY = float("inf")
ASKED: dict[str, Asked] = {
    each.scenario: each
    for each in (
        Asked("paper-normal", Accuracy(1.15, 1.15, 1.25), None, True, Accuracy(0.0066, 0.72, 0.016)),
        Asked("paper-fast", Accuracy(1.15, 1.15, 1.25), None, True, Accuracy(0.0031, 0.18, 0.0026)),
        Asked("handheld", Accuracy(1.3, 1.3, 1.3), None, True, Accuracy(0.0042, 0.34, 0.0095)),
        Asked("partial-views", Accuracy(1.3, 1.3, 1.3)),
        # A tenth of the paper's table I (i).
        Asked("noise-free", at_most=Accuracy(0.0016, 0.057, _ANY)),
        Asked("noise-free-fast", at_most=Accuracy(0.0013, 0.095, _ANY)),
    )
}

#: Spoiled data and its clean twin: the same seed gives both the same noise.
TWINS = {"walking-person": "paper-normal", "outliers": "paper-normal", "imu-faults": "paper-normal"}
TWIN_AT_MOST = 1.5
#: Of their own sigmas, on every parameter, for starts from anywhere; of the cost, against a start from the truth.
START_SIGMAS = 5.0
START_COST = 1e-6
#: How many runs the figures are asked of; a recording without noise is the same for every seed.
RUNS = 100
STARTS_ASKED = {"any": 200, "minutes": 4, "epochs": 4}
