"""Planes of a recording on the wire, and the operations that edit them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from app.schemas.common import WireModel

Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
PatchIndex = Annotated[
    int, Field(ge=0, strict=True, description="position in the list of patches at `expected_revision`")
]


class Patch(WireModel):
    """A detected plane, map frame: n . x + offset_m = 0."""

    index: int = Field(description="position in the list of patches; operations name it by this")
    name: str = Field(description="as people call it")
    normal: Vector = Field(description="unit length, map frame")
    offset_m: float = Field(description="n . x + offset_m = 0")
    area_m2: float = Field(description="of the part that was seen")
    n_points: int = Field(description="points of the cloud that lie on it")
    rms_m: float = Field(description="root mean square distance of these points from it")
    tilt_deg: float = Field(description="angle between the normal and the vertical, 0..90; see `upright`")
    confirmed: bool = Field(description="whether a solve uses it")
    restricted: bool = Field(description="whether a box that was drawn for this plane leaves part of it out")
    insisted: bool = Field(default=False, description="whether a solve uses it even where it turns out to be doubtful")
    doubt: str = Field(
        default="",
        description="what seems wrong with it; a solve leaves it out unless it is insisted on; empty: nothing",
        examples=["seems to move against the other planes"],
    )
    color: str = Field(description="as in the 3D scene", examples=["#0072b2"])


class Foreseen(WireModel):
    """The axis of the calibration that is least known with the confirmed planes, one standard deviation; see `limit`."""

    name: str = Field(examples=["Position z"], description="of the axis, for a person")
    std: float = Field(description="standard deviation to expect, in unit")
    unit: Literal["deg", "m", "s"] = Field(description="of std and limit")
    limit: float = Field(description="beyond this standard deviation the axis is weak")
    weak: bool = Field(description="whether a solve would leave this axis weak")
    text: str = Field(default="", description="of a weak axis: why, and what to do; for a person")


class Determinacy(WireModel):
    """Whether the confirmed planes fix all three directions of space."""

    ok: bool = Field(description="whether they do: a solve can follow the motion")
    text: str = Field(description="which planes are missing, or that none is; for a person")
    smallest_eigenvalue: float = Field(
        description="of the mean of n n^T over the confirmed planes' distinct directions: 1/3 is best, 0 leaves a direction "
        "free"
    )


class Planes(WireModel):
    """The recording's planes as every browser sees them."""

    patches: list[Patch] = Field(description="all planes, confirmed or not")
    determinacy: Determinacy = Field(description="whether the confirmed planes fix all three directions of space")
    foreseen: Foreseen | None = Field(
        default=None, description="null until there is a forecast, and where it cannot be told for these planes"
    )
    static: bool = Field(description="whether the platform stood still while the cloud was taken")
    upright: bool = Field(
        default=False, description="whether tilts are measured from gravity's vertical; false: from the map's z axis"
    )
    restricted: bool = Field(description="whether a box that was drawn for all planes leaves part of the cloud out")
    can_undo: bool = Field(description="whether there is a change to take back")
    can_redo: bool = Field(description="whether there is a change to make again")
    revision: int = Field(description="grows by one with every change; for `expected_revision`")


class _Operation(WireModel):
    expected_revision: int | None = Field(
        default=None,
        strict=True,
        description="refuse with 409 if the planes have changed since; null: apply to whatever is there",
    )


class Confirm(_Operation):
    """Use the patch in the solve."""

    op: Literal["confirm"]
    index: PatchIndex


class Drop(_Operation):
    """Do not use the patch."""

    op: Literal["drop"]
    index: PatchIndex


class Toggle(_Operation):
    """Confirm the patch if it was dropped, drop it otherwise."""

    op: Literal["toggle"]
    index: PatchIndex


class Insist(_Operation):
    """Use the patch in the solve even where it turns out to be doubtful, until it is dropped."""

    op: Literal["insist"]
    index: PatchIndex


class Rename(_Operation):
    """Give the patch a name no other has."""

    op: Literal["rename"]
    index: PatchIndex
    name: str = Field(min_length=1, max_length=60, examples=["wall A"], description="the new name")


class Merge(_Operation):
    """One patch out of two or more that lie in one plane; it takes the first one's place and name."""

    op: Literal["merge"]
    indices: list[PatchIndex] = Field(min_length=2, examples=[[0, 5]], description="the patches to join")


class Grow(_Operation):
    """A new, confirmed patch around a point of the cloud."""

    op: Literal["grow"]
    seed_m: Vector = Field(description="map frame, metres", examples=[[3.2, -0.4, 1.1]])


class Side(WireModel):
    """A half-space, map frame: it keeps the points with n . x + offset_m >= 0."""

    normal: Vector = Field(description="unit length, map frame, into the half that is kept")
    offset_m: float = Field(description="n . x + offset_m = 0 on the boundary")


class Restrict(_Operation):
    """Keep only what lies inside a box: of one patch, or of the whole cloud.

    The box is any intersection of half-spaces: six of them make an upright box, four the pyramid seen through a
    rectangle on the screen. Planes are fitted again to what is left of them; a plane of which nothing is left goes.
    A solve uses no point of a plane, in any scan, that lies outside of its boxes.
    Boxes add up until the change is undone or the suggestion is used.
    """

    op: Literal["restrict"]
    sides: list[Side] = Field(
        min_length=1,
        max_length=12,
        examples=[[{"normal": [0.0, 0.0, 1.0], "offset_m": 0.5}]],
        description="the half-spaces whose intersection is kept",
    )
    index: int | None = Field(
        default=None, ge=0, strict=True, description="the patch to restrict; null: all, and what is grown later"
    )


class UseSuggestion(_Operation):
    """Back to the planes as detected."""

    op: Literal["use-suggestion"]


class Undo(_Operation):
    """Take back the last change."""

    op: Literal["undo"]


class Redo(_Operation):
    """Make the change again that was taken back."""

    op: Literal["redo"]


Operation = Annotated[
    Confirm | Drop | Toggle | Insist | Rename | Merge | Grow | Restrict | UseSuggestion | Undo | Redo,
    Field(discriminator="op"),
]
