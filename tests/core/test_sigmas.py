"""Standard deviations in words."""

from __future__ import annotations

import pytest

from calib_core.sigmas import Unit, std_cell, std_row, std_text, two_digits, value_row, value_text


@pytest.mark.parametrize(
    ("std", "unit", "text", "cell"),
    [
        (0.02, "deg", "0.020 deg", "0.020"),
        (179.9, "deg", "180 deg", "180"),
        (180.0, "deg", "not determined", "not determined"),
        (0.00086, "m", "0.86 mm", "0.86"),
        (0.9994, "m", "999 mm", "999"),
        (1.0, "m", "1.0 m", "1.0 m"),
        (9.13506, "m", "9.1 m", "9.1 m"),
        (25.4e-6, "s", "0.025 ms", "0.025"),
        (10.0, "s", "10 s", "10 s"),
        (0.0, "s", "0 ms", "0"),
    ],
)
def test_a_sigma_is_said_in_the_unit_that_it_deserves(std: float, unit: Unit, text: str, cell: str) -> None:
    """Mutations: 9135.06 mm; a turn of more than half a circle as a number; a degree taken for a metre; a table's own digits."""
    assert (std_text(std, unit), std_cell(std, unit)) == (text, cell)


def test_sigmas_keep_their_last_zero() -> None:
    """As the tables beside the sentence have them. Mutations: the zero dropped; digits counted before rounding."""
    shown = {0.02: "0.020", 3.0: "3.0", 0.0996: "0.10", 0.0994: "0.099", 12.3: "12", 0.0: "0"}
    assert {value: two_digits(value) for value in shown} == shown


def test_a_row_with_another_unit_names_each() -> None:
    """Mutation: the column's unit behind a number of another: 9.1 m mm."""
    assert std_row([0.0012, 0.0031], "m") == (["1.2", "3.1"], "mm")
    assert std_row([0.0012, 9.13506], "m") == (["1.2 mm", "9.1 m"], "")
    assert std_row([0.0012, None], "m") == (["1.2", "held"], "mm")
    assert std_row([None], "s") == (["held"], "")
    assert std_row([0.01, 200.0], "deg") == (["0.010 deg", "not determined"], "")


def test_a_value_has_the_digits_and_the_unit_of_its_sigma() -> None:
    """By hand. Mutations: decimals of its own; millimetres above a sigma in metres; a held value to the digits of a sigma that is
    nobody's finding; minus nought."""
    assert value_text(0.1037261, 0.00063, "m") == ("103.73", "mm")
    assert value_text(-0.3102, 9.13506, "m") == ("-0.3", "m")
    assert value_text(12.3, 190.0, "deg") == ("12", "deg")
    assert value_text(-1e-8, 3e-4, "s") == ("0.00", "ms")
    assert value_text(0.0127, None, "s") == ("12.700", "ms")
    assert value_row([0.1, 0.2], [0.0012, 0.02], "m") == (["100.0", "200"], "mm")
    assert value_row([0.1, -0.2], [0.0012, 9.1], "m") == (["100.0 mm", "-0.2 m"], "")
