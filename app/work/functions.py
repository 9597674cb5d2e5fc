"""The jobs themselves, run in worker processes: thin steps around calib_core.api that leave files behind.

simulate   a sample recording            -> the recording's source
inspect    the doctor's report           -> {job}/report.json, {cache}/foresight/
planes     decode once, propose planes   -> {cache}/recording/, {cache}/planes/
audit      compare an extrinsic          -> {job}/audit.json
solve      calibrate                     -> {job}/result.json, reading.json, trajectory.npz, thickness.json, scans.json,
                                             evidence.json
surface    a mesh of a solved room       -> {its solve}/surface.npz
"""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from app.arrays.folder import DamagedArrays, discard
from app.arrays.proposals import foresight_folder, has_proposals, proposal_arrays, read_proposals, write_proposals
from app.arrays.recording import has_recording, read_recording, recording_arrays, write_recording
from app.arrays.surface import SURFACE, Surface, write_surface
from app.arrays.trajectory import TRAJECTORY, read_trajectory, write_trajectory
from app.compiling import compiling_told
from app.jobs.naming import document_by_name, events_by_name
from app.jobs.orders import READING, SAMPLE_SEED, Order, OrderedPlane
from app.results.companions import measure_beside
from app.results.evidence import StepListener
from app.results.thinning import spread
from app.results.verdict import solve_outcome
from app.schemas.jobs import AuditOutcome, InspectOutcome, Outcome, PlanesOutcome, SimulateOutcome, SurfaceOutcome
from app.schemas.jobs import InitialGuess as WireGuess
from app.storage.atomic import whole_file
from app.storage.sizes import source_stamp, tree_size
from app.work.head import propose_from_head
from calib_core import api
from calib_core.doctor.report import DoctorReport
from calib_core.errors import Cancelled, InputError
from calib_core.events import LogEvent, OnEvent, ShouldCancel, StageEvent
from calib_core.phrasing import counted
from calib_core.types import InitialGuess, Plane, PlaneProposals, Recording

#: A surface is laid through so many scans, thinned to voxels of this edge, and drawn with so many triangles.
SURFACE_SCANS, SURFACE_VOXEL_M, SURFACE_TRIANGLES = 60, 0.1, 12_000
#: What a job says once its planes can be looked at, while it goes on reading.
PROPOSED = "planes.proposed"
#: What a job says once some of its report can be read, while it goes on examining.
REPORTED = "inspect.reported"


def run_job(order: Order, on_event: OnEvent, should_cancel: ShouldCancel) -> Outcome:
    """Run the ordered job; its outcome. What an archive holds is unpacked once for all jobs of the recording."""
    unpacking = nullcontext() if order.unpacked is None else api.sharing_archives(order.unpacked)
    with unpacking, compiling_told(events_by_name(order, on_event)) as told:
        return _run(order, told, should_cancel)


def _run(order: Order, on_event: OnEvent, should_cancel: ShouldCancel) -> Outcome:
    match order.kind:
        case "simulate":
            return run_simulate(order, on_event, should_cancel)
        case "inspect":
            return run_inspect(order, on_event, should_cancel)
        case "planes":
            return run_planes(order, on_event, should_cancel)
        case "solve":
            return run_solve(order, on_event, should_cancel)
        case "audit":
            return run_audit(order, on_event, should_cancel)
        case "surface":
            return run_surface(order, on_event, should_cancel)


def run_simulate(order: Order, on_event: OnEvent, should_cancel: ShouldCancel) -> SimulateOutcome:
    """Write the sample where uploads end up."""
    on_event(StageEvent(stage="write", fraction=0.0, text="simulating the sensors"))
    order.source.parent.mkdir(parents=True, exist_ok=True)
    api.simulate(order.scenario, order.source, seed=SAMPLE_SEED, on_event=on_event, should_cancel=should_cancel)
    return SimulateOutcome(size_bytes=tree_size(order.source))


def run_inspect(order: Order, on_event: OnEvent, should_cancel: ShouldCancel) -> InspectOutcome:
    """Write the doctor's report: first what is known soon, which is said, then the whole."""

    def write(report: DoctorReport) -> None:
        _write(order.folder / "report.json", document_by_name(order, report.model_dump_json(by_alias=True)))

    def on_report(report: DoctorReport) -> None:
        write(report)
        what = "The topics" if report.lidar is None and report.imu is None else "The sensors"
        on_event(LogEvent(level="info", code=REPORTED, text=f"{what} can be looked at."))

    write(
        api.inspect(
            order.source,
            order.read_settings,
            on_event=on_event,
            on_report=on_report,
            cache_dir=foresight_folder(order.cache),
            should_cancel=should_cancel,
        )
    )
    return InspectOutcome()


def run_planes(order: Order, on_event: OnEvent, should_cancel: ShouldCancel) -> PlanesOutcome:
    """Propose planes, from the first seconds where that will do, and decode the recording unless that is done."""
    folder = proposal_arrays(order.cache)
    if not has_proposals(folder) and not has_recording(recording_arrays(order.cache)):
        early = propose_from_head(order, on_event, should_cancel)
        if early is not None:
            write_proposals(folder, early)
            on_event(
                LogEvent(level="info", code=PROPOSED, text=f"{counted(len(early.patches), 'plane')} can be looked at.")
            )
    recording = decoded(order, on_event, should_cancel)
    proposals = kept_proposals(folder)
    if proposals is None:
        proposals = api.propose_planes(
            recording, order.request.settings, on_event=on_event, should_cancel=should_cancel
        )
        write_proposals(folder, proposals)
    return PlanesOutcome(patches=len(proposals.patches), points=len(proposals.cloud_m), static=proposals.static)


