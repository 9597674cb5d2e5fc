"""One run of one of the paper's experiments (section IV-A): simulate, solve, compare with the truth."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal, cast

import numpy as np
from scipy.spatial.transform import Rotation

from calib_core.errors import Refused
from calib_core.paper import ImuStates, PaperOptions, solve_tracked, track_planes
from calib_core.paper.records import FrontEnd
from calib_core.settings import CalibrateSettings, Gravity
from calib_core.simulate import SCENARIOS, Scenario, Truth, generate
from calib_core.simulate.motion import Sway
from calib_core.types import FloatArray, Recording

Method = Literal["paper", "full"]
Poses = Literal["estimated", "exact", "perturbed", "perturbed but the first attitude"]
Sweep = Literal["upsampled", "held", "none"]

#: IV-A.3: half-widths of the uniform errors of the IMU states.
POSITION_ERROR_M, VELOCITY_ERROR_M_S, ORIENTATION_ERROR_RAD = 0.01, 0.01, np.radians(1.15)

PUBLISHED = PaperOptions()
#: IV-B: points on each plane of each scan.
REAL_POINTS = 150

#: The faces of the corner that the field of view sees in the paper's scenarios.
CORNER = frozenset({"floor", "wall west", "wall south"})


@dataclass(frozen=True, slots=True)
class Experiment:
    """One row of a table. range_std_m, imu_noise: what the simulated sensors add; else as the scenario has it.

    exact_map: the planes are the room's own, not detected in the first scan.   eq_3, upsampling_hz: PaperOptions.
    by_map: points' planes by the map's (front_end.Selection).   stand_off_m: from the corner; None as the scenario has it.
    points: on each plane of each scan; None for the published 100.
    table: the figure or table of the paper it belongs to.   paper_says: the paper's e_p [m] and e_R [deg], if printed.
    """

    table: str
    variant: str
    scenario: str
    range_std_m: float = 0.02
    imu_noise: bool = True
    poses: Poses = "estimated"
    motion_in_sweep: Sweep = "upsampled"
    exact_map: bool = False
    eq_3: Literal["midpoint", "printed"] = "midpoint"
    upsampling_hz: float = PUBLISHED.upsampling_hz
    by_map: bool = False
    stand_off_m: float | None = None
    points: int | None = None
    paper_says: tuple[float, float] | None = None
    methods: tuple[Method, ...] = ("paper",)

    @property
    def recording_key(self) -> tuple[str, float, bool, float]:
        """Rows with the same key are solved from the same recordings."""
        return self.scenario, self.range_std_m, self.imu_noise, self.stand_off_m or 0.0

    @property
    def is_exact(self) -> bool:
        """Whether nothing is left to chance in the recording: every seed's is the same."""
        return self.range_std_m == 0.0 and not self.imu_noise

    @property
    def key(self) -> str:
        """What is simulated and how it is solved: rows of several tables may share their runs."""
        noise = f"range {1e3 * self.range_std_m:g} mm, IMU {'noisy' if self.imu_noise else 'exact'}"
        more = [", map exact"] if self.exact_map else []
        more += [", eq. 3 as printed"] if self.eq_3 == "printed" else []
        more += [f", {self.upsampling_hz:g} Hz"] if self.upsampling_hz != PUBLISHED.upsampling_hz else []
        more += [", labels by the map"] if self.by_map else []
        more += [f", at {self.stand_off_m:g} m"] if self.stand_off_m else []
        more += [f", {self.points} pt/pl/sc"] if self.points else []
        return f"{self.scenario}, {noise}, poses {self.poses}, sweep {self.motion_in_sweep}{''.join(more)}"


@dataclass(frozen=True, slots=True)
class Outcome:
    """Errors of one run. e_R_deg, e_p_m: norms of eq. (15).   e_dt_ms: of the time offset."""

    experiment: str
    method: Method
    seed: int
    e_R_deg: float
    e_p_m: float
    e_dt_ms: float
    scans_used: int
    seconds: float


