"""The library's entry points: what the command line and the web application call, and what a script may.

    recording = api.load("room.bag")
    calibration = api.calibrate(recording)
    calibration.result.status, calibration.result.T_imu_lidar
    text = api.export(calibration.result, "fast-lio")

Frames, signs and units are those of `calib_core/CONVENTIONS.md`. The map frame is the lidar frame at the first used scan's first
point; `Recording`, `Scan`, `Plane`, `Trajectory` and the like are in `calib_core/types.py`.

`inspect`, `load`, `deskew` and `simulate` work on files; what works on a `Recording` takes one that `load` has read. Two
arguments come again and again: `on_event` is called on the caller's thread with every event (`calib_core/events.py`);
`should_cancel` is asked between scans and iterations, and where it returns True, `Cancelled` is raised.

Errors are those of `calib_core/errors.py`, each with one sentence for a person: `InputError` and those derived from it where the
call or a file is at fault. A recording that does not give an answer is no error: the result's `status` is `refused` then.

One file, however long: a caller sees every door in it, and each is a signature and a line. A function imports what it needs
when it is called: SciPy and Open3D take their time, and `unsweep --help` needs neither.
"""

from __future__ import annotations

import gc
import importlib
import threading
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from calib_core.events import OnEvent, ShouldCancel, ignore_event, never_cancel
from calib_core.input_files import make_initial_guess, read_imu_noise, read_initial_guess, read_planes, read_result
from calib_core.result import CalibrationResult
from calib_core.settings import CalibrateSettings, ReadSettings
from calib_core.types import (
    Float32Array,
    FloatArray,
    ImuData,
    InitialGuess,
    Plane,
    PlanePatch,
    PlaneProposals,
    Recording,
    Scan,
    Trajectory,
)

if TYPE_CHECKING:
    from calib_core.audit.given import Direction
    from calib_core.audit.limits import Limits
    from calib_core.audit.pose import GivenExtrinsic
    from calib_core.audit.report import AuditReport
    from calib_core.calibrate import Calibration
    from calib_core.doctor.report import DoctorReport, OnReport
    from calib_core.full.assess.own_errors import Lasers
    from calib_core.full.forecast_by_choice import Foresight
    from calib_core.full.known_extrinsic import HeldMotion
    from calib_core.maps.files import StructArray
    from calib_core.maps.room import Room
    from calib_core.maps.surface import Mesh
    from calib_core.readers.write.rewrite import CloudFormat
    from calib_core.simulate.wishes import Take

__all__ = [
    "asks_for_frames",
    "audit",
    "calibrate",
    "check_settings",
    "covers",
    "deskew",
    "deskew_points",
    "discard_archives",
    "export",
    "export_names",
    "extrinsic_text",
    "fingerprint",
    "foresight",
    "get_ready",
    "grow_plane",
    "ideal_lasers",
    "ideal_readings",
    "inspect",
    "load",
    "make_initial_guess",
    "map_points",
    "parse_extrinsic",
    "propose_planes",
    "raw_map_points",
    "read_cloud",
    "read_extrinsic",
    "read_imu_noise",
    "read_initial_guess",
    "read_limits",
    "read_planes",
    "read_result",
    "room_map",
    "room_mesh",
    "scenarios",
    "sharing_archives",
    "simulate",
    "time_offset_apart_s",
    "without_spans",
]


def recording_suffixes() -> tuple[str, ...]:
    """What a recording's file name may end in, as it is in lower case."""
    from calib_core.readers.container import names

    return names.SUFFIXES


def recording_suffix(name: str) -> str:
    """The one of these that a file's name ends in, in upper or lower case; "" where it is no recording's."""
    from calib_core.readers.container import names

    return names.recording_suffix(name)


def recording_names() -> str:
    """What a recording's file name may end in, in words."""
    from calib_core.readers.container import names

    return names.IN_WORDS


def is_recording_file(path: Path) -> bool:
    """Whether it is a file that is called as recordings are."""
    from calib_core.readers.container import files

    return files.is_recording_file(path)


def is_recording_folder(path: Path) -> bool:
    """Whether the folder is one recording, not one of recordings: by its list of files, or by the names that recorders give."""
    from calib_core.readers.container import files

    return files.is_recording_folder(path)


def recording_files(path: Path) -> list[Path]:
    """The files of the recording at `path`, a file or a folder, which are not opened.

    Raises UnreadableRecording where it is called as none, or holds none or several.
    """
    from calib_core.readers.container import files

    return files.recording_files(path).files


