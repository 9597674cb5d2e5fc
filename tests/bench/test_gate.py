"""The benchmark's gate lets good numbers pass and no bad one."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from bench import __main__ as command
from bench import aims, first_run, growth, lasers, passes
from bench.__main__ import gate
from bench.growth import Grown
from bench.metrics import Direction, Metric, slips
from bench.passes import Cost, Spent
from bench.readme import PAGES, README, WHOLE, with_tables
from bench.runs import Run
from bench.store import bless, read_baseline, write_results
from bench.workloads import WORKLOADS, Workload, metrics_of


def ratio(value: float, direction: Direction = "lower", key: str = "a", tolerance: float = 0.1) -> Metric:
    return Metric(key=key, value=value, unit="ratio", direction=direction, tolerance=tolerance)


@pytest.mark.parametrize(
    ("direction", "before", "good", "bad"),
    [
        ("lower", 1.0, 1.09, 1.11),
        ("higher", 1.0, 0.91, 0.89),
        ("near-one", 1.2, 0.7, 0.67),
        ("near-one", 1.0, 1.09, 1.11),
    ],
)
def test_slips_by_direction(direction: Direction, before: float, good: float, bad: float) -> None:
    """Fails if a direction is turned round or the tolerance is not a share of the baseline (seen: negated)."""
    baseline = {"a": ratio(before, direction)}
    assert slips([ratio(good, direction)], baseline) == []
    assert [slip.key for slip in slips([ratio(bad, direction)], baseline)] == ["a"]


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_nothing_finite_is_a_slip(value: float) -> None:
    """Fails if NaN compares its way through the gate."""
    for direction in ("lower", "near-one"):
        assert slips([ratio(value, direction)], {"a": ratio(1.0, direction)})
    assert slips([ratio(math.nan, "higher")], {"a": ratio(1.0, "higher")})


def test_seconds_are_never_judged_and_new_ratios_must_be_blessed() -> None:
    """Fails if the machine's speed can break the gate, or a new ratio passes unseen."""
    seconds = Metric(key="t", value=9.0, unit="s", direction="lower")
    assert slips([seconds], {"t": seconds.model_copy(update={"value": 1.0})}) == []
    assert "bless" in slips([ratio(1.0)], {})[0].text


def test_bless_keeps_the_others(tmp_path: Path) -> None:
    """Fails if blessing one workload forgets the rest, or seconds enter the baseline."""
    path = tmp_path / "baseline.json"
    bless([ratio(1.0, key="a"), ratio(2.0, key="b")], path)
    bless([ratio(3.0, key="b"), Metric(key="t", value=1.0, unit="s")], path)
    assert {key: metric.value for key, metric in read_baseline(path).items()} == {"a": 1.0, "b": 3.0}
    assert write_results("x", [ratio(1.0)], tmp_path / "results").is_file()


@pytest.mark.parametrize("page", PAGES)
def test_pages_show_the_committed_numbers(page: Path) -> None:
    """Fails when results are committed and the pages are not (`python -m bench readme`), or one is edited by hand."""
    text = page.read_text(encoding="utf-8")
    assert all(text.count(mark) == 1 for marks in PAGES[page] for mark in marks)
    assert with_tables(text) == text


def test_the_first_screen_says_what_the_table_says() -> None:
    """Oracle: the README's own rows of a VLP-16 by hand for 20 s, the larger error of both profiles, to a digit.

    Mutation: a figure of the sentence, or of a row, changed alone.
    """
    text = README.read_text(encoding="utf-8")
    rows = text.partition(WHOLE[0])[2].partition(WHOLE[1])[0]
    found = re.findall(
        r"^\| handheld, 20 s \| \w+ \| \d+ \| ([\d.]+) deg .*? \| ([\d.]+) mm .*? \| ([\d.]+) ms ", rows, re.MULTILINE
    )
    assert len(found) == 2
    told = re.findall(r"handheld recording with a VLP-16: ([\d.]+) deg, ([\d.]+) mm and ([\d.]+) ms", text)
    largest = (max(map(float, column)) for column in zip(*found, strict=True))
    assert told == [tuple(f"{value:.1g}" for value in largest)]


