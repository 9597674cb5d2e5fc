"""Sentences about those of the sensors' own parameters that matter."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from calib_core.intrinsics import STANDARD_GRAVITY_M_S2, UNITS
from calib_core.result import Intrinsic
from calib_core.sigmas import two_digits

#: As fast as a hand moves a rig.
_HAND_RAD_S = 2.0 * np.pi * 2.0
#: Parameters by block, and what is said of some of them: these, code and text.
_ByBlock = Mapping[str, Sequence[Intrinsic]]
_Said = Iterator[tuple[Sequence[Intrinsic], str, str]]


def sentences(parameters: Sequence[Intrinsic], *, corrected: bool) -> list[tuple[str, str]]:
    """Code and text, what is farthest off in its own sigmas first."""
    by = {str(block): [p for p in parameters if p.block == block and p.significant] for block in UNITS}
    ranges = (
        "ranges were corrected for it" if corrected else "ranges were not corrected, but the error bars allow for it"
    )
    taken = "it was taken out" if corrected else "it is counted in the error bars"
    told = [
        (max(abs(p.value) / p.std for p in off), code, text)
        for said in (_of_lidar(by, ranges, taken), _of_both_triads(by, taken), _of_each_triad(by, taken))
        for off, code, text in said
    ]
    # None of them need be beyond chance by itself: where their middle is, is not told. All error bars are wider for it.
    if beside := [p for p in parameters if p.block == "size_effect"]:
        told.append((np.inf, "sensor.size_effect", _apart(beside, taken)))
    return [(code, text) for _, code, text in sorted(told, key=lambda each: -each[0])]


def _of_lidar(by: _ByBlock, ranges: str, taken: str) -> _Said:
    if lasers := by["laser_range_offset"]:
        yield lasers, "sensor.laser_range", f"{_lasers(lasers)}; {ranges}"
    if lasers := by["laser_elevation"]:
        most_deg = np.degrees(max(abs(p.value) for p in lasers))
        who = f"ring {lasers[0].name} points" if len(lasers) == 1 else f"{len(lasers)} lasers point up to"
        text = f"{who} {two_digits(most_deg)} deg above or below where {'it' if len(lasers) == 1 else 'they'} should; {taken}"
        yield lasers, "sensor.laser_elevation", text
    if grazing := by["grazing"]:
        short_mm, how = grazing[0].value * 1e3, "short" if grazing[0].value > 0 else "long"
        text = f"walls hit at a slant read {how}, by {two_digits(abs(short_mm))} mm per metre at 45 deg; {ranges}"
        yield grazing, "sensor.grazing", text


def _of_both_triads(by: _ByBlock, taken: str) -> _Said:
    if turned := [*by["gyroscope_rotation"], *by["gyroscope_axes"], *by["accelerometer_axes"]]:
        most_deg = np.degrees(max(abs(p.value) for p in turned))
        text = f"the IMU's axes are up to {most_deg:.2f} deg off right angles, or off each other's directions; {taken}"
        yield turned, "sensor.axes", text
    if late := by["accelerometer_delay"]:
        how = "behind" if late[0].value > 0 else "ahead of"
        text = f"the accelerometer's readings are {abs(late[0].value) * 1e3:.2f} ms {how} the gyroscope's; {taken}"
        yield late, "sensor.delay", text
    if felt := by["g_sensitivity"]:
        most = np.degrees(max(abs(p.value) for p in felt)) * STANDARD_GRAVITY_M_S2
        yield (
            felt,
            "sensor.g_sensitivity",
            f"the gyroscope reacts to acceleration, by up to {most:.3f} deg/s per g; {taken}",
        )
    if smeared := by["low_pass_spread"]:
        worst = max(smeared, key=lambda p: abs(p.value))
        share = 0.5 * abs(worst.value) * _HAND_RAD_S**2
        how = "little" if worst.value > 0 else "much"
        text = (
            f"because of the IMU's low-pass filter the {worst.name} reads {share:.2%} too {how} of 2 Hz motion; {taken}"
        )
        yield smeared, "sensor.low_pass", text
    if skew := by["low_pass_skew"]:
        worst = max(skew, key=lambda p: abs(p.value))
        ms, how = 1e3 * worst.value * _HAND_RAD_S**2 / 6.0, "early" if worst.value > 0 else "late"
        text = f"because of the IMU's low-pass filter the {worst.name} reads 2 Hz motion {two_digits(abs(ms))} ms too {how}"
        yield skew, "sensor.low_pass_skew", f"{text} compared with slow motion; {taken}"
    if rate := by["clock_rate"]:
        how = "gains" if rate[0].value > 0 else "loses"
        text = f"the lidar's clock {how} {abs(rate[0].value):.1f} ppm on the IMU's; {taken}"
        yield rate, "sensor.clock", text


def _of_each_triad(by: _ByBlock, taken: str) -> _Said:
    for kind in ("gyroscope", "accelerometer"):
        if off := by[f"{kind}_scale"]:
            worst = max(off, key=lambda p: abs(p.value))
            text = f"the {kind}'s {worst.name} axis reads {abs(worst.value):.2%} too {_how(worst)}; {taken}"
            yield off, f"sensor.{kind}_scale", text
    if bent := by["accelerometer_quadratic"]:
        worst = max(bent, key=lambda p: abs(p.value))
        mg = two_digits(1e3 * abs(worst.value) * STANDARD_GRAVITY_M_S2)
        text = (
            f"the accelerometer's {worst.name} axis is not linear: it reads {mg} mg too {_how(worst)} at one g; {taken}"
        )
        yield bent, "sensor.accelerometer_quadratic", text


def _how(off: Intrinsic) -> str:
    return "much" if off.value > 0 else "little"


def _apart(beside: Sequence[Intrinsic], taken: str) -> str:
    r_m = np.reshape([p.value for p in beside], (3, 3))
    most_mm = 1e3 * max(float(np.linalg.norm(r_m[a] - r_m[b])) for a, b in ((0, 1), (0, 2), (1, 2)))
    prior_mm = 1e3 * beside[0].prior_std / len(r_m) ** 0.5
    text = f"the IMU's accelerometers are up to {two_digits(most_mm)} mm apart; {taken}. The translation refers to "
    return text + f"their middle, which may be {two_digits(prior_mm)} mm from the IMU's origin along each axis"


def _lasers(lasers: Sequence[Intrinsic]) -> str:
    """The two that are farthest off, and how many more. By ring, as clouds have them: a maker may number its lasers otherwise."""
    ordered = sorted(lasers, key=lambda p: -abs(p.value))
    worst = " and ".join(
        f"ring {p.name} reads {abs(p.value) * 1e3:.0f} mm {'long' if p.value > 0 else 'short'}" for p in ordered[:2]
    )
    more = len(ordered) - 2
    return worst + (f" ({more} more {'is' if more == 1 else 'are'} off)" if more > 0 else "")
