"""What a kept document was made of, against what is asked of the same recording now: what differs is run again.

The document has the solve's settings and the recording's SHA-256. The table has what it has not: how the recording was read, the
files of planes and guess, and the recording's size and time, so that ten thousand are not hashed to find them unchanged.
A recording is known by its bytes, wherever it lies: moved folders and other machines make nothing differ.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from app.fleet.orders import FleetOrder
from calib_core import api
from calib_core.settings import CalibrateSettings, ReadSettings

#: Why a document is not of what is asked, where that is no option.
CHANGED, UNKNOWN = "the recording", "how it was read"


@dataclass(frozen=True)
class Stored:
    """A recording as its folder lists it: bytes in all, and when it was last written [ns]."""

    size_bytes: int
    written_ns: int


def stored(path: Path) -> Stored | None:
    """How a recording lies on the disk, a folder with all its files; None where it is not there."""
    try:
        files = [path] if path.is_file() else [file for file in path.rglob("*") if file.is_file()]
        found = [file.stat() for file in files]
    except OSError:
        return None
    return Stored(sum(one.st_size for one in found), max(one.st_mtime_ns for one in found)) if found else None


def is_same_recording(path: Path, then: Stored | None, sha256: str) -> bool:
    """Whether the recording at `path` is the one of that digest.   then: how that one lay on the disk, if that is known.

    One that is not there any more, taken to the archive maybe, cannot have changed.
    """
    now = stored(path)
    if now is None or now == then:
        return True
    if then is not None and then.size_bytes != now.size_bytes:
        return False
    try:
        return api.fingerprint(path) == sha256
    except OSError:
        return False


def asked_beside(reading: ReadSettings, planes: Path | None, initial_guess: Path | None) -> str:
    """What a document does not say that it was made with, as JSON of what is not by default: to be compared, and to be read."""
    files = {"planes": planes, "initial_guess": initial_guess}
    digests = {n: hashlib.sha256(file.read_bytes()).hexdigest() for n, file in files.items() if file is not None}
    return json.dumps(reading.model_dump(mode="json", exclude_defaults=True) | digests, sort_keys=True)


def differing_options(order: FleetOrder, settings: Mapping[str, object], beside: str) -> list[str]:
    """Names of the options that a document was made with otherwise.   settings: its own.   beside: its row's `asked`, or ""."""
    try:
        made = CalibrateSettings.model_validate(settings)
    except ValidationError:  # of a version with other settings
        return ["settings"]
    names = [name for name in CalibrateSettings.model_fields if getattr(made, name) != getattr(order.solving, name)]
    now, then = _object(order.asked) or {}, _object(beside)
    if then is None:
        return [*names, UNKNOWN] if now else names
    return names + sorted(name for name in now.keys() | then.keys() if now.get(name) != then.get(name))


def _object(text: str) -> dict[str, object] | None:
    try:
        found = json.loads(text)
    except ValueError:
        return None
    return found if isinstance(found, dict) else None


def why_again(reasons: Sequence[Sequence[str]], aside: Path) -> str:
    """A sentence on recordings whose documents are of something else.   reasons: of one or more.   aside: where these are now."""
    changed = sum(CHANGED in names for names in reasons)
    options = sorted({name for names in reasons for name in names} - {CHANGED})
    why = [f"other options ({', '.join(options)})"] if options else []
    why += [f"{changed} of them changed since"] if changed else []
    count = "1 recording is" if len(reasons) == 1 else f"{len(reasons)} recordings are"
    return f"{count} run again: {' and '.join(why)}; earlier documents are in {aside}"
