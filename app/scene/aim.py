"""Where cameras stand: level axes of a room, and the four ways to look at it.

overview   from outside above a corner; what stands in the way is cut away (cutaway.py)
inside     from a corner of the room, at two thirds of its height
top        a plan: straight down
front      an elevation: along the normal of the largest wall
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from app.schemas.view import Preset
from calib_core.types import BoolArray, Float32Array, FloatArray

#: Where a camera stands for each way of looking: this direction from the middle, level axes. Not quite upright: a camera
#: that looks straight down has no right and left.
DIRECTIONS: dict[Preset, tuple[float, float, float]] = {
    "overview": (-0.55, -0.55, 0.6),
    "inside": (-0.55, -0.55, 0.25),
    "top": (-0.02, 0.0, 1.0),
    "front": (-1.0, 0.0, 0.06),
}
#: So much farther than needed for all to be on the canvas.
AIM_MARGIN = 1.16
#: Nearer than this to the middle of the points nobody looks at them.
MIN_AWAY_M = 1.0
#: Who stands inside keeps so far from walls, and no farther from the middle than this share of what is seen.
CLEARANCE_M = 0.6
INSIDE_SHARE = 0.45
#: A plane bounds the room that has this share of all points in front of it.
BOUNDING_SHARE = 0.95
#: Points this near to a wall go with it: twice what a door frame, a picture or a wrong motion stands off.
BELONGS_M = 0.25
#: A camera in a wall sees both sides of it.
BEHIND_M = 0.05
#: A view that would hide more than the rest of this share shows the whole instead.
LEAST_SEEN = 0.05
#: Rounds of cutting open and going nearer; a camera between two walls may waver for ever.
ROUNDS = 6
#: Upright for a wall: so much of its normal is level.
UPRIGHT_COS = 0.3


@dataclass(frozen=True, eq=False)
class Stage:
    """The room that content stands in.

    R_level_scene: (3, 3), rows are the level axes seen in the scene's frame: x along the first wall's normal, z up.
    walls: (K, 4) planes (n, w) whose inner side is n . x + w > 0; what lies behind one is cut away.
    """

    R_level_scene: FloatArray = field(default_factory=lambda: np.eye(3))
    walls: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))

    @property
    def up(self) -> FloatArray:
        """(3,) against gravity, scene frame."""
        vertical: FloatArray = self.R_level_scene[2]
        return vertical


@dataclass(frozen=True, eq=False)
class Stand:
    """Where a camera stands and what it looks at, (3,) each, scene frame."""

    eye_m: FloatArray
    middle_m: FloatArray


def stage_of(up: FloatArray | None, walls: FloatArray) -> Stage:
    """The stage of planes (K, 4), largest first. up: (3,) scene frame; None where the scene's own z has to do."""
    vertical = np.array([0.0, 0.0, 1.0]) if up is None else up / np.linalg.norm(up)
    ahead = np.array([1.0, 0.0, 0.0])
    for normal in walls[:, :3]:
        if abs(float(normal @ vertical)) < UPRIGHT_COS:
            ahead = normal
            break
    ahead = ahead - (ahead @ vertical) * vertical
    if np.linalg.norm(ahead) < 1e-6:
        ahead = np.cross(vertical, [0.0, 1.0, 0.0])
    ahead = ahead / np.linalg.norm(ahead)
    return Stage(np.stack([ahead, np.cross(vertical, ahead), vertical]), walls)


def stand(
    points_m: FloatArray, stage: Stage, preset: Preset, *, fov_rad: float, aspect: float, whole: bool = False
) -> Stand:
    """Where to look from, so that points (N, 3) are seen as the preset says. whole: what is cut away is on the canvas, too."""
    if preset == "inside":
        return _inside(points_m, stage)
    x, y, z = DIRECTIONS[preset]
    turned = [(x, y, z), (-y, x, z), (-x, -y, z), (y, -x, z)] if preset in {"overview", "front"} else [(x, y, z)]
    # From whichever side most of the room can be seen.
    cut = partial(_cut_open, points_m, stage, fov_rad=fov_rad, aspect=aspect, rounds=0 if whole else ROUNDS)
    views = [cut(np.array(back)) for back in turned]
    return max(views, key=lambda view: view[0])[1]


def _cut_open(
    points_m: FloatArray, stage: Stage, back: FloatArray, *, fov_rad: float, aspect: float, rounds: int
) -> tuple[int, Stand]:
    """How much is seen of the room, cut open towards `back` (level axes), and from where it fills the canvas.

    rounds: so often is the camera taken nearer to what is still seen.
    """
    back = back @ stage.R_level_scene
    wall = wall_of(points_m, stage.walls)
    shown = np.ones(len(points_m), dtype=np.bool_)
    middle, eye = whole_view(points_m, fov_rad=fov_rad, aspect=aspect, back=back, up=stage.up)
    for _ in range(
        rounds
    ):  # what is cut away needs no room on the canvas; nearer, the camera may see past another wall
        kept: BoolArray = ~np.append(hidden(stage.walls, eye), False)[wall]
        if kept.sum() < LEAST_SEEN * len(points_m) or np.array_equal(kept, shown):
            break
        shown = kept
        middle, eye = whole_view(points_m[shown], fov_rad=fov_rad, aspect=aspect, back=back, up=stage.up)
    return int((~np.append(hidden(stage.walls, eye), False)[wall]).sum()), Stand(eye, middle)


