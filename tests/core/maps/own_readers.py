"""Readers of .pcd and .ply that share nothing with the product's: written from the formats, for oracles."""

from __future__ import annotations

import struct
from pathlib import Path

KINDS = {("F", "4"): "f", ("F", "8"): "d", ("I", "1"): "b", ("I", "2"): "h", ("I", "4"): "i", ("I", "8"): "q"}
KINDS |= {("U", "1"): "B", ("U", "2"): "H", ("U", "4"): "I", ("U", "8"): "Q"}
PLY = {"float": "f", "double": "d", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int": "i", "uint": "I"}


def pcd_columns(path: Path) -> dict[str, list[object]]:
    """Each field's values, point by point, of a binary .pcd."""
    head, _, body = path.read_bytes().partition(b"DATA binary\n")
    facts = {line.split()[0]: line.split()[1:] for line in head.decode().splitlines() if not line.startswith("#")}
    code = "<" + "".join(KINDS[kind, size] for kind, size in zip(facts["TYPE"], facts["SIZE"], strict=True))
    assert set(facts["COUNT"]) == {"1"}
    rows = list(struct.iter_unpack(code, body)) if body else []
    assert len(rows) == int(facts["POINTS"][0])
    return {name: [row[k] for row in rows] for k, name in enumerate(facts["FIELDS"])}


def ply_columns(path: Path) -> dict[str, list[object]]:
    """Each property's values, point by point, of a binary little-endian .ply of points."""
    head, _, body = path.read_bytes().partition(b"end_header\n")
    lines = [line.split() for line in head.decode().splitlines()]
    names = [(line[2], PLY[line[1]]) for line in lines if line[0] == "property"]
    rows = list(struct.iter_unpack("<" + "".join(code for _, code in names), body))
    assert [line for line in lines if line[0] == "element"] == [["element", "vertex", str(len(rows))]]
    return {name: [row[k] for row in rows] for k, (name, _) in enumerate(names)}
