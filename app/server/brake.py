"""A brake on guessing: after a few wrong tokens from one address, the next try has to wait, longer each time.

Only tokens that were not tried before count: who shows the same wrong one again, as a script with an old token does, learns
nothing by it and keeps nobody of its address waiting.
"""

from __future__ import annotations

import hashlib
import ipaddress
import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

from app.errors import TooMany

#: People mistype; a script does not need more.
FREE_TRIES = 5
LONGEST_WAIT_S = 60.0
#: After this long without a wrong try an address is like any other again.
FORGET_S = 900.0
#: Addresses remembered; whoever has more of them is not slowed down by a longer table.
MOST_ADDRESSES = 4096
#: Wrong tokens remembered of each address, the newest; more than this many scripts with old tokens count as guessing.
MOST_SEEN = 32


@dataclass(frozen=True, slots=True)
class _Tries:
    """seen: fingerprints of the newest wrong tokens: a mistyped one is nearly the right one, and is not kept."""

    wrong: int
    last_s: float
    seen: tuple[bytes, ...] = ()


class Brake:
    """Wrong tries by address. Thread-safe.   clock: seconds from anywhere, never backwards."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._key = secrets.token_bytes(16)
        self._tries: OrderedDict[str, _Tries] = OrderedDict()

    def check(self, address: str) -> None:
        """Raise TooMany where this address has to wait before it may try again."""
        now_s = self._clock()
        with self._lock:
            tries = self._tries.get(_network(address))
        if tries is None:
            return
        left_s = tries.last_s + _wait_s(tries.wrong) - now_s
        if left_s > 0:
            seconds = int(left_s) + 1
            raise TooMany(
                "token.wait",
                f"Too many wrong tokens came from this address; wait {seconds} s and try again.",
                retry_after_s=seconds,
            )

    def wrong(self, address: str, token: bytes) -> None:
        """Remember a wrong try."""
        now_s, network = self._clock(), _network(address)
        shown = hashlib.blake2b(token, key=self._key, digest_size=16).digest()
        with self._lock:
            before = self._tries.pop(network, _Tries(0, now_s))
            if now_s - before.last_s > FORGET_S:
                before = _Tries(0, now_s)
            if shown not in before.seen:
                before = _Tries(before.wrong + 1, now_s, (*before.seen, shown)[-MOST_SEEN:])
            self._tries[network] = before
            while len(self._tries) > MOST_ADDRESSES:
                self._tries.popitem(last=False)


def _wait_s(wrong: int) -> float:
    return 0.0 if wrong < FREE_TRIES else min(LONGEST_WAIT_S, 2.0 ** min(wrong - FREE_TRIES, 10))


def _network(address: str) -> str:
    """An IPv6 customer has 2^64 addresses: they count as one."""
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if found.version == 4:
        return address
    return str(ipaddress.ip_network((found, 64), strict=False))
