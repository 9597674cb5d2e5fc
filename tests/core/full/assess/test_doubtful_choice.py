"""What is said of planes that a person chose."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from calib_core.full.assess import doubtful_choice
from calib_core.full.joint.estimation import MapPlane


@pytest.mark.parametrize(
    ("ghost", "chosen", "fault", "said"),
    [
        (0, True, "", "planes.unseen no point lies on ghost in the end: it has next to no effect on the answer"),
        (
            4,
            True,
            "",
            "planes.unseen 4 of 1,000,004 points lie on ghost in the end: it has next to no effect on the answer",
        ),
        (0, True, "mixed", "planes.unseen ghost is more than one surface"),
        (
            0,
            True,
            "mixed, held wrong",
            "planes.unseen no point lies on ghost in the end: it has next to no effect on the answer",
        ),
        (150, True, "mixed, held wrong", None),
        (150, True, "mixed", "planes.doubted ghost is more than one surface"),
        (150, True, "", None),
        (0, False, "", None),
        (150, False, "mixed", None),
    ],
)
def test_a_plane_where_no_points_are_is_named(
    monkeypatch: pytest.MonkeyPatch, ghost: int, chosen: bool, fault: str, said: str | None
) -> None:
    """Also where planes are held wrong, and what seems to move or to bend need not. Seen: a plane put beside the walls, with four
    points, unsaid; and walls held 5 cm off. Mutations: said of what nobody chose; only of none; said to count and to count for
    nothing; of held planes all, or nothing."""
    heard: list[str] = []
    monkeypatch.setattr(doubtful_choice, "standings", lambda *_: None)
    monkeypatch.setattr(doubtful_choice, "doubts", lambda _: np.zeros((3, 3)))
    held_wrong = fault.endswith("held wrong")
    faults = iter(["", "", fault.removesuffix(", held wrong")])
    monkeypatch.setattr(doubtful_choice, "fault_of", lambda _: next(faults))
    monkeypatch.setattr(doubtful_choice, "is_mostly_bent", lambda _: held_wrong)
    monkeypatch.setattr(
        doubtful_choice, "plane_residuals", lambda *_: [(0.01, 700_000), (0.01, 300_000), (0.01, ghost)]
    )
    run = SimpleNamespace(say=lambda level, code, text: heard.append(f"{code} {text}"))
    planes = [MapPlane("floor", chosen=True), MapPlane("wall 1", chosen=True), MapPlane("ghost", chosen=chosen)]
    solved = SimpleNamespace(problem=None, estimate=None, planes=planes)
    doubtful_choice.say_doubtful_choice(run, solved, faults_count=not held_wrong)  # type: ignore[arg-type]
    assert [text.replace(", but", ", and").split(", and")[0] for text in heard] == ([] if said is None else [said])


@pytest.mark.parametrize("torn", [True, False])
def test_what_strayed_before_the_choice_is_named_where_stretches_of_time_contradict_each_other(
    monkeypatch: pytest.MonkeyPatch, torn: bool
) -> None:
    """A cart beside a wall: the motion followed it, and nothing is wrong with it in the end. Of two walls that were blamed for a
    third that was pushed, a choice without that one fits. Seen: 3.5 to 4.7 sigmas off, `calibrated`, and no plane named.

    Mutations: named whatever time says; never; a plane that stood still as well.
    """
    heard: list[str] = []
    monkeypatch.setattr(doubtful_choice, "standings", lambda *_: None)
    monkeypatch.setattr(doubtful_choice, "doubts", lambda _: np.zeros((2, 3)))
    monkeypatch.setattr(doubtful_choice, "is_mostly_bent", lambda _: False)
    monkeypatch.setattr(doubtful_choice, "plane_residuals", lambda *_: [(0.01, 700_000), (0.01, 300_000)])
    run = SimpleNamespace(say=lambda level, code, text: heard.append(f"{code} {text}"))
    planes = [MapPlane("wall", chosen=True), MapPlane("cart", chosen=True, strayed=True)]
    solved = SimpleNamespace(problem=None, estimate=None, planes=planes)
    doubtful_choice.say_doubtful_choice(run, solved, torn=torn)  # type: ignore[arg-type]
    assert [text.split(", but")[0] for text in heard] == (
        ["planes.doubted cart moves against the other planes"] if torn else []
    )
