"""What the 3D scene of a recording shows, shared by all browsers that look at it."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, field_validator

from app.schemas.common import ErrorFacts, OffsetSeconds, RecordId, WireModel, described_by
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

    rx_deg: float = Field(default=0.0, ge=-30, le=30, description="turn about the lidar's x axis")
    ry_deg: float = Field(default=0.0, ge=-30, le=30, description="turn about the lidar's y axis")
    rz_deg: float = Field(default=0.0, ge=-30, le=30, description="turn about the lidar's z axis")
    tx_m: float = Field(default=0.0, ge=-2, le=2, description="shift along the IMU's x axis")
    ty_m: float = Field(default=0.0, ge=-2, le=2, description="shift along the IMU's y axis")
    tz_m: float = Field(default=0.0, ge=-2, le=2, description="shift along the IMU's z axis")
    dt_s: float = Field(default=0.0, ge=-0.5, le=0.5, description="added to the time offset")


class OldExtrinsic(WireModel):
    """An extrinsic the user had before, T_imu_lidar in the contract's signs, to be looked at beside the answer."""

    translation_m: tuple[float, float, float] = Field(
        description="the lidar's origin seen from the IMU, along the IMU's axes"
    )
    quaternion_xyzw: tuple[float, float, float, float] = Field(
        description="x, y, z, w of the rotation that takes lidar axes to the IMU's; of unit length, to two digits",
        examples=[(0.0, 0.0, 0.0, 1.0)],
    )
    time_offset_s: OffsetSeconds | None = Field(
        default=None,
        description="to ADD to an IMU stamp to express it in the lidar clock; null: the answer's own is kept",
    )
    name: str = Field(
        default="",
        max_length=80,
        description="what the scene calls it, such as the name of a run; empty: an old extrinsic",
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

    mode: Mode = Field(
        default="planes", description="which page's scene is shown: the planes, the solve under way, or the result"
    )
    job_id: RecordId | None = Field(
        default=None, description="the job whose result is shown; null: the latest that has one"
    )
    scan: int = Field(default=0, ge=0, description="position among the recording's scans")
    show: Show = Field(
        default="deskewed",
        description="one cloud; `both`: two in one place; `side`: beside each other; `wipe`: cut by an upright line",
    )
    against: Against = Field(default="raw", description="what `both` and `wipe` compare the de-skewed cloud with")
    wipe: float = Field(
        default=0.5,
        ge=0,
        le=1,
        description="where the line of `wipe` is, as a share of the canvas's width from the left",
    )
    extent: Extent = Field(
        default="scan",
        description="one scan, the map accumulated from many, or a surface laid through the de-skewed map",
    )
    color_by: ColorBy = Field(
        default="plane",
        description="what the points' colours mean: their plane, their time in the sweep, their distance from the plane, or "
        "the lidar's intensity",
    )
    nudge: Nudge | None = Field(default=None, description="a deliberate error of the answer; null: none")
    old: OldExtrinsic | None = Field(default=None, description="an extrinsic to compare the answer with; null: none")
    click: Click = Field(
        default="toggle",
        description="what the mouse does on the canvas in mode planes: a click confirms or drops a plane, or grows one; "
        "`restrict`: a drag draws a box, a click chooses the plane it is for",
    )
    target: int | None = Field(
        default=None, ge=0, description="index of the patch that the next box restricts; null: all"
    )
    preset: Preset = Field(
        default="overview",
        description="from where cameras look: at the room cut open, from inside it, straight down, or along a wall's normal",
    )
    looks: int = Field(default=0, ge=0, description="raise it to send the cameras to their preset again")
    point_scale: float = Field(
        default=1.0,
        ge=SMALLEST_POINTS,
        le=LARGEST_POINTS,
        description="size of the points, as a multiple of the size that fits their spacing",
    )
    straight: float = Field(
        default=1.0,
        ge=0,
        le=1,
        description="share of the motion that is taken out of a solve's sweeps; 0: as they came, 1: all",
    )
    dark: bool = Field(default=False, description="colours for a dark page")


class ChangeView(WireModel):
    """Fields left out stay as they are; `nudge: null` takes the nudge away, `old: null` the old extrinsic."""

    model_config = ConfigDict(json_schema_extra=described_by(ViewState))

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

    solved_rms_m: float = Field(description="with the answer")
    nudged_rms_m: float = Field(description="with the answer made wrong")


class View(ViewState):
    """What is shown: the wish, within what there is."""

    scene_url: str = Field(description="address of the scene on this server")
    n_scans: int = Field(description="scans of the recording; 0 until it has been read")
    scan_t_s: float | None = Field(description="the shown scan's time after the first scan")
    points_shown: int = Field(description="points that the scene draws")
    legend: str = Field(description="what the colours mean, with units")
    blur: WallBlur | None = Field(default=None, description="what the nudge costs; null without a nudge")
    old_blur: WallBlur | None = Field(default=None, description="what the old extrinsic costs; null without one")
    note: str = Field(
        default="", description="why the scene is empty or shows something else than asked; empty: it does not"
    )


class UnderPointer(WireModel):
    """What is seen at a place of the canvas."""

    text: str = Field(description="plane, tilt, laser and range in one short sentence; empty where there is nothing")


class PlanesChanged(WireModel):
    """Fetch the planes again."""

    event: Literal["planes-changed"] = "planes-changed"
    revision: int = Field(description="of the planes now")


class JobChanged(WireModel):
    """A job of this recording entered a state."""

    event: Literal["job-changed"] = "job-changed"
    job: Job = Field(description="the job in its new state")


class ViewChanged(WireModel):
    """Somebody changed what the scene shows."""

    event: Literal["view-changed"] = "view-changed"
    view: View = Field(description="what is shown now")


class RecordingChanged(WireModel):
    """Fetch the recording again; `deleted` when there is nothing left to fetch."""

    event: Literal["recording-changed"] = "recording-changed"
    deleted: bool = Field(default=False, description="whether the recording is gone")


class ClickRefused(WireModel):
    """What somebody clicked or drew in the scene could not be done."""

    event: Literal["click-refused"] = "click-refused"
    error: ErrorFacts = Field(description="why it could not be done")


class Resync(WireModel):
    """Messages were missed (a restart, a long pause): fetch everything again."""

    event: Literal["resync"] = "resync"


RecordingMessage = Annotated[
    PlanesChanged | JobChanged | ViewChanged | RecordingChanged | ClickRefused | Resync, Field(discriminator="event")
]
