"""`python -m bench answers CHECKOUT`: how far this version's answers are from another's, in sigmas: bench/results/answers.md.

    python -m bench answers ../before                       both versions on all of the recordings
    python -m bench answers ../before --names attic         on one of them

A change that is to save nothing but time is held to a thousandth of a sigma. A handful of recordings is simulated once, by
this version; `unsweep calibrate` of each checkout solves the same bytes in processes of its own, with ideal sensors and by
default. The other's loops are compiled with its first recording, which takes a minute more. Answers do not depend on how many
threads there are (`tests/core/full/test_calibrate.py`).
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from bench.campaign import version_label
from bench.machine import measured
from bench.runs import PARAMETERS, difference
from bench.store import FOLDER, RESULTS
from calib_core import api
from calib_core.errors import InputError
from calib_core.result import CalibrationResult

#: In sigmas of this version's answer.
AIM = 1e-3
PAGE = "answers.md"
#: Exit codes that come with a document: solved, and refused.
_ANSWERED = (0, 3)
MODES: Mapping[str, tuple[str, ...]] = {"ideal": ("--intrinsics", "off"), "default": ()}


@dataclass(frozen=True, slots=True)
class Case:
    """A recording: scenario, what its sensors and its room do, and its length."""

    scenario: str
    duration_s: float
    faults: str = ""

    @property
    def name(self) -> str:
        """As rows call it."""
        return f"{self.scenario}, {self.faults or 'no faults'}, {self.duration_s:g} s"


CASES = (
    Case("paper-normal", 20.0),
    Case("handheld", 20.0),
    Case("handheld", 20.0, "industrial"),
    Case("ouster", 12.0, "consumer"),
    Case("attic", 15.0),
    Case("partial-views", 20.0),
)


@dataclass(frozen=True, slots=True)
class Pair:
    """What both versions say of one recording. mode: `ideal` or `default`.   ours, theirs: the documents."""

    case: str
    mode: str
    ours: CalibrationResult
    theirs: CalibrationResult

    @property
    def sigmas(self) -> tuple[float, ...]:
        """(7,) this answer minus the other's, in this one's standard deviations; NaN where one of them has none."""
        if self.ours.uncertainty is None or self.theirs.T_imu_lidar is None or self.theirs.time_offset_ns is None:
            return (float("nan"),) * len(PARAMETERS)
        there = np.array(self.theirs.T_imu_lidar.matrix)
        away = difference(self.ours, there, self.theirs.time_offset_ns)
        return tuple((away / _stds(self.ours)).tolist())

    @property
    def wider(self) -> float:
        """By what share the standard deviation that differs most is another; NaN where one has none."""
        if self.ours.uncertainty is None or self.theirs.uncertainty is None:
            return float("nan")
        return float(np.max(np.abs(_stds(self.theirs) / _stds(self.ours) - 1.0)))

    @property
    def holds(self) -> bool:
        """Whether both say the same: to the aim, or both that there is no answer, for the same reasons."""
        if self.ours.uncertainty is None and self.theirs.uncertainty is None:
            return _reasons(self.ours) == _reasons(self.theirs)
        return bool(np.max(np.abs(self.sigmas)) <= AIM)


def _stds(result: CalibrationResult) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    assert result.uncertainty is not None
    return np.sqrt(np.diag(np.array(result.uncertainty.covariance, dtype=np.float64)))


def _reasons(result: CalibrationResult) -> list[str]:
    return [message.code for message in result.messages if message.level == "error"]


def compare(other: Path, cases: Sequence[Case] = CASES, modes: Sequence[str] = tuple(MODES)) -> Iterator[Pair]:
    """Both versions' documents of each recording, as they are done. Raises InputError where `other` is no checkout."""
    checkouts = (FOLDER.parent, other.resolve())
    for checkout in checkouts:
        _must_be_run_from(checkout)
    for case in cases:
        with tempfile.TemporaryDirectory(prefix="unsweep-answers-") as made:
            bag = Path(made) / "room.bag"
            api.simulate(case.scenario, bag, seed=1, duration_s=case.duration_s, faults=case.faults)
            for mode in modes:
                ours, theirs = (answer(checkout, bag, MODES[mode]) for checkout in checkouts)
                yield Pair(case.name, mode, ours, theirs)