def run_solve(order: Order, on_event: OnEvent, should_cancel: ShouldCancel) -> Outcome:
    """Calibrate and write what the answer is shown with."""
    recording = decoded(order, on_event, should_cancel)
    steps = StepListener(on_event)
    wish = order.request
    planes = None if wish.planes is None else [_plane(plane) for plane in wish.planes]
    calibration = api.calibrate(
        recording,
        wish.settings,
        planes=planes,
        initial_guess=meant_guess(wish.initial_guess),
        cache_dir=order.cache / "track",
        on_event=steps,
        should_cancel=should_cancel,
    )
    result, trajectory = calibration.result, calibration.trajectory
    if should_cancel():
        raise Cancelled("Stopped before anything was written.")
    if trajectory is not None:
        write_trajectory(order.folder / TRAJECTORY, trajectory)
    spans_s = wish.settings.excluded_spans_s
    beside = measure_beside(recording, result, trajectory, steps.steps, excluded_spans_s=spans_s, on_event=on_event)
    for name, measured in (("thickness", beside.walls), ("scans", beside.scans), ("evidence", beside.evidence)):
        if measured is not None:
            _write(order.folder / f"{name}.json", measured.model_dump_json())
    _write(order.folder / READING, order.read_settings.model_dump_json())
    _write(order.folder / "result.json", document_by_name(order, result.to_json()))
    return solve_outcome(result)


def run_audit(order: Order, on_event: OnEvent, should_cancel: ShouldCancel) -> AuditOutcome:
    """Hold the given extrinsic against the recording and write the report."""
    wish = order.request.audit
    if wish is None:
        raise ValueError("an audit was ordered without an extrinsic")
    recording = decoded(order, on_event, should_cancel)
    frames = (recording.imu.frame_id, recording.lidar.frame_id)
    given = api.parse_extrinsic(wish.extrinsic, direction=wish.direction, frames=frames)
    report = api.audit(recording, given, limits=wish.limits, on_event=on_event, should_cancel=should_cancel)
    _write(order.folder / "audit.json", document_by_name(order, report.to_json()))
    return AuditOutcome(verdict=report.verdict, text=report.text)


def run_surface(order: Order, on_event: OnEvent, should_cancel: ShouldCancel) -> SurfaceOutcome:
    """Lay a surface through the map of a solve, light enough to be drawn in software."""
    if order.request.surface_of is None:
        raise ValueError("a surface was ordered of no solve")
    solve = order.folder.parent / order.request.surface_of
    try:
        trajectory = read_trajectory(solve / TRAJECTORY)
    except (OSError, EOFError, ValueError, KeyError, BadZipFile) as error:
        raise InputError(
            "Expected the motion of a solve to lay a surface through its map, but it is gone; solve again.",
            code="surface.no_motion",
        ) from error
    recording = decoded(order, on_event, should_cancel)
    on_event(StageEvent(stage="deskew", fraction=0.0, text="laying a surface through the map"))
    scans = [recording.scans[place] for place in spread(len(recording.scans), SURFACE_SCANS)]
    some = replace(recording, scans=scans)
    room = api.room_map(some, trajectory, voxel_m=SURFACE_VOXEL_M, should_cancel=should_cancel)
    mesh = api.room_mesh(room, triangles=SURFACE_TRIANGLES)
    write_surface(solve / SURFACE, Surface(mesh.vertices_m, mesh.triangles.astype(np.uint32)))
    return SurfaceOutcome(triangles=len(mesh.triangles))


def decoded(order: Order, on_event: OnEvent, should_cancel: ShouldCancel) -> Recording:
    """The recording from its array file, which is made first where it is missing."""
    folder = recording_arrays(order.cache)
    try:
        if has_recording(folder):
            recording = replace(read_recording(folder), name=order.recording_name)
            on_event(StageEvent(stage="read", fraction=1.0, kept=True))
            return recording
    except DamagedArrays:
        discard(folder)
    recording = api.load(order.source, order.read_settings, on_event=on_event, should_cancel=should_cancel)
    if order.source_stamp and source_stamp(order.source) != order.source_stamp:
        raise InputError(
            f"{order.recording_name} was changed or replaced while it was being read; have it inspected again.",
            code="recording.source_changed",
        )
    write_recording(folder, replace(recording, name=order.recording_name))
    return replace(read_recording(folder), name=order.recording_name)


def kept_proposals(folder: Path) -> PlaneProposals | None:
    """The proposals that are kept; None where there are none, or damaged ones, which go."""
    try:
        return read_proposals(folder) if has_proposals(folder) else None
    except DamagedArrays:
        discard(folder)
        return None


def _plane(plane: OrderedPlane) -> Plane:
    """The plane as it is read from a file of planes, to the last digit: the shown command repeats the run exactly."""
    normal = np.array(plane.normal, dtype=np.float64)
    length = float(np.linalg.norm(normal))
    outline_m = None if plane.outline_m is None else np.array(plane.outline_m, dtype=np.float64)
    return Plane(plane.name, normal / length, plane.offset_m / length, outline_m, plane.suggested)


def meant_guess(wire: WireGuess | None) -> InitialGuess | None:
    """The start values as the solve takes them. Raises SettingsError where they are no mounting."""
    return None if wire is None else api.make_initial_guess(wire.matrix, wire.time_offset_s, where="the initial guess")


def _write(path: Path, text: str) -> None:
    with whole_file(path) as fresh:
        fresh.write_text(text, encoding="utf-8")
