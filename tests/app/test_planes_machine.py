"""Editing planes over HTTP in any order, two people at once, with a look by a server that was started anew."""

from __future__ import annotations

import httpx2
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule, run_state_machine_as_test

from app.bus import Bus
from app.planes.service import PlaneService

#: A plane more than there are.
INDEX = st.integers(0, 6)
NAMES = st.sampled_from(["roof", "floor", "east", "  wall A ", " ", "ü\u202e"])
#: Boxes of which some hold all planes, some a few, and some none.
OFFSETS_M = st.sampled_from([0.5, 1.5, 3.5, 50.0, -60.0])
NORMALS = st.sampled_from([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])


class Editing(RuleBasedStateMachine):
    """A browser that edits, and one that looks.

    Model: what the first was answered at each step, and where in these steps it is: going back shows the very answer of
    then, whatever the operation was. Mutations: a change after an undo that keeps what was undone; an operation that
    changes nothing and can be undone; going back under the old revision.
    """

    def __init__(self, live, recording_id: str) -> None:
        super().__init__()
        self.live, self.recording_id = live, recording_id
        self.url = f"/api/recordings/{recording_id}/planes"
        self.edit(op="use-suggestion")
        # A change of its own, whatever an earlier run left: nothing is left to be made again.
        self.steps = [self.shown(self.edit(op="toggle", index=0).json())]
        self.cursor = 0
        self.revision = self.look()["revision"]

    def edit(self, **operation) -> httpx2.Response:
        return self.live.http.post(f"{self.url}/operations", json=operation)

    def look(self) -> dict:
        return self.live.http.get(self.url).json()

    def shown(self, planes: dict) -> dict:
        """What a person sees, without where in the history it is."""
        return {name: planes[name] for name in ("patches", "restricted", "determinacy")}

    def changed(self, answer: httpx2.Response, *, operation_is_plain: bool = True) -> dict:
        """The planes after an operation that was taken, and the model with it.

        operation_is_plain: all that it does is shown; a box that holds everything is kept and changes nothing to be seen.
        """
        planes = answer.json()
        if answer.status_code != 200:
            assert answer.status_code in {400, 409, 422}, answer.text
            assert planes["error"]["text"].endswith(".")
            return self.look()
        if operation_is_plain and self.shown(planes) == self.steps[self.cursor]:
            assert planes["revision"] == self.revision  # nothing has changed, so there is nothing to take back
        if planes["revision"] != self.revision:
            self.steps = [*self.steps[: self.cursor + 1], self.shown(planes)]
            self.cursor += 1
            self.revision += 1
        return planes

    @rule(op=st.sampled_from(["confirm", "drop", "toggle"]), index=INDEX)
    def choose(self, op: str, index: int) -> None:
        before = [patch["confirmed"] for patch in self.steps[self.cursor]["patches"]]
        after = [patch["confirmed"] for patch in self.changed(self.edit(op=op, index=index))["patches"]]
        if index < len(before):
            before[index] = {"confirm": True, "drop": False, "toggle": not before[index]}[op]
        assert after == before

    @rule(index=INDEX, name=NAMES)
    def rename(self, index: int, name: str) -> None:
        self.changed(self.edit(op="rename", index=index, name=name))

    @rule(indices=st.lists(INDEX, min_size=1, max_size=3))
    def merge(self, indices: list[int]) -> None:
        self.changed(self.edit(op="merge", indices=indices))

    @rule(normal=NORMALS, offset_m=OFFSETS_M, index=st.none() | INDEX)
    def restrict(self, normal: list[float], offset_m: float, index: int | None) -> None:
        self.changed(
            self.edit(op="restrict", sides=[{"normal": normal, "offset_m": offset_m}], index=index),
            operation_is_plain=False,
        )

    @rule()
    def suggest(self) -> None:
        self.changed(self.edit(op="use-suggestion"))

    @precondition(lambda self: self.cursor > 0)
    @rule()
    def undo(self) -> None:
        self.cursor -= 1
        self.revision += 1
        assert self.edit(op="undo").status_code == 200

    @rule()
    def redo(self) -> None:
        answer = self.edit(op="redo")
        if self.cursor + 1 < len(self.steps):
            self.cursor += 1
            self.revision += 1
        else:
            assert answer.json()["error"]["code"] == "planes.nothing_to_redo"

    @rule(behind=st.integers(1, 3), index=INDEX)
    def edit_what_is_no_more(self, behind: int, index: int) -> None:
        answer = self.edit(op="toggle", index=index, expected_revision=self.revision - behind)
        assert answer.json()["error"]["code"] == "planes.revision"

    @invariant()
    def the_other_sees_the_same(self) -> None:
        planes = self.look()
        assert self.shown(planes) == self.steps[self.cursor]
        assert planes["revision"] == self.revision
        assert planes["can_redo"] == (self.cursor + 1 < len(self.steps))
        names = [patch["name"] for patch in planes["patches"]]
        assert len(set(names)) == len(names)
        assert all(name.strip() for name in names)

    def teardown(self) -> None:
        """A service that has nothing in memory reads the same."""
        services = self.live.services
        parts = services.planes
        fresh = PlaneService(parts._recordings, parts._documents, services.files, Bus())
        assert fresh.read(self.recording_id).model_dump(mode="json") == self.look()


def test_planes_edited_in_any_order(shared_live):
    """Fails with each of the mutations that Editing names."""
    recording_id = shared_live.ready()
    run_state_machine_as_test(
        lambda: Editing(shared_live, recording_id),
        settings=settings(
            max_examples=8, stateful_step_count=15, deadline=None, suppress_health_check=list(HealthCheck)
        ),
    )