def answer(checkout: Path, bag: Path, words: Sequence[str]) -> CalibrationResult:
    """The document of `unsweep calibrate` of a checkout. Raises InputError where it ends without one that is understood here."""
    output = bag.parent / "result.json"
    output.unlink(missing_ok=True)
    command = ["-m", "app.cli", "calibrate", str(bag), "--output", str(output), "--quiet", *words]
    code = _python(checkout, command).returncode
    if code not in _ANSWERED or not output.is_file():
        raise InputError(
            f"unsweep calibrate of {checkout} ended with exit code {code}; expected an answer or a refusal."
        )
    try:
        return CalibrationResult.from_json(output.read_text(encoding="utf-8"))
    except ValidationError as error:
        raise InputError(f"The document of {checkout} is not one that this version reads: {error}") from error


def _must_be_run_from(checkout: Path) -> None:
    """An installation elsewhere would answer for it."""
    found = _python(checkout, ["-c", "import calib_core; print(calib_core.__file__)"]).stdout.strip()
    if not found or not Path(found).resolve().is_relative_to(checkout):
        raise InputError(
            f"Expected a checkout of unsweep at {checkout}; Python started there takes "
            f"{found or 'no calib_core at all'}. Name the folder that has calib_core in it."
        )


def _python(checkout: Path, words: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """What Python says that is started with a checkout's sources."""
    if not checkout.is_dir():
        raise InputError(f"Expected a checkout of unsweep, found no folder {checkout}.")
    around = os.environ | {"PYTHONPATH": str(checkout)}
    return subprocess.run(
        [sys.executable, *words], cwd=checkout, env=around, stdout=subprocess.PIPE, text=True, check=False
    )


def report(pairs: Sequence[Pair], other: str, where: str) -> str:
    """The page. other: what the other version is called.   where: when and on what it was compared."""
    rows = []
    for pair in pairs:
        sigmas = np.array(pair.sigmas)
        at = 0 if np.isnan(sigmas).any() else int(np.argmax(np.abs(sigmas)))
        status = (
            pair.ours.status if pair.ours.status == pair.theirs.status else f"{pair.ours.status}, {pair.theirs.status}"
        )
        away = _told(abs(sigmas[at]), f" ({PARAMETERS[at]})")
        wider = _told(pair.wider)
        rows.append(
            f"| {pair.case} | {pair.mode} | {status} | {away} | {wider} | {'yes' if pair.holds else '**no**'} |"
        )
    lines = [
        "# Answers of two versions",
        "",
        (
            f"Written by `python -m bench answers`: this version's against {other}'s, of the same recordings. Apart: the "
            "largest difference among the seven parameters, in this version's standard deviations; sigmas: the share by which "
            f"the standard deviation that differs most is another. Asked: {AIM:g} sigma."
        ),
        "",
        where,
        "",
        "| recording | sensors | status | apart | sigmas | holds |",
        "| --- | --- | --- | ---: | ---: | --- |",
        *rows,
        "",
    ]
    return "\n".join(lines)


def _told(value: float, which: str = "") -> str:
    """A share, and which it is; to the last bit the same is 0, and what there is not is nothing."""
    if np.isnan(value):
        return ""
    return f"{value:.1e}{which}" if value else "0"


def main(other: Path, names: Sequence[str] = (), folder: Path = RESULTS) -> int:
    """Compare and write; 1 where an answer is another. names: scenarios to compare on, all where none is named."""
    cases = [case for case in CASES if not names or case.scenario in names]
    unknown = set(names) - {case.scenario for case in CASES}
    if unknown:
        raise InputError(
            f"Unknown: {', '.join(sorted(unknown))}; known: {', '.join(dict.fromkeys(c.scenario for c in CASES))}."
        )
    pairs, where = [], measured()
    folder.mkdir(exist_ok=True)
    for pair in compare(other, cases):
        pairs.append(pair)
        (folder / PAGE).write_text(report(pairs, version_label(other), where), encoding="utf-8")
        sys.stderr.write(f"{pair.case}, {pair.mode}: {np.max(np.abs(pair.sigmas)):.1e} sigmas\n")
    sys.stdout.write((folder / PAGE).read_text(encoding="utf-8"))
    return 0 if all(pair.holds for pair in pairs) else 1
