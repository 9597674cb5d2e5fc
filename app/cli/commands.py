"""What each command of the command line does, from parsed words to output."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from app.cli import options
from app.cli.terminal import Manner, choose_manner, listener
from app.process import forget_stdout
from app.storage.atomic import check_writable, write_text
from calib_core import api
from calib_core.errors import InputError
from calib_core.phrasing import counted
from calib_core.result import CalibrationResult

if TYPE_CHECKING:
    from app.results.evidence import StepListener
    from calib_core.events import OnEvent
    from calib_core.types import Recording, Trajectory


#: What a report may be called: it is a page to look at and to print.
_PAGES = frozenset({".html", ".htm"})


class Refused(Exception):
    """The recording cannot give the answer; str() is why."""

    def __init__(self, text: str, *, code: str = "calibration.refused") -> None:
        super().__init__(text)
        self.code = code


class AuditFailed(Exception):
    """The audited extrinsic is off; str() says where and by how much."""

    code = "audit.failed"


def serve(chosen: argparse.Namespace) -> None:
    """Serve the web application until stopped."""
    from app.cli.serving import serve_until_stopped

    serve_until_stopped(
        host=chosen.host,
        port=chosen.port,
        data_dir=chosen.data_dir,
        recordings_dir=chosen.recordings,
        token=chosen.token,
        scheduler=chosen.scheduler,
        database=chosen.database,
    )


def inspect(chosen: argparse.Namespace) -> None:
    """Report on a recording, to stdout."""
    settings = options.read_settings(chosen)
    api.get_ready()
    with listener(_manner(chosen)) as on_event:
        report = api.inspect(chosen.recording, settings, on_event=on_event)
    if chosen.json:
        sys.stdout.write(report.model_dump_json(indent=2, by_alias=True) + "\n")
        return
    from app.cli.inspect_report import report_block

    Console(highlight=False).print(report_block(report, chosen.recording))


def calibrate(chosen: argparse.Namespace) -> None:
    """Calibrate, write the result, sum it up for a person. Raises Refused after a refused result is written."""
    from app.cli.summary import refusal
    from app.cli.topic_choice import load_asking

    solving = options.solve_settings(chosen)
    planes = None if chosen.planes is None else api.read_planes(chosen.planes)
    guess = None if chosen.initial_guess is None else api.read_initial_guess(chosen.initial_guess)
    reading, manner = options.read_settings(chosen), _manner(chosen)
    _check_places(chosen.recording, chosen.output, chosen.report)
    api.get_ready()
    recording = load_asking(chosen.recording, reading, manner)
    with listener(manner) as on_event:
        steps = None if chosen.report is None else _remembering(on_event)
        done = api.calibrate(recording, solving, planes=planes, initial_guess=guess, on_event=steps or on_event)
    # The result is there before anything else is tried: minutes of solving must not be lost for a page.
    try:
        _give_result(done.result, chosen.output, manner)
    except BrokenPipeError:  # who reads stdout has left; the report goes to a file
        forget_stdout()
    if chosen.report is not None and steps is not None:
        spans_s = solving.excluded_spans_s
        with _result_kept(chosen.output):
            _write_report(recording, (done.result, done.trajectory), steps, chosen.report, spans_s=spans_s)
        if manner in {Manner.live, Manner.plain}:
            sys.stderr.write(f"Report written to {chosen.report}\n")
    if done.result.status == "refused":
        raise Refused(refusal(done.result))


def _check_places(recording: Path, output: Path | None, report: Path | None) -> None:
    """Before the work: that result and report can be written, and not one over the other or over what is read."""
    for path in (output, report):
        if path is not None:
            check_writable(path)
            if path.resolve() == recording.resolve():
                raise InputError(f"Expected a name for what is written, but {path} is the recording itself; change it.")
    if report is not None and report.suffix.lower() not in _PAGES:
        raise InputError(
            f"Expected a page of HTML for --report, but {report} is called {report.suffix or 'without a suffix'}; name it "
            ".html, and print it to a file where a .pdf is wanted."
        )
    if output is not None and report is not None and output.resolve() == report.resolve():
        raise InputError(f"Expected a name each for --output and --report, but found {output} for both; change one.")


@contextmanager
def _result_kept(output: Path | None) -> Iterator[None]:
    """What fails beside a result that is given already is told with where that is."""
    where = "on stdout" if output is None else f"in {output}"
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"Interrupted; there is no report, and the result is {where}.") from None
    except Exception as error:
        error.add_note(f"there is no report, and the result is {where}")
        raise


def calibrate_many(chosen: argparse.Namespace) -> None:
    """Calibrate every recording of a folder or a list. Raises Refused where some have no document in the end."""
    from app.cli.calibrate_many import calibrate_all, without_document

    rows = calibrate_all(chosen, options.read_settings(chosen), options.solve_settings(chosen), _manner(chosen))
    sentence = without_document(rows)
    if sentence is not None:
        raise Refused(sentence, code="fleet.incomplete")


def deskew(chosen: argparse.Namespace) -> None:
    """Write the recording's scans with the motion removed."""
    result, manner = api.read_result(chosen.calibration), _manner(chosen)
    with listener(manner) as on_event:
        count = api.deskew(
            chosen.recording,
            result,
            chosen.output,
            options.read_settings(chosen),
            cloud_format=chosen.cloud_format,
            map_out=chosen.map,
            correct_lasers=chosen.correct_lasers,
            on_event=on_event,
        )
    if manner in {Manner.live, Manner.plain}:
        sys.stderr.write(
            f"Wrote {counted(count, 'scan without its motion', 'scans without their motion')} to {chosen.output}\n"
        )


