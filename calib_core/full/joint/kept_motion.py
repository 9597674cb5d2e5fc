"""The motion that all structure has told, kept in a folder for the next solve of the same recording.

The coarse rounds and the propagation do not depend on which planes were chosen (plane_choice.py): of an untouched suggestion and
of every choice among its planes they are the same ones. The state after them is written down by whichever solve comes first, and
taken by the next where everything that it depends on is as it was, so that a second solve gives the numbers of one from scratch.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict

from calib_core.events import Event, LogEvent
from calib_core.full.initialise.start import LidarTrack
from calib_core.full.joint.estimation import COUNTING, Estimation, JointData
from calib_core.full.odometry.reference import Followed
from calib_core.full.run import Run
from calib_core.plane_kinds import kind_of, next_name
from calib_core.record_files import as_read, as_written, keep, kept
from calib_core.settings import USED_AFTER_MOTION
from calib_core.types import FloatArray, InitialGuess, Plane

_FILE = "motion.npz"


@dataclass(frozen=True)
class KeptMotion:
    """Where the motion of one recording lies, and what it depends on. path: None for nowhere."""

    path: Path | None
    key: str

    @staticmethod
    def of(
        folder: Path | None, track_key: str, run: Run, followed: Followed, lidar: LidarTrack, guess: InitialGuess | None
    ) -> KeptMotion:
        """In a folder, None for nowhere. track_key: of all that the track depends on but the planes.

        followed: with its planes called what they are, whatever a person calls them.
        """
        if folder is None:
            return KeptMotion(None, "")
        settings = run.settings.model_dump_json(exclude=set(USED_AFTER_MOTION))
        words = [
            track_key,
            settings,
            followed.reference,
            [plane.name for plane in followed.planes],
            list(followed.late),
        ]
        digest = hashlib.sha256(json.dumps(words).encode())
        arrays = [lidar.start_s, lidar.sweep_s, lidar.R, lidar.p, lidar.v_m_s, lidar.omega_rad_s]
        for plane in followed.planes:
            arrays += [plane.normal, np.array([plane.offset_m])]
        for array in arrays:
            digest.update(np.ascontiguousarray(array).tobytes())
        if guess is not None:
            for part in (guess.R_imu_lidar, guess.p_imu_lidar, guess.time_offset_ns):
                digest.update(b"-" if part is None else np.asarray(part).tobytes())
        return KeptMotion(folder / _FILE, digest.hexdigest())

    def recall(self, run: Run) -> Estimation | None:
        """The state that was kept; None where none of this key is there, or it cannot be read. Says what was said on the way."""
        found = None if self.path is None else kept(self.path)
        if found is None:
            return None
        words, arrays = found
        try:
            document = _Document.model_validate(words)
            if document.key != self.key:
                return None
            state = as_read(Estimation, document.state, arrays)
        except (ValueError, KeyError, TypeError):
            return None
        for event in document.said:
            run.on_event(event)
        return state

    def keeping(self, data: JointData) -> JointData:
        """The same problem, of which the state after the propagation is kept on the way, and what was said until then."""
        path = self.path
        if path is None:
            return data
        said: list[LogEvent] = []
        told, heard = data.on_state, data.run.on_event

        def listen(event: Event) -> None:
            if isinstance(event, LogEvent):
                said.append(event)
            heard(event)

        def on_state(name: str, state: Estimation) -> None:
            told(name, state)
            if name == COUNTING:
                # What a choice looks at anew is left out.
                words, arrays = as_written(replace(state, support=None, observations=None, minimum=None))
                keep(path, {"key": self.key, "state": words, "said": [event.model_dump() for event in said]}, arrays)

        return replace(data, run=replace(data.run, on_event=listen), on_state=on_state)


class _Document(BaseModel):
    """What is kept beside the arrays."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    key: str
    state: dict[str, Any]
    said: list[LogEvent]


def called_as(state: Estimation, planes: Sequence[Plane], up: FloatArray) -> Estimation:
    """With its first planes called as these are, and those that came into view on the way called on from there.

    up: (3,) unit, map.
    """
    names = [plane.name for plane in planes]
    for normal in state.estimate.normals[len(planes) :]:
        names.append(next_name(kind_of(normal, up)[0], names))
    return replace(state, planes=tuple(replace(q, name=name) for q, name in zip(state.planes, names, strict=True)))