def inspect(
    path: str | Path,
    settings: ReadSettings | None = None,
    *,
    on_event: OnEvent = ignore_event,
    on_report: OnReport | None = None,
    cache_dir: Path | None = None,
    should_cancel: ShouldCancel = never_cancel,
) -> DoctorReport:
    """Everything needed to know whether the recording at `path` can be calibrated, with a verdict.

    on_report: called with what is known so far, in reports that are not `final`, before the whole one is returned.
    cache_dir: folder in which the forecast is kept for `foresight`; None: it is not kept.
    Raises UnreadableRecording where the recording cannot be opened, InputError where `settings` do not fit it, Cancelled. What
    keeps it from being calibrated is in the report.
    """
    from calib_core import doctor

    return doctor.inspect(
        Path(path),
        settings or ReadSettings(),
        on_event=on_event,
        on_report=on_report,
        cache_dir=cache_dir,
        should_cancel=should_cancel,
    )


def foresight(cache_dir: Path) -> Foresight | None:
    """How the forecast's standard deviations change with the choice of planes: `foresight(folder).growth(places)` are the factors
    by which those of the seven grow where only the proposed planes at these places count.

    cache_dir: as it was given to `inspect`.   None where no `inspect` has kept a forecast there.
    """
    from calib_core.full.forecast_by_choice import kept_foresight

    return kept_foresight(cache_dir)


#: SciPy's parts in the order in which a solve comes to them. None is imported above a module: each waits for its first use.
_LATER = ("scipy.special", "scipy.spatial", "scipy.ndimage", "scipy.fft", "scipy.sparse.linalg")


def get_ready(*, aside: bool = True) -> None:
    """Import what `calibrate` needs in the background, while a recording is being read: it saves a second. Never needed.

    For a process that makes one calibration: what has been allocated by then is left out of garbage collection for good.
    aside: False imports on the caller's thread, for a process that is forked from later and must have one thread only.
    """
    collecting = gc.isenabled()
    gc.disable()  # modules stay: to look through them again and again while there come more takes an eighth of that second
    # What reading needs is imported first: two threads that import the same things wait for one another.
    importlib.import_module("calib_core.readers.load")
    if aside:
        threading.Thread(target=_import_the_rest, args=(collecting,)).start()
    else:
        _import_the_rest(collecting)


def _import_the_rest(collecting: bool) -> None:
    """What reading waits for comes first, what no solve asks for in its first moments last."""
    try:
        importlib.import_module("calib_core.readers.scans").load_loops()
        for name in ("calib_core.calibrate", *_LATER):
            importlib.import_module(name)
    finally:
        gc.freeze()
        if collecting:
            gc.enable()


def load(
    path: str | Path,
    settings: ReadSettings | None = None,
    *,
    fingerprint: bool = True,
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
) -> Recording:
    """The lidar and the IMU of the recording at `path`, decoded, in SI units, each point with its own time.

    path: a ROS 1 bag, a ROS 2 folder, a lone .mcap or .db3, or an archive of one.   settings: which topics and span, how stamps
    and point times are read; what is None there is detected, and said in the recording's `findings`.
    fingerprint: hash the whole file, for results' provenance; False leaves `sha256` empty, for a quick look.
    Raises UnreadableRecording, TopicError where no topic or several fit, PointTimeError where clouds have no point times,
    InputError for what else does not fit, Cancelled.
    """
    from calib_core.readers.load import load as read

    return read(
        Path(path), settings or ReadSettings(), fingerprint=fingerprint, on_event=on_event, should_cancel=should_cancel
    )


def fingerprint(path: str | Path) -> str:
    """The SHA-256 by which a result's provenance names the recording at `path`: of its bytes, wherever it lies."""
    from calib_core.readers.container.fingerprint import recording_sha256

    return recording_sha256(Path(path))


def propose_planes(
    recording: Recording,
    settings: CalibrateSettings | None = None,
    *,
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
) -> PlaneProposals:
    """The planes of the recording's reference scan, for a person to choose from, with the cloud that they were found in.

    The reference is the first scan whose planes determine a pose; the scans after it are merged into the cloud as long as the
    platform stands still. Planes and cloud are in the lidar frame at that scan's first point, largest plane first; no plane is no
    error. Raises Cancelled.
    """
    from calib_core.full.odometry import reference_cloud

    return reference_cloud.propose_planes(
        recording, settings or CalibrateSettings(), on_event=on_event, should_cancel=should_cancel
    )