def audit(chosen: argparse.Namespace) -> None:
    """Hold an extrinsic against a recording; the report to stdout. Raises AuditFailed, or Refused where nothing is decided."""
    from app.cli.audit_report import audit_block
    from app.cli.topic_choice import load_asking

    limits = None if chosen.limits is None else api.read_limits(chosen.limits)
    reading, manner = options.read_settings(chosen), _manner(chosen)
    # What is wrong with the file is said before the recording is read; a URDF needs its frames.
    text, asks_for_frames = api.extrinsic_text(chosen.extrinsic)
    given = None if asks_for_frames else api.parse_extrinsic(text, direction=chosen.matrix_direction)
    api.get_ready()
    recording = load_asking(chosen.recording, reading, manner)
    if given is None:
        given = api.parse_extrinsic(text, frames=(recording.imu.frame_id, recording.lidar.frame_id))
    with listener(manner) as on_event:
        report = api.audit(recording, given, limits=limits, on_event=on_event)
    if chosen.json:
        sys.stdout.write(report.to_json())
    else:
        Console(highlight=False).print(audit_block(report, chosen.extrinsic.name))
    sys.stdout.flush()
    if report.verdict == "failed":
        raise AuditFailed(report.text)
    if report.verdict == "unknown":
        raise Refused(report.text)


def export(chosen: argparse.Namespace) -> None:
    """Print the extrinsic, or what was found of the sensors, as another program wants it."""
    sys.stdout.write(api.export(api.read_result(chosen.result), chosen.format))


def simulate(chosen: argparse.Namespace) -> None:
    """Write a simulated recording and its truth."""
    manner = _manner(chosen)
    with listener(manner) as on_event:
        truth = api.simulate(
            chosen.scenario,
            chosen.out,
            seed=chosen.seed,
            mounting=options.parse_mounting(chosen.mounting),
            time_offset_s=chosen.time_offset_s,
            duration_s=chosen.duration_s,
            noise=chosen.noise != "none",
            header_at=chosen.header_at,
            faults=chosen.faults,
            on_event=on_event,
        )
    if manner in {Manner.live, Manner.plain}:
        sys.stderr.write(f"Wrote {chosen.out}, and its truth {truth}\n")


def compile_kernels(chosen: argparse.Namespace) -> None:
    """Compile every loop for this machine, so that the first calibration is as quick as the second."""
    from app import kernels

    told = _manner(chosen) in {Manner.live, Manner.plain}
    if kernels.note_path().exists():
        if told:
            sys.stderr.write("The program's loops are compiled for this machine already\n")
        return
    if told:
        sys.stderr.write("Compiling the program's loops for this machine (once, about a minute)\n")
    kernels.compile_kernels()


COMMANDS: dict[str, Callable[[argparse.Namespace], None]] = {
    "serve": serve,
    "inspect": inspect,
    "calibrate": calibrate,
    "calibrate-many": calibrate_many,
    "deskew": deskew,
    "audit": audit,
    "export": export,
    "simulate": simulate,
    "compile-kernels": compile_kernels,
}


def _remembering(on_event: OnEvent) -> StepListener:
    """Who remembers the solve's steps for a report; what a report needs takes its time to import."""
    from app.results.evidence import StepListener

    return StepListener(on_event)


def _write_report(
    recording: Recording,
    done: tuple[CalibrationResult, Trajectory | None],
    steps: StepListener,
    out: Path,
    *,
    spans_s: Sequence[tuple[float, float]],
) -> None:
    """The page to print, with everything that is measured beside a result.   spans_s: that its solve left out."""
    from app.results.companions import measure_beside
    from app.results.report import report_page

    result, trajectory = done
    measured = measure_beside(recording, result, trajectory, steps.steps, excluded_spans_s=spans_s)
    command, now = shlex.join(["unsweep", *sys.argv[1:]]), datetime.now(UTC)
    write_text(out, report_page(result, replace(measured, command=command, made_at=now)))


def _manner(chosen: argparse.Namespace) -> Manner:
    return choose_manner(quiet=chosen.quiet, log_json=chosen.log_json)


def _give_result(result: CalibrationResult, output: Path | None, manner: Manner) -> None:
    """The document to the file or stdout, and the summary where the document is not."""
    from app.cli.summary import result_summary

    if output is None:
        sys.stdout.write(result.to_json())
        sys.stdout.flush()
    else:
        write_text(output, result.to_json())
    if manner in {Manner.live, Manner.plain}:
        console = Console(stderr=output is None, highlight=False)
        console.print(result_summary(result))
        if output is not None:
            console.print(f"Result written to {output}", markup=False)
