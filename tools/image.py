"""Build the image and run it as docker/compose.yaml says: `python tools/image.py [--root DEBIAN] [--work FOLDER]`.

With a Docker engine at hand, `docker build` makes it. Without one, and with --root, docker/Dockerfile's own steps are run one by
one in copies of an unpacked Debian root (as root: overlay mounts, chroot), which stands in for the base image:

    debootstrap --variant=minbase --include=python3,python3-venv,python3-pip,python-is-python3,ca-certificates bookworm DEBIAN

Either way the service is then started as the image's user, its root read-only, in a network of its own, and asked: is it well
by its own health check, does it refuse who has no token, is the client in it, can it write nowhere but its data, does it read
and solve a recording. Which of the two ways it was is said first. What a root cannot show: bounds of memory and processes.
"""

from __future__ import annotations

import argparse
import ctypes
import fnmatch
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
KNOWN = {"ARG", "FROM", "WORKDIR", "COPY", "RUN", "ENV", "USER", "VOLUME", "EXPOSE", "HEALTHCHECK", "ENTRYPOINT", "CMD"}
#: A builder's network is its host's: names, and whom it trusts.
FROM_HOST = ("/etc/resolv.conf", "/etc/ssl/certs/ca-certificates.crt")
HOST_ENVIRONMENT = ("PIP_CERT", "SSL_CERT_FILE", "NODE_EXTRA_CA_CERTS", "http_proxy", "https_proxy", "no_proxy")
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


@dataclass(frozen=True, slots=True)
class Step:
    """One instruction. text: all behind its word, lines joined."""

    word: str
    text: str


@dataclass
class Stage:
    """What an instruction finds, and leaves to the next."""

    root: Path
    environment: dict[str, str] = field(
        default_factory=lambda: {"PATH": "/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"}
    )
    folder: str = "/"
    user: str = "root"
    volumes: list[str] = field(default_factory=list)
    entry: list[str] = field(default_factory=list)
    command: list[str] = field(default_factory=list)
    health: list[str] = field(default_factory=list)


def steps(text: str) -> list[Step]:
    """The instructions of a Dockerfile, comments left out; an unknown one is refused."""
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    found = []
    for line in "\n".join(lines).replace("\\\n", " ").splitlines():
        word, _, rest = line.strip().partition(" ")
        if word not in KNOWN:
            raise SystemExit(f"docker/Dockerfile has the instruction {word}, which tools/image.py does not know.")
        found.append(Step(word, " ".join(rest.split()) if word != "RUN" else rest.strip()))
    return found


def expanded(text: str, values: Mapping[str, str]) -> str:
    """The text with $NAME and ${NAME} put in."""
    return re.sub(r"\$\{?(\w+)\}?", lambda found: values.get(found[1], ""), text)