def run_with(seed: int, errors: Sequence[float], stds: Sequence[float], status: str = "calibrated") -> Run:
    """A run with uncorrelated errors."""
    nees = float(np.sum((np.array(errors) / np.array(stds)) ** 2))
    values = tuple(float(e) for e in errors), tuple(float(s) for s in stds)
    return Run("s", seed, "v", "full", status, "", *values, nees, 200, 200, 10**6, 6.0, 20.0, 2.0)


def test_honest_runs_have_ratios_near_one() -> None:
    """Errors drawn from the stated covariance: every ratio is 1 within its spread. Fails if degrees, millimetres or
    the three components are mixed up (seen: mean instead of sum of the variances)."""
    rng = np.random.default_rng(1)
    std = np.array([1e-4, 2e-4, 1e-4, 3e-4, 5e-4, 3e-4, 1e-5])
    errors = rng.standard_normal((2000, 7)) * std
    runs = [run_with(seed, e, std) for seed, e in enumerate(errors)]
    values = {metric.key.removeprefix("w."): metric.value for metric in metrics_of(Workload("w", "s", "t"), runs)}
    for key in ("e_R_over_sigma", "e_p_over_sigma", "e_dt_over_sigma", "nees_over_freedom"):
        assert values[key] == pytest.approx(1.0, abs=0.05)
    assert values["e_R_rms_deg"] == pytest.approx(np.rad2deg(np.linalg.norm(std[:3])), rel=0.05)
    assert values["e_p_rms_mm"] == pytest.approx(1e3 * np.linalg.norm(std[3:6]), rel=0.05)
    assert values["time_over_kernel"] == 3.0


def test_refused_runs_lower_the_share_solved() -> None:
    """Fails if runs without an answer vanish from the count."""
    good = run_with(1, [1e-4] * 7, [1e-4] * 7)
    bad = run_with(2, [math.nan] * 7, [math.nan] * 7, status="refused")
    metrics = {metric.key: metric for metric in metrics_of(Workload("w", "s", "t"), [good, bad])}
    assert metrics["w.solved"].value == 0.5
    assert slips(metrics_of(Workload("w", "s", "t"), [bad]), {"w.solved": metrics["w.solved"]})


def test_what_the_baseline_holds_is_measured_or_missed() -> None:
    """Fails if a ratio can drop out of the gate: not measured any more, or too small to be judged.

    Mutations: no look at the baseline's keys; another workload's missed as well.
    """
    baseline = {"a.one": ratio(1.0, key="a.one"), "a.two": ratio(1.0, key="a.two"), "b.one": ratio(1.0, key="b.one")}
    small = ratio(0.1, "shown", key="a.two")
    assert [slip.key for slip in slips([ratio(1.0, key="a.one"), small], baseline, ["a"])] == ["a.two"]
    assert [slip.key for slip in slips([], baseline)] == list(baseline)
    assert slips([], read_baseline(), []) == []
    assert len(slips([], read_baseline())) == len(read_baseline())


def test_what_is_small_may_grow_by_the_least_that_counts() -> None:
    """By hand: 0.1 passes that become 0.5 are noise, 0.7 are not. Mutation: the share of the baseline alone."""

    def stage(value: float) -> Metric:
        return ratio(value).model_copy(update={"least": 0.5})

    assert slips([stage(0.5)], {"a": stage(0.1)}) == []
    assert slips([stage(0.7)], {"a": stage(0.1)})


def test_blessing_a_workload_leaves_nothing_dead(tmp_path: Path) -> None:
    """Mutation: keys that are no longer measured stay, and every gate misses them."""
    path = tmp_path / "baseline.json"
    bless([ratio(1.0, key="a.old"), ratio(1.0, key="b.one")], path)
    bless([ratio(2.0, key="a.new")], path)
    assert list(read_baseline(path)) == ["a.new", "b.one"]


