"""`python -m bench.audits`: how well recordings tell a right extrinsic from a wrong one, by crispness and by audit.

    python -m bench.audits [--only crispness|verdicts] [SCENARIO ...]     writes bench/results/audits.md

Crispness: the truth, the truth turned by half a degree and the truth moved by 20 mm are each held while the motion is solved
for, and the room is laid together by the IMU with each; the axes are drawn. Verdicts: twenty recordings are calibrated; the
truth is to pass, and one axis three sigmas beyond the smallest error that the audit says would show is to fail.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from bench.store import RESULTS
from calib_core.audit.compare import SIGMAS
from calib_core.audit.crisp import Judged, audit_crispness, mounting_of
from calib_core.audit.limits import Limits
from calib_core.audit.pose import GivenExtrinsic
from calib_core.audit.run import report_of
from calib_core.calibrate import calibrate
from calib_core.full.known_extrinsic import held
from calib_core.maps.crispness import crispness_of
from calib_core.result import COVARIANCE_ORDER
from calib_core.settings import CalibrateSettings
from calib_core.simulate import SCENARIOS, Truth, generate
from calib_core.simulate.motions import PAPER_FAST
from calib_core.simulate.patterns import Spinning
from calib_core.simulate.sensors import VLP_16
from calib_core.types import FloatArray, Recording, Trajectory

TABLE = "audits.md"
PLACES = (
    "paper-normal", "paper-fast", "handheld", "walking-person", "outliers", "partial-views", "outdoor",
    "attic", "ouster", "livox",
)  # fmt: skip
DURATION_S = 12.0
OFF_DEG, OFF_M = 0.5, 0.020
SEEDS = range(1, 21)
#: As tight as a careful owner's, so that of some axes three sigmas are beyond them.
TIGHT = Limits(rotation_deg=0.02, translation_mm=1.0, time_offset_ms=0.05)
_SETTINGS = CalibrateSettings(crispness=False)


@dataclass(frozen=True, slots=True)
class Told:
    """What a room says of one wrong extrinsic.

    more_nat: its entropy over the truth's; None where no motion fits with it held.   sigmas: how far off the solve by itself
    says that it is, along the axis of the error.
    """

    slug: str
    axis: str
    more_nat: float | None
    sigmas: float

    @property
    def by_room(self) -> bool:
        """Whether the right one is preferred."""
        return self.more_nat is None or self.more_nat > 0.0

    @property
    def by_solve(self) -> bool:
        """Whether the solve, too, says that it is wrong."""
        return abs(self.sigmas) > SIGMAS


def off(truth: Truth, axis: int, by: float) -> FloatArray:
    """(4, 4): the truth with an error on one of six axes [rad or m]; composed with SciPy, not with our own exponential."""
    T = np.eye(4)
    turn = by * np.eye(3)[axis] if axis < 3 else np.zeros(3)
    T[:3, :3] = truth.R_imu_lidar @ Rotation.from_rotvec(turn).as_matrix()
    T[:3, 3] = truth.p_imu_lidar + (by * np.eye(3)[axis - 3] if axis >= 3 else np.zeros(3))
    return T


def told_by_room(slug: str, seed: int = 1) -> Iterator[Told]:
    """Of half a degree and of 20 mm, each about or along an axis that is drawn, either way."""
    recording, truth = generate(slug, seed=seed, duration_s=DURATION_S)
    found = calibrate(recording, _SETTINGS)
    right = _judged(recording, off(truth, 0, 0.0), truth.time_offset_ns)
    rng = np.random.default_rng([seed, PLACES.index(slug) if slug in PLACES else 99])
    for first, size in ((0, np.radians(OFF_DEG)), (3, OFF_M)):
        axis, by = first + int(rng.integers(3)), size * float(rng.choice([-1.0, 1.0]))
        T = off(truth, axis, by)
        wrong = _judged(recording, T, truth.time_offset_ns)
        more = None
        if right is not None and wrong is not None:
            rooms = audit_crispness(recording, wrong, right)
            assert rooms is not None, f"too little of {slug} was seen"
            more = rooms.given.mean_entropy_nat - rooms.found.mean_entropy_nat
        report = report_of(GivenExtrinsic(T, truth.time_offset_ns, "a matrix"), found, Limits())
        told = report.axes[axis] if report.axes else None
        sigmas = float("nan") if told is None or told.difference is None else told.difference / told.difference_std
        yield Told(slug, COVARIANCE_ORDER[axis], more, sigmas)


def _judged(recording: Recording, T: FloatArray, time_offset_ns: int) -> Judged | None:
    guess, priors = held(T, time_offset_ns)
    solved = calibrate(recording, _SETTINGS.model_copy(update={"priors": priors}), initial_guess=guess)
    if solved.trajectory is None:
        return None
    return Judged(mounting_of(T, time_offset_ns), solved.trajectory, np.array(solved.result.gyroscope_bias_rad_s))


def passes_and_fails(seed: int) -> tuple[str, bool, bool]:
    """The axis that is put off, whether the truth passes, and whether three sigmas beyond the smallest error fail.

    Six seconds of the paper's fastest motion in its room, a sparse lidar. The truth is judged by the limits as they are, the
    error by tight ones.
    """
    pattern = VLP_16.pattern
    assert isinstance(pattern, Spinning)
    sparse = replace(VLP_16, pattern=replace(pattern, column_period_ns=4 * pattern.column_period_ns))
    scenario = replace(SCENARIOS["paper-normal"], motion=PAPER_FAST, lidar=sparse, duration_s=6.0)
    recording, truth = generate(scenario, seed=seed)
    found = calibrate(recording, _SETTINGS)
    right = GivenExtrinsic(off(truth, 0, 0.0), truth.time_offset_ns, "a matrix")
    k, sign = seed % 7, (-1) ** seed
    axis = report_of(right, found, TIGHT).axes[k]
    by = sign * (axis.smallest_error + SIGMAS * axis.difference_std)
    T = off(truth, k, by / 1e3 if k >= 3 else float(np.radians(by))) if k < 6 else right.T_imu_lidar
    late_ns = round(by * 1e6) if k == 6 else 0
    report = report_of(GivenExtrinsic(T, truth.time_offset_ns + late_ns, "a matrix"), found, TIGHT)
    return (
        COVARIANCE_ORDER[k],
        report_of(right, found, Limits()).verdict == "passed",
        report.axes[k].verdict == "failed",
    )


def cost_of_a_minute() -> float:
    """Seconds of CPU that the crispness of a minute carried by hand takes, the exact motion given."""
    recording, truth = generate("handheld", seed=1, duration_s=60.0)
    times_s: FloatArray = np.arange(0.01, 59.9, 0.01, dtype=np.float64)
    R, p = truth.map_lidar(times_s)
    motion = Trajectory(truth.epoch_ns, times_s, R, p, np.ones(len(times_s), bool))
    started = time.process_time()
    crispness_of(recording.scans, motion)
    return time.process_time() - started


def rooms_table(told: Sequence[Told]) -> list[str]:
    """The page's first part."""
    by_slug = {each.slug: [one for one in told if one.slug == each.slug] for each in told}
    both = sum(all(one.by_room for one in some) for some in by_slug.values())
    agree = sum(one.by_room == one.by_solve for one in told)
    lines = [
        "## Crispness with extrinsics held fixed",
        "",
        (
            f"{DURATION_S:.0f} s of each. The truth makes a crisper room than either wrong one in {both} of {len(by_slug)}; the "
            f"solve by itself says the same of {agree} of {len(told)} wrong ones (beyond {SIGMAS:.0f} sigmas)."
        ),
        "",
        "| recording | off by | entropy over the truth's, nat | off by the solve, sigmas |",
        "| --- | --- | ---: | ---: |",
    ]
    for one in told:
        size = f"{OFF_DEG} deg" if one.axis[0] == "r" else f"{1e3 * OFF_M:.0f} mm"
        more = "no motion fits" if one.more_nat is None else f"{one.more_nat:+.4f}"
        lines.append(f"| {one.slug} | {size}, {one.axis} | {more} | {abs(one.sigmas):.0f} |")
    return [*lines, ""]


