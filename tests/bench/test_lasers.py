"""What lasers cost: which turns count, and what of it is judged."""

from __future__ import annotations

from bench.lasers import LIDARS, metrics_of
from bench.metrics import slips


def test_ratios_are_of_the_cheapest_turns_and_judged() -> None:
    """By hand. Mutations: the slowest turn; the ratio upside down; seconds judged; no aim."""
    turns = {16: {"off": [10.0, 12.0], "auto": [16.0, 15.0]}, 128: {"off": [20.0, 22.0], "auto": [50.0, 36.0]}}
    metrics = {metric.key: metric for metric in metrics_of(turns)}
    assert metrics["lasers.auto_over_off_16"].value == 1.5
    assert metrics["lasers.auto_over_off_128"].value == 1.8
    assert [key for key, metric in metrics.items() if metric.is_over()] == ["lasers.auto_over_off_128"]
    judged = [key for key, metric in metrics.items() if metric.is_judged()]
    assert judged == ["lasers.auto_over_off_16", "lasers.auto_over_off_128"]
    turns[128]["auto"] = [46.0]
    assert [slip.key for slip in slips(metrics_of(turns), metrics)] == ["lasers.auto_over_off_128"]


def test_each_lidar_has_the_lasers_it_is_named_by() -> None:
    """Mutation: a pattern of another sensor."""
    assert [len(lidar.pattern.ring) for lidar in LIDARS.values()] == list(LIDARS)