def run(experiment: Experiment, method: Method, seed: int) -> Outcome:
    """One Monte-Carlo run."""
    recording, truth = _simulated(_scenario(experiment), seed)
    started = time.perf_counter()
    if method == "paper":
        R, p, offset_ns, used = _by_paper(recording, truth, experiment, seed)
    else:
        R, p, offset_ns, used = _by_full(recording, CalibrateSettings())
    return Outcome(
        experiment.key,
        method,
        seed,
        float(np.degrees(np.linalg.norm(Rotation.from_matrix(R @ truth.R_imu_lidar.T).as_rotvec()))),
        float(np.linalg.norm(p - truth.p_imu_lidar)),
        (offset_ns - truth.time_offset_ns) * 1e-6,
        used,
        time.perf_counter() - started,
    )


def _scenario(experiment: Experiment) -> Scenario:
    scenario = SCENARIOS[experiment.scenario]
    lidar, imu = replace(scenario.lidar, range_std_m=experiment.range_std_m), scenario.imu
    if not experiment.imu_noise:
        imu = replace(imu, gyroscope_noise_density_rad_s_sqrt_hz=0.0, accelerometer_noise_density_m_s2_sqrt_hz=0.0)
        imu = replace(imu, gyroscope_random_walk=0.0, accelerometer_random_walk=0.0)
    scenario = replace(scenario, lidar=lidar, imu=imu)
    if experiment.stand_off_m is None:
        return scenario
    # Away from the corner, which is the room's origin, along the line on which the scenario stands: the same view of it.
    motion = cast(Sway, scenario.motion)
    away = experiment.stand_off_m / np.linalg.norm(motion.base.position_m)
    x, y, z = (float(away * value) for value in motion.base.position_m)
    return replace(scenario, motion=replace(motion, base=replace(motion.base, position_m=(x, y, z))))


@lru_cache(maxsize=2)
def _simulated(scenario: Scenario, seed: int) -> tuple[Recording, Truth]:
    return generate(scenario, seed=seed)


@lru_cache(maxsize=2)
def _tracked(scenario: Scenario, seed: int, exact_map: bool, by_map: bool, points: int | None) -> FrontEnd:
    """Rows that differ only in how they are solved share the recording and its tracked planes."""
    recording, truth = _simulated(scenario, seed)
    corner = [plane for plane in truth.planes if plane.name in CORNER]
    return track_planes(recording, _settings(truth, seed, points), planes=corner if exact_map else None, by_map=by_map)


def _settings(truth: Truth, seed: int, points: int | None) -> CalibrateSettings:
    """The published settings, gravity known."""
    gravity = Gravity(magnitude_m_s2=truth.gravity_m_s2)
    settings = CalibrateSettings(method="paper", gravity=gravity, random_seed=seed)
    return settings if points is None else settings.model_copy(update={"points_per_plane_per_scan": points})


def _by_paper(
    recording: Recording, truth: Truth, experiment: Experiment, seed: int
) -> tuple[FloatArray, FloatArray, int, int]:
    states = None if experiment.poses == "estimated" else _known_states(recording, truth, experiment.poses, seed)
    options = PaperOptions(
        fixed_states=states,
        motion_in_sweep=experiment.motion_in_sweep,
        eq_3=experiment.eq_3,
        upsampling_hz=experiment.upsampling_hz,
    )
    front = _tracked(_scenario(experiment), seed, experiment.exact_map, experiment.by_map, experiment.points)
    try:
        solved = solve_tracked(recording, _settings(truth, seed, experiment.points), front, options=options)
    except Refused:
        return np.full((3, 3), np.nan), np.full(3, np.nan), 0, len(front.scans)
    return solved.R_imu_lidar, solved.p_imu_lidar, solved.time_offset_ns, solved.scans_used


def _by_full(recording: Recording, settings: CalibrateSettings) -> tuple[FloatArray, FloatArray, int, int]:
    from calib_core import api

    result = api.calibrate(recording, settings).result
    if result.T_imu_lidar is None or result.time_offset_ns is None:
        return np.full((3, 3), np.nan), np.full(3, np.nan), 0, 0
    T = np.array(result.T_imu_lidar.matrix)
    return T[:3, :3], T[:3, 3], result.time_offset_ns, result.quality.scans_used


