"""What leaves the machine while a server works: `python -m bench.away` (as root, with unshare and ip).

Everything runs in a network of its own, which has a loopback and one interface that leads nowhere, with the default route
through it: whatever is sent to any other machine, names looked up included, is a packet that the kernel counts there. A
recording is made, sent, read, solved by the real method, drawn, reported and exported; the pages are asked for, and the scene
is looked at. In the end a packet is sent on purpose, and has to be counted.
"""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: Addresses that nobody has (RFC 5737), and the interface that leads to them.
WAY_OUT = (
    "link set lo up",
    "link add away type veth peer name nowhere",
    "link set away addrgenmode none",
    "link set nowhere addrgenmode none",
    "link set nowhere up",
    "address add 192.0.2.2/24 dev away",
    "link set away up",
    "neighbour add 192.0.2.1 lladdr 02:00:00:00:00:01 dev away",
    "route add default via 192.0.2.1",
)
ENDED = {"done", "failed", "cancelled", "interrupted"}
WITHIN = "--within"
REAL = "app.work.ready:run_job"


def isolated() -> bool:
    """Whether a network of its own can be had here."""
    if shutil.which("unshare") is None or shutil.which("ip") is None:
        return False
    made = ["unshare", "--net", "ip", "link", "add", "away", "type", "veth"]
    return subprocess.run(made, capture_output=True, check=False).returncode == 0


def apart(*words: str) -> Sequence[str]:
    """The command that runs this module in a network of its own."""
    return ["unshare", "--net", sys.executable, "-W", "ignore", "-m", "bench.away", WITHIN, *words]


def sent() -> int:
    """Packets that went to the interface that leads nowhere."""
    lines = Path("/proc/self/net/dev").read_text(encoding="ascii").splitlines()
    return next(int(line.split(":")[1].split()[9]) for line in lines if line.strip().startswith("away:"))


def unroutable() -> int:
    """Packets for which the kernel found no way at all: those to IPv6 addresses."""
    lines = Path("/proc/self/net/snmp6").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("Ip6OutNoRoutes"))


def work(entry: str) -> None:
    """All that a server does for a recording.   entry: what runs its jobs; only the real ones need a real recording."""
    from bench.load import scene_of
    from bench.victim import running, until

    with tempfile.TemporaryDirectory(prefix="unsweep-away-") as folder:
        content = made_here(Path(folder) / "room.bag") if entry == REAL else b"some bytes"
        with running(Path(folder) / "data", entry=entry) as victim:
            made = victim.ask("PUT", "/api/recordings/upload?name=room.bag", body=content)
            recording = f"/api/recordings/{json.loads(made.body)['id']}"

            def states() -> dict[str, str]:
                jobs = json.loads(victim.ask("GET", f"{recording}/jobs").body)
                return {str(job["kind"]): str(job["state"]) for job in jobs}

            def job(wish: dict[str, str]) -> str:
                headers = {"Content-Type": "application/json"}
                answer = victim.ask("POST", f"{recording}/jobs", headers=headers, body=json.dumps(wish).encode())
                until(lambda: set(states().values()) <= ENDED, 3600)
                return str(json.loads(answer.body)["id"])

            until(lambda: set(states().values()) <= ENDED and "planes" in states(), 3600)
            solve = job({"kind": "solve"})
            results = [f"/api/results/{solve}{part}" for part in RESULTS]
            answers = {path: victim.ask("GET", path).status for path in (*PAGES, recording, *results)}
            with scene_of(victim.port, recording.rsplit("/", 1)[-1]) as scene:
                scene.recv(timeout=60)
            sys.stdout.write(f"jobs {states()}\nanswers {sorted(set(answers.values()))} to {len(answers)} requests\n")


def made_here(bag: Path) -> bytes:
    """A recording of three seconds."""
    from calib_core import api

    api.simulate("paper-fast", bag, duration_s=3.0)
    return bag.read_bytes()


RESULTS = ("", "/download", "/thickness", "/scans", "/report", "/export/urdf", "/scene.html")
PAGES = ("/", "/api/docs", "/api/info", "/api/recordings", "/api/storage", "/metrics", "/readyz")


def within(entry: str) -> None:
    """In the network of its own: work, and count."""
    for command in WAY_OUT:
        subprocess.run(["ip", *command.split()], check=True)  # noqa: S607 - wherever the system has it
    before, before_6 = sent(), unroutable()
    work(entry)
    sys.stdout.write(f"sent by the server {sent() - before}, tried without a way {unroutable() - before_6}\n")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as away:
        away.sendto(b"x", ("198.51.100.1", 9))
    sys.stdout.write(f"sent on purpose {sent() - before}\n")


def main(words: Sequence[str]) -> int:
    """The command line."""
    if words[:1] == [WITHIN]:
        within(words[1])
        return 0
    if not isolated():
        sys.stderr.write("A network of its own takes root and iproute2.\n")
        return 2
    done = subprocess.run(apart(REAL), cwd=ROOT, check=False, capture_output=True, text=True)
    sys.stdout.write(done.stdout)
    sys.stderr.write(done.stderr)
    good = "sent by the server 0, tried without a way 0\nsent on purpose 1\n"
    return done.returncode or int(not done.stdout.endswith(good))


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
