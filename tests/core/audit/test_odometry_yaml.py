"""Settings of odometry as strangers may write them: what aliases repeat, what no number is."""

from __future__ import annotations

import math
import sys
import tracemalloc
from types import FrameType

import numpy as np
import pytest

from calib_core.audit.given import parse_extrinsic
from calib_core.errors import InputError

TURN = "1, 0, 0, 0, 1, 0, 0, 0, 1"


def settings_after(before: str) -> str:
    return f"{before}\nextrinsic_T: [0.1, 0, 0]\nextrinsic_R: [{TURN}]\n"


def chain(rung: str, rungs: int = 17) -> str:
    """Anchors a0, a1, ... of which each is made of the one before it, twice: 2^17 values where all are unfolded."""
    return "\n".join(["a0: &a0 {x: 1}", *(f"a{k}: &a{k} {rung.format(*[f'*a{k - 1}'] * 2)}" for k in range(1, rungs))])


@pytest.mark.parametrize(
    "before",
    [
        chain("{{p: {}, q: {}}}"),
        chain("[{}, {}]"),
        chain("{{<<: [{}, {}]}}"),
        chain("[{}, {}]") + "\n? *a16\n: 1",
        "a: &a {b: *a}",
        "? &a [*a]\n: 1",
        "s: [&b0 {x: 1}, " + ", ".join(f"&b{k} {{p: *b{k - 1}}}" for k in range(1, 3000)) + "]\nlast: *b2999",
        f"? {'k' * 90_000}\n: {{{', '.join(f'a{k}: 1' for k in range(3000))}}}",
        f"a: {'1' * 5000}",
        "a: 2001-99-99",
        "a: !!int ''",
        "a: !opencv {rows: 1}",
    ],
    ids=[
        "sections",
        "lists",
        "merged",
        "keys",
        "circle",
        "circle-key",
        "deep",
        "long",
        "digits",
        "date",
        "tag",
        "kind",
    ],
)
def test_a_short_text_of_settings_stays_short(before: str) -> None:
    """A server reads these in its own process, under no job's limits: 559 bytes of aliases took 11 s and 379 MB, 5000 digits were
    a defect of the program. Oracle: the memory that Python counts, per letter of the text. Mutations: all values made; a key's
    node put in words; sections walked by recursion; each key's path written out."""
    text = settings_after(before)
    tracemalloc.start()
    try:
        given = parse_extrinsic(text)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    np.testing.assert_array_equal(given.T_imu_lidar[:3, 3], [0.1, 0, 0])
    assert most < 3e6 + 200 * len(text)


def calls_of(text: str, *, at_most: float = math.inf) -> int:
    calls = 0

    def count(_frame: FrameType, event: str, _argument: object) -> None:
        nonlocal calls
        calls += event == "call"
        if calls > at_most:
            raise AssertionError

    sys.setprofile(count)
    try:
        parse_extrinsic(text)
    finally:
        sys.setprofile(None)
    return calls


@pytest.mark.parametrize("before", [chain("{{p: {}, q: {}}}"), "a: &a {b: *a}"], ids=["sections", "circle"])
def test_a_section_is_walked_once(before: str) -> None:
    """Oracle: the calls that the same text takes whose aliases are plain words. Mutation: a section walked as often as aliases
    lead to it, for ever in a circle."""
    text = settings_after(before)
    calls_of(text, at_most=2 * calls_of(text.replace("*", "")))


def test_what_an_alias_names_is_read() -> None:
    """Two programs' sections that share their numbers, by an alias of a list and of a whole section. Mutation: an alias passed
    over."""
    given = parse_extrinsic(
        "a: &a {extrinsic_T: &t [0.1, 0.2, 0.3], imu_time_offset: 0.5}\n"
        f"b:\n  extrinsic_T: *t\n  extrinsic_R: [{TURN}]\nc: *a\n"
    )
    np.testing.assert_array_equal(given.T_imu_lidar[:3, 3], [0.1, 0.2, 0.3])
    assert given.time_offset_ns == -500_000_000


@pytest.mark.parametrize("value", ["1" * 5000, "2001-99-99", "!!int ''", "!!bool x", "!own 3", "{a: 1}", "[1]"])
def test_a_time_that_is_none_is_refused(value: str) -> None:
    """Mutation: what the YAML library raises for a value let through, ValueError and KeyError among it."""
    with pytest.raises(InputError) as caught:
        parse_extrinsic(settings_after(f"imu_time_offset: {value}"))
    assert str(caught.value).startswith("Expected a result of unsweep, a URDF")
    assert "\n" not in str(caught.value)
