"""What the image's service is asked, in a root or in a container, started as docker/compose.yaml has it."""

from __future__ import annotations

import ctypes
import json
import subprocess
import time

from tools.image_steps import Stage, call, inside

TOKEN = "image-check"  # noqa: S105 - of a server that lives a minute in a network of its own
PATIENCE_S = 900.0
CLONE_NEWNET = 0x40000000

#: Asked from inside, beside the server.
QUESTIONS = """
import json, os, subprocess, sys, time, urllib.error, urllib.request
from pathlib import Path

def ask(method, path, body=None, token=True):
    headers = {"Authorization": "Bearer TOKEN"} if token else {}
    if body is not None and not isinstance(body, bytes):
        body, headers["Content-Type"] = json.dumps(body).encode(), "application/json"
    request = urllib.request.Request("http://127.0.0.1:8080" + path, data=body, headers=headers, method=method)
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.read()

def ended(recording):
    while True:
        jobs = json.loads(ask("GET", f"/api/recordings/{recording}/jobs")[1])
        if all(job["state"] in ("done", "failed", "cancelled", "interrupted") for job in jobs):
            return {job["kind"]: job["state"] for job in jobs}
        time.sleep(0.5)

def refused(path):
    try:
        Path(path).write_text("x")
    except OSError:
        return True
    return False

told = {"user": os.getuid(), "python": sys.version.split()[0]}
told["without a token"] = ask("GET", "/api/recordings", token=False)[0]
told["client"] = b'id="root"' in ask("GET", "/")[1]
told["cannot write"] = all(map(refused, ("/etc/x", "/opt/unsweep/x", "/home/unsweep/x", "/usr/x")))
subprocess.run(["unsweep", "simulate", "paper-fast", "/tmp/room.bag", "--quiet", "--duration-s", "3"], check=True)
made = json.loads(ask("PUT", "/api/recordings/upload?name=room.bag", Path("/tmp/room.bag").read_bytes())[1])
told["read"] = ended(made["id"])
ask("POST", f"/api/recordings/{made['id']}/jobs", {"kind": "solve"})
told["solved"] = ended(made["id"])["solve"]
print(json.dumps(told))
""".replace("TOKEN", TOKEN)


def asked_of_root(stage: Stage) -> dict[str, object]:
    """What the service in the root says, started as compose starts it: its root read-only, a /tmp of memory, its volumes."""
    for volume in stage.volumes:
        place = stage.root / volume[1:]
        call("mount", "--bind", place, place)
    call("mount", "-t", "tmpfs", "-o", "size=4g,mode=1777,nosuid,nodev", "tmpfs", stage.root / "tmp")
    # This place alone: without `bind` the file system itself could not be written, at the volumes' places either.
    call("mount", "-o", "remount,bind,ro", stage.root)
    if ctypes.CDLL(None, use_errno=True).unshare(CLONE_NEWNET) != 0:
        raise OSError(ctypes.get_errno(), "no network of its own")
    call("ip", "link", "set", "lo", "up")
    token = {"UNSWEEP_TOKEN": TOKEN}
    server = subprocess.Popen(inside(stage, [*stage.entry, *stage.command], beside=token))
    try:
        end_s = time.monotonic() + PATIENCE_S
        while subprocess.run(inside(stage, stage.health, beside={}), check=False, capture_output=True).returncode:
            if server.poll() is not None or time.monotonic() > end_s:
                raise SystemExit("The service is not well by its own health check.")
            time.sleep(1.0)
        questions = inside(stage, ["python", "-c", QUESTIONS], beside={})
        told = subprocess.run(questions, check=True, stdout=subprocess.PIPE, text=True).stdout
        server.terminate()
        stopped = server.wait(30)
    finally:
        server.kill()
    found: dict[str, object] = json.loads(told.splitlines()[-1])
    return {**found, "stopped with": stopped}


def asked_of_container(name: str) -> dict[str, object]:
    """What the service in a container says, which is bounded as in compose and has no network."""
    bounds = [
        "--read-only",
        "--tmpfs=/tmp:size=4g,mode=1777,nosuid,nodev",
        "--memory=8g",
        "--memory-swap=8g",
        "--pids-limit=512",
    ]
    bounds += [
        "--cap-drop=ALL",
        "--security-opt=no-new-privileges:true",
        "--network=none",
        f"--env=UNSWEEP_TOKEN={TOKEN}",
    ]
    call("docker", "run", "--detach", "--init", "--name", name, *bounds, "unsweep")
    try:
        end_s, state = time.monotonic() + PATIENCE_S, ""
        while state != "healthy":
            shown = ["docker", "inspect", "--format", "{{.State.Health.Status}}", name]
            state = subprocess.run(shown, check=True, capture_output=True, text=True).stdout.strip()
            if time.monotonic() > end_s:
                raise SystemExit("The container is not well by its own health check.")
            time.sleep(1.0)
        questions = ["docker", "exec", name, "python", "-c", QUESTIONS]
        told = subprocess.run(questions, check=True, stdout=subprocess.PIPE, text=True).stdout
    finally:
        call("docker", "rm", "--force", "--volumes", name)
    found: dict[str, object] = json.loads(told.splitlines()[-1])
    return found
