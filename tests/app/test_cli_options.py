"""Words of options become the right numbers, or one sentence that names the option and what it takes."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import get_args

import pytest

from app.cli import commands, options
from app.cli.parser import build_parser
from calib_core.errors import SettingsError
from calib_core.intrinsics import Block
from calib_core.settings import gravity_at_latitude_m_s2


@pytest.mark.parametrize(
    ("text", "axis", "value", "std"),
    [
        ("tz=0.31+-0.005", "tz", 0.31, 0.005),
        ("tx=-1e-2±.5", "tx", -0.01, 0.5),
        ("ty=310+/-5mm", "ty", 0.31, 0.005),
        ("rx=0+-0.5deg", "rx", 0.0, math.radians(0.5)),
        ("rz=-0.1 +- 0.01", "rz", -0.1, 0.01),
        ("dt=-20+-1ms", "dt", -0.02, 0.001),
    ],
)
def test_priors(text: str, axis: str, value: float, std: float) -> None:
    """Fails if a unit is not applied to both numbers, or a sign is lost (seen: `scale` left off the value)."""
    prior = options.parse_prior(text)
    assert prior.axis == axis
    assert prior.value == pytest.approx(value, rel=1e-12)
    assert prior.std == pytest.approx(std, rel=1e-12)


@pytest.mark.parametrize(
    "text", ["tz=0.31", "qx=1+-1", "tz=1+-0", "tz=1+-1deg", "rx=1+-1mm", "dt=1+-1m", "", "tz=nan+-1"]
)
def test_unfit_priors_are_one_sentence(text: str) -> None:
    """Fails if a length is accepted for an angle, or a standard deviation of 0 (seen: units of `t` used for all)."""
    with pytest.raises(SettingsError, match="--prior"):
        options.parse_prior(text)


def test_spans() -> None:
    """Fails if the ends are swapped, or only the last span is kept (seen: the first returned at once)."""
    assert options.parse_spans(["12.5:14", "0:1e-1"]) == ((12.5, 14.0), (0.0, 0.1))
    assert options.parse_spans([]) == ()


@pytest.mark.parametrize("text", ["12.5", "14:12.5", "3:3", "1:2:3", "a:b", "nan:1", ":4", ""])
def test_unfit_spans_are_one_sentence(text: str) -> None:
    """Fails if a span may end before it starts (seen: the comparison left out)."""
    with pytest.raises(SettingsError, match=r"START:END .*--exclude"):
        options.parse_spans([text])


@pytest.mark.parametrize(("latitude_deg", "expected"), [(0, 9.7803253359), (90, 9.8321849378), (-45, 9.8061977694)])
def test_gravity_at_known_latitudes(latitude_deg: float, expected: float) -> None:
    """WGS 84's own values at equator and pole, and the one at 45 deg from its tables. Fails if degrees are taken for
    radians (seen)."""
    assert gravity_at_latitude_m_s2(latitude_deg) == pytest.approx(expected, abs=2e-9)


def test_gravity_option() -> None:
    """Fails if a given magnitude stays free, or `free` becomes exact."""
    assert options.parse_gravity("9.81").std_m_s2 == 0.0
    assert options.parse_gravity("9.81").magnitude_m_s2 == 9.81
    assert (options.parse_gravity("free").magnitude_m_s2, options.parse_gravity("free").std_m_s2) == (9.807, 0.02)
    assert options.parse_gravity("latitude:48.1").magnitude_m_s2 == pytest.approx(9.809, abs=1e-3)
    for text in ("fast", "981", "latitude:91", "latitude:x", "longitude:5", "nan", "latitude:nan"):
        with pytest.raises(SettingsError, match="--gravity"):
            options.parse_gravity(text)


def test_points_and_field_of_view_follow_the_method_unless_named() -> None:
    """The contract: all points and directions; with `paper` 100 points and 45 deg; explicit options win. Fails if
    `all` is overridden by the paper's number."""
    assert options.parse_points(None, "full") is None
    assert options.parse_points(None, "paper") == 100
    assert options.parse_points("all", "paper") is None
    assert options.parse_points("150", "paper") == 150
    assert options.parse_field_of_view(None, "full") is None
    assert options.parse_field_of_view(None, "paper") == 45.0
    assert options.parse_field_of_view(180.0, "paper") is None
    assert options.parse_field_of_view(60.0, "full") == 60.0
    for text in ("0", "-5", "1.5", "many"):
        with pytest.raises(SettingsError, match="--points-per-plane-per-scan"):
            options.parse_points(text, "full")
    for angle_deg in (0.0, -1.0, 181.0, math.nan):
        with pytest.raises(SettingsError, match="--field-of-view-deg"):
            options.parse_field_of_view(angle_deg, "full")


