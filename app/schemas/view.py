"""What the 3D scene of a recording shows, shared by all browsers that look at it."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, field_validator

from app.schemas.common import ErrorFacts, OffsetSeconds, RecordId, WireModel
from app.schemas.jobs import Job

Mode = Literal["planes", "solve", "inspect"]
Show = Literal["raw", "deskewed", "old", "both", "side", "wipe"]
Against = Literal["raw", "old"]
Extent = Literal["scan", "map", "surface"]
ColorBy = Literal["plane", "time", "residual", "intensity"]
Click = Literal["toggle", "grow", "restrict"]
Preset = Literal["overview", "inside", "top", "front"]
#: What a tab of a browser calls itself.
TabName = Annotated[str, Field(pattern="^[0-9a-f]{8,32}$")]
#: Size of the points over what their spacing asks for: a quarter is a pixel, four times are blots.
SMALLEST_POINTS, LARGEST_POINTS = 0.25, 4.0


class Nudge(WireModel):
    """A deliberate error of the answer: turn about the lidar's axes, shift along the IMU's axes, shift of the clock."""

    rx_deg: float = Field(default=0.0, ge=-30, le=30)
    ry_deg: float = Field(default=0.0, ge=-30, le=30)
    rz_deg: float = Field(default=0.0, ge=-30, le=30)
    tx_m: float = Field(default=0.0, ge=-2, le=2)
    ty_m: float = Field(default=0.0, ge=-2, le=2)
    tz_m: float = Field(default=0.0, ge=-2, le=2)
    dt_s: float = Field(default=0.0, ge=-0.5, le=0.5)


class OldExtrinsic(WireModel):
    """An extrinsic the user had before, T_imu_lidar in the contract's signs, to be looked at beside the answer."""

    translation_m: tuple[float, float, float] = Field(description="the lidar's origin in the IMU's frame")
    quaternion_xyzw: tuple[float, float, float, float] = Field(
        description="of unit length, to two digits", examples=[(0.0, 0.0, 0.0, 1.0)]
    )
    time_offset_s: OffsetSeconds | None = Field(default=None, description="None: the answer's own is kept")
    name: str = Field(
        default="", max_length=80, description="what it is called on the scene, as a run's; '': an old extrinsic"
    )

    @field_validator("quaternion_xyzw")
    @classmethod
    def _of_unit_length(cls, quaternion: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        length = math.hypot(*quaternion)
        if not abs(length - 1.0) < 1e-2:
            raise ValueError(f"expected a unit quaternion, found one of length {length:.4g}")
        x, y, z, w = (part / length for part in quaternion)
        return x, y, z, w


class ViewState(WireModel):
    """The wish: what to show. Survives restarts."""

    mode: Mode = "planes"
    job_id: RecordId | None = Field(default=None, description="whose result; None: the latest that has one")
    scan: int = Field(default=0, ge=0, description="position among the recording's scans")
    show: Show = Field(
        default="deskewed",
        description="one cloud; `both`: two in one place; `side`: beside each other; `wipe`: cut by an upright line",
    )
    against: Against = Field(default="raw", description="what `both` and `wipe` compare the de-skewed cloud with")
    wipe: float = Field(default=0.5, ge=0, le=1, description="where the line of `wipe` is, share of the canvas's width")
    extent: Extent = Field(
        default="scan",
        description="one scan, the map accumulated from many, or a surface laid through the de-skewed map",
    )
    color_by: ColorBy = "plane"
    nudge: Nudge | None = None
    old: OldExtrinsic | None = None
    click: Click = Field(
        default="toggle",
        description="what the mouse does on the canvas in mode planes: a click confirms or drops a plane, or grows one; "
        "`restrict`: a drag draws a box, a click chooses the plane it is for",
    )
    target: int | None = Field(default=None, ge=0, description="the patch that the next box restricts; None: all")
    preset: Preset = Field(
        default="overview",
        description="from where cameras look: at the room cut open, from inside it, straight down, or along a wall's normal",
    )
    looks: int = Field(default=0, ge=0, description="raise it to have cameras go to their preset again")
    point_scale: float = Field(
        default=1.0,
        ge=SMALLEST_POINTS,
        le=LARGEST_POINTS,
        description="size of the points over what their spacing asks for",
    )
    straight: float = Field(
        default=1.0, ge=0, le=1, description="how much of the motion is taken out of a solve's sweeps; 0: as they came"
    )
    dark: bool = False


class ChangeView(WireModel):
    """Fields left out stay as they are; `nudge: null` takes the nudge away, `old: null` the old extrinsic."""

    mode: Mode = Field(default="planes", examples=["inspect"])
    job_id: RecordId | None = None
    scan: int = Field(default=0, ge=0, examples=[40])
    show: Show = "deskewed"
    against: Against = "raw"
    wipe: float = Field(default=0.5, ge=0, le=1)
    extent: Extent = "scan"
    color_by: ColorBy = "plane"
    nudge: Nudge | None = None
    old: OldExtrinsic | None = None
    click: Click = "toggle"
    target: int | None = Field(default=None, ge=0)
    preset: Preset = "overview"
    looks: int = Field(default=0, ge=0)
    point_scale: float = Field(default=1.0, ge=SMALLEST_POINTS, le=LARGEST_POINTS)
    straight: float = Field(default=1.0, ge=0, le=1)
    dark: bool = False


class WallBlur(WireModel):
    """Root mean square distance of the walls' points to their planes: as measured of the answer, and with it made wrong."""

    solved_rms_m: float
    nudged_rms_m: float


class View(ViewState):
    """What is shown: the wish, within what there is."""

    scene_url: str
    n_scans: int = Field(description="0 until the recording has been read")
    scan_t_s: float | None = Field(description="the shown scan's time after the first scan")
    points_shown: int
    legend: str = Field(description="what the colours mean, with units")
    blur: WallBlur | None = Field(default=None, description="the cost of being wrong; only with a nudge")
    old_blur: WallBlur | None = Field(default=None, description="the same of the old extrinsic, where one is given")
    note: str = Field(default="", description="why the scene is empty or shows something else than asked; '' if not")


class UnderPointer(WireModel):
    """What is seen at a place of the canvas."""

    text: str = Field(description="plane, tilt, laser, range: one short sentence; '' where there is nothing")


class PlanesChanged(WireModel):
    """Fetch the planes again."""

    event: Literal["planes-changed"] = "planes-changed"
    revision: int


class JobChanged(WireModel):
    """A job of this recording entered a state."""

    event: Literal["job-changed"] = "job-changed"
    job: Job


class ViewChanged(WireModel):
    """Somebody changed what the scene shows."""

    event: Literal["view-changed"] = "view-changed"
    view: View


class RecordingChanged(WireModel):
    """Fetch the recording again; `deleted` when there is nothing left to fetch."""

    event: Literal["recording-changed"] = "recording-changed"
    deleted: bool = False


class ClickRefused(WireModel):
    """What somebody clicked or drew in the scene could not be done."""

    event: Literal["click-refused"] = "click-refused"
    error: ErrorFacts


class Resync(WireModel):
    """Messages were missed (a restart, a long pause): fetch everything again."""

    event: Literal["resync"] = "resync"


RecordingMessage = Annotated[
    PlanesChanged | JobChanged | ViewChanged | RecordingChanged | ClickRefused | Resync, Field(discriminator="event")
]