def verdicts_table(cases: Sequence[tuple[str, bool, bool]]) -> list[str]:
    """The page's second part."""
    right, wrong = sum(case[1] for case in cases), sum(case[2] for case in cases)
    return [
        "## Verdicts",
        "",
        (
            f"The truth passes in {right} of {len(cases)} recordings; an error {SIGMAS:.0f} sigmas beyond the smallest that "
            f"would have shown fails in {wrong} of {len(cases)} (axes in turn)."
        ),
        "",
    ]


def main() -> int:
    """Both parts, told as they come."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", nargs="*", default=PLACES)
    parser.add_argument("--only", choices=("crispness", "verdicts"))
    given = parser.parse_args()
    lines = ["# Audits", "", "Made by `python -m bench.audits`. Simulated recordings whose truth is known.", ""]
    if given.only != "verdicts":
        told: list[Told] = []
        for slug in given.scenarios:
            for one in told_by_room(slug):
                told.append(one)
                print(one, flush=True)
        lines += rooms_table(told)
        lines += [f"The crispness of a minute carried by hand takes {cost_of_a_minute():.1f} s of CPU.", ""]
    if given.only != "crispness":
        cases = []
        for seed in SEEDS:
            cases.append(passes_and_fails(seed))
            print(f"seed {seed}: {cases[-1]}", flush=True)
        lines += verdicts_table(cases)
    page = "\n".join(lines)
    print(page, flush=True)
    if given.only is None and tuple(given.scenarios) == PLACES:
        (Path(RESULTS) / TABLE).write_text(page, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
