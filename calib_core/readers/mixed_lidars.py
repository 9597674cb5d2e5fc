"""Whose clouds a topic carries. Two lidars that share one give clouds in turn: each scan is another sensor's, seen from
elsewhere, and an answer would be of neither. A name that is left out once, or changed while it records, is still one lidar's.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from calib_core.errors import InputError
from calib_core.phrasing import counted, joined
from calib_core.readers.clouds.cloud import RawCloud

#: judged: another lidar is one whose clouds make so large a part of those while it sends: 20 a second beside 2 are 9 %, and a
#: frame that a driver forgets now and then is rarer.
_SHARE = 0.05
#: judged: and come in turn with the others' so often, and so often of what is possible. A driver that is started anew under
#: another name, or a playback that begins anew, changes once or twice for hundreds of clouds; those that wait
#: come by twos and threes.
_TURNS, _IN_TURN = 4, 0.25


class Sender(NamedTuple):
    """What a cloud says of its lidar. lidar_id: of Livox messages, None of others."""

    frame_id: str
    lidar_id: int | None


def sender_of(cloud: RawCloud) -> Sender:
    """Whose cloud it is."""
    return Sender(cloud.frame_id, cloud.lidar_id)


def usual_frame(clouds: Sequence[RawCloud]) -> str:
    """The frame of most of them, of equally many the first: a single cloud may have another, or none."""
    return Counter(cloud.frame_id for cloud in clouds).most_common(1)[0][0]


def in_turn(senders: Sequence[Sender]) -> list[Sender]:
    """Those whose clouds come in turn, by name; none where there is one lidar. senders: of all clouds, in order."""
    counts = Counter(senders)
    if len(counts) <= 1:
        return []
    usual = counts.most_common(1)[0][0]
    others = [sender for sender in counts if sender != usual and _takes_turns(senders, sender)]
    return sorted([usual, *others], key=_named) if others else []


def _takes_turns(senders: Sequence[Sender], sender: Sender) -> bool:
    """Whether its clouds stand among those of others, from its first to its last."""
    own = [each == sender for each in senders]
    first, last = own.index(True), len(own) - own[::-1].index(True)
    stretch = own[first:last]
    n_own = sum(stretch)
    turns = sum(not before and after for before, after in pairwise(stretch))
    possible = min(n_own, len(stretch) - n_own)
    return n_own >= _SHARE * len(stretch) and turns >= max(_TURNS, _IN_TURN * possible)


def require_one_lidar(senders: Sequence[Sender], topic: str) -> None:
    """Raises InputError where lidars share the topic. senders: of its clouds, in the order in which they came."""
    several = in_turn(senders)
    if several:
        raise InputError(
            f"{counted(len(several), 'lidar')} share the topic {topic}: clouds of the frames"
            f" {joined([_named(each) for each in several])} alternate; record each lidar on a topic of its own.",
            code="points.several_lidars",
        )


def _named(sender: Sender) -> str:
    frame = sender.frame_id or "(none)"
    return frame if sender.lidar_id is None else f"{frame} (lidar_id {sender.lidar_id})"