def wall_of(points_m: FloatArray | Float32Array, walls: FloatArray) -> NDArray[np.int16]:
    """(N,) the wall next to each point (N, 3), -1 for none within BELONGS_M. walls: (K, 4) planes (n, w)."""
    if len(walls) == 0:
        return np.full(len(points_m), -1, dtype=np.int16)
    away_m = np.abs(points_m @ walls[:, :3].T.astype(points_m.dtype) + walls[:, 3].astype(points_m.dtype))
    nearest = away_m.argmin(axis=1)
    near = away_m[np.arange(len(points_m)), nearest] <= BELONGS_M
    return np.where(near, nearest, -1).astype(np.int16)


def hidden(walls: FloatArray, eye_m: FloatArray) -> BoolArray:
    """(K,) which walls (K, 4) a camera at eye_m (3,) would see from behind."""
    behind: BoolArray = walls[:, :3] @ eye_m + walls[:, 3] < -BEHIND_M
    return behind


def _inside(points_m: FloatArray, stage: Stage) -> Stand:
    level = points_m @ stage.R_level_scene.T
    low, high = np.percentile(level, [4, 96], axis=0)
    middle, span = (low + high) / 2, high - low
    away = np.array(DIRECTIONS["inside"])
    away = away / np.abs(away).max()
    # Straight ahead lies a little below the middle, so that floor and ceiling both are seen.
    middle_m = (middle - [0.0, 0.0, 0.1 * span[2]]) @ stage.R_level_scene
    eye_m = middle_m
    # A cupboard's front is a plane too, but nobody stands between it and the wall behind it.
    bounding = np.mean(points_m @ stage.walls[:, :3].T + stage.walls[:, 3] > -BELONGS_M, axis=0) > BOUNDING_SHARE
    walls = stage.walls[bounding]
    for share in np.linspace(INSIDE_SHARE, 0.1, 8):
        eye_m = (middle + share * span * away) @ stage.R_level_scene
        if len(walls) == 0 or (walls[:, :3] @ eye_m + walls[:, 3]).min() > CLEARANCE_M:
            break
    return Stand(eye_m, middle_m)


def whole_view(
    points_m: FloatArray,
    *,
    fov_rad: float,
    aspect: float,
    back: FloatArray | None = None,
    up: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """A middle (3,) to look at and a place (3,) to look from, so that nearly all points (N, 3) fill the canvas.

    back: (3,) from the middle towards the camera.   up: (3,).
    A point at (x, y) across the view and z towards the camera is on the canvas when |x - u| <= (t - z) half aspect and
    |y - v| <= (t - z) half, with the camera at (u, v, t). What is near spreads over more of the canvas than what is far,
    so the middle of the points is not the middle of their picture: u and v are where both edges are met at once.
    """
    back = np.array(DIRECTIONS["overview"]) if back is None else back
    back = back / np.linalg.norm(back)
    right = np.cross([0.0, 0.0, 1.0] if up is None else up, back)
    right /= np.linalg.norm(right)
    above = np.cross(back, right)
    origin = np.median(points_m, axis=0)
    x, y, z = np.stack([right, above, back]) @ (points_m - origin).T
    half = float(np.tan(fov_rad / 2))
    needed_m = max(_between_edges(x, z, half * aspect)[1], _between_edges(y, z, half)[1])
    depth_m = float(np.median(z))
    away_m = depth_m + max(MIN_AWAY_M, AIM_MARGIN * (needed_m - depth_m))
    u, v = _centred(x, z, away_m, half * aspect), _centred(y, z, away_m, half)
    middle = origin + u * right + v * above + depth_m * back
    return middle, middle + (away_m - depth_m) * back


def _between_edges(across_m: FloatArray, near_m: FloatArray, half: float) -> tuple[float, float]:
    """Where across the camera stands, and how far away, so that nearly all points touch neither edge of the canvas."""
    high = float(np.percentile(across_m + half * near_m, 99.5))
    low = float(np.percentile(across_m - half * near_m, 0.5))
    return (high + low) / 2, (high - low) / (2 * half)


def _centred(across_m: FloatArray, near_m: FloatArray, away_m: float, half: float) -> float:
    """Where across the camera stands, at that distance, so that both edges are equally far from the points' picture.

    That is where both edges of a narrower canvas are met; its width is found by halving.
    """
    narrow, wide = 1e-3 * half, half
    for _ in range(24):
        width = (narrow + wide) / 2
        if _between_edges(across_m, near_m, width)[1] > away_m:
            narrow = width
        else:
            wide = width
    return _between_edges(across_m, near_m, wide)[0]
