"""Proposed planes and their cloud on disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict

from app.arrays.folder import is_whole, verify, whole_folder
from calib_core.types import Plane, PlanePatch, PlaneProposals


class _PatchText(BaseModel):
    model_config = ConfigDict(allow_inf_nan=False)
    name: str
    normal: tuple[float, float, float]
    offset_m: float
    outline_m: list[tuple[float, float, float]]
    n_points: int
    rms_m: float
    area_m2: float
    confirmed: bool


class _ProposalsText(BaseModel):
    model_config = ConfigDict(allow_inf_nan=False)
    patches: list[_PatchText]
    reference_scans: list[int]
    static: bool


def write_proposals(folder: Path, proposals: PlaneProposals) -> None:
    """Write proposals to `folder`, whole or not at all."""
    with whole_folder(folder) as fresh:
        np.savez(
            fresh / "cloud.npz",
            cloud_m=proposals.cloud_m,
            cloud_patch=proposals.cloud_patch,
            cloud_intensity=proposals.cloud_intensity,
        )
        text = _ProposalsText(
            patches=[
                _PatchText(
                    name=patch.plane.name,
                    normal=patch.plane.normal.tolist(),
                    offset_m=float(patch.plane.offset_m),
                    outline_m=patch.outline_m.tolist(),
                    n_points=int(patch.n_points),
                    rms_m=float(patch.rms_m),
                    area_m2=float(patch.area_m2),
                    confirmed=bool(patch.confirmed),
                )
                for patch in proposals.patches
            ],
            reference_scans=[int(scan) for scan in proposals.reference_scans],
            static=bool(proposals.static),
        )
        (fresh / "patches.json").write_text(text.model_dump_json(), encoding="utf-8")


def proposal_arrays(cache: Path) -> Path:
    """Where the proposed planes are kept."""
    return cache / "planes"


def foresight_folder(cache: Path) -> Path:
    """Where it is kept what the choice of planes does to the forecast."""
    return cache / "foresight"


def has_proposals(folder: Path) -> bool:
    """Whether proposals are there."""
    return is_whole(folder)


def read_proposals(folder: Path) -> PlaneProposals:
    """Proposals as they were written, or DamagedArrays."""
    verify(folder)
    text = _ProposalsText.model_validate_json((folder / "patches.json").read_text(encoding="utf-8"))
    with np.load(folder / "cloud.npz", allow_pickle=False) as arrays:
        cloud_m, cloud_patch = arrays["cloud_m"], arrays["cloud_patch"]
        cloud_intensity = arrays["cloud_intensity"]
    return PlaneProposals(
        patches=tuple(
            PlanePatch(
                plane=Plane(name=patch.name, normal=np.array(patch.normal), offset_m=patch.offset_m),
                outline_m=np.array(patch.outline_m, dtype=np.float64).reshape(-1, 3),
                n_points=patch.n_points,
                rms_m=patch.rms_m,
                area_m2=patch.area_m2,
                confirmed=patch.confirmed,
            )
            for patch in text.patches
        ),
        cloud_m=cloud_m,
        cloud_patch=cloud_patch,
        cloud_intensity=cloud_intensity,
        reference_scans=tuple(text.reference_scans),
        static=text.static,
    )
