"""The set of planes and its history: frozen records, kept as JSON.

Undo keeps whole sets instead of inverse operations: a set is a few dozen numbers, and what was there before is exactly
what comes back.
"""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

from calib_core.types import PlaneProposals

Triple = tuple[float, float, float]
#: A half-space of the map frame: (nx, ny, nz, w) keeps the points with n . x + w >= 0.
Side = tuple[float, float, float, float]

#: Steps that can be taken back.
KEPT_STEPS = 200


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class EditedPatch(_Frozen):
    """A patch as edited, map frame: n . x + offset_m = 0.

    members: patches of the proposals whose points are this one's; empty for one that was grown by hand.
    color: place in the palette, the patch's own for its life: who wants to find a renamed patch again goes by it.
    region: the half-spaces it is restricted to, besides those of the whole set.   insisted: it counts even where it turns out
    to be doubtful.
    """

    name: str
    normal: Triple
    offset_m: float
    outline_m: tuple[Triple, ...]
    n_points: int
    rms_m: float
    area_m2: float
    confirmed: bool
    members: tuple[int, ...]
    color: int
    region: tuple[Side, ...] = ()
    insisted: bool = False


class PlaneSet(_Frozen):
    """All patches at one moment. region: half-spaces outside which points make no planes."""

    patches: tuple[EditedPatch, ...]
    region: tuple[Side, ...] = ()


class PlaneHistory(_Frozen):
    """Sets in the order they were made, and which one is current. `cache_key`: the proposals they started from."""

    cache_key: str
    revision: int
    steps: tuple[PlaneSet, ...]
    cursor: int

    @property
    def current(self) -> PlaneSet:
        """The set everybody sees."""
        return self.steps[self.cursor]

    @property
    def can_undo(self) -> bool:
        """Whether there is an older set."""
        return self.cursor > 0

    @property
    def can_redo(self) -> bool:
        """Whether a newer set was taken back."""
        return self.cursor + 1 < len(self.steps)

    def push(self, planes: PlaneSet) -> PlaneHistory:
        """The history with a new current set; what had been taken back is forgotten."""
        steps = (*self.steps[: self.cursor + 1], planes)[-KEPT_STEPS:]
        return self.model_copy(update={"steps": steps, "cursor": len(steps) - 1, "revision": self.revision + 1})

    def moved(self, by: int) -> PlaneHistory:
        """The history one step back (-1) or forth (+1)."""
        return self.model_copy(update={"cursor": self.cursor + by, "revision": self.revision + 1})


def suggested(proposals: PlaneProposals) -> PlaneSet:
    """The planes as detected."""
    return PlaneSet(
        patches=tuple(
            EditedPatch(
                name=patch.plane.name,
                normal=patch.plane.normal.tolist(),
                offset_m=float(patch.plane.offset_m),
                outline_m=patch.outline_m.tolist(),
                n_points=int(patch.n_points),
                rms_m=float(patch.rms_m),
                area_m2=float(patch.area_m2),
                confirmed=bool(patch.confirmed),
                members=(place,),
                color=place,
            )
            for place, patch in enumerate(proposals.patches)
        )
    )
