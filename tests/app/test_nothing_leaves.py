"""Nothing leaves the machine: a server at work in a network of its own, whose way out is counted.

The namespace has a loopback and one interface that leads nowhere, with the default route through it: whatever is sent to
any other machine, names looked up included, is a packet that the kernel counts there.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = """
import socket, subprocess, sys, tempfile
from pathlib import Path

def sent():
    lines = Path("/proc/self/net/dev").read_text().splitlines()
    return next(int(line.split(":")[1].split()[9]) for line in lines if line.strip().startswith("away:"))

def main():
    for command in (
        "link set lo up", "link add away type veth peer name nowhere", "link set away addrgenmode none",
        "link set nowhere addrgenmode none", "link set nowhere up", "address add 192.0.2.2/24 dev away", "link set away up",
        "neighbour add 192.0.2.1 lladdr 02:00:00:00:00:01 dev away", "route add default via 192.0.2.1",
    ):
        subprocess.run(["ip", *command.split()], check=True)
    import viser
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol
    from tests.app.support.live import serving
    before = sent()
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder)) as live:
        recording = live.ready()
        for path in ("/", "/api/docs", "/api/info", "/metrics", f"/scene/{recording}/"):
            live.http.get(path)
        where = f"ws://127.0.0.1:{live.port}/scene/{recording}"
        viser_s = [Subprotocol(f"viser-v{viser.__version__}")]
        with connect(where, origin=live.origin, subprotocols=viser_s, proxy=None, max_size=None) as scene:
            assert len(scene.recv(timeout=30)) > 16
    print("sent by the server", sent() - before)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as away:
        away.sendto(b"x", ("198.51.100.1", 9))
    print("sent on purpose", sent() - before)

if __name__ == "__main__":
    main()
"""


def isolated():
    """Whether a network namespace can be had here."""
    if shutil.which("unshare") is None or shutil.which("ip") is None:
        return False
    made = ["unshare", "--net", "ip", "link", "add", "away", "type", "veth"]
    return subprocess.run(made, capture_output=True, check=False).returncode == 0


def test_a_server_at_work_sends_nothing_anywhere(tmp_path):
    """Oracle: the kernel's count of packets, seen to count one. Mutations: a library that asks for its newest version;
    viser's tunnel opened at the start of a scene.
    """
    if not isolated():
        pytest.skip("a network namespace takes root and iproute2")
    (tmp_path / "at_work.py").write_text(PROGRAM)
    told = subprocess.run(
        ["unshare", "--net", sys.executable, "-W", "ignore", str(tmp_path / "at_work.py")],
        cwd=ROOT,
        env={"PYTHONPATH": str(ROOT), "PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "UNSWEEP_SKIP_COMPILE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert told.returncode == 0, told.stderr[-2000:]
    assert told.stdout.splitlines()[-2:] == ["sent by the server 0", "sent on purpose 1"]
