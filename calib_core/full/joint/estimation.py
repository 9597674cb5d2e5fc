"""What the joint estimation knows at one moment, as a value: every step takes one and gives the next."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calib_core.factors.lidar_plane import LidarNoise
from calib_core.factors.support import PlaneExtents
from calib_core.full.joint.moments import Micro
from calib_core.full.joint.motion import Motion
from calib_core.full.joint.policies import Limits
from calib_core.full.joint.priors import Priors
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.settings import CHAIN
from calib_core.full.joint.state import CALIBRATION, BiasNodes, Estimate
from calib_core.full.joint.view import View
from calib_core.full.planes.plane_tests import Fault
from calib_core.full.prepare.nuisance import LATE, Nuisance
from calib_core.full.run import Run
from calib_core.imu.preintegration import UpsampledImu, asked_later
from calib_core.solver.levenberg import Minimum, SharedEquations
from calib_core.types import FloatArray, Plane


@dataclass(frozen=True, slots=True)
class MapPlane:
    """A plane of the map, but for where it is, which is estimated.

    outline_m: (K, 3) as given, in the map frame: not in that of the solve, which drifts from it; None where there is none.
    fault: what was wrong with it while gates were wide, "" where nothing was.   chosen: a person wants it, doubtful or not.
    late: it came into view on the way, and nobody was shown it.   strayed: it did not stand still in a motion that all structure
    has told, of which it may be one of several that were blamed.   found_m: how far from the lidar it was found, where it was
    before the solve; what turns out to be no plane may have come to lie anywhere by then.
    """

    name: str
    outline_m: FloatArray | None = None
    fault: Fault = ""
    chosen: bool = False
    late: bool = False
    strayed: bool = False
    found_m: float | None = None


@dataclass
class LastView:
    """A cache of one view: the scans laid out under the estimate that was asked for last. It changes no number, only the time."""

    view: View | None = None

    def of(self, run: Run, motion: Motion, estimate: Estimate) -> View:
        """The scans under an estimate, laid out once however often they are asked for."""
        if self.view is None or self.view.estimate is not estimate:
            before, self.view = self.view, view_of(run, motion, estimate)
            if before is not None:
                self.view = replace(self.view, few=before.few, shelf=before.shelf)
        return self.view

    def let_go(self) -> None:
        """Free what belongs to an estimate that is about to move: of a long recording a fifth of all memory."""
        if self.view is not None:
            self.view.thinned.clear()
            self.view.poses.clear()

    def forget(self) -> None:
        """Free all, the points of thinned scans as well: from where every point is used, nobody asks for those."""
        self.view = None


@dataclass
class LastReadings:
    """A cache of the readings, the accelerometer's taken at one delay after the gyroscope's: for steps that ask for nearly it."""

    readings: UpsampledImu | None = None

    def at(self, run: Run, readings: UpsampledImu, delay_s: float) -> UpsampledImu:
        """The readings at a delay of the accelerometer. readings: those without."""
        last = readings if self.readings is None else self.readings
        if abs(delay_s - last.accel_delay_s) > CHAIN.delay_moved_s:
            last = asked_later(readings, run.clocks.imu_s, run.recording.imu.accel_m_s2, run.hyper, delay_s)
            self.readings = last
        return last


@dataclass
class LastLinked:
    """A cache of the readings and the links about one estimate, for steps that ask for both before it moves: when tones are
    listened for, planes judged, points given anew. It changes no number, only the time.

    of: the estimate and what else they were made of.   readings, problem: None where nobody has asked.
    """

    of: tuple[object, ...] = ()
    readings: UpsampledImu | None = None
    problem: JointProblem | None = None

    def about(self, *of: object) -> LastLinked:
        """Itself, of these objects: emptied where they are others."""
        if len(of) != len(self.of) or any(one is not other for one, other in zip(of, self.of, strict=True)):
            self.of, self.readings, self.problem = of, None, None
        return self


#: The step before which it does not matter which planes count (solve.py).
COUNTING = "planes"


def ignore_state(_name: str, _state: Estimation) -> None:
    """For runs whose states nobody writes down."""


@dataclass(frozen=True)
class JointData:
    """What stays the same while the joint problem is solved.

    readings, nodes: over every knot that may come to be estimated.   gauge: index of the knot whose pose holds the map frame.
    reference: position of the scan in whose frame the map is.   start: the estimate by the start values.   limits: how far from
    it an answer may lie.   most_rounds: in all.   sensors: which parameters of the sensors are to be unknowns.
    dropped: planes that a person does not want, in the map frame: they must not come into view again.
    turned: whether the gyroscope has felt any turning.   only_axis_imu: (3,) about which alone it has turned, as far as the start
    could tell; None about more than one.
    laid_out, asked, linked: what the last step has computed, kept for the next one; they change no number.
    on_state: called with the name of each step and the state before it (`replay.py` writes them down).
    """

    run: Run
    readings: UpsampledImu
    nodes: BiasNodes
    gauge: int
    reference: int
    start: Estimate
    limits: Limits
    most_rounds: int
    sensors: Nuisance = Nuisance()  # noqa: RUF009  frozen
    dropped: Sequence[Plane] = ()
    turned: bool = True
    only_axis_imu: FloatArray | None = None
    laid_out: LastView = field(default_factory=LastView)
    asked: LastReadings = field(default_factory=LastReadings)
    linked: LastLinked = field(default_factory=LastLinked)
    on_state: Callable[[str, Estimation], None] = ignore_state

    @property
    def knots(self) -> int:
        """How many knots may come to be estimated."""
        return len(self.readings.knots_s)

    def portion(self, low: float, high: float) -> JointData:
        """The same, whose progress from 0 to 1 is this portion of what it was."""
        return replace(self, run=self.run.within(low, high))


@dataclass(frozen=True, slots=True)
class Estimation:
    """What is known at one moment.

    estimate: its knots are the first `knots` of the data's.   planes: in the order of its normals.   positions: scans in
    play, ascending.   support: the cells that each plane is known to fill.   observations: points given to planes, None where
    they have to be given anew.   minimum: where the last round ended.   rounds, iterations: how many there were.   untuned: what
    pulls at the readings has shown to be no tone (tones.py), and none is looked for any more.   shape_shift: (7,) by how much the
    calibration went with the shapes of planes, where these could not be estimated along (bent_surfaces.py): turns about the
    lidar's axes [rad], metres, seconds.   unseen: as the bins of the last round had it (state.py).
    """

    estimate: Estimate
    priors: Priors
    planes: tuple[MapPlane, ...]
    positions: tuple[int, ...]
    lidar_noise: LidarNoise
    support: PlaneExtents | None = None
    observations: Micro | None = None
    minimum: Minimum[Estimate] | None = None
    rounds: int = 0
    iterations: int = 0
    untuned: bool = False
    shape_shift: FloatArray = field(default_factory=lambda: np.zeros(CALIBRATION))
    unseen: tuple[int, ...] = ()

    @property
    def knots(self) -> int:
        """How many of the data's knots are estimated so far."""
        return len(self.estimate.states.p)

    @property
    def nuisance(self) -> Nuisance:
        """The sensors' own parameters in play, none before they are admitted."""
        return self.estimate.sensors.blocks

    @property
    def information(self) -> FloatArray | None:
        """Of the shared unknowns (S, S), where the last round ended; None where there was none."""
        solution = self.minimum.solution if self.minimum is not None else None
        return None if solution is None else solution.information

    def without_points(self) -> Estimation:
        """The same without the points given to planes, most of its memory: for who keeps a state while another is made."""
        return replace(self, observations=None)

    def with_nuisance(self, blocks: Nuisance) -> Estimation:
        """The state with these parameters of the sensors as unknowns; without points and minimum, which were of those before."""
        estimate = replace(self.estimate, sensors=self.estimate.sensors.onto(blocks))
        return replace(self, estimate=estimate, observations=None, minimum=None)

    def with_priors_of(self, sensors: Nuisance) -> Estimation:
        """The state with these blocks of sensor parameters and their priors; values that are known by now stay."""
        before = self.nuisance
        for late in LATE:  # in no list of what is unknown from the start
            if late in before.places:
                sensors = sensors.with_late(late, float(before.values(before.prior_std, late)[0]))
        return self.with_nuisance(before.with_sensors(sensors))