def _known_states(recording: Recording, truth: Truth, poses: Poses, seed: int) -> ImuStates:
    """The IMU's true states at the scans' first points, world origin at the first; perturbed if wished (IV-A.3)."""
    stamps_ns = np.array([scan.stamp_ns for scan in recording.scans], dtype=np.int64)
    exact = truth.imu(truth.seconds(stamps_ns))
    R, p, v = exact.R_world, exact.p_m - exact.p_m[0], exact.v_m_s
    if poses == "exact":
        return ImuStates(R, p, v)
    rng = np.random.default_rng([seed, 715])
    turns, moves, pushes = rng.uniform(-1.0, 1.0, size=(3, R.shape[0], 3))
    # The first position is the world's origin by definition (the paper's p_W^0 is no unknown).
    moves[0] = 0.0
    if poses == "perturbed but the first attitude":
        turns[0] = 0.0
    turned = R @ Rotation.from_rotvec(ORIENTATION_ERROR_RAD * turns).as_matrix()
    return ImuStates(turned, p + POSITION_ERROR_M * moves, v + VELOCITY_ERROR_M_S * pushes)


def experiments() -> Iterator[Experiment]:
    """All of section IV-A, table by table."""
    both: tuple[Method, ...] = ("paper", "full")
    for lidar_on, imu_on in ((False, False), (False, True), (True, False), (True, True)):
        words = f"lidar {'noisy' if lidar_on else 'exact'}, IMU {'noisy' if imu_on else 'exact'}"
        yield Experiment("figure 6", words, "paper-normal", 0.02 if lidar_on else 0.0, imu_on, methods=both)
    for std in (0.0, 0.005, 0.01, 0.02, 0.04):
        yield Experiment("figure 7", f"range std {1e3 * std:.0f} mm", "paper-normal", std, methods=both)
    yield Experiment("figure 7", "range std 20 mm, labels by the map", "paper-normal", 0.02, by_map=True)
    yield Experiment("figure 7", "range std 40 mm, labels by the map", "paper-normal", 0.04, by_map=True)
    exact, perturbed = (0.0057, 0.02), (0.34, 0.96)
    yield Experiment("IV-A.3", "exact poses", "paper-normal", poses="exact", paper_says=exact)
    yield Experiment("IV-A.3", "exact poses, exact map", "paper-normal", poses="exact", exact_map=True)
    words = "exact poses, exact map, 3.6 m from the corner (else 1.9 m)"
    yield Experiment("IV-A.3", words, "paper-normal", poses="exact", exact_map=True, stand_off_m=3.6)
    yield Experiment("IV-A.3", "perturbed poses", "paper-normal", poses="perturbed", paper_says=perturbed)
    first: Poses = "perturbed but the first attitude"
    yield Experiment("IV-A.3", "perturbed poses but for the first attitude", "paper-normal", poses=first)
    yield Experiment("IV-A.3", "poses estimated", "paper-normal", methods=both)
    yield Experiment("IV-A.3", "poses estimated, exact map", "paper-normal", exact_map=True)
    said: dict[tuple[str, str], tuple[float, float]] = {
        ("paper-normal", "upsampled"): (5.7e-4, 0.016),
        ("paper-fast", "upsampled"): (9.5e-4, 0.013),
        ("paper-normal", "none"): (1.0e-2, 0.23),
        ("paper-fast", "none"): (7.97e-2, 0.34),
    }
    sweeps: tuple[tuple[Sweep, str], ...] = (
        ("upsampled", "(i) upsampled preintegration"),
        ("held", "(ii) raw readings, each held"),
        ("none", "(ii) no motion within a sweep"),
    )
    for scenario, pace in (("paper-normal", "normal"), ("paper-fast", "fast")):
        for sweep, words in sweeps:
            yield Experiment(
                "table I",
                f"{pace} motion, {words}",
                scenario,
                0.0,
                imu_noise=False,
                poses="exact",
                motion_in_sweep=sweep,
                paper_says=said.get((scenario, sweep)),
            )
        for hz in (1000.0, 500.0):
            yield Experiment(
                "table I",
                f"{pace} motion, (i) with eq. 3 as printed, steps at {hz:g} Hz",
                scenario,
                0.0,
                imu_noise=False,
                poses="exact",
                eq_3="printed",
                upsampling_hz=hz,
                paper_says=said[scenario, "upsampled"],
            )
        yield Experiment("table I", f"{pace} motion, poses estimated too", scenario, 0.0, imu_noise=False, methods=both)
    words = f"hand-held, simulated, {REAL_POINTS} pt/pl/sc"
    yield Experiment("IV-B", words, "handheld", points=REAL_POINTS, methods=both)
