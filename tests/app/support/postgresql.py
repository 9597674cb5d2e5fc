"""A real PostgreSQL of a test's own: Debian's server over an empty folder, reachable by a socket file and by nothing else."""

from __future__ import annotations

import os
import pwd
import shutil
import signal
import subprocess
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

PATIENCE_S = 60.0


def programs():
    """The folder of initdb and postgres, of the newest version; None where there is none."""
    named = shutil.which("postgres")
    found = [Path(named)] if named else sorted(Path("/usr/lib/postgresql").glob("*/bin/postgres"), key=_version)
    return found[-1].parent if found else None


@contextmanager
def postgresql():
    """The address of its empty database, as `serve --database` takes it."""
    folder = Path(tempfile.mkdtemp(prefix="unsweep-postgresql-"))
    who = _somebody()
    if who:
        os.chown(folder, who["user"], who["group"])
    data = folder / "data"
    quiet = {"cwd": folder, "stdout": subprocess.DEVNULL, **who}
    try:
        with (folder / "log").open("w") as log:
            make = [
                "initdb",
                "-D",
                data,
                "-U",
                "postgres",
                "--auth",
                "trust",
                "-E",
                "UTF8",
                "--locale",
                "C",
                "--no-sync",
            ]
            subprocess.run([programs() / make[0], *make[1:]], check=True, stderr=log, **quiet)
            # Nothing of it outlives the test, so nothing need reach the disk.
            words = [programs() / "postgres", "-D", data, "-k", folder, "-c", "listen_addresses=", "-c", "fsync=off"]
            with subprocess.Popen(words, stderr=log, **quiet) as server:
                try:
                    _wait_until_ready(data / "postmaster.pid")
                    yield f"postgresql+psycopg://postgres@/postgres?host={folder}"
                finally:
                    server.send_signal(signal.SIGINT)  # its fast end: connections are cut
    finally:
        shutil.rmtree(folder)


def _somebody():
    """Whom to run it as: it refuses to be root."""
    if os.geteuid() != 0:
        return {}
    names = {entry.pw_name: entry for entry in pwd.getpwall()}
    entry = names.get("postgres") or names["nobody"]
    return {"user": entry.pw_uid, "group": entry.pw_gid, "extra_groups": []}


def _wait_until_ready(status):
    """Until the server has noted, in the last line of its file, that it takes connections."""
    deadline = time.monotonic() + PATIENCE_S
    while not (status.exists() and status.read_text().split()[-1:] == ["ready"]):
        assert time.monotonic() < deadline, "PostgreSQL did not start"
        time.sleep(0.02)


def _version(path):
    return [int(word) for word in path.parts[-3].split(".") if word.isdecimal()]
