"""Which scene belongs to a view: the wish, met as far as what is there allows."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from app.errors import ApiError
from app.jobs.service import JobService
from app.jobs.state_machine import FINAL
from app.jobs.stored_parts import error_of
from app.planes.service import PlaneService
from app.scene.aim import Stage
from app.scene.build import Solved, build_first, build_planes, build_straightened, build_unsolved, empty, solved_stage
from app.scene.camera import Camera
from app.scene.converge import build_converging, steady_up
from app.scene.inspect import Look, Motions, build_inspection
from app.scene.items import Cloud, Content
from app.scene.nudge import nudged, wall_blur, with_old
from app.scene.sources import SceneSources, Shelf, SolvedJob
from app.scene.straighten import fastest_scan, straighten
from app.scene.surface import LEGEND, surface_items
from app.schemas.view import View, ViewState, WallBlur
from app.storage.records import JobRecord, RecordingRecord
from calib_core.types import FloatArray, Recording, Trajectory

NOT_READ = "The recording has not been read yet."


@dataclass(frozen=True)
class Composed:
    """A scene and the view it makes true."""

    content: Content
    view: View


@dataclass(frozen=True)
class Costs:
    """What the walls say of a nudge and of the old extrinsic; None where there is none."""

    nudge: WallBlur | None = None
    old: WallBlur | None = None


class Composer:
    """Builds the scene of a view."""

    def __init__(self, sources: SceneSources, planes: PlaneService, jobs: JobService, *, displayed_points: int) -> None:
        self._sources = sources
        self._planes = planes
        self._jobs = jobs
        self._limit = displayed_points
        self._fastest: Shelf[int] = Shelf()
        self._costs: Shelf[WallBlur] = Shelf(kept=64)
        self._stages: Shelf[Stage] = Shelf()

    def compose(self, record: RecordingRecord, state: ViewState, camera: Camera | None = None) -> Composed:
        """The scene of the view. camera: for the wipe, where the browser looks from."""
        recording = self._sources.recording(record)
        n_scans = 0 if recording is None else len(recording.scans)
        state = state.model_copy(update={"scan": max(0, min(state.scan, n_scans - 1))})
        costs = Costs()
        if state.mode == "planes":
            content = self._planes_scene(record, recording, state)
        elif recording is None or n_scans == 0:
            content = empty(NOT_READ)
        elif state.mode == "solve":
            content = self._solve_scene(record, recording, state)
        else:
            content, costs = self._inspect_scene(record, recording, state, camera)
        return Composed(_as_wished(content, state), _view(record, recording, state, content, costs))

    def forget(self, recording_id: str) -> None:
        """The recording is deleted."""
        self._sources.forget(recording_id)
        for shelf in (self._fastest, self._costs, self._stages):
            shelf.forget(recording_id)

    def _planes_scene(self, record: RecordingRecord, recording: Recording | None, state: ViewState) -> Content:
        try:
            proposals, history = self._planes.current(record.id)
        except ApiError as error:
            first = self._sources.first_cloud(record)
            if first is not None:
                return build_first(first, limit=self._limit, note="The first scans; their planes are being looked for.")
            if recording is None or len(recording.scans) == 0:
                return empty(str(error))
            return build_unsolved(recording, state.scan, color_by="intensity", limit=self._limit, note=str(error))
        return build_planes(
            proposals,
            history.current,
            limit=self._limit,
            judging=state.click == "toggle",
            target=state.target,
            up=self._planes.up(record.id),
        )

    def _solve_scene(self, record: RecordingRecord, recording: Recording, state: ViewState) -> Content:
        """The sweeps straightened by the estimate of the moment, as it says where they were; else by the gyroscope."""
        job_id = self._solve_shown(record, state)
        steps = [] if job_id is None else self._jobs.logs.iterations(job_id)
        step = steps[-1] if steps else None
        if step is not None and step.sweeps:
            up = steady_up(steps[0], self._planes.up(record.id))
            found = self._sources.solved(record, job_id)
            measured = None if found is None else found.solved.walls
            return build_converging(
                recording,
                step,
                limit=self._limit,
                up=up,
                straight=state.straight,
                dark=state.dark,
                measured=measured,
            )
        place = self._fastest.get(f"{record.id}{record.read_settings_json}", lambda: fastest_scan(recording))
        if step is None:
            note = raw_note(job_id, self._jobs.records_of(record.id))
            return build_unsolved(recording, place, color_by="time", limit=self._limit, note=note)
        matrix: FloatArray = np.array(step.matrix)
        scan = recording.scans[place]
        points_m = straighten(scan, recording.imu, T_imu_lidar=matrix, time_offset_s=step.time_offset_s)
        R_lidar_imu = matrix[:3, :3].T
        return build_straightened(scan, points_m, R_lidar_imu=R_lidar_imu, p_lidar_imu=-R_lidar_imu @ matrix[:3, 3])

    def _solve_shown(self, record: RecordingRecord, state: ViewState) -> str | None:
        for job in self._jobs.records_of(record.id):
            if job.kind == "solve" and state.job_id in {None, job.id}:
                return job.id
        return None

    def _inspect_scene(
        self, record: RecordingRecord, recording: Recording, state: ViewState, camera: Camera | None
    ) -> tuple[Content, Costs]:
        found = self._sources.solved(record, state.job_id)
        if found is None:
            note = "There is no answer yet: the scan is raw."
            content = build_unsolved(recording, state.scan, color_by=state.color_by, limit=self._limit, note=note)
            return content, Costs()
        solved = found.solved
        stage = self._stages.get(f"{record.id}{found.job_id}", lambda: solved_stage(recording, solved))
        motions = _motions(solved, state)
        look = Look(
            place=state.scan,
            show=state.show,
            against=state.against,
            extent=state.extent,
            color_by=state.color_by,
            wipe=state.wipe,
            limit=self._limit,
            stage=stage,
            preset=state.preset,
            dark=state.dark,
        )
        costs_of = f"{record.id}{found.job_id}"
        costs = Costs(
            nudge=None if state.nudge is None else self._cost(costs_of, recording, found.solved, motions.shown),
            old=None if motions.old is None else self._cost(costs_of, recording, found.solved, motions.old),
        )
        if state.extent != "surface":
            return build_inspection(recording, look, motions, camera), costs
        return self._with_surface(record, recording, found, look, motions), costs

    def _with_surface(
        self, record: RecordingRecord, recording: Recording, found: SolvedJob, look: Look, motions: Motions
    ) -> Content:
        """The surface instead of the map, once it has been laid; what is being done about it until then."""
        shown = build_inspection(recording, replace(look, extent="map", show="deskewed"), motions, None)
        if found.surface is None:
            job = self._sources.surface_job(record, found.job_id)
            error = None if job is None else error_of(job)
            waits = "The surface is being laid; until then, the map."
            return replace(shown, note=waits if error is None else error.text)
        sheets = surface_items(found.surface, found.solved, look.stage)
        kept = tuple(item for item in shown.items if not isinstance(item, Cloud))
        return replace(shown, items=(*sheets, *kept), legend=LEGEND)

    def _cost(self, name: str, recording: Recording, solved: Solved, wrong: Trajectory) -> WallBlur:
        """What a wrong motion costs, worked out once: a slider through the scans does not change it."""
        mark = zlib.crc32(wrong.times_s.tobytes() + wrong.R_map_lidar.tobytes() + wrong.p_map_lidar.tobytes())
        return self._costs.get(f"{name}{mark}", lambda: wall_blur(recording, solved, wrong))


def _as_wished(content: Content, state: ViewState) -> Content:
    """The content seen from where it is wished to be seen, its points as large as wished."""
    items = tuple(
        replace(item, size_m=item.size_m * state.point_scale) if isinstance(item, Cloud) else item
        for item in content.items
    )
    return replace(content, items=items, preset=state.preset, looks=state.looks)


def _motions(solved: Solved, state: ViewState) -> Motions:
    nudge = state.nudge
    shown = solved.trajectory if nudge is None else nudged(solved.trajectory, solved.T_imu_lidar, nudge)
    if state.old is None:
        return Motions(solved, shown, None)
    return Motions(solved, shown, with_old(solved, state.old), state.old.name)


def _view(
    record: RecordingRecord, recording: Recording | None, state: ViewState, content: Content, costs: Costs
) -> View:
    scans = () if recording is None else recording.scans
    scan_t_s = (scans[state.scan].stamp_ns - scans[0].stamp_ns) * 1e-9 if len(scans) > 0 else None
    return View(
        **state.model_dump(),
        scene_url=f"/scene/{record.id}/",
        n_scans=len(scans),
        scan_t_s=scan_t_s,
        points_shown=content.points_shown,
        legend=content.legend,
        blur=costs.nudge,
        old_blur=costs.old,
        note=content.note,
    )


def raw_note(job_id: str | None, jobs: Sequence[JobRecord]) -> str:
    """What stands beside a sweep that no estimate straightens: of a run that has ended none is to come."""
    over = any(job.id == job_id and job.state in FINAL for job in jobs)
    return f"No estimate{'' if over else ' yet'}: the sweep that turned fastest, raw."