def grow_plane(proposals: PlaneProposals, seed_m: FloatArray) -> PlanePatch | None:
    """The plane around a point that a person points at, of those points of the cloud that belong to no plane yet.

    seed_m: (3,) [m], in the frame of the proposals.   None where the points around it are not flat.
    """
    from calib_core.full.planes import propose

    return propose.grow_plane(proposals, seed_m)


def check_settings(settings: CalibrateSettings, initial_guess: InitialGuess | None = None) -> None:
    """What `calibrate` checks before it looks at a recording, for who has it solved later.

    Raises SettingsError where settings and guess do not fit each other, or name a sensor that no preset is of.
    """
    from calib_core import request

    request.check_settings(settings, initial_guess)


def calibrate(
    recording: Recording,
    settings: CalibrateSettings | None = None,
    *,
    planes: Sequence[Plane] | None = None,
    initial_guess: InitialGuess | None = None,
    cache_dir: Path | None = None,
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
) -> Calibration:
    """The result document and, unless its `status` is `refused`, the lidar's motion.

    planes: those that count, in the map frame or as `propose_planes` gives them, which is told apart; None: all that are
    found. Planes that are `suggested` are left out where they turn out to be doubtful, others count whatever they are.
    initial_guess: where the solve starts, as far as it is known; what is None in it, or without it, is found from the recording.
    cache_dir: folder in which the lidar's motion is kept for the next solve of the same recording. It saves time and
    changes no number.
    Raises SettingsError where settings, planes and guess do not fit one another or the recording, Cancelled.
    """
    from calib_core import calibrate as estimator

    return estimator.calibrate(
        recording,
        settings or CalibrateSettings(),
        planes=planes,
        initial_guess=initial_guess,
        cache_dir=cache_dir,
        on_event=on_event,
        should_cancel=should_cancel,
    )


def audit(
    recording: Recording,
    given: GivenExtrinsic,
    *,
    limits: Limits | None = None,
    settings: CalibrateSettings | None = None,
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
) -> AuditReport:
    """A given extrinsic compared with what the recording says by itself: difference, sigmas and verdict per axis.

    The recording is calibrated with `settings`, without the given extrinsic as a start.   limits: the differences up to
    which an axis passes; None: those beyond which a result of ours is `weak`.   Raises SettingsError and Cancelled, as
    `calibrate` does.
    """
    from calib_core.audit import run
    from calib_core.audit.limits import Limits as AllLimits

    return run.audit(
        recording,
        given,
        limits or AllLimits(),
        settings or CalibrateSettings(),
        on_event=on_event,
        should_cancel=should_cancel,
    )


def read_extrinsic(
    path: str | Path, *, direction: Direction = "imu_lidar", frames: tuple[str, str] = ("", "")
) -> GivenExtrinsic:
    """The extrinsic in a file of ours or of another program, as T_imu_lidar; `calib_core/audit/given.py` lists the forms.

    direction: which way bare numbers lead, of which nobody else can tell; "imu_lidar" for T_imu_lidar.
    frames: names of the IMU's and the lidar's link, to find them in a URDF.
    Raises InputError where the file cannot be read or holds no extrinsic.
    """
    from calib_core.audit import given

    return given.read_extrinsic(Path(path), direction=direction, frames=frames)


def extrinsic_text(path: str | Path) -> tuple[str, bool]:
    """The text of a file with an extrinsic, and whether `parse_extrinsic` needs the recording's frames for it, as for a URDF.

    For who has no recording yet when the file is read. Raises InputError where it cannot be.
    """
    from calib_core.audit import given

    text = given.extrinsic_text(Path(path))
    return text, given.asks_for_frames(text)


def asks_for_frames(text: str) -> bool:
    """Whether `parse_extrinsic` needs the recording's frames for a text: a URDF has many links."""
    from calib_core.audit import given

    return given.asks_for_frames(text)


def check_urdf(text: str) -> None:
    """Raises InputError where a text that `asks_for_frames` gives no extrinsic, whatever the frames are."""
    from calib_core.audit import urdf

    urdf.check_urdf(text)


def parse_extrinsic(
    text: str, *, direction: Direction = "imu_lidar", frames: tuple[str, str] | None = None
) -> GivenExtrinsic:
    """The extrinsic in a text that `extrinsic_text` has read, or somebody has typed; otherwise as `read_extrinsic`."""
    from calib_core.audit import given

    return given.parse_extrinsic(text, direction=direction, frames=frames or ("", ""))


