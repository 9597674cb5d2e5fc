"""A fleet from its orders to its documents: what is there is kept, what is lost is run again, what comes is written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from pathlib import Path
from typing import NamedTuple

from app.fleet.executors import Executor
from app.fleet.orders import OTHER_VERSION, TRIES, FleetOrder, FleetOutcome
from app.fleet.provenance import Stored, stored
from app.fleet.summary import Row, add_row, documented, read_rows, row_of, write_rows
from app.storage.atomic import write_text
from calib_core.errors import InputError

#: In the output folder: documents of what is not asked any more.
ASIDE = "earlier"
#: Ctrl-C is heard between two looks.
_LOOK_S = 0.25

OnRow = Callable[[Row], None]


class TakenUp(NamedTuple):
    """What an earlier run has left.

    done: rows of recordings that have their documents.   ahead: the orders still to run.   others: of those of them that had a
    document of something else, what differs; these documents are in the folder ASIDE by now.   besides: rows of documents that
    nobody asks for this time.
    """

    done: list[Row]
    ahead: list[FleetOrder]
    others: list[tuple[str, ...]]
    besides: list[Row]


def take_up(orders: Sequence[FleetOrder], folder: Path) -> TakenUp:
    """What an earlier run has left in the folder, where afterwards no document is of something else than is asked."""
    rows = {row.name: row for row in read_rows(folder)}
    left = TakenUp([], [], [], [])
    for order in orders:
        found = documented(order, folder, rows)
        if isinstance(found, Row):
            left.done.append(found)
            continue
        left.ahead.append(order)
        if found:
            left.others.append(found)
            _set_aside(folder / f"{order.name}.json")
    asked = {order.name for order in orders}
    left.besides.extend(row for name, row in rows.items() if row.has_document and name not in asked)
    write_rows(folder, [*left.besides, *left.done])
    return left


def _set_aside(document: Path) -> None:
    """Before it is run again, not after: what is stopped on the way must not leave an old document for a new one."""
    try:
        (document.parent / ASIDE).mkdir(exist_ok=True)
        document.replace(document.parent / ASIDE / document.name)
    except OSError as error:
        raise InputError(
            f"{document} is of other options or of another recording, and could not be put aside ({error.strerror}); move it, or "
            "choose another folder."
        ) from error


def run_fleet(orders: Sequence[FleetOrder], folder: Path, executor: Executor, on_row: OnRow) -> list[Row]:
    """Run the orders; their rows, each on the disk with its document before on_row hears of it.

    Raises InputError where a worker is of another version: its answers must not get into the same table.
    However this is left, nothing goes on running, and what was finished stays.
    """
    rows: list[Row] = []
    waiting: dict[Future[str], tuple[FleetOrder, int]] = {}
    lay = {
        order.name: stored(order.recording) for order in orders
    }  # before anybody reads them: what changes later is seen
    try:
        for order in orders:
            waiting[executor.start(order.model_dump_json())] = (order, 1)
        while waiting:
            for future in wait(waiting, timeout=_LOOK_S, return_when=FIRST_COMPLETED).done:
                order, tries = waiting.pop(future)
                outcome = outcome_of(future, order)
                if outcome.code == OTHER_VERSION:
                    raise InputError(outcome.text)
                tries = max(tries, outcome.tries)  # a cluster gives what a lost worker had to another one by itself
                if outcome.is_lost and tries < TRIES:
                    waiting[executor.start(order.model_dump_json())] = (order, tries + 1)
                    continue
                rows.append(_keep(order, outcome, tries, lay[order.name], folder))
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


def _keep(order: FleetOrder, outcome: FleetOutcome, tries: int, lay: Stored | None, folder: Path) -> Row:
    row = row_of(order, outcome, tries, lay)
    if outcome.document is not None:
        write_text(folder / f"{order.name}.json", outcome.document)
    add_row(folder, row)
    return row
