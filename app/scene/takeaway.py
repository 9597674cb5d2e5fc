"""A scene as one page to take away, which cuts its room open by itself: there is no server to do so when the view is turned.

viser's client applies what a server says; the page says the same words to it. They go where the client keeps what is still to
be applied, a place that it shows for its own tests. The version of viser is pinned exactly, and a test in a browser turns a page
that was taken away.
"""

from __future__ import annotations

import json
from collections.abc import Mapping

from app.scene.aim import BEHIND_M
from calib_core.types import FloatArray

#: How often the page looks where its camera is.
LOOK_EVERY_MS = 60

#: camera and root are in the client's own axes; walls, as everything that was sent, in those of the scene.
_CUT = """
(() => {
  const walls = @walls@, wallOf = @wall_of@, shown = new Map();
  const eye = () => {
    const {camera} = window.__viserMutable ?? {}, root = window.__viserSceneTree?.getState()[""];
    if (!camera || !root?.wxyz) return null;
    const [w, x, y, z] = root.wxyz, at = camera.position;
    const p = root.position ?? [0, 0, 0], d = [at.x - p[0], at.y - p[1], at.z - p[2]];
    const t = [2 * (d[1] * z - d[2] * y), 2 * (d[2] * x - d[0] * z), 2 * (d[0] * y - d[1] * x)];
    return [
      d[0] + w * t[0] + (t[1] * z - t[2] * y),
      d[1] + w * t[1] + (t[2] * x - t[0] * z),
      d[2] + w * t[2] + (t[0] * y - t[1] * x),
    ];
  };
  setInterval(() => {
    const viewer = window.__viserMutable, from = eye();
    if (from === null || !Object.keys(wallOf).some((name) => name in viewer.nodeRefFromName)) return;
    const behind = walls.map(([a, b, c, w]) => a * from[0] + b * from[1] + c * from[2] + w < -@behind@);
    const said = [];
    for (const [name, wall] of Object.entries(wallOf)) {
      const visible = !behind[wall];
      if (shown.get(name) === visible) continue;
      shown.set(name, visible);
      said.push({type: "SetSceneNodeVisibilityMessage", name, visible, owner: ""});
    }
    if (said.length === 0) return;
    viewer.messageQueue.push(...said);
    viewer.requestRender();
  }, @every@);
})();
"""


def cutting_itself(html: str, walls: FloatArray, wall_of: Mapping[str, int]) -> str:
    """The page with walls (K, 4) hidden while they are seen from behind. wall_of: by each node's path, the wall it goes with."""
    if not wall_of:
        return html
    script = _CUT
    for place, value in (
        ("walls", json.dumps(walls.tolist())),
        ("wall_of", json.dumps(dict(wall_of))),
        ("behind", json.dumps(BEHIND_M)),
        ("every", json.dumps(LOOK_EVERY_MS)),
    ):
        script = script.replace(f"@{place}@", value)
    head, body, rest = html.partition("</head>")
    return f"{head}<script>{script}</script>{body}{rest}"
