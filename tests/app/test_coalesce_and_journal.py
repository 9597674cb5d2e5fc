"""Fewer messages without losing any that matters, and a list that threads fill and coroutines follow."""

from __future__ import annotations

import asyncio
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

from hypothesis import given, settings
from hypothesis import strategies as st

from app.jobs.coalesce import Coalescer
from app.jobs.journal import Journal
from app.jobs.log import JobLogs
from calib_core.events import LogEvent, StageEvent

STAGES = ("read", "planes", "solve")


def stage(name, number):
    return StageEvent(stage=name, fraction=number / 1000, text=str(number))


def log(number):
    return LogEvent(level="info", code="test", text=str(number))


@settings(deadline=None)  # a loaded machine is no failure
@given(st.lists(st.tuples(st.sampled_from((*STAGES, "log")), st.integers(0, 60)), max_size=60))
def test_order_is_kept_logs_are_all_there_and_each_burst_ends_with_its_last(story):
    """Oracle: the list of what was told. Mutation: no flush before a log line swaps it with older progress."""
    clock = {"ms": 0}
    sent = []
    coalesce = Coalescer(sent.append, clock=lambda: clock["ms"] / 1000, interval_s=0.05, later=lambda *_: None)
    told = []
    for number, (kind, wait_ms) in enumerate(story):
        clock["ms"] += wait_ms
        told.append(log(number) if kind == "log" else stage(kind, number))
        coalesce(told[-1])
    coalesce.flush()
    places = [told.index(event) for event in sent]
    assert places == sorted(set(places))
    for place, event in enumerate(told):
        followed = place + 1 < len(told) and isinstance(told[place + 1], StageEvent) and isinstance(event, StageEvent)
        if isinstance(event, LogEvent) or not followed or told[place + 1].stage != event.stage:
            assert event in sent


def test_a_burst_within_the_interval_becomes_two_messages():
    """Mutation: comparing with `<=` 0 instead of the interval sends all hundred."""
    sent = []
    coalesce = Coalescer(sent.append, clock=lambda: 1.0, interval_s=0.05, later=lambda *_: None)
    for number in range(100):
        coalesce(stage("solve", number))
    coalesce.flush()
    assert [event.text for event in sent] == ["0", "99"]


def test_what_is_said_last_before_a_long_silence_is_heard():
    """Mutations: held until something else is said; a look asked for by each of a burst; none asked for after the first."""
    sent, looks = [], []
    coalesce = Coalescer(sent.append, clock=lambda: 1.0, interval_s=0.05, later=lambda after_s, act: looks.append(act))
    for number in range(3):
        coalesce(stage("solve", number))
    assert len(looks) == 1
    looks.pop()()
    assert [event.text for event in sent] == ["0", "2"]
    coalesce(stage("solve", 3))
    looks.pop()()
    assert [event.text for event in sent] == ["0", "2", "3"]


def test_followers_get_everything_once_from_where_they_ask():
    """Oracle: the appended numbers. Mutation: clearing the event after reading loses what came between."""

    async def follow(journal, start):
        return [entry async for _, entry in journal.follow(start)]

    async def scene():
        journal = Journal()
        journal.append(0)
        followers = [asyncio.create_task(follow(journal, start)) for start in (0, 1, 5)]
        await asyncio.sleep(0)

        def fill():
            for number in range(1, 500):
                journal.append(number)
            journal.close()

        thread = threading.Thread(target=fill)
        thread.start()
        found = await asyncio.gather(*followers)
        thread.join()
        return found

    # In a thread of its own: the browser tests leave a running loop in the thread of whichever worker had them.
    with ThreadPoolExecutor(1) as pool:
        found = pool.submit(lambda: asyncio.run(scene())).result()
    assert found == [list(range(500)), list(range(1, 500)), list(range(5, 500))]


def test_a_limited_journal_keeps_numbers_while_it_forgets():
    """Mutation: numbering from 0 of what is kept sends a returning browser the wrong message."""
    journal = Journal(limit=3)
    for number in range(10):
        assert journal.append(number * 11) == number
    assert (journal.oldest, journal.end) == (7, 10)
    assert journal.since(8) == ([(8, 88), (9, 99)], False)
    assert journal.since(0)[0][0] == (7, 77)


def test_a_log_read_back_is_what_was_told(tmp_path):
    """Oracle: the journal in memory, of words that a sensor's name may hold: U+0085 and U+2028 end lines for Python and not in
    JSON. A crash cuts the last line off, within a letter. Mutations: splitlines; the file read as text; what was cut off kept."""
    files = SimpleNamespace(job=lambda job_id: tmp_path / job_id)
    logs = JobLogs(files)
    for text in ("topic /imu\x85x \u2028", "\x0b\x0c\x1c\r", "Lidar à"):
        logs.write("one", LogEvent(level="info", code="a.b", text=text))
    told = logs.journal("one", live=True).since(0)[0]
    path = tmp_path / "one" / "events.jsonl"
    path.write_bytes(path.read_bytes() + '{"text": "à'.encode()[:-1])
    assert JobLogs(files).journal("one", live=False).since(0)[0] == told
    assert len(told) == 3


def test_threads_that_tell_at_once_send_one_after_the_other_and_nothing_empty():
    """Pools of threads report progress into one pipe, which takes one message at a time. Oracle: who is inside `send`.

    Mutations: no lock (two are inside, a pipe would mix their bytes); flushing without it (None is sent).
    """
    sent, inside, most = [], [0], [0]

    def send(event):
        inside[0] += 1
        most[0] = max(most[0], inside[0])
        time.sleep(0.0005)
        sent.append(event)
        inside[0] -= 1

    coalesce = Coalescer(send, clock=time.monotonic, interval_s=0.0)

    def tell(name):
        for number in range(40):
            coalesce(stage(name, number))
            coalesce(log(number))

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(tell, STAGES))
    coalesce.flush()
    assert most == [1]
    assert None not in sent
    assert sum(isinstance(event, LogEvent) for event in sent) == 40 * len(STAGES)


@given(count=st.integers(0, 300), limit=st.none() | st.integers(1, 200), number=st.integers(-3, 310))
def test_what_came_since_is_the_same_however_it_is_fetched(count, limit, number):
    """Oracle: a range of numbers. Mutations: the few fetched from the wrong end; one too few of them."""
    journal = Journal(limit=limit)
    for entry in range(count):
        journal.append(entry)
    oldest = max(0, count - (count if limit is None else limit))
    wanted = range(max(number, oldest), count)
    assert journal.since(number) == ([(entry, entry) for entry in wanted], False)
