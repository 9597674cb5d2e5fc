"""viser's own page, served by us: its control panel hidden, because controls live in our page around it."""

from __future__ import annotations

import secrets
from functools import cache
from pathlib import Path

import viser

from app.errors import Unavailable

#: Same origin, so one line of CSS reaches it; the selector is pinned by a browser test.
#: On a telephone it is another one, which has no name.
HIDE_PANEL = (
    "<style>[data-testid^='floating-panel'],.mantine-Paper-root[style*='position: fixed'],.mantine-Notifications-root"
    "{display:none!important}</style>"
)


#: Stands in the page for what each answer draws anew.
NONCE = "@nonce-of-this-answer@"

#: A file dragged over the canvas is the page's, which covers it then; else the browser would open the file instead.
FORWARD_DRAGS = (
    f"<script nonce='{NONCE}'>addEventListener('dragenter',e=>parent.dispatchEvent("
    "new DragEvent('dragenter',{dataTransfer:e.dataTransfer})))</script>"
)


#: viser's page makes code from text in two places: for a kind of scene that is never shown here, when it is loaded, and
#: for what a server wants run in it. The policy forbids both; here they make functions that do nothing, without complaint.
NO_CODE_FROM_TEXT = (
    f"<script nonce='{NONCE}'>{{const nothing=()=>()=>undefined;"
    "Function=new Proxy(Function,{apply:()=>nothing,construct:()=>nothing})}</script>"
)

#: Where viser's one script begins, and where it makes the script that it unpacks: both have to show the nonce.
LOADER = "<script data-p="
UNPACKED = 'e.type="module";e.textContent=code;'
#: Everything is in the page itself, its worker and its pictures included; the one place to talk to is this server.
POLICY = (
    "default-src 'none'; script-src 'nonce-{nonce}' 'wasm-unsafe-eval'; style-src 'unsafe-inline'; img-src data: blob:; "
    "font-src data:; connect-src 'self' data: blob:; worker-src blob: data:; object-src 'none'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'self'"
)


def scene_page() -> tuple[str, str]:
    """The page's HTML and its content security policy, good for one answer."""
    nonce = secrets.token_urlsafe(16)
    return _page().replace(NONCE, nonce), POLICY.format(nonce=nonce)


@cache
def _page() -> str:
    path = Path(viser.__file__).parent / "client" / "build" / "index.html"
    try:
        html = path.read_text(encoding="utf-8")
    except OSError as error:
        raise Unavailable("scene.no_page", "The 3D view's page is not installed; install viser again.") from error
    for place in (LOADER, UNPACKED, "</head>"):
        if html.count(place) != 1:
            raise Unavailable(
                "scene.other_page", "The 3D view's page is not the one this program knows; install it again."
            )
    html = html.replace(LOADER, f'<script nonce="{NONCE}" data-p=')
    html = html.replace(UNPACKED, f'e.type="module";e.nonce="{NONCE}";e.textContent=code;')
    return html.replace("</head>", NO_CODE_FROM_TEXT + FORWARD_DRAGS + HIDE_PANEL + "</head>")
