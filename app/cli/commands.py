"""What each command of the command line does, from parsed words to output."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

from pydantic import ValidationError
from rich.console import Console

from app.cli import options
from app.cli.terminal import Manner, choose_manner, listener
from app.storage.atomic import check_writable, write_text
from calib_core import api
from calib_core.errors import InputError, SettingsError
from calib_core.result import CalibrationResult
from calib_core.settings import CalibrateSettings, ReadSettings


class Refused(Exception):
    """The recording cannot give the answer; str() is why."""

    def __init__(self, text: str, *, code: str = "calibration.refused") -> None:
        super().__init__(text)
        self.code = code


def serve(chosen: argparse.Namespace) -> None:
    """Serve the web application until stopped."""
    from app.cli.serving import serve_until_stopped

    serve_until_stopped(
        host=chosen.host,
        port=chosen.port,
        data_dir=chosen.data_dir,
        recordings_dir=chosen.recordings,
        token=chosen.token,
    )


def inspect(chosen: argparse.Namespace) -> None:
    """Report on a recording, to stdout."""
    settings = _read_settings(chosen)
    with listener(_manner(chosen)) as on_event:
        report = api.inspect(chosen.recording, settings, on_event=on_event)
    if chosen.json:
        sys.stdout.write(report.model_dump_json(indent=2, by_alias=True) + "\n")
        return
    from app.cli.inspect_report import report_block

    Console(highlight=False).print(report_block(report, chosen.recording))


def calibrate(chosen: argparse.Namespace) -> None:
    """Calibrate, write the result, sum it up for a person. Raises Refused after a refused result is written."""
    from app.cli.choosing import load_asking
    from app.cli.summary import refusal

    solving = _solve_settings(chosen)
    planes = None if chosen.planes is None else api.read_planes(chosen.planes)
    guess = None if chosen.initial_guess is None else api.read_initial_guess(chosen.initial_guess)
    reading, manner = _read_settings(chosen), _manner(chosen)
    if chosen.output is not None:
        check_writable(chosen.output)
    api.get_ready()
    recording = load_asking(chosen.recording, reading, manner)
    with listener(manner) as on_event:
        done = api.calibrate(recording, solving, planes=planes, initial_guess=guess, on_event=on_event)
    _give_result(done.result, chosen.output, manner)
    if done.result.status == "refused":
        raise Refused(refusal(done.result))


def calibrate_many(chosen: argparse.Namespace) -> None:
    """Calibrate every recording of a folder or a list. Raises Refused where some have no document in the end."""
    from app.cli.many import calibrate_all, without_document

    rows = calibrate_all(chosen, _read_settings(chosen), _solve_settings(chosen), _manner(chosen))
    sentence = without_document(rows)
    if sentence is not None:
        raise Refused(sentence, code="fleet.incomplete")


def deskew(chosen: argparse.Namespace) -> None:
    """Write the recording's scans with the motion removed."""
    result, manner = api.read_result(chosen.calibration), _manner(chosen)
    if chosen.output.exists() and not (chosen.output.is_dir() and not any(chosen.output.iterdir())):
        raise InputError(f"The output {chosen.output} exists already; remove it or choose another name.")
    with listener(manner) as on_event:
        count = api.deskew(chosen.recording, result, chosen.output, _read_settings(chosen), on_event=on_event)
    if manner in {Manner.live, Manner.plain}:
        sys.stderr.write(f"Wrote {count} scans without their motion to {chosen.output}\n")


def export(chosen: argparse.Namespace) -> None:
    """Print the extrinsic as another program wants it."""
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
    "export": export,
    "simulate": simulate,
    "compile-kernels": compile_kernels,
}


def _manner(chosen: argparse.Namespace) -> Manner:
    return choose_manner(quiet=chosen.quiet, log_json=chosen.log_json)


def _read_settings(chosen: argparse.Namespace) -> ReadSettings:
    """The options of the groups of `_add_reading`, which have the names of the settings."""
    words = vars(chosen)
    try:
        return ReadSettings.model_validate({name: words[name] for name in ReadSettings.model_fields if name in words})
    except ValidationError as error:
        raise _unfit(error) from error


def _solve_settings(chosen: argparse.Namespace) -> CalibrateSettings:
    try:
        return CalibrateSettings(
            method=chosen.method,
            points_per_plane_per_scan=options.parse_points(chosen.points_per_plane_per_scan, chosen.method),
            field_of_view_deg=options.parse_field_of_view(chosen.field_of_view_deg, chosen.method),
            gravity=options.parse_gravity(chosen.gravity),
            imu_noise=options.parse_imu_noise(chosen.imu_noise),
            estimate_time_offset=not chosen.fix_time_offset,
            estimate_planes=not chosen.fix_planes,
            bias_model=chosen.bias_model,
            imu_sampling=chosen.imu_sampling,
            priors=options.parse_priors(chosen.prior),
            random_seed=chosen.random_seed,
            max_rounds=chosen.max_rounds,
            excluded_spans_s=options.parse_spans(chosen.exclude),
        )
    except ValidationError as error:
        raise _unfit(error) from error


def _unfit(error: ValidationError) -> SettingsError:
    first = error.errors()[0]
    option = "-".join(str(part) for part in first["loc"]).replace("_", "-")
    return SettingsError(f"The option --{option} does not fit: {first['msg']}; correct it")


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