def context_files() -> list[Path]:
    """What a builder would be sent: files under version control but for those of .dockerignore."""
    listed = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.splitlines()
    patterns = [line for line in (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines() if line]
    kept = [name for name in listed if not any(ignored(name, pattern) for pattern in patterns)]
    return [Path(name) for name in kept]


def ignored(name: str, pattern: str) -> bool:
    """Whether a file is left out by a line of .dockerignore, itself or through a folder it lies in."""
    parts = name.split("/")
    whole = ["/".join(parts[: k + 1]) for k in range(len(parts))]
    if pattern.startswith("**/"):
        return any(fnmatch.fnmatchcase(part, pattern[3:]) for part in parts)
    return any(fnmatch.fnmatchcase(each, pattern) and each.count("/") == pattern.count("/") for each in whole)


class Roots:
    """Runs a Dockerfile's steps in copies of an unpacked root."""

    def __init__(self, base: Path, work: Path) -> None:
        self._base = base
        self._work = work
        self._stages: dict[str, Stage] = {}

    def build(self, todo: Sequence[Step]) -> Stage:
        """The last stage."""
        stage = Stage(self._base)
        for number, step in enumerate(todo):
            began_s = time.monotonic()
            if step.word == "FROM":
                _, _, name = step.text.partition(" AS ")
                stage = self._stages[name or "last"] = Stage(self._copy(name or "last"))
            else:
                self._do(stage, step)
            sys.stderr.write(
                f"[{number + 1}/{len(todo)}] {step.word} {step.text[:90]} ({time.monotonic() - began_s:.0f} s)\n"
            )
        return stage

    def _copy(self, name: str) -> Path:
        upper, work, root = (self._work / name / part for part in ("upper", "work", "root"))
        for folder in (upper, work, root):
            folder.mkdir(parents=True)
        call("mount", "-t", "overlay", "overlay", "-o", f"lowerdir={self._base},upperdir={upper},workdir={work}", root)
        for marker in root.glob("usr/lib/python3*/EXTERNALLY-MANAGED"):
            marker.unlink()  # the base image's Python is its own, not Debian's
        call("mount", "-t", "proc", "proc", root / "proc")
        (root / "dev" / "shm").mkdir(exist_ok=True)
        call("mount", "-t", "tmpfs", "-o", "size=64m,mode=1777", "tmpfs", root / "dev" / "shm")
        for path in FROM_HOST:
            if Path(path).exists():
                shutil.copy(path, root / path[1:])
        return root

    def _do(self, stage: Stage, step: Step) -> None:
        text = step.text
        if step.word == "WORKDIR":
            stage.folder = os.path.join(stage.folder, text)  # noqa: PTH118 - a path of the image
            (stage.root / stage.folder[1:]).mkdir(parents=True, exist_ok=True)
        elif step.word == "COPY":
            self._take(stage, shlex.split(text))
        elif step.word == "RUN":
            run_in(
                stage,
                ["/bin/sh", "-c", text],
                beside={name: os.environ[name] for name in HOST_ENVIRONMENT if name in os.environ},
            )
        elif step.word == "ENV":
            for pair in shlex.split(text):
                name, _, value = pair.partition("=")
                stage.environment[name] = expanded(value, stage.environment)
        elif step.word == "USER":
            stage.user = text
        elif step.word == "VOLUME":
            stage.volumes += text.split()
        elif step.word == "ENTRYPOINT":
            stage.entry = json.loads(text)
        elif step.word == "CMD":
            stage.command = json.loads(text)
        elif step.word == "HEALTHCHECK":
            stage.health = json.loads(text.partition(" CMD ")[2])

    def _take(self, stage: Stage, words: list[str]) -> None:
        *sources, target = [word for word in words if not word.startswith("--")]
        to = stage.root / os.path.join(stage.folder, target)[1:]  # noqa: PTH118 - a path of the image
        origin = next((word.partition("=")[2] for word in words if word.startswith("--from=")), "")
        if origin:
            to.mkdir(parents=True, exist_ok=True)
            call("cp", "-a", f"{self._stages[origin].root / sources[0][1:]}/.", to)
            return
        for source in sources:
            for file in context_files():
                if file.is_relative_to(source):
                    place = to / file.name if file == Path(source) else to / file.relative_to(source)
                    place.parent.mkdir(parents=True, exist_ok=True)
                    shutil.copy(ROOT / file, place)


def call(*words: object) -> None:
    """A command that must succeed."""
    subprocess.run([str(word) for word in words], check=True)


def inside(stage: Stage, command: Sequence[str], *, beside: Mapping[str, str]) -> list[str]:
    """The words that run a command in a stage's root, as its user, in its folder, with its environment and no other."""
    home = "/root" if stage.user == "root" else f"/home/{stage.user}"
    pairs = [f"{name}={value}" for name, value in {"HOME": home, **beside, **stage.environment}.items()]
    script = f"cd {shlex.quote(stage.folder)} && exec {shlex.join(command)}"
    return [
        "chroot",
        f"--userspec={stage.user}",
        str(stage.root),
        "/usr/bin/env",
        "-i",
        *pairs,
        "/bin/sh",
        "-c",
        script,
    ]


def run_in(stage: Stage, command: Sequence[str], *, beside: Mapping[str, str]) -> None:
    """A command in a stage's root that must succeed."""
    subprocess.run(inside(stage, command, beside=beside), check=True, stdout=sys.stderr)


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


def engine() -> bool:
    """Whether a Docker engine answers."""
    if shutil.which("docker") is None:
        return False
    return subprocess.run(["docker", "info"], check=False, capture_output=True).returncode == 0


def built(root: Path | None, work: Path) -> Iterator[str]:
    """Lines: which way it was, and what the service said."""
    if engine():
        call("docker", "build", "-f", ROOT / "docker" / "Dockerfile", "-t", "unsweep", ROOT)
        yield "built by a Docker engine"
        yield json.dumps(asked_of_container("unsweep-image-check"))
        return
    if root is None:
        raise SystemExit("No Docker engine answers, and no unpacked Debian root was given by --root.")
    stage = Roots(root, work).build(steps((ROOT / "docker" / "Dockerfile").read_text(encoding="utf-8")))
    release = re.search(r'PRETTY_NAME="([^"]+)"', (root / "etc" / "os-release").read_text(encoding="utf-8"))
    yield f"built by its steps in an unpacked root of {release[1] if release else 'unknown origin'}; no Docker engine is at hand"
    yield json.dumps(asked_of_root(stage))


def main() -> int:
    """The command line. Without an engine, mounts are those of a namespace: they end with it, before the folder is removed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, help="an unpacked Debian")
    parser.add_argument(
        "--work", type=Path, help="where to make a folder of a few GB; by default where temporary files are"
    )
    parser.add_argument("--within", type=Path, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.within is None:
        within = Path(tempfile.mkdtemp(prefix="unsweep-image-", dir=chosen.work))
        apart = [] if engine() else ["unshare", "--mount", "--pid", "--fork", "--kill-child"]
        try:
            again = [*apart, sys.executable, __file__, *sys.argv[1:], f"--within={within}"]
            return subprocess.run(again, check=False).returncode
        finally:
            shutil.rmtree(within, ignore_errors=True)
    for line in built(chosen.root, chosen.within):
        sys.stdout.write(line + "\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
