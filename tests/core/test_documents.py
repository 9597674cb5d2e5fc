"""The contract's small files: read right, or refused with the file's name and the place in it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.documents import read_imu_noise, read_initial_guess, read_planes, read_result
from calib_core.errors import SettingsError
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
    ],
)
def test_guess_in_any_form(tmp_path: Path, transform: dict[str, object]) -> None:
    """The result's own forms, against SciPy. Fails if the angles' order or the quaternion's is turned."""
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
