"""Job functions for tests of the machinery: quick, and told by the recording's name how to behave.

- slow: works until it is asked to stop; stubborn: works and never looks; deaf: does not even hear SIGTERM
- lost: works until its process is killed, once; run again it succeeds. Its process's number is in its folder
- family: dies and leaves a child of its own behind that holds its pipes
- crash: its process dies; defect: raises what nobody expects; broken: refuses the input
- greedy: asks for 64 GB of memory; hungry: fills 3 GB, bit by bit, and tells of it; threads: starts one whose stack has 64 GB;
  filling: writes a file of 8 MB
- halfway: some of its report is there, the rest when it is told
- refused: ends without an answer; anything else succeeds, with the world of world.py

Planes are proposed for `room` only, and as long as there is a file `hold` beside its source they are not. What the world of a
test is made of is imported above: once, by the process that jobs are forked from.
"""

from __future__ import annotations

import json
import os
import signal
import threading
import time

from app.arrays.proposals import proposal_arrays, write_proposals
from app.arrays.recording import recording_arrays, write_recording
from app.arrays.trajectory import write_trajectory
from app.results.scans import measure_scans
from app.results.thickness import measure_thickness
from app.results.verdict import solve_outcome
from app.schemas.jobs import AuditOutcome, InspectOutcome, PlanesOutcome, SimulateOutcome
from app.work.functions import REPORTED, run_surface
from calib_core import api
from calib_core.audit.run import report_of
from calib_core.calibrate import Calibration
from calib_core.errors import Cancelled, UnreadableRecording
from calib_core.events import IterationEvent, LogEvent, StageEvent
from tests.app.support import world
from tests.app.support.report import report_json


def run(order, on_event, should_cancel):
    """One job."""
    on_event(LogEvent(level="info", code="fake.threads", text=os.environ.get("OPENBLAS_NUM_THREADS", "")))
    if order.kind == "simulate":
        order.source.parent.mkdir(parents=True, exist_ok=True)
        order.source.write_bytes(b"simulated")
        return SimulateOutcome(size_bytes=9)
    if order.kind == "inspect":
        if order.recording_name.startswith("broken"):
            raise UnreadableRecording("Expected a bag, found porridge in broken.bag; choose another file.")
        if order.recording_name.startswith("halfway"):
            stay_halfway(order, on_event, should_cancel)
        (order.folder / "report.json").write_text(report_json(order.recording_name))
        return InspectOutcome()
    if order.kind == "planes":
        if not order.recording_name.startswith("room"):
            return PlanesOutcome(patches=0, points=0, static=False)
        return propose(order)
    if order.kind == "audit":
        return audit(order)
    if order.kind == "surface":
        return run_surface(order, on_event, should_cancel)
    return solve(order, on_event, should_cancel)


def stay_halfway(order, on_event, should_cancel):
    """Some of a report, until it is asked to stop or finds a file in its folder."""
    report = json.loads(report_json(order.recording_name))
    (order.folder / "report.json").write_text(json.dumps(report | {"final": False}))
    on_event(LogEvent(level="info", code=REPORTED, text="Some of it can be looked at."))
    while not (order.folder / "go-on").exists():
        time.sleep(0.02)
        if should_cancel():
            raise Cancelled("Stopped as asked.")


def propose(order):
    """The planes of world.py, once nothing holds them back."""
    while (order.source.parent / "hold").exists():
        time.sleep(0.02)
    write_recording(recording_arrays(order.cache), world.make_recording())
    write_proposals(proposal_arrays(order.cache), world.make_proposals())
    return PlanesOutcome(patches=6, points=6200, static=True)


def audit(order):
    """The library's part is tested with it; here it is answered by hand, from the order's own words."""
    given = api.parse_extrinsic(order.request.audit.extrinsic, frames=("imu", "lidar"))
    report = report_of(given, Calibration(world.make_result(), None), order.request.audit.limits)
    (order.folder / "audit.json").write_text(report.to_json())
    return AuditOutcome(verdict=report.verdict, text=report.text)


def solve(order, on_event, should_cancel):
    """A solve that behaves as the recording's name says."""
    name = order.recording_name
    if name.startswith("crash"):
        os._exit(7)
    if name.startswith("deaf"):
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    if name.startswith("family"):
        child = os.fork()
        if child == 0:
            time.sleep(600)
        on_event(LogEvent(level="info", code="fake.child", text=str(child)))
        time.sleep(0.1)
        os._exit(7)
    take_too_much(name, order.folder, on_event)
    if name.startswith("defect"):
        raise ZeroDivisionError("secret internals")
    for step in range(5):
        on_event(iteration(step))
    if name.startswith("lost") and not (order.folder / "process").exists():
        (order.folder / "process").write_text(str(os.getpid()))
        time.sleep(600)
    while name.startswith(("slow", "stubborn", "deaf")):
        on_event(StageEvent(stage="solve", fraction=0.5, text="thinking"))
        time.sleep(0.02)
        if name.startswith("slow") and should_cancel():
            raise Cancelled("Stopped as asked.")
    return answer(order, name)


def answer(order, name):
    """What a solve of the world of world.py leaves behind."""
    result = world.make_result("refused" if name.startswith("refused") else "calibrated", name)
    asked = {plane.name: plane.outline_m for plane in order.request.planes or ()}
    for plane in result.quality.planes:
        corners = asked.get(plane.name)
        plane.outline_m = None if corners is None else [list(corner) for corner in corners]
    trajectory = world.make_trajectory()
    if result.T_imu_lidar is not None:
        write_trajectory(order.folder / "trajectory.npz", trajectory)
        walls = measure_thickness(world.make_recording(), trajectory, world.plane_quality())
        (order.folder / "thickness.json").write_text(walls.model_dump_json())
        scans = measure_scans(world.make_recording(), trajectory, world.plane_quality())
        (order.folder / "scans.json").write_text(scans.model_dump_json())
    (order.folder / "result.json").write_text(result.to_json())
    return solve_outcome(result)


def take_too_much(name, folder, on_event):
    """Memory or disk, as the recording's name says."""
    if name.startswith("greedy"):
        bytearray(64 * 2**30)
    kept = []
    while name.startswith("hungry") and len(kept) < 300:
        kept.append(b"x" * 10**7)
        on_event(iteration(len(kept)))
        time.sleep(0.01)
    if name.startswith("threads"):
        threading.stack_size(64 * 2**30)
        threading.Thread(target=time.sleep, args=(0,)).start()
    if name.startswith("filling"):
        (folder / "big").write_bytes(bytes(8 * 2**20))


def iteration(step):
    """A step of a solve."""
    return IterationEvent(
        iteration=step,
        round=0,
        cost=100.0 / (step + 1),
        matrix=world.transform_matrix().tolist(),
        translation_m=world.P_IMU_LIDAR.tolist(),
        euler_xyz_deg=[10.0, -20.0, 30.0],
        time_offset_s=0.0,
        rotation_std_deg=[0.1] * 3,
        translation_std_m=[0.01] * 3,
        time_offset_std_s=0.001,
        planes=[],
    )
