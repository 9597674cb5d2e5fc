"""`python -m bench.first_views`: what a person sees first of ten scenarios, judged by geometry and drawn into one picture.

    python -m bench.first_views [--folder DIR] [SCENARIO ...]     writes docs/images/first-views.png

Each recording goes the way it goes in the application: the doctor's report, the planes, their names and the vertical, the
scene as data, the camera. The truth says what is floor and which way is up.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy.spatial import cKDTree

from app.planes.state import PlaneHistory, PlaneSet, suggested
from app.planes.upright import Room, named, room_of
from app.scene.aim import Stage, hidden, stand, wall_of
from app.scene.build import build_planes
from app.scene.items import Cloud, Content, Edges, Label, Sheet
from calib_core import api
from calib_core.simulate import TruthFile, simulate, truth_path
from calib_core.types import FloatArray, PlaneProposals

SCENARIOS = (
    "paper-normal", "handheld", "walking-person", "ouster", "attic",
    "partial-views", "outdoor", "livox", "vehicle", "one-axis",
)  # fmt: skip
PICTURE = Path(__file__).resolve().parents[1] / "docs" / "images" / "first-views.png"
#: The first picture is of the first seconds; a car moves late.
DURATION_S = 8.0
FOV_RAD, WIDTH, HEIGHT = float(np.radians(50.0)), 480, 300
POINTS = 40_000
#: What the truth calls what one stands on.
GROUNDS = ("floor", "ground")
#: A sheet's corner this near to a true plane lies on it: the sheets' cells are 5 cm and more.
ON_PLANE_M = 0.12
#: What stands so far over the ground, beside a point of it within this.
OVER_M, BESIDE_M = 0.5, 0.3
#: Between two rings of a sixteen-beam lidar, 2 deg apart, is seen ground, however far out; a cell of it may reach over its edge.
RINGS_RAD = float(np.radians(2.5))
#: Nobody sees that a room is this little aslant.
UP_DEG = 5.0


@dataclass(frozen=True)
class FirstView:
    """What was found.

    up_deg: between the scene's vertical and the truth's.   floor_low: the true floor is lower in the picture than what stands
    over it; None where nothing is seen to.   wrong_names: planes whose name is not what they are.   inside: the camera that
    stands inside is in front of every true plane that bounds the room.   stray: share of the sheets' corners where nothing was
    seen.   furniture: share of those that lie on no true plane.   seen: share of the points that the first view shows.
    """

    slug: str
    up_deg: float
    floor_low: bool | None
    wrong_names: list[str]
    inside: bool
    stray: float
    furniture: float
    seen: float
    content: Content

    @property
    def faults(self) -> list[str]:
        """Everything that a person would call wrong."""
        return [
            *([f"up is {self.up_deg:.1f} deg off"] if self.up_deg > UP_DEG else []),
            *(["the floor is not below"] if self.floor_low is False else []),
            *[f"wrongly named: {name}" for name in self.wrong_names],
            *(["the camera inside is not"] if not self.inside else []),
            *([f"{self.stray:.0%} of the sheets are where nothing was seen"] if self.stray > 0.02 else []),
            *([f"only {self.seen:.0%} of the points are seen"] if self.seen < 0.25 else []),
        ]


def look(slug: str, folder: Path, *, duration_s: float = DURATION_S) -> FirstView:
    """The first view of a scenario."""
    path = folder / f"{slug}.bag"
    simulate(slug, path, seed=1, duration_s=duration_s)
    report = api.inspect(path)
    proposals = api.propose_planes(api.load(path, fingerprint=False))
    room = room_of(report.planes, proposals)
    planes = named_planes(proposals, room)
    content = build_planes(proposals, planes, limit=POINTS, up=room.up)
    truth = TruthFile.model_validate_json(truth_path(path).read_text(encoding="utf-8"))
    path.unlink()
    true = np.array([(*plane.normal, plane.offset_m) for plane in truth.planes])
    grounds = [row for row, plane in zip(true, truth.planes, strict=True) if plane.name in GROUNDS]
    up = grounds[0][:3] if grounds else content.stage.up
    cloud = next(item.xyz for item in content.items if isinstance(item, Cloud)).astype(np.float64)
    found = stand(cloud, content.stage, "overview", fov_rad=FOV_RAD, aspect=WIDTH / HEIGHT)
    within = stand(cloud, content.stage, "inside", fov_rad=FOV_RAD, aspect=WIDTH / HEIGHT)
    corners = np.concatenate([item.vertices for item in content.items if isinstance(item, Sheet)]).astype(np.float64)
    apart_m, _ = cKDTree(proposals.cloud_m).query(corners)
    off_m = np.abs(corners @ true[:, :3].T + true[:, 3]).min(axis=1)
    cut = np.append(hidden(content.stage.walls, found.eye_m), False)
    shown = cloud[~cut[wall_of(cloud, content.stage.walls)]]
    floor_low = None
    if grounds:
        rows = project(shown, found.eye_m, found.middle_m, content.stage.up)[:, 1]
        floor_low = is_below(shown, rows, grounds[0])
    bounding = true[np.mean(cloud @ true[:, :3].T + true[:, 3] > -ON_PLANE_M, axis=0) > 0.95]
    sides = bounding[:, :3] @ within.eye_m + bounding[:, 3]
    return FirstView(
        slug=slug,
        up_deg=float(np.degrees(np.arccos(np.clip(content.stage.up @ up, -1.0, 1.0)))),
        floor_low=floor_low,
        wrong_names=wrong_names(planes, up),
        inside=bool((sides > 0.0).all()),
        stray=float(((apart_m > BESIDE_M) & (aside_rad(corners, proposals.cloud_m) > RINGS_RAD)).mean()),
        furniture=float((off_m > ON_PLANE_M).mean()),
        seen=float((~cut[wall_of(cloud, content.stage.walls)]).mean()),
        content=content,
    )


def aside_rad(points_m: FloatArray, cloud_m: NDArray[np.float32]) -> FloatArray:
    """(N,) [rad]: how far from each point the nearest ray passed, seen from the lidar, which stands at the map's origin."""
    ways, rays = (xyz / np.maximum(np.linalg.norm(xyz, axis=1), 1e-6)[:, None] for xyz in (points_m, cloud_m))
    chord, _ = cKDTree(rays).query(ways)
    return 2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))


