"""Which two fields are one stamp, by names nobody agreed on."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.readers.timing.split_time import is_split, joined_ns, split_times


def cloud(**kinds: str) -> np.ndarray:
    """Three points of these fields."""
    return np.zeros(3, [("x", "<f4"), *kinds.items()])


@pytest.mark.parametrize(
    ("fields", "found"),
    [
        ({"sec": "<u4", "nsec": "<u4"}, ["sec+nsec"]),
        ({"timestamp_nsec": "<u4", "timestamp_sec": "<u4"}, ["timestamp_sec+timestamp_nsec"]),
        ({"timeSecond": "<i8", "timeNanosecond": "<i8"}, ["timeSecond+timeNanosecond"]),
        ({"tv_sec": "<i4", "tv_usec": "<i4"}, ["tv_sec+tv_usec"]),
        ({"t_sec": "<u4", "ring_nsec": "<u4"}, []),
        ({"time_s": "<f4", "time_ns": "<u4"}, []),
        ({"class": "u1", "returns": "u1", "ns": "<u4"}, []),
    ],
)
def test_two_fields_of_one_name_are_one_stamp(fields: dict[str, str], found: list[str]) -> None:
    """The same offset in two units is none. Fails when names need not begin alike, or floats count."""
    assert split_times(cloud(**fields)) == found


@pytest.mark.parametrize(("field", "part"), [("sec+nsec", 250_000_000), ("sec+usec", 250_000)])
def test_the_part_is_in_its_own_unit(field: str, part: int) -> None:
    """Fails when microseconds are taken for nanoseconds, or seconds are multiplied in 32 bits."""
    points = cloud(sec="<u4", **{field.split("+")[1]: "<u4"})
    points["sec"], points[field.split("+")[1]] = 1_700_000_000, part
    assert is_split(field, points)
    assert joined_ns(points, field).tolist() == [1_700_000_000_250_000_000] * 3


def test_a_field_of_that_very_name_is_no_stamp_in_two() -> None:
    """Fails when a plus sign alone makes two of one."""
    points = np.zeros(3, [("x", "<f4"), ("sec", "<u4"), ("nsec", "<u4"), ("sec+nsec", "<f8")])
    assert not is_split("sec+nsec", points)
    assert not is_split("sec+msec", points)


def test_nanoseconds_of_the_epoch_are_a_stamp_of_their_own() -> None:
    """Beside whole seconds, as a driver may send both: their sum would be 1970 twice. Fails when names alone decide."""
    points = cloud(stamp_s="<u4", stamp_ns="<u8")
    points["stamp_s"], points["stamp_ns"] = 1_700_000_000, 1_700_000_000_250_000_000
    assert split_times(points) == []
    points["stamp_ns"] = [250_000_000, 250_000_001, 2**63]  # one that is damaged
    assert split_times(points) == ["stamp_s+stamp_ns"]
