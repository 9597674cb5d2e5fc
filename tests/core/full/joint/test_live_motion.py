"""What the steps of a solve tell of the motion is the motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.calibrate import calibrate
from calib_core.events import IterationEvent, ignore_event
from calib_core.factors.lidar_plane import Gate
from calib_core.full.joint import round as round_
from calib_core.full.joint.settings import WATCHING
from calib_core.full.joint.state import CALIBRATION, ROTATION, TIME_OFFSET
from calib_core.geometry import log
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.solver.information import covariance
from calib_core.types import Recording
from tests.core.full.joint.conftest import Half


def test_the_last_step_puts_its_sweeps_where_they_were(noisy: tuple[Recording, Truth]) -> None:
    """Within each sweep the lidar turned and moved as in truth, and its planes are the room's, by name.

    Fails with the time offset left out (the motion of 17 ms later), or with the IMU's poses told for the lidar's; with gravity
    told in the world's axes, or as what the accelerometer feels.
    """
    recording, truth = noisy
    steps: list[IterationEvent] = []
    calibrate(
        recording,
        CalibrateSettings(crispness=False),
        on_event=lambda e: steps.append(e) if isinstance(e, IterationEvent) else None,
    )
    last = steps[-1]
    assert WATCHING.sweeps - 2 <= len(last.sweeps) <= WATCHING.sweeps
    known = {scan.stamp_ns: scan for scan in recording.scans}
    for sweep in last.sweeps:
        end_s = float(known[sweep.stamp_ns].points["offset_ns"].max()) * 1e-9
        np.testing.assert_allclose(sweep.offset_s, np.linspace(0.0, end_s, WATCHING.instants), atol=1e-6)
        R = Rotation.from_quat(sweep.quaternion_xyzw).as_matrix()
        p = np.array(sweep.position_m)
        t_s = (sweep.stamp_ns - truth.epoch_ns) * 1e-9 + np.array(sweep.offset_s)
        R_true, p_true = truth.map_lidar(t_s)
        turned, turned_true = R[0].T @ R[-1], R_true[0].T @ R_true[-1]
        moved, moved_true = R[0].T @ (p[-1] - p[0]), R_true[0].T @ (p_true[-1] - p_true[0])
        assert np.degrees(np.linalg.norm(log(turned_true.T @ turned))) < 0.1
        assert np.linalg.norm(moved - moved_true) < 0.003
    down = truth.lidar(np.array([(truth.map_time_ns - truth.epoch_ns) * 1e-9])).R_world[0].T @ truth.gravity_world_m_s2
    np.testing.assert_allclose(last.gravity_m_s2, down, atol=0.05)
    assert len({plane.name for plane in last.planes}) == len(last.planes)
    np.testing.assert_allclose([np.linalg.norm(plane.normal) for plane in last.planes], 1.0, atol=1e-6)


def test_a_step_that_nobody_hears_of_is_not_told(half: Half, monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: what makes the event, barred; it is asked for as soon as anybody listens. Mutation: tell it all the same."""
    asked: list[int] = []
    monkeypatch.setattr(round_, "iteration_event", lambda *_: asked.append(1))
    state = round_.associate(half.data, half.state, Gate(extra_m=0.02), stride=7)
    for listener, times in ((ignore_event, 0), (lambda _: None, 1)):
        data = replace(half.data, run=replace(half.data.run, on_event=listener))
        round_.descend(data, state, iterations=1, tolerance=0.0)
        assert len(asked) == times


def test_what_a_round_holds_has_no_standard_deviation(half: Half) -> None:
    """Mutations: the round-off of what holds it told as the best of all answers; all seven unknown where one is held; degrees
    taken for radians.
    """
    state = round_.associate(half.data, half.state, Gate(extra_m=0.02), stride=7)

    def told(also_frozen: tuple[int, ...]) -> IterationEvent:
        steps: list[IterationEvent] = []
        run = replace(half.data.run, on_event=lambda e: steps.append(e) if isinstance(e, IterationEvent) else None)
        after, _ = round_.descend(
            replace(half.data, run=run), state, iterations=1, tolerance=0.0, also_frozen=also_frozen
        )
        assert after.minimum is not None
        assert after.minimum.solution is not None
        std = np.sqrt(np.diag(covariance(after.minimum.solution.information).matrix))
        for told_deg, end in zip(steps[0].rotation_std_deg, np.degrees(std[ROTATION]), strict=True):
            # The end of the descent is another linearisation than its first step, but not by as much as a radian is to a degree.
            assert told_deg is None or 0.1 * end < told_deg < 10.0 * end
        return IterationEvent.model_validate_json(steps[0].model_dump_json())

    free, part, none = told(()), told((4, TIME_OFFSET)), told(tuple(range(CALIBRATION)))
    assert None not in [*free.rotation_std_deg, *free.translation_std_m, free.time_offset_std_s]
    assert [std is None for std in part.translation_std_m] == [False, True, False]
    assert (None in part.rotation_std_deg, part.time_offset_std_s) == (False, None)
    for one, other in zip(free.rotation_std_deg, part.rotation_std_deg, strict=True):
        assert one is not None
        assert other is not None
        assert 0.05 * one < other < 1.001 * one  # what is held tells the others something
    assert [*none.rotation_std_deg, *none.translation_std_m, none.time_offset_std_s] == [None] * CALIBRATION
