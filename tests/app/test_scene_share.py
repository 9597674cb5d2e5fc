"""A scene to give away is the room as the page shows it: upright, and open towards whoever looks."""

from __future__ import annotations

import numpy as np

from app.scene import share
from app.scene.apply import ShownScene
from app.scene.build import Solved, solved_stage
from tests.app.support import world


def test_the_page_to_share_stands_upright_and_is_cut_open(monkeypatch) -> None:
    """Oracle: the stage of the page on the screen. Mutation: no stage, so that the room lies aslant and is seen through its
    ceiling.
    """
    recording = world.make_recording()
    result = world.make_result()
    solved = Solved(
        trajectory=world.make_trajectory(),
        planes=result.quality.planes,
        colors=list(range(len(result.quality.planes))),
        T_imu_lidar=np.eye(4),
    )
    seen = []
    monkeypatch.setattr(ShownScene, "export_html", lambda self: seen.append((self._content, self._behind)) or "")
    share.shared_page(recording, solved, limit=5000, dark=False)
    content, behind = seen[0]
    wanted = solved_stage(recording, solved)
    assert len(content.stage.walls) == len(result.quality.planes) > 0
    np.testing.assert_allclose(content.stage.up, wanted.up)
    assert behind, "what the first camera sees from behind is still drawn"


def test_no_sky_is_mirrored_and_no_shadow_thrown() -> None:
    """Oracle: viser's own messages, which every browser gets before anything that is drawn. Mutations: either left as viser has
    it, in software ten seconds of work before the first picture; the lights put out; planes' faces left dark.
    """
    shown = ShownScene(on_patch=lambda *_: None, on_ray=lambda *_: None)
    try:
        buffer = shown._server._websock_server.get_message_buffer()
        said = {type(message).__name__: message for message in buffer.message_from_id.values()}
    finally:
        shown.close()
    assert said["EnvironmentMapMessage"].hdri_data is None
    assert said["EnableLightsMessage"].enabled
    assert not said["EnableLightsMessage"].cast_shadow
    assert said["AmbientLightMessage"].props.intensity > 1.0
