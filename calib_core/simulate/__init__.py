"""Recordings with known truth: product code, and the oracle that everything else is held against.

`simulate` writes a bag and its truth; `generate` makes the same recording in memory. A `Scenario` joins a scene, a
motion, sensors and a mounting; `SCENARIOS` names the ready ones, and tests compose their own. Shares no interpolation,
integration or projection code with the estimator.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from calib_core.errors import SettingsError
from calib_core.events import OnEvent, ShouldCancel, ignore_event, never_cancel
from calib_core.simulate.faults import Fault, parse_faults
from calib_core.simulate.generate import generate, run
from calib_core.simulate.scenario import Scenario
from calib_core.simulate.scenarios import SCENARIOS
from calib_core.simulate.simulation import Simulation, prepare
from calib_core.simulate.truth import Truth, TruthFile
from calib_core.simulate.wishes import Mounting, Wishes

if TYPE_CHECKING:
    from calib_core.simulate.bags import Container

__all__ = [
    "SCENARIOS",
    "Fault",
    "Mounting",
    "Scenario",
    "Simulation",
    "Truth",
    "TruthFile",
    "generate",
    "parse_faults",
    "prepare",
    "simulate",
    "truth_path",
]


def truth_path(out: Path) -> Path:
    """Where the truth of the recording `out` lies."""
    return out.with_suffix(".truth.json")


def simulate(
    scenario: str | Scenario,
    out: Path,
    *,
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
    **wishes: Unpack[Wishes],
) -> Path:
    """Write a recording to `out` (.bag: ROS 1; .mcap; no suffix: a ROS 2 folder) and its truth beside it.

    wishes: see there.   Returns the truth's path. Raises SettingsError and Cancelled.
    """
    from calib_core.simulate import bags

    container = bags.container_of(out)
    simulation = prepare(scenario, **wishes)
    truth_file = truth_path(out)
    if out.exists() and not truth_file.exists():
        raise SettingsError(
            f"expected a new recording's name, found {out} which exists and was not made by a simulation; "
            "name another file or remove it",
            code="simulate.exists",
        )
    try:
        with bags.finished_file(out, container) as draft:
            _write(simulation, draft, container, on_event, should_cancel)
        truth_file.write_text(simulation.truth.to_file().to_json(), encoding="utf-8")
    except OSError as error:
        raise SettingsError(
            f"the recording cannot be written to {out}: {error.strerror}; choose another place", code="simulate.output"
        ) from error
    return truth_file


def _write(
    simulation: Simulation, draft: Path, container: Container, on_event: OnEvent, should_cancel: ShouldCancel
) -> None:
    from calib_core.simulate import bags

    lidar, imu = simulation.scenario.lidar, simulation.scenario.imu
    records = simulation.imu_records
    kind = "CustomMsg" if lidar.layout == "livox" else "PointCloud2"
    sink = bags.BagSink(draft, container, lidar_topic=lidar.topic, imu_topic=imu.topic, cloud_kind=kind)
    sent = 0
    try:
        for cloud in run(simulation, on_event=on_event, should_cancel=should_cancel):
            received_ns = simulation.received_ns(cloud)
            while sent < records.stamps_ns.shape[0] and records.received_ns[sent] <= received_ns:
                sink.add_imu(records, sent, imu.frame_id)
                sent += 1
            sink.add_cloud(cloud, received_ns, lidar.frame_id)
        for index in range(sent, records.stamps_ns.shape[0]):
            sink.add_imu(records, index, imu.frame_id)
    except BaseException:
        sink.abort()
        raise
    sink.close()