def is_below(points_m: FloatArray, rows: FloatArray, ground: FloatArray) -> bool | None:
    """Whether ground is lower in the picture than what stands over it; None where nothing does. ground: (4,) plane."""
    height_m = points_m @ ground[:3] + ground[3]
    flat = points_m - height_m[:, None] * ground[:3]
    low, high = np.flatnonzero(np.abs(height_m) < ON_PLANE_M), np.flatnonzero(height_m > OVER_M)
    if len(low) == 0 or len(high) == 0:
        return None
    apart_m, nearest = cKDTree(flat[low]).query(flat[high])
    over = apart_m < BESIDE_M
    return bool(np.mean(rows[low[nearest[over]]] > rows[high[over]]) > 0.95) if over.any() else None


def named_planes(proposals: PlaneProposals, room: Room) -> PlaneSet:
    """The suggestion, with the doctor's names."""
    history = PlaneHistory(cache_key="", revision=0, steps=(suggested(proposals),), cursor=0)
    return named(history, room).current


def wrong_names(planes: PlaneSet, up: FloatArray) -> list[str]:
    """Floors above the lidar or that lean, ceilings below it, walls that lie."""
    wrong = []
    for patch in planes.patches:
        cosine, height_m = float(np.array(patch.normal) @ up), -patch.offset_m * float(np.array(patch.normal) @ up)
        good = {
            "floor": abs(cosine) > 0.9 and height_m < 0,
            "ceiling": abs(cosine) > 0.9 and height_m > 0,
            "wall": abs(cosine) < 0.35,
        }
        kind = patch.name.split(" ")[0]
        if not good.get(kind, True):
            wrong.append(patch.name)
    return wrong


