"""Opening a recording where several topics fit: a person at a terminal is asked, a script is told the flag."""

from __future__ import annotations

import sys
from pathlib import Path

from rich.console import Console
from rich.prompt import IntPrompt

from app.cli.terminal import Manner, listener
from calib_core import api
from calib_core.errors import TopicError
from calib_core.settings import ReadSettings
from calib_core.types import Recording

#: Which setting answers which question of the readers.
SETTING_OF_QUESTION = {"recording.several_lidar": "lidar_topic", "recording.several_imu": "imu_topic"}


def load_asking(path: Path, settings: ReadSettings, manner: Manner) -> Recording:
    """The recording, after as many questions as it takes. Without a terminal the error goes on to the caller."""
    while True:
        try:
            with listener(manner) as on_event:
                return api.load(path, settings, on_event=on_event)
        except TopicError as error:
            setting = SETTING_OF_QUESTION.get(error.code)
            if setting is None or manner is not Manner.live or not sys.stdin.isatty():
                raise
            chosen = _ask(error)
        settings = settings.model_copy(update={setting: chosen})


def _ask(error: TopicError) -> str:
    """One of the error's candidates, chosen by its number."""
    console = Console(stderr=True, highlight=False)
    console.print(f"[yellow]{'lidar' if 'lidar' in error.code else 'IMU'}:[/] several topics fit. Which one?")
    for number, topic in enumerate(error.candidates, start=1):
        console.print(f"  {number}  {topic}", markup=False)
    numbers = [str(number) for number in range(1, len(error.candidates) + 1)]
    answer = IntPrompt.ask("Number", choices=numbers, console=console)
    return error.candidates[answer - 1]
