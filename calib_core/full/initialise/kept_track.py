"""The lidar's track (`lidar_motion.py`), kept in a folder for the next solve of the same recording.

Other planes chosen, a prior given, the sensors taken for ideal: none of it changes how the lidar moved. A kept track is taken
only where everything that it depends on is as it was: a second solve gives the first one's numbers, and need not follow the
lidar again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from calib_core import record_files
from calib_core.errors import Refused
from calib_core.events import Event, LogEvent, StageEvent
from calib_core.full.initialise.lidar_motion import begin
from calib_core.full.initialise.proposed_planes import choice_among, joined
from calib_core.full.initialise.tracking_failures import of_rest
from calib_core.full.odometry.distance_travelled import require_motion
from calib_core.full.odometry.reference import Followed
from calib_core.full.odometry.reference_cloud import propose_planes
from calib_core.full.odometry.register import ScanMotion
from calib_core.full.run import Run
from calib_core.record_files import Arrays
from calib_core.settings import USED_AFTER_TRACKING
from calib_core.types import FloatArray, Plane, PlaneProposals

_FILE = "track.npz"


@dataclass(frozen=True)
class KeptTrack:
    """A track with what it was made from.

    found: the planes that were proposed.   extra: given ones that were followed beside them.   chosen: whether a choice of planes
    was given.   said: the sentences for a person on the way, said again when it is taken.   begins: position of the scan that
    the given planes told the track to begin with; None: they told none.
    """

    followed: Followed
    found: tuple[Plane, ...]
    extra: tuple[Plane, ...]
    chosen: bool
    said: tuple[LogEvent, ...]
    begins: int | None = None

    def serves(self, given: Sequence[Plane] | None, begins: int | None = None) -> bool:
        """Whether the same track would be made for this choice of planes."""
        given = choice_among(self.found, given)
        if self.begins != begins:
            return False
        # A choice among the proposals holds the map in their reference scan; without one the track may have left it.
        if self.followed.away and self.chosen != (given is not None):
            return False
        return _same(self.extra, joined(self.found, given or [])[len(self.found) :])


def follow_or_recall(
    run: Run, given: Sequence[Plane] | None, folder: Path | None, begins: int | None = None
) -> Followed:
    """The lidar's motion and planes as `begin` has them; from the folder where they lie there, and put there otherwise.

    begins: the position of the scan in whose frame the given planes are, where they tell it; None: the one proposed.
    Raises Refused where there is no motion in them.
    """
    try:
        followed = _followed_or_recalled(run, given, folder, begins)
        require_motion(followed.motions, len(run.recording.scans), followed.planes)
    except Refused as refusal:
        raise of_rest(run, refusal) from None
    return followed


def _followed_or_recalled(run: Run, given: Sequence[Plane] | None, folder: Path | None, begins: int | None) -> Followed:
    if folder is None:
        return begin(run, given, _proposed(run, begins))
    key = key_of(run)
    kept = read_track(folder / _FILE, key)
    if kept is not None and kept.serves(given, begins):
        run.on_event(StageEvent(stage="track", fraction=1.0, kept=True))
        for event in kept.said:
            run.on_event(event)
        return kept.followed
    said: list[LogEvent] = []

    def listen(event: Event) -> None:
        if isinstance(event, LogEvent):
            said.append(event)
        run.on_event(event)

    listening = replace(run, on_event=listen)
    found = _proposed(listening, begins)
    followed = begin(listening, given, found)
    planes = tuple(patch.plane for patch in found.patches)
    given = choice_among(planes, given)
    extra = tuple(joined(planes, given or [])[len(planes) :])
    kept = KeptTrack(followed, planes, extra, given is not None, tuple(said), begins)
    write_track(folder / _FILE, key, kept)
    return followed


def _proposed(run: Run, begins: int | None) -> PlaneProposals:
    return propose_planes(
        run.recording, run.settings, position=begins, on_event=run.on_event, should_cancel=run.should_cancel
    )


def key_of(run: Run) -> str:
    """A digest of all that a track depends on but the planes: the readings, when they were taken, the settings, the program."""
    settings = run.settings.model_dump_json(exclude=set(USED_AFTER_TRACKING))
    try:
        program = version("unsweep")
    except PackageNotFoundError:
        program = ""
    digest = hashlib.sha256(json.dumps([program, run.recording.sha256, settings]).encode())
    c, imu = run.clocks, run.recording.imu
    for array in (c.imu_s, c.scan_s, c.sweep_s, c.scan_points, imu.gyro_rad_s, imu.accel_m_s2):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def write_track(path: Path, key: str, kept: KeptTrack) -> None:
    """Whole or not at all."""
    motions, planes = kept.followed.motions, kept.followed.planes
    words: dict[str, Any] = {
        "key": key,
        "chosen": kept.chosen,
        "away": kept.followed.away,
        "begins": kept.begins,
        "home": bool(kept.followed.proposals),
        "of_proposal": kept.followed.of_proposal,
        "said": [event.model_dump() for event in kept.said],
        "names": [[plane.name for plane in some] for some in (planes, kept.found, kept.extra)],
    }
    arrays: Arrays = {
        "reference": np.array(kept.followed.reference),
        "planes": _rows(planes),
        "found": _rows(kept.found),
        "extra": _rows(kept.extra),
        "position": np.array([m.position for m in motions]),
        "R": np.array([m.R for m in motions]),
        "vectors": np.array([[m.p, m.omega_rad_s, m.v_m_s] for m in motions]),
        "unseen": np.array([m.unseen for m in motions]),
        "numbers": np.array([[m.share, m.rms_m, m.std_rad, m.std_m] for m in motions]),
    }
    record_files.keep(path, words, arrays)


def read_track(path: Path, key: str) -> KeptTrack | None:
    """What was written with this key; None where it was not, or what lies there cannot be read."""
    there = record_files.kept(path)
    if there is None:
        return None
    words: Any = there[0]
    stored = there[1]
    try:
        return _as_track(words, stored) if words["key"] == key else None
    except (ValueError, KeyError, TypeError):
        return None


def _as_track(words: dict[str, Any], stored: Arrays) -> KeptTrack:
    """From what was written. Raises ValueError, KeyError or TypeError where it was something else."""
    planes, found, extra = (
        [Plane(name, row[:3], float(row[3])) for name, row in zip(names, stored[rows], strict=True)]
        for names, rows in zip(words["names"], ("planes", "found", "extra"), strict=True)
    )
    columns = zip(stored["position"], stored["R"], stored["vectors"], stored["numbers"], stored["unseen"], strict=True)
    motions = [
        replace(ScanMotion(int(at), R, p, omega, v, *numbers.tolist()), unseen=unseen)
        for at, R, (p, omega, v), numbers, unseen in columns
    ]
    followed = Followed(
        int(stored["reference"]),
        planes,
        motions,
        proposals=tuple(found) if words["home"] else (),
        away=bool(words["away"]),
        of_proposal=tuple(words["of_proposal"]),
        late=tuple(which < 0 for which in words["of_proposal"]),
    )
    said = tuple(LogEvent.model_validate(event) for event in words["said"])
    return KeptTrack(followed, tuple(found), tuple(extra), bool(words["chosen"]), said, words["begins"])


def _rows(planes: Sequence[Plane]) -> FloatArray:
    return np.array([[*plane.normal, plane.offset_m] for plane in planes], dtype=np.float64).reshape(-1, 4)


def _same(some: Sequence[Plane], others: Sequence[Plane]) -> bool:
    """The same planes under the same names."""
    names = [plane.name for plane in some] == [plane.name for plane in others]
    return names and np.array_equal(_rows(some), _rows(others))
