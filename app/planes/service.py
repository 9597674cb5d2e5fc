"""Planes of all recordings: one history each, one queue of operations each, kept in the store."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from pydantic import ValidationError

from app.arrays.folder import DamagedArrays, discard
from app.arrays.proposals import foresight_folder, has_proposals, proposal_arrays, read_proposals
from app.bus import Bus
from app.errors import ApiError, Conflict, NotFound
from app.events import PlanesEdited, RecordingArrived
from app.jobs.orders import OrderedPlane
from app.locks import NamedLocks
from app.planes.geometry import solved_outline
from app.planes.operations import apply
from app.planes.palette import plane_hex
from app.planes.state import EditedPatch, PlaneHistory, PlaneSet, suggested
from app.planes.strength import Strength, foreseen
from app.planes.upright import Room, named, room_of
from app.planes.wire import wire_planes
from app.schemas.jobs import PlaneLook
from app.schemas.planes import Operation, Planes, Redo, Undo
from app.storage.files import DataFolder
from app.storage.records import RecordingRecord
from app.storage.store import DocumentStore, RecordingStore
from calib_core import api
from calib_core.doctor.report import DoctorReport
from calib_core.types import FloatArray, PlaneProposals

DOCUMENT = "planes"
#: The code of a refusal: there are no planes yet.
NOT_PROPOSED = "planes.not_proposed"

#: Clouds kept in memory between two clicks.
KEPT_PROPOSALS = 4
#: What the doctor calls the planes, and the mark of the report that says so.
MarkedRoom = tuple[str, Room]


class PlaneService:
    """Reading and editing planes. Thread-safe: operations come from routes and from clicks in the scene.

    Each recording has a lock of its own, held while its clouds are read and fitted: who edits another does not wait for it.
    Tells the bus of each change, never under that lock: who hears of it may want another one, of jobs for instance, whose
    holder wants this one.
    """

    def __init__(self, recordings: RecordingStore, documents: DocumentStore, files: DataFolder, bus: Bus) -> None:
        self._bus = bus
        self._recordings = recordings
        self._documents = documents
        self._files = files
        self._editing = NamedLocks()
        self._lock = threading.Lock()  # of the dictionaries below; never held while anything is read or fitted
        self._proposals: OrderedDict[str, PlaneProposals] = OrderedDict()
        self._names: dict[str, dict[int, str]] = {}
        self._rooms: dict[str, MarkedRoom] = {}
        self._damaged: dict[str, RecordingRecord] = {}
        self._strength = Strength()

    def read(self, recording_id: str) -> Planes:
        """The planes now."""
        with self._held(recording_id):
            proposals, history, room = self._now(recording_id)
            return self._wire(room, history, proposals)

    def up(self, recording_id: str) -> FloatArray | None:
        """(3,) the vertical in the frame of the planes; None until the doctor knows it."""
        with self._lock:
            known = self._rooms.get(recording_id)
        return None if known is None else known[1].up

    def current(self, recording_id: str) -> tuple[PlaneProposals, PlaneHistory]:
        """Proposals and history; Conflict until there are some."""
        with self._held(recording_id):
            proposals, history, _ = self._now(recording_id)
            return proposals, history

    def _now(self, recording_id: str) -> tuple[PlaneProposals, PlaneHistory, MarkedRoom]:
        """Proposals, history, and what the doctor calls the planes. The recording's lock is held."""
        key, proposals, room = self._load(recording_id)
        history = self._kept(recording_id)
        if history is None or history.cache_key != key:
            revision = 0 if history is None else history.revision + 1
            history = PlaneHistory(cache_key=key, revision=revision, steps=(suggested(proposals),), cursor=0)
            self._keep(recording_id, history)
        return proposals, named(history, room[1]), room

    def apply(self, recording_id: str, operation: Operation) -> Planes:
        """The planes after the operation."""
        with self._held(recording_id):
            proposals, history, room = self._now(recording_id)
            expected = operation.expected_revision
            if expected is not None and expected != history.revision:
                raise Conflict(
                    "planes.revision",
                    f"The planes have changed meanwhile (revision {history.revision}, you saw {expected}); look again.",
                )
            after = named(self._after(history, operation, proposals), room[1])
            if after.current == history.current and after.cursor == history.cursor:
                return self._wire(room, history, proposals)
            self._keep(recording_id, after)
            planes = self._wire(room, after, proposals)
        self._bus.publish(PlanesEdited(recording_id, planes.revision))
        return planes

    def proposed(self, recording_id: str) -> None:
        """New proposals are there: tell those who look."""
        _, history = self.current(recording_id)
        self._bus.publish(PlanesEdited(recording_id, history.revision))

    def confirmed(self, recording_id: str) -> tuple[OrderedPlane, ...] | None:
        """The planes a solve uses, each with whether it is as it was proposed: who drops one has chosen none of the others.

        None, which lets the solve find its own, where none have been proposed.
        """
        try:
            proposals, history = self.current(recording_id)
        except Conflict as error:
            if error.code != NOT_PROPOSED:
                raise
            return None
        planes = history.current
        proposed = frozenset(_unnamed(patch) for patch in suggested(proposals).patches)
        chosen = tuple(ordered(patch, planes, proposed=proposed) for patch in planes.patches if patch.confirmed)
        if not chosen:
            raise Conflict(
                "planes.none_confirmed", "No plane is confirmed; confirm at least three that face different ways."
            )
        return chosen

    def looks(self, recording_id: str, planes: Sequence[OrderedPlane]) -> list[PlaneLook]:
        """How a run's planes are shown: in their colours, and by the names they have today."""
        today = self._names_of(recording_id)
        return [
            PlaneLook(
                name=plane.name,
                title=plane.name if plane.color is None else today.get(plane.color, plane.name),
                color=plane_hex(place if plane.color is None else plane.color),
                restricted=plane.outline_m is not None,
            )
            for place, plane in enumerate(planes)
        ]

    def _names_of(self, recording_id: str) -> dict[int, str]:
        """Today's names by colour; remembered until they change, and of a deleted recording not at all."""
        with self._held(recording_id):
            with self._lock:
                today = self._names.get(recording_id)
            if today is not None:
                return today
            there = True
            try:
                planes = self._now(recording_id)[1].current
            except ApiError as error:  # its proposals are gone, or it is
                there = not isinstance(error, NotFound)
                history = self._kept(recording_id)
                planes = PlaneSet(patches=()) if history is None else history.current
            today = {patch.color: patch.name for patch in planes.patches}
            if there:
                with self._lock:
                    self._names[recording_id] = today
            return today

    def forget(self, recording_id: str) -> None:
        """Drop what is in memory of a deleted recording, once nobody is at it any more."""
        with self._editing.hold(recording_id), self._lock:
            self._names.pop(recording_id, None)
            self._rooms.pop(recording_id, None)
            self._damaged.pop(recording_id, None)
            for cached in [key for key in self._proposals if key.startswith(recording_id)]:
                del self._proposals[cached]

    @contextmanager
    def _held(self, recording_id: str) -> Iterator[None]:
        """Hold the recording's lock, once in a call; what was found damaged meanwhile is told afterwards."""
        try:
            with self._editing.hold(recording_id):
                yield
        finally:
            with self._lock:
                damaged = self._damaged.pop(recording_id, None)
            if damaged is not None:
                self._bus.publish(RecordingArrived(damaged))

    def _kept(self, recording_id: str) -> PlaneHistory | None:
        """The planes as they were left; None where they never were touched, or can no longer be read."""
        text = self._documents.read(recording_id, DOCUMENT)
        try:
            return None if text is None else PlaneHistory.model_validate_json(text)
        except ValidationError:
            return None

    def _keep(self, recording_id: str, history: PlaneHistory) -> None:
        self._documents.write(recording_id, DOCUMENT, history.model_dump_json())
        with self._lock:
            self._names.pop(recording_id, None)

    def _after(self, history: PlaneHistory, operation: Operation, proposals: PlaneProposals) -> PlaneHistory:
        if isinstance(operation, Undo):
            if not history.can_undo:
                raise Conflict("planes.nothing_to_undo", "There is nothing to take back.")
            return history.moved(-1)
        if isinstance(operation, Redo):
            if not history.can_redo:
                raise Conflict("planes.nothing_to_redo", "There is nothing to make again.")
            return history.moved(+1)
        edited: PlaneSet = apply(history.current, operation, proposals=proposals, grow=api.grow_plane)
        return history if edited == history.current else history.push(edited)

    def _wire(self, marked: MarkedRoom, history: PlaneHistory, proposals: PlaneProposals) -> Planes:
        mark, room = marked
        growth = self._strength.growth(room, mark, history.current, suggested(proposals))
        known = foreseen(room.forecast, growth)
        return wire_planes(history, static=proposals.static, up=room.up, known=known, doubts=room.doubts)

    def _room(self, record: RecordingRecord, proposals: PlaneProposals) -> MarkedRoom:
        """What the doctor calls these planes; worked out anew when there is another report."""
        mark = f"{self._files.cache_key(record)}/{hash(record.report_json)}"
        with self._lock:
            known = self._rooms.get(record.id)
        if known is not None and known[0] == mark:
            return known
        report = None if record.report_json is None else DoctorReport.model_validate_json(record.report_json)
        room = Room() if report is None else room_of(report.planes, proposals, report.forecast)
        room = replace(room, foresight=foresight_folder(self._files.cache(record)))
        with self._lock:
            self._rooms[record.id] = (mark, room)
            self._names.pop(record.id, None)
        return mark, room

    def _load(self, recording_id: str) -> tuple[str, PlaneProposals, MarkedRoom]:
        record = self._recordings.find(recording_id)
        if record is None:
            raise NotFound("recording.not_found", "The recording has been deleted.")
        key = self._files.cache_key(record)
        folder = proposal_arrays(self._files.cache(record))
        cached = f"{recording_id}/{key}"
        with self._lock:
            proposals = self._proposals.pop(cached, None)
        try:
            if not has_proposals(folder):
                raise DamagedArrays
            if proposals is None:
                proposals = read_proposals(folder)
        except DamagedArrays:
            if discard(folder):  # there was something, and it was not whole: it is found again
                with self._lock:
                    self._damaged[recording_id] = record
            raise Conflict(NOT_PROPOSED, "The planes of this recording have not been found yet.") from None
        with self._lock:
            self._proposals[cached] = proposals  # at the end: the one used last
            while len(self._proposals) > KEPT_PROPOSALS:
                self._proposals.popitem(last=False)
        return key, proposals, self._room(record, proposals)


def ordered(patch: EditedPatch, planes: PlaneSet, *, proposed: frozenset[EditedPatch] = frozenset()) -> OrderedPlane:
    """A patch of a set as a solve takes it. proposed: the patches as they were found, without names."""
    corners_m = solved_outline(patch, planes.region)
    outline_m = None if corners_m is None else tuple((x, y, z) for x, y, z in corners_m.tolist())
    return OrderedPlane(
        name=patch.name,
        normal=patch.normal,
        offset_m=patch.offset_m,
        color=patch.color,
        outline_m=outline_m,
        suggested=not planes.region and _unnamed(patch) in proposed,
    )


def _unnamed(patch: EditedPatch) -> EditedPatch:
    """Without its name, which the doctor's report and a person's taste change."""
    return patch.model_copy(update={"name": ""})
