"""Clouds as files: every field of every number type to the bit, against readers of the test's own."""

from __future__ import annotations

import struct
import sys
from pathlib import Path

import numpy as np
import pytest

from calib_core.errors import InputError, SettingsError
from calib_core.maps.files import read_cloud, write_cloud
from calib_core.maps.library import load_open3d
from tests.core.maps.own_readers import pcd_columns, ply_columns

COLUMNS = {".pcd": pcd_columns, ".ply": ply_columns}
FIELDS = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("t", "<u4"), ("ring", "<u2")]
FIELDS += [("time", "<f8"), ("tag", "u1"), ("tilt", "i1"), ("layer", "<i2"), ("echo", "<i4"), ("rgb", "<f4")]


def cloud(n: int = 57) -> np.ndarray:
    """Values at the ends of their types; some points invalid in each of the ways that drivers have."""
    rng = np.random.default_rng(4)
    points = np.zeros(n, FIELDS)
    for name, kind in FIELDS:
        points[name] = rng.integers(0, 100, n) if np.dtype(kind).kind != "f" else rng.normal(size=n)
    for name in ("t", "ring", "tag", "tilt", "layer", "echo"):
        ends = np.iinfo(points.dtype[name])
        points[name][:2] = ends.min, ends.max
    for name in "xyz":
        points[name][5], points[name][6] = np.nan, 0.0
    points["x"][7] = np.inf
    points["time"][3] = 1_700_000_000.123456789
    return points


@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
def test_every_field_comes_back_to_the_bit(suffix: str, tmp_path: Path) -> None:
    """Mutations: drop invalid points on reading; write `t` as int32; write the .ply by Open3D (refuses uint32); let a
    field called rgb through to Open3D (its file is then damaged)."""
    points, path = cloud(), tmp_path / f"c{suffix}"
    write_cloud(path, points)
    columns = COLUMNS[suffix](path)
    back = read_cloud(path)
    for name, kind in FIELDS:
        stored = "rgb_" if name == "rgb" and suffix == ".pcd" else name
        own = np.array(columns[stored], np.dtype(kind))
        assert own.tobytes() == points[name].tobytes(), name
        assert back[stored].dtype == points.dtype[name]
        assert back[stored].tobytes() == points[name].tobytes(), name


@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
def test_fields_lie_as_they_like_in_memory(suffix: str, tmp_path: Path) -> None:
    """With gaps between them, big-endian, or their order of bytes spelled out. Mutation: hand Open3D the bytes."""
    points = np.zeros(3, {"names": ["x", "y", "z", "ring"], "formats": [">f4"] * 3 + [">u2"], "offsets": [0, 4, 8, 18]})
    points["x"], points["ring"] = [1.0, 2.0, 3.0], [1, 2, 300]
    for k, kind in enumerate((">", "<")):
        path = tmp_path / f"{k}{suffix}"
        spelled = np.dtype([(n, points.dtype[n].newbyteorder(kind)) for n in points.dtype.names or ()])
        write_cloud(path, points.astype(spelled) if k else points)
        columns = COLUMNS[suffix](path)
        assert columns["x"] == [1.0, 2.0, 3.0]
        assert columns["ring"] == [1, 2, 300]


@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
def test_a_cloud_without_points_is_a_file_too(suffix: str, tmp_path: Path) -> None:
    """Mutation: leave empty clouds to Open3D, which writes none."""
    write_cloud(tmp_path / f"c{suffix}", cloud(8)[:0])
    assert all(values == [] for values in COLUMNS[suffix](tmp_path / f"c{suffix}").values())


def test_clouds_of_other_programs(tmp_path: Path) -> None:
    """A text .pcd and a big-endian .ply, as written by hand here. Mutation: read every .ply as little-endian."""
    (tmp_path / "a.pcd").write_text(
        "VERSION 0.7\nFIELDS x y z normal_x normal_y normal_z ring\nSIZE 4 4 4 4 4 4 2\nTYPE F F F F F F U\n"
        "COUNT 1 1 1 1 1 1 1\nWIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA ascii\n"
        "1 2 3 0 0 1 7\nnan nan nan 0 1 0 65535\n"
    )
    points = read_cloud(tmp_path / "a.pcd")
    assert [float(v) for v in points[["x", "y", "z", "normal_z", "ring"]][0]] == [1, 2, 3, 1, 7]
    assert np.isnan(points["x"][1])
    assert points["ring"][1] == 65535
    head = (
        b"ply\nformat binary_big_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
    )
    (tmp_path / "b.ply").write_bytes(head + b"end_header\n" + struct.pack(">3f", 1.5, -2.0, 0.25))
    big = read_cloud(tmp_path / "b.ply")
    assert [float(big[n][0]) for n in "xyz"] == [1.5, -2.0, 0.25]


def test_damaged_files_and_wrong_names_are_one_sentence(tmp_path: Path) -> None:
    """Mutation: hand back the points that are left of a file cut short."""
    for suffix in (".ply", ".pcd"):
        path = tmp_path / f"c{suffix}"
        write_cloud(path, cloud())
        path.write_bytes(path.read_bytes()[:-9])
        with pytest.raises(InputError, match=r"cut short.*copy it again\.$"):
            read_cloud(path)
    with pytest.raises(InputError, match=r"cannot be read .* check the name\.$"):
        read_cloud(tmp_path / "none.ply")
    with pytest.raises(SettingsError, match=r"\.ply or \.pcd, but found c\.xyz"):
        write_cloud(tmp_path / "c.xyz", cloud())


def test_a_missing_system_library_is_one_sentence_that_names_the_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutation: let the ImportError through."""
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(InputError, match=r"apt-get install libegl1 libgl1 libx11-6 libusb-1.0-0") as caught:
        load_open3d()
    assert "\n" not in str(caught.value)
