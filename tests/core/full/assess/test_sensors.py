"""What is said of the sensors' own parameters."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core.full.assess import confidence, materials
from calib_core.full.assess.disagreement import Disagreement
from calib_core.full.assess.sensor_sentences import sentences
from calib_core.full.assess.sensors import sensor_findings
from calib_core.full.joint.sensor_state import SensorState
from calib_core.full.prepare.nuisance import MATERIAL, Nuisance, NuisanceBlock
from calib_core.full.run import LineStd
from calib_core.intrinsics import NAMES, UNITS, Block
from calib_core.result import Intrinsic
from tests.core.full.assess.made_information import solution_of


def _found(block: Block, value: float, *, significant: bool = True) -> Intrinsic:
    name = NAMES[block][0] if block in NAMES else "4"
    told = {"block": block, "name": name, "unit": UNITS[block], "value": value, "std": 1e-5, "prior_std": 1e-3}
    return Intrinsic.model_validate({**told, "state": "estimated", "significant": significant})


@pytest.mark.parametrize(
    ("block", "value", "corrected", "code", "text"),
    [
        (
            "grazing",
            7e-4,
            True,
            "sensor.grazing",
            "read short, by 0.70 mm per metre at 45 deg; ranges were corrected for it",
        ),
        (
            "grazing",
            -2e-3,
            False,
            "sensor.grazing",
            "read long, by 2.0 mm per metre at 45 deg; ranges were not corrected",
        ),
        ("grazing", 4e-5, True, "sensor.grazing", "read short, by 0.040 mm per metre"),
        ("laser_elevation", np.radians(0.004), True, "sensor.laser_elevation", "ring 4 points 0.0040 deg above"),
        ("laser_range_offset", -0.009, True, "sensor.laser_range", "ring 4 reads 9 mm short"),
        (
            "accelerometer_delay",
            2e-3,
            True,
            "sensor.delay",
            "the accelerometer's readings are 2.00 ms behind the gyroscope's",
        ),
        (
            "accelerometer_quadratic",
            -1.2e-4,
            True,
            "sensor.accelerometer_quadratic",
            "the accelerometer's x axis is not linear: it reads 1.2 mg too little at one g; it was taken out",
        ),
        (
            "g_sensitivity",
            1.8e-4,
            True,
            "sensor.g_sensitivity",
            "the gyroscope reacts to acceleration, by up to 0.101 deg/s per g; it was",
        ),
        (
            "size_effect",
            0.012,
            True,
            "sensor.size_effect",
            "up to 12 mm apart; it was taken out. The translation refers to their middle, which may be 0.58 mm from",
        ),
        # 158 / s2 of motion of 2 Hz: v / 2 of it is 0.38 %; u / 6 of it, of 5e-6 s3, 0.13 ms.
        (
            "low_pass_spread",
            4.8e-5,
            True,
            "sensor.low_pass",
            "gyroscope reads 0.38% too little of 2 Hz motion; it was",
        ),
        (
            "low_pass_skew",
            5e-6,
            True,
            "sensor.low_pass_skew",
            "reads 2 Hz motion 0.13 ms too early compared with slow motion",
        ),
        (
            "low_pass_skew",
            -5e-6,
            True,
            "sensor.low_pass_skew",
            "reads 2 Hz motion 0.13 ms too late compared with slow motion",
        ),
        ("clock_rate", -60.5, True, "sensor.clock", "clock loses 60.5 ppm on the IMU's; it was taken out"),
        ("clock_rate", 12.25, True, "sensor.clock", "clock gains 12.2 ppm on the IMU's"),
        ("gyroscope_scale", -4e-3, True, "sensor.gyroscope_scale", "x axis reads 0.40% too little; it was taken out"),
    ],
)
def test_what_is_beyond_chance_is_said(block: Block, value: float, corrected: bool, code: str, text: str) -> None:
    """And nothing of what is not.

    Mutations: short and long, gains and loses, early and late exchanged; said or corrected whether or not; what is small told
    as 0.0 mm.
    """
    found = [_found(block, value)]
    if block == "size_effect":
        found = [found[0].model_copy(update={"name": name, "value": value * (name == "xx")}) for name in NAMES[block]]
    ((told, sentence),) = sentences(found, corrected=corrected)
    assert told == code
    assert text in sentence
    none = [each.model_copy(update={"significant": False}) for each in found]
    # Accelerometers were told to be apart before they became unknowns.
    assert [said for said, _ in sentences(none, corrected=corrected)] == [code] * (block == "size_effect")


def test_what_is_farthest_off_in_its_own_sigmas_comes_first() -> None:
    """A screen has room for a few. Mutations: in the order of the blocks; by size; the least first; accelerometers that are
    apart, which widen all error bars, by their own sigmas, too."""
    found = [_found("laser_range_offset", -0.009), _found("clock_rate", -60.5), _found("gyroscope_scale", -4e-3)]
    found = [one.model_copy(update={"std": std}) for one, std in zip(found, (2e-3, 10.0, 1e-4), strict=True)]
    apart = [_found("size_effect", 1e-5).model_copy(update={"name": name}) for name in NAMES["size_effect"]]
    assert next(code for code, _ in sentences([*found, *apart], corrected=True)) == "sensor.size_effect"
    assert [code for code, _ in sentences(found, corrected=True)] == [
        "sensor.gyroscope_scale",
        "sensor.clock",
        "sensor.laser_range",
    ]


@pytest.mark.parametrize(
    ("count", "tail"),
    [(2, "short; ranges"), (3, "short (1 more is off); ranges"), (5, "short (3 more are off); ranges")],
)
def test_lasers_beyond_the_first_two_are_counted(count: int, tail: str) -> None:
    """Mutations: one that are off; the two that are named counted along."""
    found = [_found("laser_range_offset", -0.01).model_copy(update={"name": str(k)}) for k in range(count)]
    ((_, sentence),) = sentences(found, corrected=True)
    assert tail in sentence


@pytest.mark.parametrize(
    ("wider", "clock_place", "said"),
    [
        (1.0, -1, "ranges were corrected for it"),
        (1.3, -1, "because parts of the recording disagree"),
        (2.0, -1, ""),
        (1.3, 0, "ranges were corrected for it"),
    ],
)
def test_parts_that_disagree_make_a_sensor_less_sure(wider: float, clock_place: int, said: str) -> None:
    """Seen: a bent wall that was kept had an ideal lidar's beams read long by 13 sigmas, told as a fact. Four sigmas here. And
    where stamps jitter, which makes the clocks' rate less sure, parts were said to disagree that did not.
    Mutations: the model's own sigma; no word of why; the clocks' rate counted.
    """
    nuisance = Nuisance((NuisanceBlock("grazing", ("all",), np.array([1e-3])),))
    layout = SimpleNamespace(nuisance=lambda: slice(2, 3))
    solved: Any = SimpleNamespace(
        nuisance=nuisance,
        estimate=SimpleNamespace(sensors=SensorState(nuisance, np.array([4e-4]))),
        minimum=SimpleNamespace(solution=solution_of(np.diag([1.0, 1.0, 1e8]))),
        problem=SimpleNamespace(layout=lambda _: layout, sensors=SimpleNamespace(clock_place=clock_place)),
    )
    found = sensor_findings(solved, None, np.array([(wider**2 - 1.0) * 1e-8]), torn=False)
    (one,) = found.parameters
    assert one.std == pytest.approx(wider * 1e-4)
    assert one.significant is bool(said)
    assert [text for _, text in found.sentences if not text.endswith(said)] == []
    assert bool(found.sentences) is bool(said)
    # Shaken faster than the IMU reads, its axes were "up to 5.62 deg off", by six sigmas. Mutation: said all the same.
    in_two = sensor_findings(solved, None, np.array([(wider**2 - 1.0) * 1e-8]), torn=True)
    assert in_two.sentences == ()
    assert [(each.value, each.std) for each in in_two.parameters] == [(one.value, one.std)]
    assert not in_two.parameters[0].significant


@pytest.mark.parametrize(
    ("disagree", "claimed", "expected"),
    [(True, [], [1.0, 6.0, 3.0]), (False, [], [0.0, 4.0, 0.0]), (False, [2], [0.0, 4.0, 3.0])],
)
def test_what_their_variances_lack(
    monkeypatch: pytest.MonkeyPatch, disagree: bool, claimed: list[int], expected: list[float]
) -> None:
    """What parts disagree about, and of the clocks' rate, the second here, the square of what jittering stamps leave open. Where
    the seven agree, those alone are asked that would be claimed.

    Mutations: either left out; the rate's standard deviation for its square; asked of columns that are not theirs; none asked
    where the seven agree.
    """
    asked: list[list[int]] = []

    def lacking(_problem: object, _estimate: object, columns: np.ndarray, _found: object, _apart: object) -> np.ndarray:
        asked.append(columns.tolist())
        return np.array([1.0, 2.0, 3.0])[columns - 8]

    monkeypatch.setattr(confidence, "_claimed", lambda *_: np.array(claimed, np.int64))

    monkeypatch.setattr(confidence, "unexplained_variance", lacking)
    block = NuisanceBlock("accelerometer_scale", ("x", "y", "z"), np.ones(3))
    layout = SimpleNamespace(nuisance=lambda: slice(8, 13))  # two of a tone besides
    problem = SimpleNamespace(layout=lambda _: layout, sensors=SimpleNamespace(clock_place=1), lidar=None)
    solved: Any = SimpleNamespace(nuisance=Nuisance((block,)), estimate=None, problem=problem)
    run: Any = SimpleNamespace(clocks=SimpleNamespace(line=LineStd(rate_std_ppm=2.0)))
    found = [Disagreement("time", 2.0, (1.0 if disagree else 0.0) * np.eye(7))]
    assert confidence._sensors_unexplained(run, solved, found).tolist() == expected
    assert asked == ([[8, 9, 10]] if disagree else [[10]] if claimed else [])


def test_those_that_would_be_claimed_are_asked_but_for_single_lasers() -> None:
    """Mutations: all; single lasers' too; those within three of their standard deviations; below zero none."""
    blocks = (
        NuisanceBlock("gyroscope_scale", ("x", "y", "z"), np.ones(3)),
        NuisanceBlock("laser_range_offset", ("0", "1"), np.ones(2)),
        NuisanceBlock("grazing", ("all",), np.ones(1)),
    )
    sensors, std = Nuisance(blocks), np.array([1.0, 2.0, 3.0, 0.1, 0.1, 1e-4])
    estimate = SimpleNamespace(sensors=SensorState(sensors, np.array([2.9, -6.1, 0.0, 5.0, 0.0, 3.1e-4])))
    information = np.diag(np.concatenate([np.full(8, 1.0), 1.0 / std**2]))
    minimum = SimpleNamespace(solution=solution_of(information))
    solved: Any = SimpleNamespace(nuisance=sensors, estimate=estimate, minimum=minimum)
    assert confidence._claimed(solved, 8).tolist() == [1, 5]


