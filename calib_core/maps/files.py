"""Point clouds as .ply and .pcd files, every field kept to the bit, invalid points (NaN) too.

.pcd is read and written by Open3D, which knows all its number types and both binary forms. A .ply of plain binary
points is read and written here: Open3D 0.20 refuses int8, int16, uint32 and 64-bit integers in it (an Ouster's `t` is
uint32) and leaves out what others spell `ushort`. Every other .ply (text, big-endian, lists) is read by Open3D.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib_core.errors import InputError, SettingsError
from calib_core.maps.library import load_open3d

StructArray = NDArray[np.void]

#: The suffixes of the files that are known.
SUFFIXES = (".ply", ".pcd")
#: Spelled so that Open3D, PCL, CloudCompare and MeshLab all read them.
_PLY_NAMES = {
    "i1": "int8",
    "u1": "uint8",
    "i2": "int16",
    "u2": "uint16",
    "i4": "int",
    "u4": "uint",
    "f4": "float",
    "f8": "double",
}
_PLY_TYPES = {name: kind for kind, name in _PLY_NAMES.items()} | {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float32": "f4",
    "float64": "f8",
}
#: Names that mean more than one number to Open3D: a field called so is written with an underscore behind it.
_RESERVED = {"positions", "normals", "colors", "rgb", "rgba"}
_EXPANDED = {
    "positions": ("x", "y", "z"),
    "normals": ("normal_x", "normal_y", "normal_z"),
    "colors": ("red", "green", "blue"),
}
#: A header is shorter than this, whoever wrote it.
_HEADER_BYTES = 1 << 16


def write_cloud(path: Path, points: StructArray) -> None:
    """Write the points as the suffix says.   points: (N,) scalar fields, among them x y z [m] float32."""
    if path.suffix == ".ply":
        path.write_bytes(ply_bytes(points))
    elif path.suffix == ".pcd":
        _write_pcd(path, points)
    else:
        raise SettingsError(f"Expected a cloud's name to end in .ply or .pcd, but found {path.name}; change the name.")


def read_cloud(path: Path) -> StructArray:
    """The points in a .ply or .pcd file: (N,), fields as in the file, x y z first where Open3D has read it."""
    if path.suffix not in SUFFIXES:
        raise InputError(f"Expected a .ply or .pcd file, but found {path.name}; convert it first.", code="cloud.kind")
    try:
        with path.open("rb") as file:
            head = file.read(_HEADER_BYTES)
    except OSError as error:
        raise InputError(
            f"Expected a point cloud in {path}, but it cannot be read ({error.strerror}); check the name.",
            code="cloud.unreadable",
        ) from error
    if path.suffix == ".ply":
        layout = _plain_layout(head)
        if layout is not None:
            dtype, count, at = layout
            body = path.read_bytes()[at : at + count * dtype.itemsize]
            if len(body) == count * dtype.itemsize:
                return np.frombuffer(body, dtype).copy()
            raise _damaged(path)
    return _read_by_open3d(path)


def ply_bytes(points: StructArray) -> bytes:
    """A binary little-endian .ply of the points."""
    points = _packed(points)
    dtype = points.dtype
    lines = [f"property {_PLY_NAMES[dtype[n].str[1:]]} {n.replace(' ', '_')}\n" for n in dtype.names or ()]
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {points.size}\n{''.join(lines)}end_header\n"
    return head.encode("ascii", "replace") + points.tobytes()


def _packed(points: StructArray) -> StructArray:
    """The scalar fields without gaps, little-endian."""
    names = [n for n in points.dtype.names or () if points.dtype[n].shape == ()]
    dtype = np.dtype([(n, points.dtype[n].newbyteorder("<")) for n in names])
    if dtype == points.dtype:
        return points
    packed = np.empty(points.size, dtype)
    for name in names:
        packed[name] = points[name]
    return packed


def _write_pcd(path: Path, points: StructArray) -> None:
    points = _packed(points)
    if points.size == 0:  # Open3D refuses these
        path.write_bytes(_empty_pcd(points.dtype))
        return
    o3d = load_open3d()
    cloud = o3d.t.geometry.PointCloud()
    cloud.point.positions = o3d.core.Tensor(np.stack([points[n] for n in "xyz"], axis=1))
    for name in points.dtype.names or ():
        if name not in {"x", "y", "z"}:
            column = points[name].astype(points.dtype[name].newbyteorder("="))[:, None]  # Open3D knows no other
            cloud.point[_pcd_name(name)] = o3d.core.Tensor(column)
    if not o3d.t.io.write_point_cloud(str(path), cloud):
        raise InputError(
            f"The cloud could not be written to {path}; check that the folder exists and the disk has room.",
            code="cloud.unwritable",
        )


def _pcd_name(name: str) -> str:
    name = name.replace(" ", "_")
    return f"{name}_" if name in _RESERVED else name


def _empty_pcd(dtype: np.dtype[np.void]) -> bytes:
    names = dtype.names or ()
    kinds = [dtype[n] for n in names]
    letters = {"f": "F", "i": "I", "u": "U"}
    rows = (
        ("FIELDS", (_pcd_name(n) for n in names)),
        ("SIZE", (str(k.itemsize) for k in kinds)),
        ("TYPE", (letters[k.kind] for k in kinds)),
        ("COUNT", ("1" for _ in names)),
    )
    fields = "".join(f"{key} {' '.join(words)}\n" for key, words in rows)
    end = "WIDTH 0\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 0\nDATA binary\n"
    return f"VERSION 0.7\n{fields}{end}".encode("ascii", "replace")


def _plain_layout(head: bytes) -> tuple[np.dtype[np.void], int, int] | None:
    """Dtype, number of points and where they begin, of a .ply of nothing but binary little-endian points."""
    end = head.find(b"end_header\n")
    lines = [line.split() for line in head[: max(end, 0)].decode("ascii", "replace").splitlines()]
    words = [line for line in lines if line and line[0] not in {"comment", "obj_info", "ply"}]
    if end < 0 or not words or words[0] != ["format", "binary_little_endian", "1.0"]:
        return None
    elements = [line for line in words if line[0] == "element"]
    properties = [line for line in words if line[0] == "property"]
    if (
        len(elements) != 1
        or elements[0][1] != "vertex"
        or any(len(p) != 3 or p[1] not in _PLY_TYPES for p in properties)
    ):
        return None
    dtype = np.dtype([(name, "<" + _PLY_TYPES[kind]) for _, kind, name in properties])
    return dtype, int(elements[0][2]), end + len(b"end_header\n")


def _read_by_open3d(path: Path) -> StructArray:
    o3d = load_open3d()
    cloud = o3d.t.io.read_point_cloud(str(path), remove_nan_points=False, remove_infinite_points=False)
    if "positions" not in cloud.point:
        raise _damaged(path)
    columns: dict[str, NDArray[np.generic]] = {}
    for name in ("positions", *sorted(set(cloud.point) - {"positions"})):
        values = cloud.point[name].numpy()
        names = _EXPANDED.get(name, (name,))
        columns.update(dict(zip(names, values.T, strict=True)))
    points = np.empty(len(columns["x"]), [(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        points[name] = column
    return points


def _damaged(path: Path) -> InputError:
    return InputError(
        f"Expected a point cloud in {path}, but it is cut short, empty or not what its name says; copy it again.",
        code="cloud.unreadable",
    )
