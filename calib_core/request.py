"""What somebody asks for, made fit to be solved: what does not fit together is refused or said, in a sentence for a person."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from calib_core.errors import SettingsError
from calib_core.events import LogEvent, OnEvent
from calib_core.full.planes.settings import PATCHES
from calib_core.planes.same_plane import same_surface
from calib_core.presets import by_preset_names
from calib_core.settings import OBEYED_BY_PAPER, CalibrateSettings
from calib_core.types import InitialGuess, Level, Plane, Recording


def check_settings(settings: CalibrateSettings, guess: InitialGuess | None) -> None:
    """Raises SettingsError where settings and start do not fit each other, or name a sensor that nobody knows."""
    by_preset_names(settings)  # knows them all, or raises
    _check_turns(settings, guess)


def _check_turns(settings: CalibrateSettings, guess: InitialGuess | None) -> None:
    """Raises SettingsError where a turn is given from nowhere: of the program's own start nobody knows anything beforehand."""
    turns = sorted({prior.axis for prior in settings.priors if prior.axis in ("rx", "ry", "rz")})
    if turns and (guess is None or guess.R_imu_lidar is None):
        raise SettingsError(
            f"Expected an initial guess with a rotation, because the prior on {', '.join(turns)} is a small turn from it about "
            "the lidar's axes, but found none; give the known rotation as the initial guess."
        )


def say_unused(settings: CalibrateSettings, on_event: OnEvent) -> None:
    """What was asked for and has no effect on the published method."""
    defaults = CalibrateSettings(method="paper")
    unused = [
        name.replace("_", " ")
        for name in CalibrateSettings.model_fields
        if name not in OBEYED_BY_PAPER and getattr(settings, name) != getattr(defaults, name)
    ]
    if settings.range_std_m is not None:
        unused = [name if name != "imu noise" else "imu noise (except the range's)" for name in unused]
    if settings.method == "paper" and unused:
        text = f"the published method ignores the settings {', '.join(unused)}: use `--method full` for them"
        _say(on_event, "warning", "settings.unused", text)


def with_offset_to_hold(
    recording: Recording, settings: CalibrateSettings, guess: InitialGuess | None, on_event: OnEvent
) -> InitialGuess | None:
    """A guess with the time offset that is to be held: where none is given, that of one clock for both, 0.

    What the solve would begin with is off by a millisecond, and would be held as if somebody knew it. Raises SettingsError where
    both sensors' stamps are of different times.
    """
    is_given = guess is not None and guess.time_offset_ns is not None
    if settings.estimate_time_offset or settings.method == "paper" or is_given:
        return guess
    if recording.coarse_offset_ns:
        apart_s = abs(recording.coarse_offset_ns) * 1e-9
        raise SettingsError(
            "Expected an initial guess with the time offset that is to be held, but found none, and the two sensors' stamps are "
            f"{apart_s:,.1f} s apart; give the time offset, or let it be estimated."
        )
    text = "no time offset to hold was given: it is held at 0, as if both sensors had one clock; give one, or let it be estimated"
    _say(on_event, "info", "offset.held", text)
    return replace(guess or InitialGuess(), time_offset_ns=0)


def each_once(planes: Sequence[Plane], on_event: OnEvent) -> list[Plane]:
    """Each surface once, and each by a name of its own; says which were left out, or called otherwise.

    Of points near two planes nobody knows whose they are, and neither gets them. Outlines keep two parts of a surface apart.
    """
    kept: list[Plane] = []
    for plane in planes:
        twin = next((k for k, other in enumerate(kept) if _is_twice(plane, other)), None)
        if twin is None:
            kept.append(_named_apart(plane, {other.name for other in kept}, on_event))
            continue
        within = f"within {PATCHES.twice_deg:g} deg and {1e3 * PATCHES.twice_m:g} mm"
        text = f"{plane.name} is the same surface as {kept[twin].name}, {within}: it counts once"
        _say(on_event, "warning", "planes.twice", text)
        if kept[twin].suggested and not plane.suggested:  # what somebody insists on
            kept[twin] = replace(plane, name=kept[twin].name)
    return kept


def _named_apart(plane: Plane, taken: Collection[str], on_event: OnEvent) -> Plane:
    if plane.name not in taken:
        return plane
    names = (f"{plane.name} ({number})" for number in itertools.count(2))
    name = next(each for each in names if each not in taken)
    _say(on_event, "info", "planes.named", f"two planes are called {plane.name}: one of them is renamed {name}")
    return replace(plane, name=name)


def _is_twice(one: Plane, other: Plane) -> bool:
    if one.outline_m is not None and other.outline_m is not None:
        return False
    normals, offsets_m = np.array([one.normal, other.normal]), np.array([one.offset_m, other.offset_m])
    of = normals[1:], offsets_m[1:]
    return bool(
        same_surface(normals[:1], offsets_m[:1], of=of, within_deg=PATCHES.twice_deg, within_m=PATCHES.twice_m)[0, 0]
    )


def _say(on_event: OnEvent, level: Level, code: str, text: str) -> None:
    on_event(LogEvent(level=level, code=code, text=text))
