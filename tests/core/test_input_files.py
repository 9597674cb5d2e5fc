"""The contract's small files: read right, or refused with the file's name and the place in it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from calib_core.api import read_extrinsic
from calib_core.audit.limits import read_limits
from calib_core.errors import InputError, SettingsError
from calib_core.input_files import make_initial_guess, read_imu_noise, read_initial_guess, read_planes, read_result
from calib_core.result import CalibrationResult, Transform
from tests.core.exporters.results import make_result

ROTATION = Rotation.from_euler("ZYX", [179.9, -1.11, 2.9], degrees=True)


def written(folder: Path, document: object) -> Path:
    path = folder / "file.json"
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    return path


@pytest.mark.parametrize(
    "transform",
    [
        {
            "matrix": [[*row, p] for row, p in zip(ROTATION.as_matrix().tolist(), [1, 2, 3], strict=True)]
            + [[0, 0, 0, 1]]
        },
        {"quaternion_xyzw": ROTATION.as_quat().tolist(), "translation_m": [1, 2, 3]},
        {"euler_xyz_deg": [2.9, -1.11, 179.9], "translation_m": [1, 2, 3]},
        [[*row, p] for row, p in zip(ROTATION.as_matrix().tolist(), [1, 2, 3], strict=True)] + [[0, 0, 0, 1]],
    ],
)
def test_guess_in_any_form(tmp_path: Path, transform: object) -> None:
    """The result's own forms and a bare matrix, against SciPy. Fails if the angles' order or the quaternion's is turned, or
    a matrix needs a name."""
    guess = read_initial_guess(written(tmp_path, {"T_imu_lidar": transform, "time_offset_s": -0.0127}))
    assert guess.R_imu_lidar is not None
    assert guess.p_imu_lidar is not None
    np.testing.assert_allclose(guess.R_imu_lidar, ROTATION.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(guess.p_imu_lidar, [1, 2, 3])
    assert guess.time_offset_ns == -12_700_000


def test_guess_may_be_any_subset_and_a_whole_result(tmp_path: Path) -> None:
    """Fails if a missing part is filled in, or the exact nanoseconds of a result are taken from its float."""
    only_time = read_initial_guess(written(tmp_path, {"time_offset_s": 0.1}))
    assert (only_time.R_imu_lidar, only_time.p_imu_lidar, only_time.time_offset_ns) == (None, None, 100_000_000)
    only_place = read_initial_guess(written(tmp_path, {"T_imu_lidar": {"translation_m": [0, 0, 1]}}))
    assert only_place.R_imu_lidar is None
    whole = make_result(np.eye(3), np.ones(3), 1_716_257_158_900_000_001)
    guess = read_initial_guess(written(tmp_path, whole.to_json()))
    assert guess.time_offset_ns == 1_716_257_158_900_000_001


@pytest.mark.parametrize(
    "document",
    [
        {},
        {"T_imu_lidar": {}},
        {"T_imu_lidar": {"matrix": np.diag([1, 1, -1, 1]).tolist()}},
        {"T_imu_lidar": {"matrix": np.diag([2, 1, 1, 1]).tolist()}},
        {"T_imu_lidar": {"matrix": np.eye(3).tolist()}},
        {"T_imu_lidar": {"quaternion_xyzw": [1, 1, 0, 0]}},
        {"T_imu_lidar": {"translation_m": [1, 2]}},
        {"T_imu_lidar": {"rotation": [1, 2]}},
        '{"time_offset_s": NaN}',
        "not JSON",
    ],
)
def test_unfit_guess_is_one_sentence(tmp_path: Path, document: object) -> None:
    """Fails if a mirror, a scale or a slip of the pen is repaired in silence.

    Seen with the check of the determinant taken out.
    """
    with pytest.raises(SettingsError, match=r"file\.json"):
        read_initial_guess(written(tmp_path, document))


TURNED = (ROTATION * Rotation.from_rotvec([0, 0, 5e-6])).as_quat().tolist()


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"translation_m": [1, 2, 3.000002]}, "matrix and translation_m .* different translations"),
        ({"quaternion_xyzw": TURNED}, "matrix and quaternion_xyzw .* different rotations"),
        ({"euler_xyz_deg": [2.9, -1.11, 179.901]}, "matrix and euler_xyz_deg .* different rotations"),
        ({"matrix": None, "quaternion_xyzw": TURNED}, "quaternion_xyzw and euler_xyz_deg"),
    ],
)
def test_a_guess_whose_forms_differ_is_refused(tmp_path: Path, changed: dict[str, object], reason: str) -> None:
    """An edited result: whoever edits one of two forms means that one. Mutation: the first form there is taken."""
    document = json.loads(make_result(ROTATION.as_matrix(), np.array([1.0, 2, 3]), 5).to_json())
    assert read_initial_guess(written(tmp_path, document)).time_offset_ns == 5
    document["T_imu_lidar"] |= changed
    with pytest.raises(SettingsError, match=rf"file\.json.* {reason}.* left out; correct it\.$"):
        read_initial_guess(written(tmp_path, document))


@pytest.mark.parametrize(
    ("document", "reason"),
    [
        ({"time_offset_s": 0.005, "time_offset_ns": 4_998_999}, "of 0.005 s and its time_offset_ns of 4998999 ns"),
        ({"time_offset_s": 1e300}, "time_offset_s: .* 9000000000"),
        ({"time_offset_ns": -(10**19)}, "time_offset_ns: .* -9000000000000000000"),
        ({"T_lidar_imu": np.eye(4).tolist(), "time_offset_s": 0.1}, "T_imu_lidar, .*T_lidar_imu is its inverse"),
        ({"translation_m": [0, 0, 1], "time_offset_s": 0.1}, "key translation_m"),
        ({"extrinsic_T": [0, 0, 1], "time_offset_s": 0.1}, "key extrinsic_T"),
    ],
)
def test_a_guess_of_which_part_would_be_passed_over_is_refused(tmp_path: Path, document: object, reason: str) -> None:
    """Mutations: the nanoseconds taken before the seconds; no bound on either (an OverflowError); other keys ignored."""
    with pytest.raises(SettingsError, match=reason) as caught:
        read_initial_guess(written(tmp_path, document))
    assert "\n" not in str(caught.value)


def test_rounded_times_of_a_guess_agree_and_far_ones_of_a_page_do_not_overflow(tmp_path: Path) -> None:
    """Mutations: seconds held to a nanosecond; the page's guess without the file's bound."""
    guess = read_initial_guess(written(tmp_path, {"time_offset_s": 0.005, "time_offset_ns": 4_999_500}))
    assert guess.time_offset_ns == 4_999_500
    with pytest.raises(SettingsError, match="at most 9e"):
        make_initial_guess(None, 1e300, where="the page")
    far = np.eye(4)
    far[0, 3] = 1e300
    with pytest.raises(SettingsError, match=r"at most 1e\+06 m in the page"):
        make_initial_guess(far.tolist(), None, where="the page")


def test_a_mark_at_the_beginning_of_a_file_is_no_part_of_it(tmp_path: Path) -> None:
    """Windows editors write one. Mutations: the documents, or the limits, read as they stand ('Invalid JSON')."""
    path = tmp_path / "marked.json"

    def marked(document: object) -> Path:
        path.write_text(json.dumps(document), encoding="utf-8-sig")
        return path

    assert read_initial_guess(marked({"time_offset_s": 0.1})).time_offset_ns == 100_000_000
    floor = {"name": "floor", "normal": [0, 0, 1], "offset_m": 1}
    assert len(read_planes(marked({"schema": "unsweep.planes/1", "planes": [floor]}))) == 1
    noise = {"gyroscope_noise_density_rad_s_sqrt_hz": 1e-4, "accelerometer_noise_density_m_s2_sqrt_hz": 1e-3}
    assert read_imu_noise(marked(noise)).range_std_m is None
    assert read_limits(marked({"rotation_deg": 2.0})).rotation_deg == 2.0


def test_planes_are_unit_and_keep_their_place(tmp_path: Path) -> None:
    """A plane given with a normal of length 1.004 stays where it is: fails if only the normal is divided."""
    entry = {"name": "floor", "normal": [0, 0, 1.004], "offset_m": 1.004}
    (plane,) = read_planes(written(tmp_path, {"schema": "unsweep.planes/1", "planes": [entry]}))
    np.testing.assert_allclose(plane.normal, [0, 0, 1])
    assert plane.offset_m == pytest.approx(1.0)


def floor_with(outline_m: object) -> dict[str, object]:
    """A planes file with one plane, z = -1, and an outline."""
    plane = {"name": "floor", "normal": [0, 0, 1], "offset_m": 1, "outline_m": outline_m}
    return {"schema": "unsweep.planes/1", "planes": [plane]}


@pytest.mark.parametrize(
    "outline",
    [
        [[0, 0, -1], [1, 0, -1], [0, 1, -1]],
        [[0, 0, -1], [0, 2, -1], [1, 2, -1], [1, 1, -1], [1, 0, -1]],
        [[0, 0, -1], [1, 0, -1], [1 - 1e-12, -1e-12, -1], [0, 1, -1]],
    ],
)
def test_an_outline_is_read_either_way_round(tmp_path: Path, outline: list[list[float]]) -> None:
    """Fails if the key is ignored, one way round is refused, or a corner in the middle of a side is, or one said twice."""
    (plane,) = read_planes(written(tmp_path, floor_with(outline)))
    assert plane.outline_m is not None
    assert plane.outline_m.tolist() == outline


@pytest.mark.parametrize(
    "outline",
    [
        [[0, 0, -1], [1, 0, -1]],
        [[0, 0, -1], [1, 0, -1], [2, 0, -1]],
        [[0, 0, 0], [1, 0, 0], [0, 1, 0]],
        [[0, 0, -1], [1, 1, -1], [1, 0, -1], [0, 1, -1]],
        [[0, 0, -1], [4, 0, -1], [1, 1, -1], [0, 4, -1]],
        [[1, 0, -1], [-0.8, 0.6, -1], [0.3, -1, -1], [0.3, 1, -1], [-0.8, -0.6, -1]],
        [[0, 0], [1, 0], [0, 1]],
    ],
    ids=["two", "line", "off the plane", "crossed", "hollow", "star", "flat"],
)
def test_an_unfit_outline_is_one_sentence(tmp_path: Path, outline: list[list[float]]) -> None:
    """Fails if corners may lie anywhere, on a line, or in any order: a five-pointed star turns one way only, but twice."""
    with pytest.raises(SettingsError, match=r"outline_m.*file\.json|file\.json.*outline_m"):
        read_planes(written(tmp_path, floor_with(outline)))


@pytest.mark.parametrize(
    "document",
    [
        {"schema": "unsweep.planes/2", "planes": [{"name": "a", "normal": [0, 0, 1], "offset_m": 1}]},
        {"schema": "unsweep.planes/1", "planes": []},
        {"schema": "unsweep.planes/1", "planes": [{"name": "a", "normal": [0, 0, 2], "offset_m": 1}]},
        {"schema": "unsweep.planes/1", "planes": [{"name": "a", "normal": [0, 0], "offset_m": 1}]},
        {"planes": []},
    ],
)
def test_unfit_planes_are_one_sentence(tmp_path: Path, document: object) -> None:
    """Fails if another schema or a normal of any length passes."""
    with pytest.raises(SettingsError, match=r"file\.json"):
        read_planes(written(tmp_path, document))


def test_noise_and_result_files(tmp_path: Path) -> None:
    """Fails if an unknown key passes, a file that is not there ends in a traceback, or a result changes on the way."""
    keys = {"gyroscope_noise_density_rad_s_sqrt_hz": 1e-4, "accelerometer_noise_density_m_s2_sqrt_hz": 1e-3}
    assert read_imu_noise(written(tmp_path, keys)).range_std_m is None
    for unfit in ({**keys, "typo": 1}, {"gyroscope_noise_density_rad_s_sqrt_hz": 1e-4}):
        with pytest.raises(SettingsError, match=r"file\.json"):
            read_imu_noise(written(tmp_path, unfit))
    result = make_result(ROTATION.as_matrix(), np.ones(3), -5)
    assert read_result(written(tmp_path, result.to_json())) == result
    with pytest.raises(SettingsError, match="No such file"):
        read_result(tmp_path / "absent.json")
    (tmp_path / "bytes.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SettingsError, match=r"bytes\.json"):
        read_result(tmp_path / "bytes.json")


@pytest.mark.parametrize(
    ("place", "edited", "said"),
    [
        ("translation_m", [1.0, 1.0, 1.00001], "matrix and translation_m"),
        ("quaternion_xyzw", [0.0, 0.0, 0.0, 1.0], "matrix and quaternion_xyzw"),
        ("euler_xyz_deg", [1.0, 2.0, 3.0], "matrix and euler_xyz_deg"),
        ("matrix", np.eye(4).tolist(), "matrix and quaternion_xyzw"),
        ("time_offset_s", 0.05, "time_offset_s of 0.05 s"),
        ("time_offset_ns", 50_000_000, "time_offset_ns of 50000000 ns"),
    ],
)
def test_a_result_that_was_edited_in_one_form_is_refused(tmp_path: Path, place: str, edited: object, said: str) -> None:
    """`export` and `deskew` took the matrix and the nanoseconds, whatever the other forms said, in silence.

    Mutations: `_differing_forms` returns None; the times are not compared.
    """
    document = json.loads(make_result(ROTATION.as_matrix(), np.ones(3), 4_016_957).to_json())
    (document if place in document else document["T_imu_lidar"])[place] = edited
    with pytest.raises(SettingsError, match=rf"file\.json.*{said}.*unchanged\.$"):
        read_result(str(written(tmp_path, document)))


def test_a_result_written_with_fewer_digits_is_one_result(tmp_path: Path) -> None:
    """Six decimals in each form, or in all but one of them. Mutations: turns compared to the last digit; places."""
    document = json.loads(make_result(ROTATION.as_matrix(), np.array([0.1234567, -1.0, 2.0000004])).to_json())
    transform = document["T_imu_lidar"]
    rounded = {key: np.round(transform[key], 6).tolist() for key in transform}
    for whole in ("", *transform):
        document["T_imu_lidar"] = rounded | ({whole: transform[whole]} if whole else {})
        assert read_result(written(tmp_path, document)).T_imu_lidar is not None


def later(document: dict[str, object]) -> dict[str, object]:
    """The document with a key more in every object of it, as a later version of the program may write it."""

    def grown(value: object) -> object:
        if isinstance(value, dict):
            return {**{key: grown(part) for key, part in value.items()}, "rotation_to_come": [1.0]}
        return [grown(part) for part in value] if isinstance(value, list) else value

    settings = document["provenance"]
    whole = grown(document)
    assert isinstance(settings, dict)
    assert isinstance(whole, dict)
    whole["provenance"] |= {key: settings[key] for key in ("settings", "software")}  # these hold any keys
    return whole


def test_keys_that_a_later_version_adds_to_a_result_are_passed_over(tmp_path: Path) -> None:
    """The contract: keys may be added. `export` and `deskew` refused the document ("Extra inputs are not permitted"), and so did
    `--initial-guess`, and an audit where the key sounds like a mounting.

    Mutations: `from_json` without `extra`; the guess never lenient; `is_result` False. What is no result keeps its slips of the
    pen, and what is written has no unknown key. Mutation: a guess always lenient.
    """
    result = make_result(ROTATION.as_matrix(), np.ones(3), -5)
    path = written(tmp_path, later(json.loads(result.to_json())))
    assert read_result(path) == result
    assert CalibrationResult.from_json(path.read_text()).to_json() == result.to_json()
    guess = read_initial_guess(path)
    assert guess.time_offset_ns == -5
    np.testing.assert_allclose(guess.R_imu_lidar, ROTATION.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(read_extrinsic(path).T_imu_lidar[:3, 3], 1.0)
    for slip in (
        {"T_imu_lidar": {"translation_m": [0, 0, 1], "rotation": [1]}},
        {"rotation_deg": 1.0, "time_offset_s": 0},
    ):
        with pytest.raises(SettingsError):
            read_initial_guess(written(tmp_path, slip))
    with pytest.raises(ValidationError):
        Transform.model_validate({**json.loads(result.to_json())["T_imu_lidar"], "rotation_to_come": [1.0]})


RESULT_TWICE = make_result(np.eye(3), np.ones(3)).to_json().replace('"status"', '"time_offset_s": 0.5,\n  "status"', 1)


@pytest.mark.parametrize(
    ("read", "text", "key"),
    [
        (read_result, RESULT_TWICE, "time_offset_s"),
        (read_initial_guess, RESULT_TWICE, "time_offset_s"),
        (read_extrinsic, RESULT_TWICE, "time_offset_s"),
        (read_initial_guess, '{"time_offset_s": 0.1, "time_offset_s": 0.1}', "time_offset_s"),
        (
            read_planes,
            '{"schema": "unsweep.planes/1", "planes": [{"name": "a", "normal": [0,0,1], "offset_m": 1, "offset_m": 2}]}',
            "offset_m",
        ),
        (read_limits, '{"rotation_deg": 0.1, "rotation_deg": 3}', "rotation_deg"),
        (
            read_imu_noise,
            '{"range_std_m": 0.01, "gyroscope_noise_density_rad_s_sqrt_hz": 1e-4, "range_std_m": 0.02}',
            "range_std_m",
        ),
        (read_extrinsic, '{"T_imu_lidar": {"matrix": [], "matrix": []}}', "matrix"),
        (read_limits, '{"rotation\\ndeg": 0.1, "rotation\\ndeg": 3}', r"rotation\\ndeg"),
    ],
)
def test_a_key_that_stands_twice_is_refused(
    tmp_path: Path, read: Callable[[Path], object], text: str, key: str
) -> None:
    """JSON's readers take the last in silence, and somebody edited the first. Mutations: each reader's own check left out; the
    key written as it is, over two lines."""
    with pytest.raises(InputError, match=rf"the key '{key}' stands twice .*; correct (it|the file)\.$") as caught:
        read(written(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_one_key_in_several_objects_is_no_key_twice(tmp_path: Path) -> None:
    """Mutation: keys seen in one object kept for the next."""
    planes = [{"name": name, "normal": [0, 0, 1], "offset_m": 1} for name in "ab"]
    assert len(read_planes(written(tmp_path, {"schema": "unsweep.planes/1", "planes": planes}))) == 2


@pytest.mark.parametrize("read", [read_result, read_planes, read_limits, read_initial_guess, read_extrinsic])
def test_brackets_without_end_are_one_sentence(tmp_path: Path, read: Callable[[Path], object]) -> None:
    """Python's own reader of JSON gives up with a RecursionError. Mutation: that let through (a defect, and a 500 of a paste)."""
    with pytest.raises(InputError, match="Expected"):
        read(written(tmp_path, "[" * 150_000))
