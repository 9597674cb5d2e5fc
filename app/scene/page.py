"""viser's own page, served by us: its control panel hidden, because controls live in our page around it."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import viser

from app.errors import Unavailable

#: Same origin, so one line of CSS reaches it; the selector is pinned by a browser test.
HIDE_PANEL = "<style>[data-testid^='floating-panel'],.mantine-Notifications-root{display:none!important}</style>"


#: A file dragged over the canvas is the page's, which covers it then; else the browser would open the file instead.
FORWARD_DRAGS = (
    "<script>addEventListener('dragenter',e=>parent.dispatchEvent("
    "new DragEvent('dragenter',{dataTransfer:e.dataTransfer})))</script>"
)


@cache
def scene_page() -> str:
    """The page's HTML."""
    path = Path(viser.__file__).parent / "client" / "build" / "index.html"
    try:
        html = path.read_text(encoding="utf-8")
    except OSError as error:
        raise Unavailable("scene.no_page", f"The 3D view's page is not at {path}; install viser again.") from error
    return html.replace("</head>", HIDE_PANEL + FORWARD_DRAGS + "</head>", 1)
