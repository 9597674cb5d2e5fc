"""What a person gave beforehand, held against the recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from calib_core.calibrate import calibrate
from calib_core.errors import SettingsError
from calib_core.full.assess.given_values import CONTRADICTED, contradictions, of_planes
from calib_core.full.joint.priors import PriorRow
from calib_core.settings import CalibrateSettings, Gravity, Prior
from calib_core.simulate import Truth
from calib_core.types import InitialGuess, Recording


@pytest.mark.parametrize(
    ("given", "std", "alone", "alone_std", "is_told"),
    [
        (0.31, 0.005, 0.1035, 0.0012, True),
        (0.31, 0.005, 0.335, 0.001, False),  # 4.9 of both together
        (0.31, 0.005, 0.337, 0.001, True),  # 5.3, on the other side
        (0.31, 1e-4, 0.2, 0.05, False),  # what is given is known far better: 2.2
        (0.31, 1e-4, 0.03, 0.05, True),  # and all the same wrong: 5.6
        (0.31, 0.005, 3.0, 10.0, False),  # the recording says nothing
    ],
)
def test_two_gaussians_that_do_not_agree(
    given: float, std: float, alone: float, alone_std: float, is_told: bool
) -> None:
    """Oracle: both made one by hand, and their distance in the root of both variances.

    Mutations: the answer's own sigma; the prior's; the answer's distance for the recording's; the signed distance.
    """
    weight, alone_weight = std**-2, alone_std**-2
    at, stds = np.zeros(7), np.ones(7)
    at[4] = (weight * given + alone_weight * alone) / (weight + alone_weight)
    stds[4] = (weight + alone_weight) ** -0.5
    found = contradictions([PriorRow(4, given, std), PriorRow(0, 0.0, 2.0)], at, stds)
    assert len(found) == is_told
    for each in found:
        assert each.sigmas == pytest.approx(abs(alone - given) / np.hypot(std, alone_std), rel=1e-6)
        assert each.away == f"{1e3 * abs(alone - given):.3g} mm"
    # Where parts of the recording disagree by a third of the distance, it is three of both together at most.
    added = np.full(7, (abs(alone - given) / 3.0) ** 2)
    assert contradictions([PriorRow(4, given, std)], at, stds, added) == []


@pytest.mark.parametrize(("alone_std", "is_told"), [(0.03, True), (9.14, False), (np.inf, False)])
def test_a_recording_that_says_nothing_contradicts_nothing(alone_std: float, is_told: bool) -> None:
    """A tape measure's number, and an answer that is 6 mm from it as it was held there: that is beyond 5 sigmas of what a
    recording would move it by that knows 30 mm.

    Seen: of a turntable, whose lever arm along its axis is open, 83.7 +- 5 mm, right to the tenth, "contradicts the recording,
    which by itself puts it 3.41e+05 mm away (68 standard deviations)". Mutations: asked all the same; only where nothing at
    all is said.
    """
    given, std = 0.31, 0.005
    at, stds = np.zeros(7), np.ones(7)
    at[5], stds[5] = given - 0.006, (std**-2.0 + alone_std**-2.0) ** -0.5
    assert bool(contradictions([PriorRow(5, given, std)], at, stds)) == is_told


def test_a_prior_that_the_recording_contradicts_is_named(noisy: tuple[Recording, Truth]) -> None:
    """And one that it does not is not. Mutations: the covariance in another unit; `calibrated` all the same; standing priors
    judged, too.
    """
    recording, truth = noisy
    x_m = float(truth.p_imu_lidar[0])
    for away_m, status in ((0.0, "calibrated"), (0.2, "weak")):
        settings = CalibrateSettings(
            intrinsics="off",
            crispness=False,
            priors=(Prior(axis="ty", value=0.0, std=5.0), Prior(axis="tx", value=x_m + away_m, std=0.01)),
        )
        result = calibrate(recording, settings, planes=truth.planes).result
        told = [message.text for message in result.messages if message.code == CONTRADICTED]
        assert (result.status, len(told)) == (status, int(away_m > 0.0))
        for text in told:
            assert text.startswith(
                "what was given for the translation along the IMU's x axis contradicts the recording"
            )
            stated_mm = float(text.split("by itself puts it ")[1].split(" mm")[0])
            assert stated_mm == pytest.approx(1e3 * away_m, rel=0.1)


@pytest.mark.parametrize(
    ("said", "change", "off_ms", "away"),
    [
        ("time offset", {"estimate_time_offset": False}, 0.0, None),
        ("time offset", {"estimate_time_offset": False}, 1.0, "ms"),
        ("magnitude of gravity", {"gravity": Gravity(magnitude_m_s2=9.81, std_m_s2=0.0)}, 0.0, None),
        ("magnitude of gravity", {"gravity": Gravity(magnitude_m_s2=9.4, std_m_s2=0.0)}, 0.0, "m/s\u00b2"),
    ],
)
def test_what_is_held_and_wrong_is_named(
    noisy: tuple[Recording, Truth], said: str, change: dict[str, object], off_ms: float, away: str | None
) -> None:
    """A time offset a millisecond off, and a gravity of nowhere on Earth; the true ones are not. Oracle: how far they are off.

    Mutations: not asked; let go with gravity's own prior; the one held called the other.
    """
    recording, truth = noisy
    settings = CalibrateSettings.model_validate({"intrinsics": "off", "crispness": False, **change})
    held_ns = truth.time_offset_ns + round(1e6 * off_ms)
    guess = InitialGuess(None, None, held_ns) if said == "time offset" else None
    result = calibrate(recording, settings, planes=truth.planes, initial_guess=guess).result
    told = [message.text for message in result.messages if message.code == CONTRADICTED]
    assert (result.status, len(told)) == (("calibrated", 0) if away is None else ("weak", 1))
    for text in told:
        assert text.startswith(f"what was given for the {said} contradicts the recording")
        number, unit = text.split("by itself puts it ")[1].split(" away")[0].split()
        assert unit == away
        assert float(number) == pytest.approx(off_ms if off_ms > 0.0 else 9.81 - 9.4, rel=0.2)


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize(("off_ms", "std_s", "count"), [(0.0, 1e-5, 0), (4.0, 5e-4, 1)])
def test_a_true_offset_does_not_contradict_stamps_that_were_cut(
    noisy: tuple[Recording, Truth], off_ms: float, std_s: float, count: int, *, held: bool
) -> None:
    """Given sharply or held, beside stamps of whole milliseconds: these tell the offset to half a millisecond, however well the
    motion fits. Oracle: the truth; one that is 4 ms off, more than five of both, is named all the same.

    Seen: the true one, 0.12 ms from what the stamps say, 7 and 5 standard deviations off, and the answer weak for it. Mutations:
    what stamps are off by left out of the one, of the other.
    """
    recording, truth = noisy
    ms = 1_000_000
    cut = replace(recording, imu=replace(recording.imu, stamps_ns=recording.imu.stamps_ns // ms * ms))
    given_ns = truth.time_offset_ns + round(off_ms * ms)
    settings = CalibrateSettings(intrinsics="off", crispness=False, estimate_time_offset=not held)
    if not held:
        settings = settings.model_copy(update={"priors": (Prior(axis="dt", value=given_ns * 1e-9, std=std_s),)})
    guess = InitialGuess(None, None, given_ns) if held else None
    result = calibrate(cut, settings, planes=truth.planes, initial_guess=guess).result
    assert [message.code for message in result.messages].count(CONTRADICTED) == count
    assert result.status == ("weak" if count else "calibrated")


def test_a_turn_is_given_from_a_rotation(noisy: tuple[Recording, Truth]) -> None:
    """From the program's own start it is no knowledge: 0 +- 0.001 deg from there was 29 sigmas off, and called calibrated.

    Mutations: taken from the start; asked of a translation, too; a guess without a rotation is enough.
    """
    recording, truth = noisy
    turn = CalibrateSettings(priors=(Prior(axis="rz", value=0.0, std=1e-3),))
    for guess in (None, InitialGuess(None, truth.p_imu_lidar, truth.time_offset_ns)):
        with pytest.raises(SettingsError, match="initial guess with a rotation, because the prior on rz"):
            calibrate(recording, turn, initial_guess=guess)
    short = replace(recording, scans=recording.scans[:3])
    for settings, known in (
        (CalibrateSettings(priors=(Prior(axis="tz", value=0.0, std=1.0),)), None),
        (turn, InitialGuess(truth.R_imu_lidar, None, None)),
    ):
        assert calibrate(short, settings, initial_guess=known).result.status == "refused"


@pytest.mark.parametrize("wider", [1.0, 3.0])
def test_planes_are_asked_as_one(wider: float) -> None:
    """Oracle: points of four planes, whose own least squares make the covariance; how far each stands off amid them; the tail
    of the chi-square law beside that of the normal one.

    Mutations: the offset about the origin; the planes one by one, of which none is beyond 5; the frame's six counted;
    disagreement left out, or taken for a square.
    """
    random = np.random.default_rng(4)
    steps, blocks = [], []
    for far, turn_rad, off_m in ((4.0, 1e-4, 0.0), (6.0, 0.0, 4e-4), (3.0, 0.0, 3e-4), (5.0, 0.0, 3.5e-4)):
        about = random.normal(0.0, 1.0, (200, 2)) + far
        rows = np.column_stack([about, np.ones(200)]) / 5e-3
        blocks.append(np.linalg.inv(rows.T @ rows))
        # Turned about the middle of its points, and moved there.
        middle = about.mean(axis=0)
        steps.append(np.array([turn_rad, 0.0, off_m - turn_rad * middle[0]]))
    known = np.zeros((12, 12))
    for k, block in enumerate(blocks):
        known[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = block
    steps = [4.0 * wider * step for step in steps]
    saved = sum(float(step @ np.linalg.solve(block, step)) for step, block in zip(steps, blocks, strict=True))
    told = of_planes(["a", "b", "c", "d"], steps, known, wider)
    as_normal = stats.norm.isf(stats.chi2.sf(saved / wider**2, 6))
    assert told.sigmas / wider == pytest.approx(as_normal, rel=0.05)
    assert told.what == "planes (b most of all)"
    shift_mm, degrees = told.away.removesuffix(" deg").split(" mm and ")
    assert (float(shift_mm), float(degrees)) == (pytest.approx(4e-1 * 4.0 * wider, rel=0.02), 0.0)


@pytest.mark.parametrize(
    ("off_m", "status", "level", "said"),
    [
        (0.0, "calibrated", [], ""),
        (0.001, "calibrated", ["info"], "it hardly changes the calibration"),
        (0.02, "weak", ["warning"], "everything else was bent to fit"),
    ],
)
def test_planes_that_are_held_where_they_are_not(
    noisy: tuple[Recording, Truth], off_m: float, status: str, level: list[str], said: str
) -> None:
    """A wall a millimetre off, and two centimetres; the true ones are not told of, and no other wall is said to move or to bend.

    Mutations: not asked; `weak` whatever is bent; never; the others called doubtful beside it.
    """
    recording, truth = noisy
    planes = [replace(plane, suggested=False) for plane in truth.planes]
    planes[0] = replace(planes[0], offset_m=planes[0].offset_m + off_m)
    settings = CalibrateSettings(intrinsics="off", crispness=False, estimate_planes=False)
    result = calibrate(recording, settings, planes=planes).result
    told = [message for message in result.messages if message.code == CONTRADICTED]
    assert (result.status, [message.level for message in told]) == (status, level)
    assert all(said in message.text and "planes (" in message.text for message in told)
    doubts = [message.text for message in result.messages if message.code in {"planes.doubted", "planes.bent"}]
    assert not (told and doubts)
