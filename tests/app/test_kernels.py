"""When the program's loops are compiled, and by whom. That it helps is measured, not tested: it is a matter of seconds."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import pytest

from app import kernels
from app.cli import main as cli
from calib_core.errors import InputError
from tests.app.support.processes import is_alive

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def cache(monkeypatch, tmp_path):
    """A cache of the test's own, and a program that a test has made up in place of the library."""
    library = tmp_path / "library"
    library.mkdir()
    (library / "loops.py").write_text("@numba.njit\n")
    (library / "words.py").write_text("pass\n")
    monkeypatch.setattr(kernels, "_LIBRARY", library)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.delenv(kernels.SKIP_VARIABLE, raising=False)
    return library


def test_the_note_is_of_the_loops_and_of_the_processor(cache, monkeypatch):
    """Mutations: leave out the sources or the processor; compile anew when a file without loops has changed."""
    note = kernels.note_path()
    assert note.parent == cache.parent / "cache"
    os.utime(cache / "words.py", (1, 1))
    assert kernels.note_path() == note
    os.utime(cache / "loops.py", (1, 1))
    changed = kernels.note_path()
    assert changed != note
    monkeypatch.setattr(kernels, "_processor", lambda: "another")
    assert kernels.note_path() != changed


def test_a_server_compiles_once_and_takes_all_with_it(cache, monkeypatch):
    """Mutations: start although the note is there; start although told not to; leave a grandchild running."""
    told = cache / "pid"
    script = (
        "import pathlib, subprocess; child = subprocess.Popen(['sleep', '60']); "
        f"new = pathlib.Path({str(told)!r} + '.new'); new.write_text(str(child.pid)); new.rename({str(told)!r}); child.wait()"
    )
    monkeypatch.setattr(kernels, "_BACKGROUND", ["-c", script])
    process = kernels.compile_in_background()
    assert process is not None
    deadline = time.monotonic() + 30
    while not told.exists():
        assert time.monotonic() < deadline
        time.sleep(0.02)
    kernels.end(process)
    while is_alive(int(told.read_text())):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    kernels.note_path().parent.mkdir()
    kernels.note_path().touch()
    assert kernels.compile_in_background() is None
    kernels.note_path().unlink()
    monkeypatch.setenv(kernels.SKIP_VARIABLE, "1")
    assert kernels.compile_in_background() is None


def test_loops_are_compiled_once_whoever_asks(cache, monkeypatch):
    """Threads stand for a machine's workers. Mutations: no lock; not looked again with the lock held; although told not to; a
    failure raised, or tried before every recording.
    """
    begun = []

    def compiling():
        begun.append("compiled")
        time.sleep(0.3)
        kernels.note_path().touch()

    monkeypatch.setattr(kernels, "compile_kernels", compiling)
    once = kernels.compile_once.__wrapped__  # of as many processes
    threads = [threading.Thread(target=once) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert begun == ["compiled"]
    kernels.note_path().unlink()
    with monkeypatch.context() as told:
        told.setenv(kernels.SKIP_VARIABLE, "1")
        once()
    assert begun == ["compiled"]

    def failing():
        begun.append("failed")
        raise InputError("It cannot be.")

    monkeypatch.setattr(kernels, "compile_kernels", failing)
    kernels.compile_once.cache_clear()
    kernels.compile_once()
    kernels.compile_once()
    assert begun == ["compiled", "failed"]
    kernels.compile_once.cache_clear()


def test_the_command_says_what_it_does_and_leaves_the_note_when_it_is_done(cache, monkeypatch, capsys):
    """Mutations: leave the note where compiling failed; compile again where all is compiled."""
    asked = []
    monkeypatch.setattr(kernels, "_ERRAND", ["-c", "import sys; sys.exit(3)"])
    with pytest.raises(InputError, match="compiled in the first calibration"):
        kernels.compile_kernels()
    assert not kernels.note_path().exists()
    monkeypatch.setattr(kernels, "_ERRAND", ["-c", "pass"])
    assert cli.run(["compile-kernels"]) == 0
    assert "once" in capsys.readouterr().err
    assert kernels.note_path().exists()
    monkeypatch.setattr(kernels, "compile_kernels", lambda: asked.append("again"))
    assert cli.run(["compile-kernels"]) == 0
    assert "already" in capsys.readouterr().err
    assert asked == []


def test_installing_compiles():
    """Mutations: take the step out of `make run`, `make test` or the image."""
    makefile = (ROOT / "Makefile").read_text()
    rules = {line.split(":")[0]: line for line in makefile.splitlines() if ":" in line}
    assert "$(STAMPS)/kernels" in rules["run"]
    assert "ready" in rules["test"]
    assert "$(STAMPS)/kernels" in rules["ready"]
    assert "RUN unsweep compile-kernels" in (ROOT / "docker" / "Dockerfile").read_text()