def test_mounting_takes_seven_numbers() -> None:
    """Fails if six or a word pass, or the order changes."""
    assert options.parse_mounting("0.1,-2,3,0,0,0,1") == (0.1, -2.0, 3.0, 0.0, 0.0, 0.0, 1.0)
    assert options.parse_mounting(None) is None
    for text in ("1,2,3", "a,b,c,d,e,f,g", "1,2,3,0,0,0,inf"):
        with pytest.raises(SettingsError, match="--mounting"):
            options.parse_mounting(text)


def test_imu_noise_is_a_file_or_a_preset(tmp_path: Path) -> None:
    """Fails if a missing file is taken for a preset's name, as words in its path may be. Mutation: `.json` alone tells a file."""
    path = tmp_path / "noise.json"
    path.write_text('{"gyroscope_noise_density_rad_s_sqrt_hz": 1e-4, "accelerometer_noise_density_m_s2_sqrt_hz": 1e-3}')
    noise = options.parse_imu_noise(str(path))
    assert not isinstance(noise, str | None)
    assert noise.gyroscope_noise_density_rad_s_sqrt_hz == 1e-4
    assert options.parse_imu_noise("mti-3") == "mti-3"
    assert options.parse_imu_noise(None) is None
    for absent in (str(tmp_path / "absent.json"), "rig/mti30", "mti30.yaml"):
        with pytest.raises(SettingsError, match=rf"{re.escape(absent)}, but it cannot be read"):
            options.parse_imu_noise(absent)


def test_an_imu_that_nobody_knows_is_told_at_once_with_all_names() -> None:
    """It was told after the planes were found, with a reference to a help that has no names. Mutation: any name is taken."""
    with pytest.raises(SettingsError, match=r"one of livox-mid360, .*xsens-mti-300.*, but found `mpi-30`"):
        options.parse_imu_noise("mpi-30")


def test_intrinsics_are_a_word_or_blocks() -> None:
    """Oracle: the names in calib_core/intrinsics.py, read from its types. Fails if a block's name is taken for a word, one
    unknown name among known ones passes (seen: `any` for the list), or the sentence does not list the names."""
    assert [options.parse_intrinsics(word) for word in ("auto", "consider", "off")] == ["auto", "consider", "off"]
    assert options.parse_intrinsics("clock_rate") == ("clock_rate",)
    assert options.parse_intrinsics("laser_range_offset, gyroscope_scale") == ("gyroscope_scale", "laser_range_offset")
    assert options.parse_intrinsics(",".join(get_args(Block))) == get_args(Block)
    for text in ("", "on", "clock_rate,lasers", "clock_rate,", "auto,clock_rate"):
        with pytest.raises(SettingsError, match=r"auto, consider, off, .*incidence.*--intrinsics") as refused:
            options.parse_intrinsics(text)
        assert all(name in str(refused.value) for name in get_args(Block))


def test_a_lidar_is_a_preset() -> None:
    """Fails if a word inside another word names a preset, an unknown name is taken for the general case (seen: the search for
    words in topics used here: `velodyne-99` passed), or a model as its maker writes it is none."""
    assert options.parse_lidar(None) is None
    assert options.parse_lidar("Velodyne-VLP16") == options.parse_lidar("VLP 16") == "velodyne-vlp16"
    assert options.parse_lidar("OS1-64") == "ouster-os"
    assert options.parse_lidar("os1") == "ouster-os"
    for text in ("", "velodyne-99", "sonar"):
        with pytest.raises(SettingsError, match=r"name of a lidar, one of livox-mid360, .*robosense, but found"):
            options.parse_lidar(text)


@pytest.mark.parametrize("asked", [False, True])
def test_lasers_are_corrected_only_where_asked(asked: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fails if the option is dropped on its way to the library, or is the default."""
    heard: list[object] = []

    def deskew(*_: object, **chosen: object) -> int:
        heard.append(chosen["correct_lasers"])
        return 1

    monkeypatch.setattr(commands.api, "deskew", deskew)
    monkeypatch.setattr(commands.api, "read_result", lambda _: None)
    words = ["deskew", "room.bag", "--calibration", "result.json", "--output", str(tmp_path / "out"), "--quiet"]
    commands.deskew(build_parser().parse_args([*words, *["--correct-lasers"] * asked]))
    assert heard == [asked]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["--range-min-m", "-1"],
            "The option --range-min-m does not fit: it should be greater than or equal to 0, found -1.0",
        ),
        (["--range-max-m", "0"], "The option --range-max-m does not fit: it should be greater than 0, found 0.0"),
        (
            ["--range-min-m", "300"],
            "These options do not fit: expected a least range below the greatest, found 300 to 200 m",
        ),
    ],
)
def test_ranges_are_lengths_and_in_order(words: list[str], said: str) -> None:
    """Seen: -1 was squared and left out what is nearer than 1 m. Mutations: any number; either order; "Value error" is said."""
    with pytest.raises(SettingsError, match=re.escape(said)):
        options.read_settings(build_parser().parse_args(["inspect", "room.bag", *words]))
