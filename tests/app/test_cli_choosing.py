"""Where several topics fit, a person at a terminal is asked; a script never."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from app.cli.terminal import Manner
from app.cli.topic_choice import load_asking
from calib_core import api
from calib_core.errors import TopicError
from calib_core.settings import ReadSettings


class Terminal(io.StringIO):
    """Typed lines that claim to come from a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def two_of_each(monkeypatch: pytest.MonkeyPatch) -> None:
    """A library whose recording has two lidars and two IMUs, and says so one at a time."""

    def load(path: Path, settings: ReadSettings, **_: object) -> ReadSettings:
        for what, given in (("lidar", settings.lidar_topic), ("imu", settings.imu_topic)):
            if given is None:
                topics = (f"/{what}/left", f"/{what}/right")
                text = f"room.bag has two {what} topics; choose one with --{what}-topic."
                raise TopicError(text, code=f"recording.several_{what}", candidates=topics)
        return settings

    monkeypatch.setattr(api, "load", load)


@pytest.mark.usefixtures("two_of_each")
def test_a_person_is_asked_for_both(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Wrong answers are asked again. Fails if a number picks the topic beside it, or the first answer is forgotten."""
    monkeypatch.setattr("sys.stdin", Terminal("7\n2\n1\n"))
    chosen = load_asking(Path("room.bag"), ReadSettings(start_s=3.0), Manner.live)
    assert (chosen.lidar_topic, chosen.imu_topic, chosen.start_s) == ("/lidar/right", "/imu/left", 3.0)
    assert "/lidar/left" in capsys.readouterr().err


@pytest.mark.usefixtures("two_of_each")
@pytest.mark.parametrize("manner", [Manner.plain, Manner.quiet, Manner.json])
def test_a_script_is_told_the_flag(manner: Manner, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fails if anything waits for an answer that nobody gives."""
    monkeypatch.setattr("sys.stdin", Terminal("1\n1\n"))
    with pytest.raises(TopicError, match="--lidar-topic"):
        load_asking(Path("room.bag"), ReadSettings(), manner)


@pytest.mark.usefixtures("two_of_each")
def test_without_a_keyboard_nobody_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stderr may be a terminal while stdin is not: fails if the prompt reads from a pipe."""
    monkeypatch.setattr("sys.stdin", io.StringIO("1\n1\n"))
    with pytest.raises(TopicError):
        load_asking(Path("room.bag"), ReadSettings(), Manner.live)