@dataclass(frozen=True)
class Solved:
    """The end of the joint estimation. map_time_s: of the first used scan, lidar clock.   data, state: to go on from there.

    shared: the equations of its last steps.
    """

    problem: JointProblem
    estimate: Estimate
    minimum: Minimum[Estimate]
    observations: Micro
    lidar_noise: LidarNoise
    map_time_s: float
    planes: tuple[MapPlane, ...]
    rounds: int
    iterations: int
    data: JointData
    state: Estimation
    shared: SharedEquations

    @property
    def nuisance(self) -> Nuisance:
        """The sensors' own parameters in play."""
        return self.estimate.sensors.blocks

    @property
    def map_pose(self) -> tuple[FloatArray, FloatArray]:
        """The lidar's pose at the first used scan's time, in the frame of the solve: R (3, 3), p (3,). It defines the map."""
        return lidar_pose(self.problem.motion(self.estimate), self.estimate, self.map_time_s)


def lidar_pose(motion: Motion, estimate: Estimate, lidar_s: float) -> tuple[FloatArray, FloatArray]:
    """The lidar at an instant of its own clock: R (3, 3), p (3,)."""
    e = estimate
    pose = motion.lidar_at(np.array([lidar_s - e.time_offset_s]), e.R_imu_lidar, e.p_imu_lidar)
    return pose.R[0], pose.p[0]


def view_of(run: Run, motion: Motion, estimate: Estimate) -> View:
    """The scans under a motion and an estimate."""
    clocks = run.clocks.at_rate(estimate.sensors.clock_rate_ppm())
    return View(run.recording.scans, clocks, motion, estimate, run.settings, run.threads)