def project(points_m: FloatArray, eye_m: FloatArray, middle_m: FloatArray, up: FloatArray) -> FloatArray:
    """(N, 3): pixel right, pixel down, depth [m]."""
    ahead = (middle_m - eye_m) / np.linalg.norm(middle_m - eye_m)
    right = np.cross(ahead, up)
    right /= np.linalg.norm(right)
    seen = (points_m - eye_m) @ np.stack([right, np.cross(ahead, right), ahead]).T
    scale = HEIGHT / 2 / np.tan(FOV_RAD / 2)
    depth = np.maximum(seen[:, 2], 1e-6)
    pixels = [WIDTH / 2 + scale * seen[:, 0] / depth, HEIGHT / 2 + scale * seen[:, 1] / depth, seen[:, 2]]
    return np.stack(pixels, axis=1)


def draw(view: FirstView, *, upright: bool = True) -> Image.Image:
    """The first view as the application aims it: points in their colours, outlines, names, what is cut away left out.

    upright: else the whole cloud in the lidar's own axes, as it is seen where nobody asks which way is up.
    """
    content = view.content
    stage = content.stage if upright else Stage()
    cloud = next(item for item in content.items if isinstance(item, Cloud))
    found = stand(cloud.xyz.astype(np.float64), stage, "overview", fov_rad=FOV_RAD, aspect=WIDTH / HEIGHT)
    cut = np.append(hidden(stage.walls, found.eye_m), False)
    kept = ~cut[wall_of(cloud.xyz, stage.walls)]
    seen = project(cloud.xyz[kept].astype(np.float64), found.eye_m, found.middle_m, stage.up)
    canvas: NDArray[np.uint8] = np.full((HEIGHT, WIDTH, 3), (12, 14, 17), np.uint8)
    order = np.argsort(-seen[:, 2], kind="stable")
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        x, y = (np.floor(seen[order, 0]) + dx).astype(int), (np.floor(seen[order, 1]) + dy).astype(int)
        on = (x >= 0) & (x < WIDTH) & (y >= 0) & (y < HEIGHT) & (seen[order, 2] > 0)
        canvas[y[on], x[on]] = cloud.rgb[kept][order][on]
    image = Image.fromarray(canvas)
    pen = ImageDraw.Draw(image)
    for item in content.items if upright else ():
        if isinstance(item, Edges) and (item.wall is None or not cut[item.wall]):
            ends = project(item.ends.reshape(-1, 3).astype(np.float64), found.eye_m, found.middle_m, stage.up)
            for first, second in ends.reshape(-1, 2, 3):
                if min(first[2], second[2]) > 0:
                    pen.line((*first[:2], *second[:2]), fill=item.rgb)
    for item in content.items if upright else ():
        if isinstance(item, Label) and (item.wall is None or not cut[item.wall]):
            x, y, depth = project(item.position[None].astype(np.float64), found.eye_m, found.middle_m, stage.up)[0]
            if depth > 0:
                pen.text((x, y), item.text, fill="white", anchor="mm", stroke_width=2, stroke_fill="black")
    pen.text((8, 6), view.slug if upright else f"{view.slug}, as the lidar has it", fill="white")
    return image


def main() -> int:
    """Look at all, say what is wrong, draw them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", nargs="*", default=SCENARIOS)
    parser.add_argument("--folder", type=Path, help="for the recordings, which go when they have been looked at")
    given = parser.parse_args()
    sheet = Image.new("RGB", (2 * WIDTH, HEIGHT * len(given.scenarios)))
    wrong = 0
    with tempfile.TemporaryDirectory(dir=given.folder) as folder:
        for place, slug in enumerate(given.scenarios):
            view = look(slug, Path(folder))
            sheet.paste(draw(view, upright=False), (0, place * HEIGHT))
            sheet.paste(draw(view), (WIDTH, place * HEIGHT))
            names = ", ".join(item.text for item in view.content.items if isinstance(item, Label))
            shares = f"{view.seen:.0%} seen, {view.furniture:.0%} of the sheets on furniture"
            print(f"{slug}: {'; '.join(view.faults) or 'right'} ({names}; {shares})", flush=True)
            wrong += bool(view.faults)
    if tuple(given.scenarios) == SCENARIOS:
        sheet.quantize(128, dither=Image.Dither.NONE).save(PICTURE, optimize=True)
    else:
        sheet.save(PICTURE.with_name("first-views-some.png"))
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
