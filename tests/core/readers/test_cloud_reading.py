"""What a sample of clouds is asked, in which order, for whoever loads a recording and for whoever inspects it."""

from __future__ import annotations

from typing import Any

import pytest

from calib_core.readers import cloud_reading as module
from calib_core.settings import ReadSettings
from calib_core.types import Finding


def test_each_question_is_asked_of_what_the_one_before_has_mended(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every finding is told, and the last decoder has what all of them mend.

    Mutations: the findings of any of the four left out; the decoder of any of the three not handed on; rows before times.
    """

    def finding(code: str) -> tuple[Finding, ...]:
        return (Finding(code, "info", code),)

    steps: dict[str, Any] = {
        "point_timing": lambda _, decoder, *__, **___: (decoder + " timed", "timing", finding("times")),
        "once_each": lambda _, decoder, timing, *__: (f"{decoder} once by {timing}", finding("twice")),
        "by_rows": lambda _, decoder, *__: (decoder + " by rows", finding("rows")),
        "where_rays_meet": lambda *_: finding("rays"),
    }
    for name, step in steps.items():
        monkeypatch.setattr(module, name, step)
    plain: Any = "decoder"
    found = module.cloud_reading([], plain, ReadSettings(), topic="/points", help_text="")
    assert found.decoder == "decoder timed once by timing by rows"
    assert found.timing == "timing"
    assert [each.code for each in found.findings] == ["times", "twice", "rows", "rays"]
