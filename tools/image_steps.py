"""A Dockerfile's steps, read, and run without a builder in copies of an unpacked Debian root: overlay mounts, chroot, as root."""

from __future__ import annotations

import fnmatch
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
KNOWN = {"ARG", "FROM", "WORKDIR", "COPY", "RUN", "ENV", "USER", "VOLUME", "EXPOSE", "HEALTHCHECK", "ENTRYPOINT", "CMD"}
#: A builder's network is its host's: names, and whom it trusts.
FROM_HOST = ("/etc/resolv.conf", "/etc/ssl/certs/ca-certificates.crt")
HOST_ENVIRONMENT = ("PIP_CERT", "SSL_CERT_FILE", "NODE_EXTRA_CA_CERTS", "http_proxy", "https_proxy", "no_proxy")


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
            raise SystemExit(f"docker/Dockerfile has the instruction {word}, which tools/image_steps.py does not know.")
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
        elif step.word == "ARG":
            name, _, value = text.partition("=")
            stage.environment.setdefault(name, value)
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
