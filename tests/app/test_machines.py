"""Uploads, jobs and the queue under any order of events: what was kept stays, what ended stays ended."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from app.jobs.queue import Ticket, Turns
from app.jobs.state_machine import FINAL, IllegalTransition, transition
from app.storage.partial import Appender, PartialFile

BYTES = st.binary(min_size=1, max_size=200)
SIGNALS = st.sampled_from(["start", "finish", "fail", "cancel", "stop", "lose"])


class Upload(RuleBasedStateMachine):
    """An upload that is written, synced, cut off, and lies on a disk that keeps only what was synced.

    Model: the bytes up to the last sync, and those after it. Mutations: the offset taken from the file's length;
    `roll_back` left out when a writer begins; a sync noted before it is done.
    """

    def __init__(self) -> None:
        super().__init__()
        self.folder = Path(tempfile.mkdtemp(prefix="unsweep-upload-"))
        self.partial = PartialFile(self.folder / ("0" * 32))
        self.partial.create(None)
        self.kept, self.fresh = b"", b""
        self.writer: Appender | None = None

    def teardown(self) -> None:
        if self.writer is not None:
            self.writer.close()
        shutil.rmtree(self.folder)

    @precondition(lambda self: self.writer is None)
    @rule()
    def begin(self) -> None:
        self.writer, self.fresh = Appender(self.partial), b""

    @precondition(lambda self: self.writer is not None)
    @rule(block=BYTES)
    def append(self, block: bytes) -> None:
        self.writer.append(block)
        self.fresh += block

    @precondition(lambda self: self.writer is not None)
    @rule()
    def sync(self) -> None:
        self.writer.sync()
        self.kept, self.fresh = self.kept + self.fresh, b""

    @precondition(lambda self: self.writer is not None)
    @rule()
    def forget(self) -> None:
        self.writer.roll_back()
        self.fresh = b""

    @precondition(lambda self: self.writer is not None)
    @rule()
    def end(self) -> None:
        self.writer.close()
        self.writer, self.fresh = None, b""

    @precondition(lambda self: self.writer is not None)
    @rule(share=st.floats(0, 1), junk=st.binary(max_size=50))
    def lose_power(self, share: float, junk: bytes) -> None:
        """Of what was not synced some part is on the disk, and blocks that were never written behind it."""
        os.close(self.writer._descriptor)
        self.writer = None
        left = self.kept + self.fresh[: int(share * len(self.fresh))] + junk
        self.partial.path.write_bytes(left)
        self.fresh = b""

    @invariant()
    def what_was_synced_is_there(self) -> None:
        durable = self.partial.durable_bytes()
        assert durable == len(self.kept)
        assert self.partial.path.read_bytes()[:durable] == self.kept


class Jobs(RuleBasedStateMachine):
    """Jobs that are asked for and get any signal at any time. Mutations: a way out of a final state; a start after a cancel."""

    def __init__(self) -> None:
        super().__init__()
        self.state = "queued"
        self.past: list[str] = ["queued"]

    @rule(signal=SIGNALS)
    def signalled(self, signal: str) -> None:
        try:
            self.state = transition(self.state, signal)
        except IllegalTransition:
            return
        self.past.append(self.state)

    @invariant()
    def it_ends_once_and_runs_only_when_nobody_minds(self) -> None:
        ends = [k for k, state in enumerate(self.past) if state in FINAL]
        assert ends in ([], [len(self.past) - 1])
        if "cancelling" in self.past:
            assert "failed" not in self.past
            assert "interrupted" not in self.past
        assert self.past.count("running") <= 1


class Queue(RuleBasedStateMachine):
    """Jobs asked for by a few people about a few recordings, started one by one, ended in any order.

    Mutations: whoever asked first; a client's busy jobs not counted.
    """

    def __init__(self) -> None:
        super().__init__()
        self.turns = Turns()
        self.waiting: list[Ticket] = []
        self.running: list[Ticket] = []
        self.count = 0

    @rule(client=st.sampled_from("abc"), recording=st.sampled_from("xyz"), many=st.integers(1, 5))
    def ask(self, client: str, recording: str, many: int) -> None:
        for _ in range(many):
            self.count += 1
            self.waiting.append(Ticket(str(self.count), client, client + recording, self.count))

    @precondition(lambda self: self.waiting)
    @rule()
    def start(self) -> None:
        order = self.turns.order(self.waiting, self.running)
        assert sorted(order, key=lambda t: t.sequence) == sorted(self.waiting, key=lambda t: t.sequence)
        first = order[0]
        busy = {client: sum(t.client == client for t in self.running) for client in {t.client for t in self.waiting}}
        assert busy[first.client] == min(busy.values())
        alike = [t for t in self.waiting if (t.client, t.recording_id) == (first.client, first.recording_id)]
        assert first.sequence == min(t.sequence for t in alike)
        self.turns.serve(first)
        self.waiting.remove(first)
        self.running.append(first)

    @precondition(lambda self: self.running)
    @rule(data=st.data())
    def end(self, data: st.DataObject) -> None:
        self.running.remove(data.draw(st.sampled_from(self.running)))


for machine, examples in ((Upload, 40), (Jobs, 60), (Queue, 40)):
    machine.TestCase.settings = settings(max_examples=examples, stateful_step_count=30)
TestUpload, TestJobs, TestQueue = Upload.TestCase, Jobs.TestCase, Queue.TestCase
