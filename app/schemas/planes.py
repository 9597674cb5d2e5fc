"""Planes of a recording on the wire, and the operations that edit them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from app.schemas.common import WireModel

Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
PatchIndex = Annotated[int, Field(ge=0, description="position in the list of patches at `expected_revision`")]


class Patch(WireModel):
    """A detected plane, map frame: n . x + offset_m = 0."""

    index: int
    name: str
    normal: Vector
    offset_m: float
    area_m2: float
    n_points: int
    rms_m: float
    tilt_deg: float = Field(description="angle between the normal and the vertical, 0..90; see `upright`")
    confirmed: bool
    restricted: bool = Field(description="whether a box of its own leaves part of it out")
    insisted: bool = Field(default=False, description="whether it counts even where it turns out to be doubtful")
    doubt: str = Field(
        default="",
        description="what seems wrong with it before a solve, which leaves it out unless it is insisted on",
        examples=["does not seem to stand still"],
    )
    color: str = Field(description="as in the 3D scene", examples=["#0072b2"])


class Foreseen(WireModel):
    """The axis of the calibration that is least known with the confirmed planes, one standard deviation; see `limit`."""

    name: str = Field(examples=["Position z"])
    std: float
    unit: Literal["deg", "m", "s"]
    limit: float = Field(description="beyond which the axis is weak, in the same unit")
    weak: bool = Field(description="whether it is beyond the limit: a solve would not know this axis")
    text: str = Field(default="", description="of a weak axis: what is the matter, and what to do; for a person")


class Determinacy(WireModel):
    """Whether the confirmed planes fix all three directions of space."""

    ok: bool
    text: str
    smallest_eigenvalue: float = Field(
        description="of the mean of n n^T over distinct confirmed directions: 1/3 is best, 0 leaves a direction free"
    )


class Planes(WireModel):
    """The recording's planes as every browser sees them."""

    patches: list[Patch]
    determinacy: Determinacy
    foreseen: Foreseen | None = Field(
        default=None, description="None until there is a forecast, and where it cannot be told for these planes"
    )
    static: bool
    upright: bool = Field(default=False, description="whether the vertical is gravity's; else it is the map's z axis")
    restricted: bool = Field(description="whether a box leaves part of the cloud out, for all planes")
    can_undo: bool
    can_redo: bool
    revision: int


class _Operation(WireModel):
    expected_revision: int | None = Field(
        default=None, description="refuse with 409 if the planes have changed since; None: apply to whatever is there"
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
    name: str = Field(min_length=1, max_length=60, examples=["wall A"])


class Merge(_Operation):
    """One patch out of two or more that lie in one plane; it takes the first one's place and name."""

    op: Literal["merge"]
    indices: list[PatchIndex] = Field(min_length=2, examples=[[0, 5]])


class Grow(_Operation):
    """A new, confirmed patch around a point of the cloud."""

    op: Literal["grow"]
    seed_m: Vector = Field(description="map frame, metres", examples=[[3.2, -0.4, 1.1]])


class Side(WireModel):
    """A half-space, map frame: it keeps the points with n . x + offset_m >= 0."""

    normal: Vector
    offset_m: float


class Restrict(_Operation):
    """Keep only what lies inside a box: of one patch, or of the whole cloud.

    The box is any intersection of half-spaces: six of them make an upright box, four the pyramid seen through a
    rectangle on the screen. Planes are fitted again to what is left of them; a plane of which nothing is left goes.
    A solve uses no point of a plane, in any scan, that lies outside of its boxes.
    Boxes add up until the change is undone or the suggestion is used.
    """

    op: Literal["restrict"]
    sides: list[Side] = Field(min_length=1, max_length=12, examples=[[{"normal": [0.0, 0.0, 1.0], "offset_m": 0.5}]])
    index: int | None = Field(default=None, ge=0, description="the patch to restrict; None: all, and what grows later")


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
