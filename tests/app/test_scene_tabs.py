"""Two tabs of one recording share its scene, not what a click in it means; and a click goes through what is cut away."""

from __future__ import annotations

import msgspec
import numpy as np

from app.scene.tabs import REMEMBERED, Tabs
from bench.fuzz_scene import CAMERA, CLICK, POINTER
from tests.app.support import world

PLANES_TAB, INSPECT_TAB = "aaaaaaaa", "bbbbbbbb"
PATH = "/planes/{}"


def look(live, recording_id, socket, from_m):
    """Have the browser's camera stand there; the scene hears of it only once it has made the browser's acquaintance."""

    def seen():
        socket.send(msgspec.msgpack.encode(CAMERA | {"position": from_m}))
        camera = live.services.scenes.camera(recording_id)
        return camera is not None and np.allclose(camera.p_scene_camera, from_m)

    live.wait(seen)


def test_a_click_means_what_the_screen_says_on_which_it_was_made(shared_live):
    """Inspect in one tab, Planes in the other, opened last: a click, and a rectangle, in the first change nothing.

    Oracle: the planes over HTTP. Mutation: what was clicked judged by the shared view alone; the camera kept back as well.
    """
    recording_id = shared_live.ready()
    url = f"/api/recordings/{recording_id}"
    for tab, mode in ((INSPECT_TAB, "inspect"), (PLANES_TAB, "planes")):
        assert shared_live.http.post(f"{url}/view?tab={tab}", json={"mode": mode}).status_code == 200
    before = shared_live.http.get(f"{url}/planes").json()
    assert shared_live.http.get(f"/scene/{recording_id}/{INSPECT_TAB}/").status_code == 200
    with (
        shared_live.scene(f"{recording_id}/{INSPECT_TAB}") as inspect,
        shared_live.scene(f"{recording_id}/{PLANES_TAB}") as planes,
    ):
        look(shared_live, recording_id, inspect, (0.0, 1.0, 0.0))
        look(shared_live, recording_id, planes, (0.0, 2.0, 0.0))
        inspect.send(msgspec.msgpack.encode(CLICK | {"name": PATH.format(0)}))
        inspect.send(msgspec.msgpack.encode(POINTER))
        look(shared_live, recording_id, inspect, (0.0, 3.0, 0.0))
        planes.send(msgspec.msgpack.encode(CLICK | {"name": PATH.format(1)}))
        shared_live.wait(lambda: shared_live.http.get(f"{url}/planes").json()["revision"] > before["revision"])
    after = shared_live.http.get(f"{url}/planes").json()
    assert after["revision"] == before["revision"] + 1
    assert [p["confirmed"] for p in after["patches"]] == [True, False, True, True, True, False]


def test_tabs_are_known_by_recording_and_forgotten_in_the_end():
    """A tab nobody has heard of, as after the server's restart, is judged by the view. Mutations: one screen a tab, of
    whichever recording; no bound."""
    tabs = Tabs()
    tabs.entered("one", PLANES_TAB, "inspect")
    assert not tabs.edits("one", PLANES_TAB)
    assert tabs.edits("two", PLANES_TAB)
    assert tabs.edits("one", None)
    for other in range(REMEMBERED):
        tabs.entered("one", f"{other:08x}", "solve")
    assert tabs.edits("one", PLANES_TAB)


def test_a_plane_grows_on_the_wall_that_is_seen_not_on_the_one_cut_away(shared_live, monkeypatch):
    """From outside the wall in front is cut away, and a click goes through it. Oracle: the world's far wall.

    Mutation: all points picked from, drawn or not.
    """
    recording_id = shared_live.ready()
    hub = shared_live.services.scenes
    shared_live.http.post(f"/api/recordings/{recording_id}/view", json={"mode": "planes", "click": "grow"})
    grown = []
    monkeypatch.setattr(hub._planes, "apply", lambda _, operation: grown.append(operation.seed_m))
    with shared_live.scene(recording_id) as socket:
        eye_m = np.array([-12.0, 0.5, 0.2])
        look(shared_live, recording_id, socket, tuple(eye_m.tolist()))
        cloud_m = world.make_proposals().cloud_m.astype(np.float64)
        rays = cloud_m - eye_m
        far_m = cloud_m[:, 0].max()
        near_m = cloud_m[:, 0].min()
        # A pixel in which both walls have a point.
        for target in cloud_m[cloud_m[:, 0] > far_m - 1e-3]:
            ray = target - eye_m
            cos = rays @ ray / np.linalg.norm(rays, axis=1) / np.linalg.norm(ray)
            if (cos[cloud_m[:, 0] < near_m + 1e-3] > np.cos(0.005)).any():
                break
        hub.click_ray(recording_id, eye_m, ray, modified=False)
    ((x, _, _),) = grown
    assert abs(x - far_m) < 1e-3
