"""What is asked of a minute and of shorter recordings: which figure is held against which aim, and what is run for it."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench import aims
from bench.aims import metrics_of
from bench.passes import Cost, Spent

PASSES = [Spent(0.6, 0.5), Spent(0.5, 0.4), Spent(0.9, 0.6)]


def costs(*whole_s: float) -> list[Cost]:
    """Turns of so many seconds, twice as much CPU and a hundred times as many MB."""
    return [Cost({}, each, 3, 100.0 * each, 2.0 * each) for each in whole_s]


def test_each_figure_is_in_passes_over_the_minute_and_has_its_aim() -> None:
    """By hand, and the table as it was asked for: seconds where the pass takes 0.5 s.

    Mutations: the slowest turn; CPU over a pass by the clock; the default of twenty seconds judged; an aim in seconds.
    """
    runs = {
        "ideal": costs(6.0, 4.5),
        "default": costs(9.0, 8.0),
        "inspect": costs(3.5),
        "paper_20_ideal": costs(2.4),
        "paper_20_default": costs(3.0),
        "ouster_20_ideal": costs(4.1),
        "ouster_20_default": costs(6.0),
    }
    metrics = {metric.key.removeprefix("aims."): metric for metric in metrics_of(PASSES, runs, {"second_ideal": 1.4})}
    asked_s = {"inspect": 3.0, "paper_20_ideal": 2.5, "ouster_20_ideal": 4.0, "second_ideal": 1.5}
    asked = {"ideal": 10.0, "default": 15.0, **{name: asked_s / 0.5 for name, asked_s in asked_s.items()}}
    assert {key: m.aim for key, m in metrics.items() if m.unit == "passes" and m.aim is not None} == asked
    assert metrics["ideal"].value == pytest.approx(9.0)
    assert metrics["default"].value == pytest.approx(16.0)
    assert metrics["default_cpu"].value == pytest.approx(40.0)
    assert metrics["default_mb"].value == pytest.approx(800.0)
    assert [key for key, m in metrics.items() if m.is_over()] == ["default", "inspect", "ouster_20_ideal"]
    shown = {key for key, m in metrics.items() if not m.is_judged()}
    assert shown == {"pass_s", "paper_20_default", "ouster_20_default"}


def test_every_figure_has_its_own_recording_and_words(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is run, between passes over the minute. Mutations: passes over the short ones; the default's with ideal sensors."""
    said: list[str] = []

    def simulated(slug: str, bag: Path, *, seed: int, duration_s: float) -> None:
        said.append(f"{slug} {seed} {duration_s:g} s")

    def passed(bag: Path) -> Spent:
        said.append(f"pass {bag.stem}")
        return PASSES[0]

    def run(words: list[str]) -> Cost:
        said.append(" ".join([words[0], Path(words[1]).stem, *(words[4:] if words[0] == "calibrate" else [])]))
        return costs(1.0)[0]

    monkeypatch.setattr("bench.aims.api.simulate", simulated)
    monkeypatch.setattr("bench.aims.api.load", lambda *_, **__: "recording")
    monkeypatch.setattr(aims, "honest_pass", passed)
    monkeypatch.setattr(aims, "run_command", run)
    monkeypatch.setattr(aims, "second_solve", lambda *of: (None, 1.0 if of[3].intrinsics == "off" else 2.0))
    metrics = {metric.key: metric.value for metric in aims.measure(turns=2)}
    assert said[:4] == ["handheld 0 60 s", "paper-normal 0 20 s", "ouster 0 20 s", "pass handheld"]
    turn = [
        "calibrate handheld --intrinsics off",
        "calibrate handheld",
        "inspect handheld",
        "calibrate paper-normal --intrinsics off",
        "calibrate paper-normal",
        "calibrate ouster --intrinsics off",
        "calibrate ouster",
    ]
    assert said[4:] == [each for words in turn * 2 for each in ("pass handheld", words)]
    assert metrics["aims.second_default"] == pytest.approx(2.0 * metrics["aims.second_ideal"])
