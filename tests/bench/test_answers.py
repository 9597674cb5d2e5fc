"""Answers of two versions in sigmas: what is the same, what is not, and whose sources answered."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench import answers
from bench.answers import Case, Pair, answer, compare, main, report
from calib_core.errors import InputError
from calib_core.result import CalibrationResult, Message
from tests.core.exporters.results import make_result

R, P_M = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix(), np.array([0.1, -0.2, 0.05])
#: As `make_result` states them.
STDS = np.array([7e-5, 9e-5, 1e-4, 3e-4, 4e-4, 5e-4, 1e-5])


def moved(sigmas: np.ndarray) -> CalibrationResult:
    """An answer that is so many sigmas away, parameter by parameter; to a nanosecond."""
    away = sigmas * STDS
    return make_result(R @ Rotation.from_rotvec(away[:3]).as_matrix(), P_M + away[3:6], round(1e9 * away[6]))


@pytest.mark.parametrize("parameter", range(7))
def test_a_parameter_that_moved_is_told_in_its_own_sigmas(parameter: int) -> None:
    """By hand, turns on the right. Mutations: variances; the sigma of another; the largest without its sign; an aim of 0.01."""
    sigmas = np.zeros(7)
    sigmas[parameter] = -0.0021 if parameter < 6 else -0.0020
    pair = Pair("a room", "ideal", moved(sigmas), make_result(R, P_M))
    np.testing.assert_allclose(pair.sigmas, sigmas, atol=1e-6 if parameter < 6 else 1e-4)
    assert not pair.holds
    assert Pair("a room", "ideal", moved(0.4 * sigmas), make_result(R, P_M)).holds
    name = ("rx", "ry", "rz", "tx", "ty", "tz", "dt")[parameter]
    assert f"2.{1 if parameter < 6 else 0}e-03 ({name})" in report([pair], "abc", "Today.")


def test_sigmas_that_differ_are_told_and_refusals_are_held_by_their_reasons() -> None:
    """By hand. Mutations: an answer and a refusal are the same; refusals for other reasons too."""
    one = make_result(R, P_M)
    assert one.uncertainty is not None
    wide = one.uncertainty.model_copy(update={"covariance": (1.21 * np.diag(STDS) ** 2).tolist()})
    pair = Pair("a room", "default", one, one.model_copy(update={"uncertainty": wide}))
    assert pair.wider == pytest.approx(0.1)
    assert pair.holds
    assert "| a room | default | calibrated | 0 | 1.0e-01 | yes |" in report([pair], "abc", "Today.")
    refused = make_result(R, P_M, status="refused")
    other = refused.model_copy(update={"messages": [Message(code="motion.none", level="error", text="Still.")]})
    assert Pair("a room", "ideal", refused, refused).holds
    assert not Pair("a room", "ideal", refused, other).holds
    assert not Pair("a room", "ideal", one, refused).holds
    assert not Pair("a room", "ideal", refused, one).holds
    page = report([Pair("a room", "ideal", one, refused)], "abc", "Today.")
    assert "| a room | ideal | calibrated, refused |  |  | **no** |" in page
    assert "Today." in page


def checkout(folder: Path, result: CalibrationResult, code: int = 0) -> Path:
    """A program that writes this document whatever it is asked, and what it was asked."""
    (folder / "calib_core").mkdir(parents=True)
    (folder / "calib_core" / "__init__.py").touch()
    (folder / "app" / "cli").mkdir(parents=True)
    (folder / "app" / "__init__.py").touch()
    (folder / "document.json").write_text(result.to_json(), encoding="utf-8")
    (folder / "app" / "cli" / "__init__.py").write_text(
        "import pathlib, sys\n"
        "pathlib.Path('asked.txt').open('a').write(' '.join(sys.argv[1:]) + '\\n')\n"
        "pathlib.Path(sys.argv[sys.argv.index('--output') + 1]).write_text(pathlib.Path('document.json').read_text())\n",
        encoding="utf-8",
    )
    (folder / "app" / "cli" / "__main__.py").write_text(f"import sys; sys.exit({code})\n", encoding="utf-8")
    return folder


def test_each_checkout_answers_by_itself_of_the_same_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two programs that do as they are told. Mutations: one answers for both; other words in a mode; simulated for each."""
    ours = checkout(tmp_path / "ours", moved(np.array([0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0])))
    theirs = checkout(tmp_path / "theirs", make_result(R, P_M), code=3)
    made: list[str] = []
    monkeypatch.setattr(answers, "FOLDER", ours / "bench")
    monkeypatch.setattr("bench.answers.api.simulate", lambda slug, bag, **wishes: made.append(f"{slug} {wishes}"))
    pairs = list(compare(theirs, [Case("attic", 9.0, "industrial")]))
    assert made == ["attic {'seed': 1, 'duration_s': 9.0, 'faults': 'industrial'}"]
    assert [pair.mode for pair in pairs] == ["ideal", "default"]
    assert [pair.sigmas[3] for pair in pairs] == pytest.approx([0.5, 0.5])
    asked = [[line.split() for line in (each / "asked.txt").read_text().splitlines()] for each in (ours, theirs)]
    assert asked[0] == asked[1]
    assert [line[-2:] for line in asked[0]] == [["--intrinsics", "off"], [asked[0][1][3], "--quiet"]]
    monkeypatch.setattr(answers, "CASES", (Case("attic", 9.0),))
    assert main(theirs, (), tmp_path / "results") == 1
    assert "5.0e-01 (tx)" in (tmp_path / "results" / "answers.md").read_text(encoding="utf-8")


def test_what_is_no_checkout_and_what_has_no_answer_is_said(tmp_path: Path) -> None:
    """Mutations: the installed program answers for a folder without sources; a document of the turn before is read again."""
    empty = tmp_path / "empty"
    empty.mkdir()
    for nothing, words in ((empty, "has calib_core in it"), (tmp_path / "none", "no folder")):
        with pytest.raises(InputError, match=words):
            next(compare(nothing))
    fails = checkout(tmp_path / "fails", make_result(R, P_M), code=4)
    (tmp_path / "result.json").write_text(make_result(R, P_M).to_json(), encoding="utf-8")
    with pytest.raises(InputError, match="exit code 4"):
        answer(fails, tmp_path / "room.bag", [])
    odd = checkout(tmp_path / "odd", make_result(R, P_M))
    (odd / "document.json").write_text("{}", encoding="utf-8")
    with pytest.raises(InputError, match="not one that this version reads"):
        answer(odd, tmp_path / "room.bag", [])
    (odd / "app" / "cli" / "__init__.py").write_text("", encoding="utf-8")
    with pytest.raises(InputError, match="exit code 0"):
        answer(odd, tmp_path / "room.bag", [])
    with pytest.raises(InputError, match="Unknown: cellar; known: paper-normal"):
        main(odd, ["cellar"], tmp_path)
