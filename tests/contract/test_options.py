"""Whatever the command line takes, its command asks for: an option that nobody reads is a promise that nobody keeps."""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from app.cli import calibrate_many, commands
from app.cli.parser import build_parser
from calib_core import api
from tests.core.exporters.results import make_result


class Heard(argparse.Namespace):
    """The words of a call, and the names of those that were asked for: one by one, or out of `vars`."""

    def __getattribute__(self, name: str) -> object:
        own = super().__getattribute__("__dict__")
        asked = own.setdefault("_asked", set())
        if name == "__dict__":
            return _Listening(own, asked)
        asked.add(name)
        return super().__getattribute__(name)


class _Listening(dict[str, object]):
    """The dictionary of a namespace. Whether a name is in it is no reading of what stands there."""

    def __init__(self, own: dict[str, object], asked: set[str]) -> None:
        super().__init__(own)
        self._own, self._asked = own, asked

    def __getitem__(self, name: str) -> object:
        self._asked.add(name)
        return super().__getitem__(name)

    def __setitem__(self, name: str, value: object) -> None:
        self._own[name] = value

    def items(self) -> None:  # type: ignore[override]
        """Who takes all has asked for none."""
        raise AssertionError("expected a command to name the options that it takes")

    values = items  # type: ignore[assignment]


def options_of(command: str) -> set[str]:
    """What argparse puts into the namespace for a command."""
    (choices,) = [action.choices for action in build_parser()._actions if isinstance(action.choices, dict)]
    return {action.dest for action in choices[command]._actions if action.dest != argparse.SUPPRESS} - {"help"}


def heard(command: str, words: list[str]) -> set[str]:
    """What the command asks for of its words."""
    plain = build_parser().parse_args([command, *words])
    chosen = Heard(**{name: value for name, value in vars(plain).items() if name != "command"})
    commands.COMMANDS[command](chosen)
    return object.__getattribute__(chosen, "__dict__")["_asked"]


@pytest.fixture
def words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, list[str]]:
    """The least that each command takes, with nobody behind them: the library, the server and the fleet do nothing."""
    result = make_result(np.eye(3), np.zeros(3))
    report = SimpleNamespace(verdict="passed", to_json=str, model_dump_json=lambda **_: "{}")
    answers = {
        "load": None,
        "inspect": report,
        "calibrate": SimpleNamespace(result=result, trajectory=None),
        "audit": report,
        "extrinsic_text": ("a text", False),
        "parse_extrinsic": "an extrinsic",
        "read_result": result,
        "deskew": 3,
        "export": "",
        "simulate": tmp_path / "truth.json",
        "get_ready": None,
    }
    for name, answer in answers.items():
        monkeypatch.setattr(api, name, lambda *_, _answer=answer, **__: _answer)
    monkeypatch.setattr("app.cli.serving.serve_until_stopped", lambda **_: None)
    monkeypatch.setattr("app.cli.audit_report.audit_block", lambda *_: "")
    monkeypatch.setattr("app.cli.inspect_report.report_block", lambda *_: "")
    monkeypatch.setattr("app.kernels.note_path", lambda: tmp_path)
    monkeypatch.setattr(calibrate_many, "run_fleet", lambda *_: [])
    (tmp_path / "room.bag").touch()
    out = str(tmp_path / "out")
    return {
        "serve": [],
        "inspect": ["room.bag"],
        "calibrate": ["room.bag"],
        "calibrate-many": [str(tmp_path), "--output", out],
        "deskew": ["room.bag", "--calibration", "result.json", "--output", out],
        "audit": ["room.bag", "--extrinsic", "result.json"],
        "export": ["result.json", "--format", "glim"],
        "simulate": ["paper-normal", "room.bag"],
        "compile-kernels": [],
    }


@pytest.mark.parametrize("command", commands.COMMANDS)
def test_every_option_of_a_command_is_read_by_it(command: str, words: dict[str, list[str]]) -> None:
    """Mutations: `audit --correct-lasers`, which was taken and never read; any `chosen.NAME` of a command left out."""
    assert options_of(command) - heard(command, words[command]) == set()


def test_to_have_an_option_is_not_to_read_it() -> None:
    """Mutation: `in vars(chosen)` heard as a reading, with which nothing could be missed."""
    chosen = Heard(one=1, two=2, three=3)
    assert "three" in vars(chosen)
    assert (chosen.one, vars(chosen)["two"]) == (1, 2)
    assert object.__getattribute__(chosen, "__dict__")["_asked"] == {"one", "two"}