def time_offset_apart_s(first: CalibrationResult, second: CalibrationResult) -> float:
    """The second answer's time offset less the first's; of one recording as both are at the second's instant."""
    from calib_core.audit import compare

    return compare.offset_apart_s(first, second)


def read_limits(path: str | Path) -> Limits:
    """The limits for an audit in a JSON file, of rotation [deg], translation [mm] and time offset [ms]. Raises SettingsError."""
    from calib_core.audit import limits

    return limits.read_limits(Path(path))


def deskew(
    path: str | Path,
    result: CalibrationResult,
    out: str | Path,
    settings: ReadSettings | None = None,
    *,
    cloud_format: CloudFormat = "ply",
    map_out: str | Path | None = None,
    correct_lasers: bool = False,
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
) -> int:
    """Write the recording at `path` to `out` with the motion taken out of every scan; returns the number of scans.

    result: the calibration to do it with, which is held.   out: without suffix a folder of .ply or .pcd files (`cloud_format`),
    else a bag of the same kind as the recording.   map_out: .ply or .pcd file for the accumulated map; None: no map.
    correct_lasers: correct the points, of scans and map, by what the calibration found of the lasers (offsets and scales of
    ranges, angles).   settings: topics that they leave open are the result's, where several fit.
    Raises InputError where the recording cannot be read, `out` cannot be written, the result is `refused`, or there is no motion
    to lay a map with; Cancelled. Neither scans nor map are left behind then.
    """
    from calib_core.full.known_extrinsic import held_calibration, held_motion, laser_corrector
    from calib_core.readers.container.unpacked import kept_unpacked
    from calib_core.readers.load import load as read
    from calib_core.readers.write.output import check_output, placed_last
    from calib_core.readers.write.rewrite import rewrite_clouds

    path, out, settings = Path(path), Path(out), settings or ReadSettings()
    map_out = None if map_out is None else Path(map_out)
    held_calibration(result)  # says so before the recording is read where there is none
    if correct_lasers:
        laser_corrector(result)
    with ExitStack() as until_done:
        until_done.enter_context(kept_unpacked())
        check_output(path, out, map_out)
        # The map waits until the scans are in their place: whoever is stopped, or fails, on the way leaves neither.
        made_map = None if map_out is None else until_done.enter_context(placed_last(map_out))
        found_in = result.provenance.recording
        recording = read(
            path,
            settings,
            topics_before=(found_in.lidar_topic, found_in.imu_topic),
            on_event=on_event,
            should_cancel=should_cancel,
        )
        motion = held_motion(
            recording, result, correct_lasers=correct_lasers, on_event=on_event, should_cancel=should_cancel
        )
        if made_map is not None:
            _write_map(recording, motion, made_map, should_cancel)
        return rewrite_clouds(
            path,
            recording.lidar.topic,
            out,
            motion.deskew,
            settings=settings,
            cloud_format=cloud_format,
            on_event=on_event,
            should_cancel=should_cancel,
        )


def _write_map(recording: Recording, motion: HeldMotion, out: Path, should_cancel: ShouldCancel) -> None:
    from calib_core.maps.files import write_cloud
    from calib_core.maps.room import no_map

    if motion.solved is None:
        raise no_map(recording.name)
    room = room_map(recording, motion.solved, correct=motion.correct, should_cancel=should_cancel)
    write_cloud(out, room.with_normals())


def room_map(
    recording: Recording,
    trajectory: Trajectory,
    *,
    voxel_m: float = 0.05,
    correct: Callable[[Scan], Scan] | None = None,
    should_cancel: ShouldCancel = never_cancel,
) -> Room:
    """The room as one cloud in the map frame, one return a voxel, without stray points, with normals towards the lidar.

    Of the scans that the trajectory covers.   voxel_m: the voxels' edge.   correct: applied to each scan first, as to take the
    lasers' errors out of it.   Raises InputError where the trajectory covers no scan, Cancelled.
    """
    from calib_core.maps import room

    scans: Iterable[Scan] = recording.scans if correct is None else map(correct, recording.scans)
    return room.room_of(scans, trajectory, voxel_m, should_cancel=should_cancel)


def room_mesh(room: Room, *, triangles: int | None = None) -> Mesh:
    """The room's surface as a triangle mesh, map frame, cut back to where points are.

    triangles: at most so many; None: as many as it has.   Raises InputError where there are too few points for one.
    """
    from calib_core.maps import surface

    return surface.mesh_of(room.cloud, room.normals, triangles=triangles)