@pytest.mark.parametrize(("lacking_m2", "told"), [(0.0, True), (2e-6, False)])
def test_a_material_that_places_disagree_about_is_not_told(
    monkeypatch: pytest.MonkeyPatch, lacking_m2: float, told: bool
) -> None:
    """Of two planes the second reads 4 mm short, by four sigmas of noise: beside a curtain, say. Asked is that one alone.

    Mutations: by noise alone; both asked; variances for standard deviations.
    """
    asked: list[list[int]] = []

    def lacking(_problem: object, _estimate: object, columns: np.ndarray, _found: object) -> np.ndarray:
        asked.append(columns.tolist())
        return np.full(len(columns), lacking_m2)

    monkeypatch.setattr(materials, "unexplained_variance", lacking)
    made = Nuisance((NuisanceBlock(MATERIAL, ("wall", "floor"), np.full(2, 0.004)),))
    information = np.diag(np.concatenate([np.ones(8), np.full(2, 1e6)]))
    solved: Any = SimpleNamespace(
        nuisance=made,
        estimate=SimpleNamespace(sensors=SensorState(made, np.array([0.0029, 0.004]))),
        problem=SimpleNamespace(layout=lambda _: SimpleNamespace(nuisance=lambda: slice(8, 10))),
        minimum=SimpleNamespace(solution=solution_of(information)),
        planes=[SimpleNamespace(name="wall"), SimpleNamespace(name="floor")],
    )
    said = materials.told_materials(solved)
    assert asked == [[9]]
    assert bool(said) is told
    assert all(text.startswith("floor reads 4.0 mm short") for _, text in said)
