"""What a second worker brings: counted over all turns, told with what it was measured on, red where it is too little."""

from __future__ import annotations

import os

import pytest

from bench import fleet
from bench.fleet import Cost, Pass, gain, held_to, report

COST = Cost(20.0, 128.0, 20.0, 14.0, 700.0, 300.0, 140.0, 43.0)


def turns(*walls_s):
    """One worker and two in turn."""
    return [Pass(1 + k % 2, wall_s, 0.97, 10, 0.5) for k, wall_s in enumerate(walls_s)]


def test_the_gain_is_of_all_turns_together():
    """By hand: (100 + 50) / (50 + 30). Mutations: the mean of ratios; the best turn alone; two over one."""
    assert gain(turns(100.0, 50.0, 50.0, 30.0)) == pytest.approx(150 / 80)


@pytest.mark.parametrize(("two_s", "documents", "code"), [(55.0, 4, 0), (56.0, 4, 1), (50.0, 3, 1)])
def test_too_small_a_gain_and_a_missing_document_are_red(tmp_path, monkeypatch, capsys, two_s, documents, code):
    """Mutations: the limit not looked at; a recording without its document not counted."""
    monkeypatch.setattr(fleet, "RESULTS", tmp_path)
    monkeypatch.setattr(fleet, "usable_cores", lambda: 2)
    monkeypatch.setattr(fleet, "cost", lambda folder, duration_s: COST)
    monkeypatch.setattr(fleet, "recordings_in", lambda folder, count, duration_s: [tmp_path] * count)
    walls_s = {1: 100.0, 2: two_s}
    monkeypatch.setattr(fleet, "one_pass", lambda *_: Pass(_[3], walls_s[_[3]], 1.0, documents, 0.1))
    assert fleet.main(["--recordings", "4"]) == code
    assert f"{100 / two_s:.2f} times" in (tmp_path / "fleet.md").read_text()


def test_what_is_started_has_one_core_and_we_keep_ours():
    """Oracle: the kernel. Mutation: the cores not given back."""
    before = os.sched_getaffinity(0)
    with held_to(1):
        assert len(os.sched_getaffinity(0)) == 1
    assert os.sched_getaffinity(0) == before


def test_the_page_says_what_it_was_measured_on():
    """Mutation: the load left out."""
    text = report([COST], turns(100.0, 50.0), 10, 6.0)
    assert "| 128 MB | 14.0 s |" in text and "| 0.5 |" in text and "2.00 times" in text
