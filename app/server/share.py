"""Links that show one recording to whoever has them, for a while: read-only, signed, nothing kept of them.

    {"recording": id, "until": seconds since 1970} as base64url  .  HMAC-SHA256 of it

The key comes from the server's token: a changed token ends every link.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import json
import re
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta

from app.errors import Conflict, Refused
from app.schemas.common import ID_DIGITS, is_id
from app.schemas.recordings import NewShareLink, ShareLink

COOKIE = "unsweep_share"
#: Longer than any link of ours; more is not looked at.
LONGEST_LINK = 400
#: What belongs to the one recording is checked once more where it is loaded, since a job's id does not say whose it is.
_OF_ONE = re.compile(rf"/api/(recordings/(?P<recording>{ID_DIGITS})(/.*)?|(jobs|results)/{ID_DIGITS}(/.*)?|info)")


class ShareLinks:
    """Makes and reads links.   clock: seconds since 1970."""

    def __init__(self, token: str, clock: Callable[[], float] = time.time) -> None:
        self._key = hmac.new(token.encode(), b"share", hashlib.sha256).digest()
        self._clock = clock

    def make(self, recording_id: str, until_s: float) -> str:
        """The signed part of a link."""
        text = json.dumps({"recording": recording_id, "until": until_s}, separators=(",", ":"))
        payload = base64.urlsafe_b64encode(text.encode()).decode()
        return f"{payload}.{self._signature(payload)}"

    def recording_of(self, link: str) -> str | None:
        """The recording that the link shows; None where it is not ours or has run out."""
        payload, _, signature = link.partition(".")
        if len(link) > LONGEST_LINK or not hmac.compare_digest(self._signature(payload).encode(), signature.encode()):
            return None
        try:
            found = json.loads(base64.urlsafe_b64decode(payload.encode()))
        except (ValueError, binascii.Error):
            return None
        live = float(found["until"]) > self._clock()
        return str(found["recording"]) if live and is_id(str(found["recording"])) else None

    def _signature(self, payload: str) -> str:
        return hmac.new(self._key, payload.encode(), hashlib.sha256).hexdigest()


def share_link(token: str | None, recording_id: str, wish: NewShareLink) -> ShareLink:
    """A link that shows the recording; Conflict on a server that everybody may use anyway."""
    if token is None:
        raise Conflict(
            "share.open_server",
            "This server has no token, so whoever reaches it sees everything; send its address.",
        )
    until = datetime.now(UTC) + timedelta(hours=wish.hours)
    link = ShareLinks(token).make(recording_id, until.timestamp())
    return ShareLink(path=f"/r/{recording_id}/recording?share={link}", until=until)


def other_recording() -> Refused:
    """The answer to who came by a link and asks for what it does not show."""
    return Refused("share.other", "Your link shows one recording only; ask for the server's own address.")


def shown_to_guests(path: str, recording_id: str) -> bool:
    """Whether someone with a link to the recording may GET this path: the client's page, and what is about the recording."""
    if path.split("/", 2)[1:2] not in (["api"], ["scene"], ["metrics"]):
        return True
    found = _OF_ONE.fullmatch(path)
    return found is not None and found["recording"] in {None, recording_id}
