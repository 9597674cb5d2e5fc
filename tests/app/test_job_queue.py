"""Who is next, by hand-made queues and by law."""

from __future__ import annotations

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from app.jobs.queue import Ticket, Turns
from app.jobs.state_machine import sentence_of

asked = st.lists(st.tuples(st.sampled_from("abc"), st.sampled_from("xy")), max_size=40)


def tickets(pairs):
    return [Ticket(f"{client}{n}", client, f"{client}/{rec}", n) for n, (client, rec) in enumerate(pairs, start=1)]


def test_two_hundred_jobs_of_one_do_not_go_before_one_of_another():
    """Oracle: the place. Mutation: ordering by sequence: 201."""
    waiting = tickets([("a", "x")] * 200 + [("b", "x")])
    turns = Turns()
    running = waiting[0]
    turns.serve(running)
    order = turns.order(waiting[1:], [running])
    assert order[0].client == "b"
    assert [ticket.sequence for ticket in order[1:]] == list(range(2, 201))


def test_who_was_just_served_is_not_served_again_while_another_waits():
    """One slot, and the one job that ran has ended: nobody is busy. Mutation: counting only what runs now."""
    first, second, third = tickets([("a", "x"), ("a", "x"), ("b", "x")])
    turns = Turns()
    turns.serve(first)
    assert turns.order([second, third], []) == [third, second]


def test_a_client_is_no_other_for_having_another_recording():
    """Mutation: turns by recording alone: twenty recordings are twenty turns."""
    first, second, third = tickets([("a", "x"), ("a", "y"), ("b", "x")])
    turns = Turns()
    turns.serve(first)
    assert turns.order([second, third], []) == [third, second]


def test_a_clients_own_recordings_take_turns_too():
    """Mutation: one line a client."""
    waiting = tickets([("a", "x"), ("a", "x"), ("a", "x"), ("a", "y")])
    assert [ticket.sequence for ticket in Turns().order(waiting, [])] == [1, 4, 2, 3]


@given(asked, st.integers(0, 5))
def test_nobody_is_lost_each_line_keeps_its_order_and_clients_stay_level(pairs, n_running):
    """Laws: a permutation; oldest first within client and recording; while both wait, counts differ by one at most.

    Mutation: popping the newest of a line.
    """
    made = tickets(pairs)
    running, waiting = made[:n_running], made[n_running:]
    order = Turns().order(waiting, running)
    assert sorted(order, key=lambda ticket: ticket.sequence) == waiting
    for line in {(ticket.client, ticket.recording_id) for ticket in order}:
        own = [ticket.sequence for ticket in order if (ticket.client, ticket.recording_id) == line]
        assert own == sorted(own)
    left, served = Counter(ticket.client for ticket in order), Counter(ticket.client for ticket in running)
    for ticket in order:
        assert all(served[ticket.client] <= served[other] for other in left if left[other] > 0)
        served[ticket.client] += 1
        left[ticket.client] -= 1


def test_the_order_shown_is_the_order_that_comes():
    """Places are told ahead: started one by one, the jobs come in that very order. Mutation: turns not kept in order()."""
    waiting = tickets([("a", "x")] * 4 + [("b", "y")] * 2 + [("c", "x"), ("c", "y")])
    turns = Turns()
    shown = turns.order(waiting, [])
    came = []
    while waiting:
        came.append(turns.order(waiting, [])[0])
        turns.serve(came[-1])
        waiting.remove(came[-1])
    assert came == shown


def test_what_a_waiting_job_says():
    """Mutation: counting the job itself."""
    assert sentence_of("queued", 1) == "Waiting for a free slot."
    assert sentence_of("queued", 2) == "Waiting for a free slot; 1 job is before it."
    assert sentence_of("queued", 5) == "Waiting for a free slot; 4 jobs are before it."
    assert sentence_of("running", None) == "Running."