def read_cloud(path: str | Path) -> StructArray:
    """The points of a .ply or .pcd file, (N,) structured, with all their fields. Raises InputError."""
    from calib_core.maps import files

    return files.read_cloud(Path(path))


def deskew_points(scan: Scan, trajectory: Trajectory) -> Float32Array:
    """(N, 3) [m]: the scan's points in the lidar frame at its first point's time, the sweep's motion taken out."""
    from calib_core import deskew

    return deskew.deskew_points(scan, trajectory)


def map_points(scan: Scan, trajectory: Trajectory) -> Float32Array:
    """(N, 3) [m]: the scan's points in the map frame, each moved by the pose at its own time."""
    from calib_core import deskew

    return deskew.map_points(scan, trajectory)


def raw_map_points(scan: Scan, trajectory: Trajectory) -> Float32Array:
    """(N, 3) [m]: the same with the sweep's motion left in, as if all of it had been seen from its first point's pose."""
    from calib_core import deskew

    return deskew.raw_map_points(scan, trajectory)


def covers(trajectory: Trajectory, scan: Scan) -> bool:
    """Whether the trajectory is valid all through the sweep, not bridged across a gap: only then the scan belongs in a map, or
    in a measurement.
    """
    from calib_core.maps import accumulate

    return accumulate.covers(trajectory, scan)


def ideal_lasers(result: CalibrationResult) -> Lasers | None:
    """The lidar's own errors (ranges, angles) that the result's solve has estimated, to correct a scan's points by; None where it
    has estimated none.
    """
    from calib_core.full.assess import own_errors

    return own_errors.ideal_lasers(result)


def ideal_readings(recording: Recording, result: CalibrationResult) -> ImuData:
    """The IMU's readings corrected by what the result's solve has estimated of the IMU (scales, axes, delay) and of the clocks'
    rate. Biases stay in.
    """
    from calib_core.full.assess import own_errors

    return own_errors.ideal_readings(recording, result)


def without_spans(recording: Recording, spans_s: Sequence[tuple[float, float]]) -> Recording:
    """The recording without the scans that touch a span, as a solve with `excluded_spans_s` sees it; the IMU keeps its readings.

    spans_s: (start, end) in seconds after the first scan.   Raises SettingsError where no scan is left.
    """
    from calib_core.full.prepare import excluded_spans as exclude

    return exclude.without_spans(recording, spans_s)


def sharing_archives(folder: Path) -> AbstractContextManager[None]:
    """A context in which archives are unpacked into `folder`, once for all processes that name it, and stay there afterwards."""
    from calib_core.readers.container import unpacked

    return unpacked.sharing(folder)


def discard_archives(folder: Path) -> bool:
    """Remove what `sharing_archives` has unpacked into a folder; returns False, and removes nothing, while a process reads it."""
    from calib_core.readers.container import unpacked

    return unpacked.discard(folder)


def export(result: CalibrationResult, name: str) -> str:
    """The extrinsic, or what was found of the sensors, as another program wants it: the text of one of that program's own files.

    name: one of `export_names()`.   Raises InputError where there is no such name, or the result has not what it needs.
    """
    from calib_core import exporters

    return exporters.export(result, name)


def export_names() -> tuple[str, ...]:
    """The names that `export` knows."""
    from calib_core import exporters

    return exporters.NAMES


def scenarios() -> dict[str, str]:
    """What `simulate` can make: slug and one sentence of each scenario."""
    from calib_core import simulate as simulator

    return {slug: scenario.text for slug, scenario in simulator.SCENARIOS.items()}


def simulate(
    scenario: str,
    out: str | Path,
    *,
    faults: str = "",
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
    **wishes: Unpack[Take],
) -> Path:
    """Write a recording with known truth to `out`; returns the path of the truth, a JSON file beside it.

    scenario: one of `scenarios()`, behind another lidar as in `handheld+os1`.
    out: .bag for ROS 1, .mcap, or without suffix a ROS 2 folder.
    wishes: seed, mounting, time_offset_s, duration_s and the like; see `calib_core.simulate.wishes`.
    faults: names with commas between them, each with a size if wanted, such as `industrial` or `laser-offsets=0.008`.
    Raises SettingsError where scenario, faults or `out` are not as said, Cancelled.
    """
    from calib_core import simulate as simulator

    return simulator.simulate(
        scenario,
        Path(out),
        faults=simulator.parse_faults(faults),
        on_event=on_event,
        should_cancel=should_cancel,
        **wishes,
    )
