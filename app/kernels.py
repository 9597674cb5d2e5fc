"""Compiled loops made ready when the program is installed, not in somebody's first click.

Which loops with which types, a calibration knows best: one process runs two small ones in a row, each with what the other lacks,
and Numba keeps what it compiles. Two processes would both compile what both have, which is nearly all. A note beside the caches
says for which program and processor that was done.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import platform
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path

from calib_core import __version__, api
from calib_core.errors import InputError
from calib_core.settings import CalibrateSettings

#: Set, a server's first start compiles nothing: for tests, and for machines that are thrown away.
SKIP_VARIABLE = "UNSWEEP_SKIP_COMPILE"

#: The shortest recording of the paper's room that is calibrated: two seconds of standing still, then turns.
_DURATION_S = 8.0
_ERRAND = ["-m", "app.kernels", "loops"]
_BACKGROUND = ["-m", "app.kernels", "all"]
#: Nobody waits for what a server compiles beside its work.
_PATIENCE = 10
#: Beside the notes: who holds it compiles.
_LOCK_NAME = "compiling.lock"
_LIBRARY = Path(api.__file__).parent


def compile_kernels() -> None:
    """Compile in a process. Raises InputError where it fails; the program still works without."""
    command = [sys.executable, *_ERRAND]
    if subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False).returncode:
        raise InputError(
            "The calibration that compiles unsweep's loops failed; they are compiled in the first calibration instead."
        )
    note = note_path()
    note.parent.mkdir(parents=True, exist_ok=True)
    note.touch()


@cache
def compile_once() -> None:
    """Compile what is not compiled, once in this process's life; others of the machine that ask the same wait for the first one.

    Never an error: what could not be compiled, or has no place to be kept in, is compiled in the first recordings.
    """
    if is_compiled():
        return
    with suppress(InputError, OSError):
        folder = note_path().parent
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / _LOCK_NAME).open("a", encoding="ascii") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not is_compiled():
                compile_kernels()


def is_compiled() -> bool:
    """Whether nothing is to be compiled before a recording, or is not to be."""
    return bool(os.environ.get(SKIP_VARIABLE)) or note_path().exists()


def compile_in_background() -> subprocess.Popen[bytes] | None:
    """The process that compiles, with the patience of one that nobody waits for; None where all is compiled."""
    if is_compiled():
        return None
    command = [sys.executable, *_BACKGROUND]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)


def end(process: subprocess.Popen[bytes]) -> None:
    """End a compilation in the background, with all that it has started."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def note_path() -> Path:
    """The note that says: compiled for this program, these versions and this processor."""
    told = hashlib.sha256("\n".join([__version__, version("numba"), platform.python_version(), _processor()]).encode())
    for source in sorted(_LIBRARY.rglob("*.py")):
        if b"njit" in source.read_bytes():
            told.update(f"{source} {source.stat().st_mtime_ns}".encode())
    own = os.environ.get("NUMBA_CACHE_DIR")
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return (Path(own) if own else home / "unsweep") / f"compiled-{told.hexdigest()[:16]}"


def run_errand() -> None:
    """Read a recording, calibrate it with the sensors' own parameters and without, and examine it."""
    with tempfile.TemporaryDirectory(prefix="unsweep-kernels-") as folder:
        bag = Path(folder) / "room.bag"
        api.simulate("paper-normal", bag, duration_s=_DURATION_S)
        recording = api.load(bag)
        api.calibrate(recording, CalibrateSettings(intrinsics="auto"))
        api.calibrate(recording, CalibrateSettings(intrinsics="off", max_rounds=2))
        api.inspect(bag)


def _processor() -> str:
    """What code is compiled for: model and features, where the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.machine()
    return "\n".join(dict.fromkeys(line for line in lines if line.startswith(("model name", "flags", "Features"))))


def main(arguments: Sequence[str]) -> None:
    """A process that compiles: `all`, with the note when it is done, or the `loops` alone."""
    if arguments[0] == "all":
        os.nice(_PATIENCE)
        compile_kernels()
        return
    run_errand()


if __name__ == "__main__":
    main(sys.argv[1:])
