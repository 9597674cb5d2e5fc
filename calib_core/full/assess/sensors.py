"""What was found of the sensors themselves: values with their sigmas, and what it costs not to know them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.full.assess.considered import Considered, parameter_std
from calib_core.full.assess.gyroscope import gyroscope_covariance
from calib_core.full.assess.observability import assess
from calib_core.full.assess.sensor_sentences import sentences
from calib_core.full.assess.settings import WORDING
from calib_core.full.assess.unestimated_shifts import shift_of
from calib_core.full.joint.estimation import Solved
from calib_core.full.joint.state import ROTATION, TIME_OFFSET, TRANSLATION
from calib_core.full.prepare.nuisance import SIZE_EFFECT, priors_of, sensor_block
from calib_core.full.run import Run
from calib_core.intrinsics import UNITS, UNKNOWN_IMU, UNKNOWN_LIDAR
from calib_core.result import Intrinsic
from calib_core.types import FloatArray

_GROUPS = ("rotation", "translation", "the time offset")
_FRAME = "the accelerometer's x axis and xy plane; the gyroscope is turned into it"


@dataclass(frozen=True)
class SensorFindings:
    """parameters: every one of them.   sentences: for people, code and text."""

    parameters: tuple[Intrinsic, ...]
    sentences: tuple[tuple[str, str], ...]

    @property
    def imu_frame(self) -> str:
        """Which sensor's axes define the IMU's frame."""
        return _FRAME if self.parameters else ""

    def find(self, block: str) -> Intrinsic | None:
        """The only parameter of a block; None where it is not in play."""
        return next((each for each in self.parameters if each.block == block), None)


def sensor_findings(
    solved: Solved, considered: Considered | None, unexplained: FloatArray, *, torn: bool
) -> SensorFindings:
    """Of a solved recording. considered: where the parameters were held.

    unexplained: (N,) what their variances lack where parts of the recording disagree. What is no plane bends the sensors, too:
    with a bent wall that somebody kept, an ideal lidar's beams read long by 13 of their own sigmas.
    torn: stretches of time contradict each other. What is found has sigmas that nobody may rely on, and is claimed of no sensor.
    """
    sensors = solved.nuisance.sensors
    if not sensors.blocks:
        return SensorFindings((), ())
    values, state, doubtful = solved.estimate.sensors.onto(sensors).values, "estimated", False
    if considered is not None:
        values, std, state = considered.value, considered.std, "considered"
    else:
        assert solved.minimum.solution is not None
        start = solved.problem.layout(solved.estimate).nuisance().start
        own = slice(start, start + sensors.size)
        by_noise = parameter_std(solved.minimum.solution, own)
        std = np.hypot(by_noise, np.sqrt(unexplained))
        wider = std > WORDING.counted * by_noise
        clock = solved.problem.sensors.clock_place
        if clock >= 0:
            wider[clock] = False  # its stamps jitter, which is no disagreement
        doubtful = bool(wider.any())
    parameters = []
    for each in sensors.blocks:
        place = sensors.places[each.block]
        shifts = [None] * len(each.names) if considered is None else [shift_of(s) for s in considered.shift.T[place]]
        for name, value, own_std, prior, shift in zip(
            each.names, values[place], std[place], each.prior_std, shifts, strict=True
        ):
            parameters.append(
                Intrinsic.model_validate(
                    {
                        "block": each.block,
                        "name": name,
                        "unit": UNITS[sensor_block(each)],
                        "value": float(value),
                        "std": float(own_std),
                        "prior_std": float(prior),
                        "state": state,
                        "significant": bool(abs(value) > WORDING.off_sigmas * own_std) and not torn,
                        "shift": shift,
                    }
                )
            )
    told = sentences(parameters, corrected=considered is None)
    if doubtful:
        told = [(code, f"{text}; this may be wrong, because parts of the recording disagree") for code, text in told]
    return SensorFindings(tuple(parameters), tuple(told))


def cost_of_sensors(solved: Solved) -> FloatArray:
    """By how many times standard deviations are wider than with sensors known exactly: rotation, translation, time offset (3,).

    The same information with the sensors' columns taken out. Ones where they have none. Accelerometers that are apart are so
    whatever is known of sensors of their kind.
    """
    assert solved.minimum.solution is not None
    information, priors = solved.minimum.solution.information, solved.problem.priors
    start = solved.problem.layout(solved.estimate).nuisance().start
    sensors = np.arange(solved.nuisance.sensors.size)
    if (apart := solved.nuisance.places.get(SIZE_EFFECT)) is not None:
        sensors = np.setdiff1d(sensors, sensors[apart])
    others = np.setdiff1d(np.arange(len(information)), start + sensors)
    exact = np.diag(assess(information[np.ix_(others, others)], priors).covariance)
    stated = np.diag(assess(information, priors).covariance)
    return np.array(
        [np.sqrt(stated[part].sum() / exact[part].sum()) for part in (ROTATION, TRANSLATION, [TIME_OFFSET])]
    )


def told_cost(run: Run, solved: Solved, considered: Considered | None) -> tuple[tuple[str, str], ...]:
    """What it costs not to know the sensors exactly, in one sentence, code and text; none where that is little.

    considered: where the parameters were held; they are in no column then.
    """
    if considered is not None or not solved.nuisance.sensors.blocks:
        return ()
    times = cost_of_sensors(solved)
    if times.max() < WORDING.costly:
        return ()
    told = [f"{a:.1f} times in {name}" if a >= WORDING.counted else "" for a, name in zip(times, _GROUPS, strict=True)]
    if told[0] and (turned := _of_the_gyroscope(solved)) < times[0]:
        told[0] += f" ({turned:.1f} times for the rotation into the gyroscope's own axes)"
    widened = ", ".join(filter(None, told))
    unnamed = _unnamed(run)
    why, cure = "the sensors may be off by as much as their data sheets allow", ""
    if run.beyond_sheets:
        why = "some sensors are worse than their data sheets say, so that larger errors of them are allowed for"
    if unnamed:
        models = "model of the" if len(unnamed) == 1 else "models of"
        these = "is" if len(unnamed) == 1 else "are"
        why = (
            f"the {models} {' and '.join(unnamed)} {these} not known, so that large errors of their own are allowed for"
        )
        cure = f"; name the {' and the '.join(unnamed)} to narrow them"
    return (("sensor.priors", f"{why}: this makes the error bars wider than with exact sensors, {widened}{cure}"),)


def _of_the_gyroscope(solved: Solved) -> float:
    """By how many times the rotation into the gyroscope's axes is wider than with sensors known exactly."""
    turned, plain = gyroscope_covariance(solved, solved.nuisance.sensors)
    return float(cost_of_sensors(solved)[0] * np.sqrt(np.trace(turned) / np.trace(plain)))


def _unnamed(run: Run) -> list[str]:
    """Sensors for which the middle of all there are stands in."""
    imu, lidar = priors_of(run.recording, run.settings)
    return [name for name, known in (("IMU", imu != UNKNOWN_IMU), ("lidar", lidar != UNKNOWN_LIDAR)) if not known]
