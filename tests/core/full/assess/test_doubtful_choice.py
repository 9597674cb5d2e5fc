"""What is said of planes that a person chose."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from calib_core.full.assess import doubtful_choice
from calib_core.full.joint.estimation import MapPlane


@pytest.mark.parametrize(
    ("ghost", "chosen", "said"),
    [
        (0, True, "no point lies on ghost: it counts for nothing"),
        (4, True, "4 of 1,000,004 points lie on ghost: it counts for nothing"),
        (150, True, None),
        (0, False, None),
    ],
)
def test_a_plane_where_no_points_are_is_named(
    monkeypatch: pytest.MonkeyPatch, ghost: int, chosen: bool, said: str | None
) -> None:
    """Seen: a plane put beside the walls, with four points, unsaid. Mutations: said of what nobody chose; only of none."""
    heard: list[str] = []
    monkeypatch.setattr(doubtful_choice, "standings", lambda *_: None)
    monkeypatch.setattr(doubtful_choice, "doubts", lambda _: np.zeros((3, 3)))
    monkeypatch.setattr(doubtful_choice, "fault_of", lambda _: "")
    monkeypatch.setattr(doubtful_choice, "is_mostly_bent", lambda _: False)
    monkeypatch.setattr(
        doubtful_choice, "plane_residuals", lambda *_: [(0.01, 700_000), (0.01, 300_000), (0.01, ghost)]
    )
    run = SimpleNamespace(say=lambda level, code, text: heard.append(f"{code} {text}"))
    planes = [MapPlane("floor", chosen=True), MapPlane("wall 1", chosen=True), MapPlane("ghost", chosen=chosen)]
    solved = SimpleNamespace(problem=None, estimate=None, planes=planes)
    doubtful_choice.say_doubtful_choice(run, solved)  # type: ignore[arg-type]
    assert [text.split(", and")[0] for text in heard] == ([] if said is None else [f"planes.unseen {said}"])
