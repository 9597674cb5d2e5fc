"""A fleet from its orders to its documents: what is there is kept, what is lost is run again, what comes is written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from pathlib import Path

from app.fleet.executors import Executor
from app.fleet.orders import FleetOrder, FleetOutcome
from app.fleet.summary import Row, add_row, documented, read_rows, row_of, write_rows
from app.storage.atomic import write_text

#: A recording whose worker was lost is tried so often in all: one that kills its worker every time must not go on for ever.
TRIES = 3
#: Ctrl-C is heard between two looks.
_LOOK_S = 0.25

OnRow = Callable[[Row], None]


def take_up(orders: Sequence[FleetOrder], folder: Path) -> tuple[list[Row], list[FleetOrder]]:
    """What an earlier run has left: rows of recordings that have their documents, and the orders still to run."""
    rows = {row.name: row for row in read_rows(folder)}
    done: list[Row] = []
    ahead: list[FleetOrder] = []
    for order in orders:
        row = documented(order, folder, rows)
        if row is None:
            ahead.append(order)
        else:
            done.append(row)
    others = [row for name, row in rows.items() if row.has_document and name not in {order.name for order in orders}]
    write_rows(folder, [*others, *done])
    return done, ahead


def run_fleet(orders: Sequence[FleetOrder], folder: Path, executor: Executor, on_row: OnRow) -> list[Row]:
    """Run the orders; their rows, each on the disk with its document before on_row hears of it.

    However this is left, nothing goes on running, and what was finished stays.
    """
    rows: list[Row] = []
    waiting: dict[Future[str], tuple[FleetOrder, int]] = {}
    try:
        for order in orders:
            waiting[executor.start(order.model_dump_json())] = (order, 1)
        while waiting:
            for future in wait(waiting, timeout=_LOOK_S, return_when=FIRST_COMPLETED).done:
                order, tries = waiting.pop(future)
                outcome = outcome_of(future, order)
                if outcome.is_lost and tries < TRIES:
                    waiting[executor.start(order.model_dump_json())] = (order, tries + 1)
                    continue
                rows.append(_keep(order, outcome, tries, folder))
                on_row(rows[-1])
    finally:
        executor.stop()
    return rows


def outcome_of(future: Future[str], order: FleetOrder) -> FleetOutcome:
    """What a finished future holds; a worker that was lost on the way is an outcome too."""
    try:
        return FleetOutcome.model_validate_json(future.result())
    except (Exception, CancelledError) as error:  # noqa: BLE001  executors raise their own errors for lost workers
        text = (
            f"The worker that had {order.recording} was lost ({type(error).__name__}): see that unsweep runs on the workers "
            "and that they have memory enough, then give the same command again."
        )
        return FleetOutcome(code="job.lost", text=text, is_lost=True)


def _keep(order: FleetOrder, outcome: FleetOutcome, tries: int, folder: Path) -> Row:
    row = row_of(order.name, order.recording, outcome, tries)
    if outcome.document is not None:
        write_text(folder / f"{order.name}.json", outcome.document)
    add_row(folder, row)
    return row
