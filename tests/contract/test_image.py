"""The image: its steps are ones that can be run without a builder; and, where there is time and a root, they are run."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tools.image import engine
from tools.image_steps import context_files, expanded, ignored, steps

ROOT = Path(__file__).resolve().parents[2]
#: An unpacked Debian with Python in it, for machines without a Docker engine; see tools/image.py.
DEBIAN = os.environ.get("UNSWEEP_DEBIAN_ROOT", "")


def test_steps_are_read_as_a_builder_reads_them():
    """Oracle: by hand. Mutations: a continued line taken for two; a comment within one taken for its end."""
    text = '# first\nARG A=1\nFROM ${A} AS build\nRUN one \\\n# why\n    && two\n\nCMD ["a", "b"]\n'
    got = [(step.word, " ".join(step.text.split())) for step in steps(text)]
    assert got == [("ARG", "A=1"), ("FROM", "${A} AS build"), ("RUN", "one && two"), ("CMD", '["a", "b"]')]
    with pytest.raises(SystemExit, match="ONBUILD"):
        steps("ONBUILD RUN x\n")
    assert expanded("/opt/bin:$PATH:${X}", {"PATH": "/bin"}) == "/opt/bin:/bin:"


@pytest.mark.parametrize(
    ("name", "pattern", "left_out"),
    [
        ("tests/core/test_deskew.py", "tests", True),
        ("app/tests/x.py", "tests", False),
        ("frontend/node_modules/a/b.js", "**/node_modules", True),
        ("app/static/index.html", "app/static", True),
        ("app/static_files.py", "app/static", False),
        ("room.bag", "*.bag", True),
        ("app/room.bag", "*.bag", False),
    ],
)
def test_what_a_builder_is_not_sent(name, pattern, left_out):
    """Oracle: Docker's rules for .dockerignore. Mutations: a pattern without slashes looked for at every depth."""
    assert ignored(name, pattern) is left_out


def test_every_file_that_the_image_copies_is_sent_and_every_step_is_known():
    """Mutations: a folder of the program in .dockerignore; an instruction of which tools/image_steps.py knows nothing."""
    sent = {str(file) for file in context_files()}
    todo = steps((ROOT / "docker" / "Dockerfile").read_text(encoding="utf-8"))
    for step in todo:
        if step.word == "COPY" and "--from" not in step.text:
            for source in step.text.split()[:-1]:
                assert any(name == source or name.startswith(f"{source}/") for name in sent), source
    assert not any(name.startswith(("tests/", "bench/", "docs/")) for name in sent)
    assert [step.word for step in todo[-3:]] == ["HEALTHCHECK", "ENTRYPOINT", "CMD"]


@pytest.mark.slow
def test_the_image_is_built_and_serves():
    """Which way it was built is printed first; it takes minutes and a registry, so it is asked for.

    Mutations: the client left out of the wheel; the data's folder owned by root; a root that may be written.
    """
    if os.environ.get("UNSWEEP_IMAGE") != "1":
        pytest.skip("it takes minutes and a registry: UNSWEEP_IMAGE=1")
    if not (engine() or (DEBIAN and os.geteuid() == 0)):
        pytest.skip("neither a Docker engine nor an unpacked Debian (UNSWEEP_DEBIAN_ROOT, as root)")
    words = [sys.executable, "-m", "tools.image", *(["--root", DEBIAN] if DEBIAN else [])]
    done = subprocess.run(words, cwd=ROOT, check=True, capture_output=True, text=True)
    way, told = done.stdout.splitlines()[-2:]
    sys.stdout.write(way + "\n")
    assert way.startswith(("built by a Docker engine", "built by its steps in an unpacked root"))
    found = json.loads(told)
    assert found["user"] == 10001
    assert found["without a token"] == 401
    assert found["client"] is True
    assert found["cannot write"] is True
    assert found["read"] == {"inspect": "done", "planes": "done"}
    assert found["solved"] == "done"
