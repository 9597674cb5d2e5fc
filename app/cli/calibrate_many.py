"""`unsweep calibrate-many`: every recording of a folder or a list, a document each, and the table of them all."""

from __future__ import annotations

import argparse
import json
import sys
from functools import partial
from pathlib import Path

from app.cli.fleet_table import counts, fleet_listener, recordings
from app.cli.terminal import Manner
from app.fleet.campaign import ASIDE, TakenUp, run_fleet, take_up
from app.fleet.executors import Executor, LocalProcesses
from app.fleet.find import document_names, find_recordings
from app.fleet.folder_lock import alone_in
from app.fleet.orders import FleetOrder
from app.fleet.overview import PAGE_NAME, Overview
from app.fleet.provenance import asked_beside, why_again
from app.fleet.summary import NAME, Row, moved, read_rows
from calib_core import api
from calib_core.errors import InputError
from calib_core.settings import CalibrateSettings, ReadSettings


def calibrate_all(
    chosen: argparse.Namespace, reading: ReadSettings, solving: CalibrateSettings, manner: Manner
) -> list[Row]:
    """The rows of all recordings. A sentence is raised before anything runs where the call is at fault."""
    folder = chosen.output
    with alone_in(folder):
        left = take_up(orders_of(chosen, reading, solving), folder)
        if left.others:
            _tell(manner, "fleet.again", why_again(left.others, folder / ASIDE))
        rows = left.done + _run(left, folder, chosen, manner)
    if manner in {Manner.live, Manner.plain}:
        sys.stderr.write(
            f"{recordings(len(rows))}: {counts(rows)}; {folder / NAME} has them all, {PAGE_NAME} shows them\n"
        )
    return rows


def _tell(manner: Manner, code: str, text: str) -> None:
    if manner in {Manner.live, Manner.plain}:
        sys.stderr.write(text + "\n")
    elif manner is Manner.json:
        sys.stderr.write(json.dumps({"event": "log", "level": "info", "code": code, "text": f"{text}."}) + "\n")
    sys.stderr.flush()


def _run(left: TakenUp, folder: Path, chosen: argparse.Namespace, manner: Manner) -> list[Row]:
    """The rows of what is still to run, none where nothing is."""
    total = len(left.ahead) + len(left.done)
    overview = Overview(folder, left.besides + left.done, total=total + len(left.besides))
    try:
        if not left.ahead:
            return []
        executor = choose_executor(chosen.scheduler, chosen.workers)
        overview.where = executor.where
        overview.write(is_running=True)
        executor.prepare(partial(_tell, manner))
        with fleet_listener(manner, total, left.done, executor.where) as tell:

            def on_row(row: Row) -> None:
                overview.add(row)
                tell(row)

            return run_fleet(left.ahead, folder, executor, on_row)
    except KeyboardInterrupt:
        raise Stopped(folder) from None
    finally:
        overview.write(is_running=False)


class Stopped(KeyboardInterrupt):
    """Ctrl-C between two recordings; str() says what is left."""

    def __init__(self, folder: Path) -> None:
        super().__init__(
            f"Interrupted; finished documents are in {folder}, and the same command goes on where it stopped."
        )


def orders_of(chosen: argparse.Namespace, reading: ReadSettings, solving: CalibrateSettings) -> list[FleetOrder]:
    """An order for each recording. Planes and guess are read once here: a bad file is one sentence, not one a recording."""
    planes, guess = _whole(chosen.planes), _whole(chosen.initial_guess)
    if planes is not None:
        api.read_planes(planes)
    if guess is not None:
        api.read_initial_guess(guess)
    found = find_recordings(chosen.source)
    rows = read_rows(chosen.output)
    known = {Path(row.recording): row.name for row in rows} | moved(found, rows, chosen.output)
    names = document_names(found, known)
    memory_bytes = None if chosen.memory_limit_mb is None else chosen.memory_limit_mb * 10**6
    asked = asked_beside(reading, planes, guess)
    return [
        FleetOrder(
            name=names[path],
            recording=path,
            reading=reading,
            solving=solving,
            planes=planes,
            initial_guess=guess,
            asked=asked,
            time_limit_s=chosen.time_limit_s,
            memory_bytes=memory_bytes,
        )
        for path in found
    ]


def choose_executor(scheduler: str | None, workers: int | None) -> Executor:
    """Processes on this machine, or the cluster of a scheduler."""
    if scheduler is None:
        return LocalProcesses(workers)
    if workers is not None:
        raise InputError("Expected --workers or --scheduler, but found both: a cluster has its own workers; drop one.")
    from app.fleet.cluster import DaskCluster

    return DaskCluster(scheduler)


def without_document(rows: list[Row]) -> str | None:
    """One sentence about recordings that have none; None where all have one."""
    missing = [row for row in rows if not row.has_document]
    if not missing:
        return None
    first = missing[0]
    count = f"{len(missing)} of {recordings(len(rows))} ha{'s' if len(missing) == 1 else 've'} no document"
    return f"{count}; the first is {first.name}: {first.sentence}"


def _whole(path: Path | None) -> Path | None:
    return None if path is None else path.absolute()