def test_every_key_of_the_baseline_is_one_that_is_measured() -> None:
    """Of costs as their workloads make them, and of a run. Mutation: a key in baseline.json that no workload makes."""
    cost = Cost(dict.fromkeys(("start", "read", "planes", "track", "initialise", "solve"), 1.0), 6.0, 3, 300.0, 8.0)
    runs = [Grown("length", size, 6, 1, Spent(1.0, 1.0), cost) for size in (10.0, 60.0)]
    runs += [
        Grown(of, size, 6, 1, Spent(1.0, 1.0), cost)
        for of, size in (("lasers", 16), ("lasers", 128), ("planes", 3), ("planes", 30))
    ]
    once = {"off": [1.0], "auto": [1.0]}
    asked = [f"{of}{mode}" for of in ("", "paper_20_", "ouster_20_") for mode in ("ideal", "default")]
    made = [
        *aims.metrics_of(
            [Spent(1.0, 1.0)],
            {name: [cost] for name in (*asked, "inspect")},
            {"second_ideal": 1.0, "second_default": 1.0},
        ),
        *first_run.metrics_of({mode: [first_run.Pair(cost, cost, 0)] for mode in ("ideal", "default")}),
        *passes.metrics_of(1.0, passes.Apart(1.0, 1.0, 1.0, 10), [cost], [cost], [cost], 100.0),
        *growth.metrics_of(runs),
        *lasers.metrics_of(dict.fromkeys(lasers.LIDARS, once)),
        *metrics_of(WORKLOADS["paper-normal"], [run_with(1, [1e-4] * 7, [1e-4] * 7)]),
    ]
    assert read_baseline().keys() <= {metric.key for metric in made if metric.is_judged()}


def test_the_gate_says_what_does_not_reach_its_aim(capsys: pytest.CaptureFixture[str]) -> None:
    """By hand. Mutations: the aim, or the baseline, is not said; what is over its aim fails the gate; a limit does not."""
    whole = Metric(key="p.whole", value=16.2, unit="passes", direction="lower", tolerance=0.15, aim=10.0)
    before = {"p.whole": whole.model_copy(update={"value": 32.6})}
    assert whole.told(before["p.whole"]) == "16.2 passes; aim 10, baseline 32.6"
    assert gate([whole], before, ["p"]) == 0
    assert (
        "OVER ITS AIM: p.whole = 16.2 passes; aim 10, baseline 32.6\n1 of 1 aims are missed." in capsys.readouterr().err
    )
    assert gate([whole.model_copy(update={"is_bound": True})], before, ["p"]) == 1
    good = whole.model_copy(update={"value": 9.9, "is_bound": True})
    assert gate([good], before, ["p"]) == 0
    assert "0 of 1 aims are missed" in capsys.readouterr().err
    assert good.model_copy(update={"value": math.nan}).is_over()


def test_what_is_measured_or_blessed_is_shown_with_its_aim_too(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A workload that measures at once. Mutations: figures without their aims; only the gate says what is missed."""
    whole = Metric(key="aims.whole", value=16.2, unit="passes", direction="lower", aim=10.0)
    blessed: list[Metric] = []
    monkeypatch.setattr(command, "_COSTS", {"aims": lambda: [whole]})
    monkeypatch.setattr(command, "write_results", lambda *_: None)
    monkeypatch.setattr(command, "bless", blessed.extend)
    for word, expected in (("run", []), ("bless", [whole])):
        assert command.main([word, "aims"]) == 0
        told = capsys.readouterr()
        assert told.out.split(maxsplit=1) == ["aims.whole", "16.2 passes; aim 10\n"]
        assert told.err == "OVER ITS AIM: aims.whole = 16.2 passes; aim 10\n1 of 1 aims are missed.\n"
        assert blessed == expected
    assert command.main(["gate", "aims"]) == 1
    assert "aims.whole = 16.2 has no baseline; bless it." in capsys.readouterr().err
