"""Whether the end of a solve can be true."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core.errors import Refused
from calib_core.full.assess import verdict
from calib_core.solver.arrow import NotPositiveDefinite
from calib_core.solver.levenberg import Outcome


def test_an_end_that_determines_nothing_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seen once in 200 drawn rigs: a chain that is not positive definite, told as a traceback. Mutation: not caught."""

    def not_definite(*_: object, **__: object) -> None:
        raise NotPositiveDefinite("the chain of knots is not positive definite")

    monkeypatch.setattr(verdict, "implausible", lambda *_: None)
    monkeypatch.setattr(verdict, "confidence", not_definite)
    minimum = SimpleNamespace(solution=object(), outcome=Outcome.CONVERGED, cost=5e4)
    solved: Any = SimpleNamespace(minimum=minimum, observations=SimpleNamespace(count=np.full(1000, 100)))
    run: Any = None
    with pytest.raises(Refused) as refused:
        verdict.weigh(run, solved, is_choice=False)
    assert refused.value.code == "solve.diverged"


@pytest.mark.parametrize("torn", [False, True])
def test_sensors_are_less_sure_by_what_parts_disagree_about(monkeypatch: pytest.MonkeyPatch, torn: bool) -> None:
    """Mutations: the model's own sigmas handed on; whether stretches of time contradict each other not."""

    class Asked(Exception):
        pass

    def asked(_solved: object, _considered: object, unexplained: object, *, torn: bool) -> None:
        raise Asked(unexplained, torn)

    monkeypatch.setattr(verdict, "sensor_findings", asked)
    nothing: Any = SimpleNamespace(estimate=None)
    trust: Any = SimpleNamespace(knowledge=None, considered=None, sensors_unexplained=2.4, is_torn=torn)
    with pytest.raises(Asked, match=rf"2\.4, {torn}"):
        verdict.answer(nothing, nothing, trust, nothing)


@pytest.mark.parametrize("torn", [False, True])
def test_materials_are_not_told_where_stretches_of_time_contradict_each_other(
    monkeypatch: pytest.MonkeyPatch, torn: bool
) -> None:
    """Mutations: told all the same; never."""

    class Told(Exception):
        pass

    def told(who: str) -> Any:
        def tell(*_: object) -> None:
            raise Told(who)

        return tell

    found = SimpleNamespace(parameters=(), sentences=())
    monkeypatch.setattr(verdict, "sensor_findings", lambda *_, **__: found)
    monkeypatch.setattr(verdict, "told_considered", lambda *_: ())
    monkeypatch.setattr(verdict, "told_materials", told("materials"))
    monkeypatch.setattr(verdict, "told_cost", told("cost"))  # is told next
    nothing: Any = SimpleNamespace(estimate=None)
    knowledge = SimpleNamespace(covariance=None)
    trust: Any = SimpleNamespace(knowledge=knowledge, considered=None, sensors_unexplained=0.0, is_torn=torn)
    with pytest.raises(Told, match="cost" if torn else "materials"):
        verdict.answer(nothing, nothing, trust, nothing)


@pytest.mark.parametrize(("is_choice", "wrong", "said"), [(True, "", True), (True, "planes", False), (False, "", None)])
def test_planes_that_are_held_wrong_make_no_others_doubtful(
    monkeypatch: pytest.MonkeyPatch, is_choice: bool, wrong: str, said: bool | None
) -> None:
    """And what no point lies on is looked for all the same. Mutations: not looked for; doubtful all the same; of no choice."""
    asked: list[tuple[bool, str]] = []
    contradicted = (SimpleNamespace(what=verdict.PLANES),) if wrong else ()
    trust = SimpleNamespace(
        contradicted=contradicted, knowledge=SimpleNamespace(rotation_known=True), is_torn="as told"
    )
    monkeypatch.setattr(verdict, "confidence", lambda *_: trust)
    monkeypatch.setattr(
        verdict, "say_doubtful_choice", lambda *_, faults_count, torn: asked.append((faults_count, torn))
    )
    monkeypatch.setattr(verdict, "implausible", lambda *_: None)
    minimum = SimpleNamespace(solution=object(), outcome=Outcome.CONVERGED, cost=5e4)
    solved: Any = SimpleNamespace(minimum=minimum, observations=SimpleNamespace(count=np.full(1000, 100)))
    run: Any = None
    assert verdict.weigh(run, solved, is_choice=is_choice) is trust
    assert asked == ([] if said is None else [(said, "as told")])
