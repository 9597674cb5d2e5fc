"""What is known, from information matrices whose weak directions were put there."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.full.assess.observability import Direction, Knowledge, assess
from calib_core.full.assess.weak_sentences import advice, named_direction, weak_directions
from calib_core.full.joint.priors import PriorRow, Priors
from calib_core.full.joint.undetermined import UNITS
from calib_core.geometry import exp
from calib_core.result import COVARIANCE_ORDER
from calib_core.types import FloatArray
from tests.core.full.assess.made_information import STANDING, information_of, priors_of

#: Spread of a well-determined parameter, in units of 1 deg, 10 mm, 1 ms.
GOOD = 0.02


def _assess(spread: FloatArray, directions: FloatArray | None = None, *extra: PriorRow, **kw: float) -> Knowledge:
    priors = priors_of(*extra)
    axes = np.eye(7) if directions is None else directions
    return assess(information_of(spread, axes, priors), priors, inflation=kw.get("inflation", 1.0))


def _all(value: float, **changed: float) -> FloatArray:
    spread = np.full(7, value)
    for name, v in changed.items():
        spread[COVARIANCE_ORDER.index(name)] = v
    return spread


def test_what_no_residual_knows_of_the_clocks_is_added_to_the_offset_alone() -> None:
    """Mutation: added to the standard deviation instead of the variance, or although the offset is held."""
    priors = priors_of()
    information = information_of(_all(GOOD), np.eye(7), priors)
    plain, widened = assess(information, priors), assess(information, priors, offset_std_s=3e-4)
    expected = plain.covariance.copy()
    expected[6, 6] += 9e-8
    np.testing.assert_allclose(widened.covariance, expected, rtol=1e-12)
    assert widened.data_std[6] == pytest.approx(np.hypot(plain.data_std[6], 3e-4))
    held = assess(information, priors, frozen_offset=True, offset_std_s=3e-4)
    np.testing.assert_array_equal(held.covariance, assess(information, priors, frozen_offset=True).covariance)


def _taking_away(direction: FloatArray, priors: Priors) -> FloatArray:
    """Information (17, 17) of two unknowns more that are the same but for round-off, and coupled to a direction all the same."""
    first = information_of(_all(GOOD), np.eye(7), priors)
    out = np.zeros((17, 17))
    out[:15, :15] = first
    out[15:, 15:] = [[1.0, 1.0 - 1e-13], [1.0 - 1e-13, 1.0]]
    out[:7, 15] = out[15, :7] = 0.1 * direction / UNITS
    return out


def test_what_is_added_to_the_covariance_leaves_less_known() -> None:
    """Oracle: covariances add; with the standing prior, information. And where other unknowns take away more than there is of a
    direction, as round-off has them do, the direction is open, what is added or not, and the others are known as they are.

    Seen: a room seen two ways, 7 m open, "calibrated" to 17 mm once its parts disagreed by 17 mm. Mutations: information below
    zero left in, with what is added or without; added to the information; added twice.
    """
    priors = priors_of()
    root = 0.05 * np.random.default_rng(2).normal(size=(7, 2))
    added = root @ root.T
    widened = assess(information_of(_all(GOOD), np.eye(7), priors), priors, added=added)
    prior = np.array([1.0 / (row.std / unit) ** 2 for row, unit in zip(STANDING, UNITS, strict=True)])
    expected = np.linalg.inv(np.linalg.inv(np.eye(7) * GOOD**2 + added) + np.diag(prior))
    np.testing.assert_allclose(widened.covariance / UNITS / UNITS[:, None], expected, rtol=1e-6, atol=1e-9)

    direction = np.array([0.6, -0.4, 0.65, -0.05, 0.2, -0.02, -0.02])
    information = _taking_away(direction / np.linalg.norm(direction), priors)
    for each in (None, added):
        known = assess(information, priors, added=each)
        (open_direction,) = weak_directions(known)
        assert abs(np.array(open_direction.vector) @ direction) / np.linalg.norm(direction) > 0.99
        assert "does not determine" in open_direction.text
        std = np.sqrt(np.diag(known.covariance)) / UNITS
        lacking = np.zeros(7) if each is None else np.diag(each)
        # The last two have hardly a part in it.
        np.testing.assert_allclose(std[5:], np.sqrt(GOOD**2 + lacking[5:]), rtol=0.05)
        assert (std[:3] > 1.0).all()


def test_what_is_well_known_is_reported_with_its_own_spread() -> None:
    """Fails when the rest is not eliminated (the block of the information is inverted instead of the whole).

    Against the matrix that went in: covariance with the standing prior, spreads without it.
    """
    directions = np.linalg.qr(np.random.default_rng(1).normal(size=(7, 7)))[0]
    spread = np.linspace(0.5, 2.0, 7) * GOOD
    known = _assess(spread, directions)
    assert known.weak == ()
    assert not known.is_weak
    assert known.rotation_known
    covariance = (directions * spread**2) @ directions.T * UNITS[:, None] * UNITS
    np.testing.assert_allclose(known.covariance, covariance, rtol=1e-5, atol=1e-12)
    np.testing.assert_allclose(known.data_std, np.sqrt(np.diag(covariance)), rtol=1e-5)


@pytest.mark.parametrize(
    ("label", "limit"), [*((f"r{a}", 0.5) for a in "xyz"), *((f"t{a}", 2.0) for a in "xyz"), ("dt", 2.0)]
)
def test_weak_is_beyond_half_a_degree_20_mm_or_2_ms(label: str, limit: float) -> None:
    """Fails when a limit of LIMITS moves: 0.5 deg, 20 mm and 2 ms are the contract's."""
    assert not _assess(_all(GOOD, **{label: 0.97 * limit})).is_weak
    known = _assess(_all(GOOD, **{label: 1.05 * limit}))
    assert known.is_weak
    assert [d.label for d in weak_directions(known)] == [label]
    assert known.weak[0].spread == pytest.approx(1.05 * limit, rel=1e-3)
    np.testing.assert_allclose(np.abs(known.weak[0].vector), np.eye(7)[COVARIANCE_ORDER.index(label)], atol=1e-6)
    assert "1 sigma" in weak_directions(known)[0].text


@pytest.mark.parametrize("label", COVARIANCE_ORDER)
def test_what_nothing_determines_is_the_priors_and_said_to_be(label: str) -> None:
    """Fails when an undetermined direction is worded like one that is merely weak."""
    known = _assess(_all(GOOD, **{label: np.inf}))
    assert [d.label for d in weak_directions(known)] == [label]
    assert "does not determine" in weak_directions(known)[0].text
    std = np.sqrt(np.diag(known.covariance))
    column = COVARIANCE_ORDER.index(label)
    assert std[column] == pytest.approx(STANDING[column].std, rel=1e-3)
    assert np.isfinite(known.covariance).all()
    assert np.delete(std / UNITS, column).max() < 1.1 * GOOD


def test_a_parameter_that_is_named_has_the_size_that_the_tables_have() -> None:
    """A lever arm's x of 24.5 mm, 24.1 of them along the direction that has its name, and an offset that the clocks widen.

    Mutations: the direction's own size; the offset's before the clocks are counted.
    """
    way = np.zeros(7)
    way[[3, 4]] = [0.98, np.sqrt(1 - 0.98**2)]
    rest = np.linalg.qr(np.column_stack([way, np.eye(7)[:, [0, 1, 2, 4, 5, 6]]]))[0]
    across = int(np.argmax(np.abs(rest[4])))
    spread = np.full(7, GOOD)
    spread[[0, across]] = 2.46, 2.2
    known = _assess(spread, rest)
    (x,) = [d for d in weak_directions(known) if d.label == "tx"]
    assert known.data_std[3] == pytest.approx(0.02451, abs=1e-5)
    assert "x axis only to 25 mm (1 sigma)" in x.text
    priors = priors_of()
    (late,) = weak_directions(assess(information_of(_all(GOOD, dt=2.5), np.eye(7), priors), priors, offset_std_s=6e-3))
    assert "determines time offset only to 6.5 ms" in late.text


def test_a_slanting_direction_is_found_and_named_by_its_parts() -> None:
    """Fails when the vector is not in the contract's units, or a mixture is given the label of its largest part.

    Mutation: parts named by letters that leave open what they are of.
    """
    way = np.zeros(7)
    way[[3, 4, 6]] = [0.8, -0.5, np.sqrt(1 - 0.89)]
    rest = np.linalg.qr(np.column_stack([way, np.eye(7)[:, [0, 1, 2, 3, 4, 5]]]))[0]
    rest[:, 0] = way
    known = _assess(np.array([30.0, *[GOOD] * 6]), rest)
    assert len(known.weak) == 1
    assert weak_directions(known)[0].label is None
    assert abs(known.weak[0].vector @ way) == pytest.approx(1.0, abs=1e-4)
    said = "the combination +0.80 translation x, -0.50 translation y, +0.33 time offset (in units of 1 deg, 10 mm and 1 ms)"
    assert said in weak_directions(known)[0].text
    # Of what parts disagree about it is said with the same words.
    turned = np.zeros(7)
    turned[[1, 3]] = 0.7, 0.71
    assert named_direction(np.outer(turned, turned)).startswith("the combination +0.70 turn y, +0.71 translation x (")


def test_a_direction_is_told_the_same_way_round_whichever_way_it_came() -> None:
    """Its largest part is positive in the document, and in words. Mutations: as it came; the first part positive."""
    way = np.array([-0.2, 0.0, 0.0, 0.9, 0.0, 0.0, np.sqrt(1.0 - 0.85)])
    data_std = np.full(7, 0.03)
    told = [
        weak_directions(
            Knowledge(np.eye(7), data_std, (Direction(sign * way, 3.0, is_open=False),), rotation_known=True)
        )
        for sign in (1.0, -1.0)
    ]
    assert told[0] == told[1]
    np.testing.assert_array_equal(told[0][0].vector, way)
    assert "-0.20 turn x, +0.90 translation x, +0.39 time offset" in told[0][0].text


def test_a_direction_of_one_kind_is_named_as_such() -> None:
    """Fails when a slanting lever arm is called a combination in units nobody thinks in, or a rotation a lever arm."""
    for first, said in (
        (3, "the translation along (+0.80, -0.60, +0.00) of the IMU's"),
        (0, "rotation about (+0.80, -0.60, +0.00) of"),
    ):
        basis = np.eye(7)
        basis[first : first + 2, first : first + 2] = [[0.8, 0.6], [-0.6, 0.8]]
        spread = np.full(7, GOOD)
        spread[first] = 30.0
        known = _assess(spread, basis)
        assert [d.label for d in weak_directions(known)] == [None]
        assert said in weak_directions(known)[0].text


def test_a_tape_measure_fills_in_but_does_not_hide_what_the_data_lack() -> None:
    """Fails when only standing priors are taken out: a user's prior of 1 mm would make the recording look good."""
    tape = PriorRow(5, 0.3, 0.001)
    for spread in (5.0, np.inf):
        without = _assess(_all(GOOD, tz=spread))
        known = _assess(_all(GOOD, tz=spread), None, tape)
        assert [d.label for d in weak_directions(known)] == ["tz"]
        assert known.is_weak
        np.testing.assert_allclose(known.data_std, without.data_std, rtol=2e-2)
        assert np.sqrt(known.covariance[5, 5]) == pytest.approx(0.001, rel=0.01)


def test_a_trace_of_an_undetermined_direction_leaves_the_rotation_as_well_known_as_it_is() -> None:
    """Fails when `undetermined` returns the bare eigenvectors: rz would pass for known to 0.2 deg only.

    Noise in the motion mixes 0.0002 deg a 10 mm into a lever arm that nothing determines; 0.02 deg is what is known.
    """
    way = np.array([0.0, 0.0, 2e-4, 0.0, 0.6, 0.8, 0.0])
    way /= np.linalg.norm(way)
    others = np.linalg.qr(np.column_stack([way, np.eye(7)[:, [0, 1, 2, 3, 4, 6]]]))[0]
    known = _assess(np.array([30.0, *[GOOD] * 6]), others)
    std = np.sqrt(np.diag(known.covariance)) / UNITS
    assert std[2] == pytest.approx(GOOD, rel=0.01)
    assert std[5] == pytest.approx(800.0, rel=0.01)
    mixed = np.array([0.0, 0.0, 2e-2, 0.0, 0.6, 0.8, 0.0])
    others[:, 0] = mixed / np.linalg.norm(mixed)
    others = np.linalg.qr(others)[0]
    known = _assess(np.array([30.0, *[GOOD] * 6]), others)
    assert np.sqrt(known.covariance[2, 2]) / UNITS[2] > 15.0, "a real part stays one"


def test_what_nothing_tells_beside_micrometres_is_no_wider_than_the_priors() -> None:
    """What is known best leaves round-off in what is not known at all: seen as variances below nothing, which ended in a defect.
    Oracle: the priors along the open directions alone. Mutations: plainly inverted; not held at nothing.
    """
    rng = np.random.default_rng(3)
    stds = np.array([row.std for row in STANDING]) / UNITS
    for _ in range(50):
        axes = np.linalg.qr(rng.normal(size=(7, 7)))[0]
        spread = 10.0 ** rng.uniform(-5.0, -3.5, 7)
        spread[:3] = np.inf
        scaled = _assess(spread, axes).covariance / UNITS / UNITS[:, None]
        alone = np.linalg.inv((axes[:, :3].T / stds**2) @ axes[:, :3])
        assert np.all(np.diag(scaled) > 0.0)
        # Round-off may as well tell something where nothing is told, but nothing is less than nothing.
        assert np.linalg.eigvalsh(scaled)[-1] < np.linalg.eigvalsh(alone)[-1] * (1.0 + 1e-6)


def test_inflation_multiplies_every_spread() -> None:
    """Fails when variances are multiplied by the factor instead of its square."""
    plain, inflated = _assess(_all(GOOD)), _assess(_all(GOOD), inflation=3.0)
    np.testing.assert_allclose(inflated.data_std, 3.0 * plain.data_std, rtol=1e-4)
    np.testing.assert_allclose(np.diag(inflated.covariance), 9.0 * np.diag(plain.covariance), rtol=1e-3)


def test_a_time_offset_that_was_given_is_not_missed() -> None:
    """Fails when a frozen offset's empty column counts as something the data lack."""
    priors = priors_of()
    information = information_of(_all(GOOD, dt=np.inf), np.eye(7), priors)
    assert assess(information, priors).is_weak
    frozen = assess(information, priors, frozen_offset=True)
    assert not frozen.is_weak


@pytest.mark.parametrize(
    ("turns", "known"), [((np.inf,) * 3, False), ((30.0, 30.0, 30.0), False), ((1.0, np.inf, np.inf), True)]
)
def test_rotation_counts_as_known_where_any_component_is(turns: tuple[float, float, float], known: bool) -> None:
    """Fails when the worst component decides instead of the best."""
    assert _assess(np.array([*turns, *[GOOD] * 4])).rotation_known is known


def test_advice_names_the_axis_to_turn_about() -> None:
    """Fails when the axis that turned most is recommended, advice is given where nothing is weak, or it is said to be about
    another parameter; when the same turning is asked for twice.

    A lever arm along z is told by turning about x or y: about y here, which was quiet.
    """
    turning = np.array([0.5, 0.01, 0.7])
    assert advice(_assess(_all(GOOD)), turning, np.eye(3)) == []
    (lever,) = advice(_assess(_all(GOOD, tz=np.inf)), turning, np.eye(3))
    assert lever.about == (5,)
    assert "the translation along the IMU's z axis" in lever.text
    assert "about the IMU's y axis" in lever.text
    both, other = advice(_assess(_all(GOOD, tx=np.inf, ty=np.inf, tz=np.inf)), turning, np.eye(3))
    assert (both.about, other.about) == ((3, 5), (4,))
    assert "the translation along the IMU's x and z axes, turn to and fro about the IMU's y axis" in both.text
    (turn,) = advice(_assess(_all(GOOD, rx=3.0)), turning, exp(np.array([0.1, 0, 0])))
    assert ("rotation" in turn.text, turn.about) == (True, (0, 1, 2))
    (offset,) = advice(_assess(_all(GOOD, dt=5.0)), turning, np.eye(3))
    assert ("time offset" in offset.text, offset.about) == (True, (6,))


def test_advice_leaves_out_what_no_motion_tells() -> None:
    """Mutations: turning for axes that the sensors alone leave weak; about other parameters; nothing said of them."""
    turning, weak = np.array([0.5, 0.01, 0.7]), _assess(_all(GOOD, tz=np.inf, rx=3.0, dt=5.0))
    lever, sensors = advice(weak, turning, np.eye(3), by_sensors=("rx", "dt"))
    assert lever.about == (5,)
    assert sensors.about == (0, 6)
    assert sensors.text.startswith("The rotation and time offset are weak only because of possible sensor errors")
    assert [said.about for said in advice(weak, turning, np.eye(3))] == [(5,), (0, 1, 2), (6,)]


def test_where_most_scans_do_not_count_no_turning_is_advised() -> None:
    """Seen: 7 scans of 249 counted, as a wall filled the view, and more turning was asked for of a rig that turned at 80 deg/s.

    Mutations: said where nothing is weak; where half of the scans count; beside the turning; of all seven.
    """
    turning, weak = np.array([1.2, 1.2, 1.4]), _assess(_all(GOOD, tz=np.inf, rx=3.0))
    (said,) = advice(weak, turning, np.eye(3), (7, 249))
    assert said.about == (0, 5)
    assert "Only 7 of 249 scans count" in said.text
    assert "three planes that face different directions" in said.text
    assert "turn" not in said.text
    assert advice(_assess(_all(GOOD)), turning, np.eye(3), (7, 249)) == []
    for enough in ((125, 250), None):
        assert advice(weak, turning, np.eye(3), enough) == advice(weak, turning, np.eye(3))


def test_what_is_weak_is_so_in_tables_and_in_advice() -> None:
    """One open direction, of which a tenth lies along the IMU's x: its table is a metre wide there too. Seen: a table named three
    axes and the advice two of them.

    Oracle: the standard deviations of the data. Mutations: advice for axes that take a third of a direction; only the axis after
    which a direction is named.
    """
    way = np.zeros(7)
    way[3:6] = [0.12, -0.39, np.sqrt(1 - 0.12**2 - 0.39**2)]
    rest = np.linalg.qr(np.column_stack([way, np.eye(7)[:, [0, 1, 2, 3, 4, 6]]]))[0]
    known = _assess(np.array([np.inf, *[GOOD] * 6]), rest)
    assert (known.data_std[3:6] > 1.0).all()
    assert len(known.weak) == 1
    assert known.weak_axes == ("tx", "ty", "tz")
    said = advice(known, np.array([0.5, 0.01, 0.7]), np.eye(3))
    assert sorted(place for each in said for place in each.about) == [3, 4, 5]


@pytest.mark.parametrize("frozen", [False, True])
def test_a_prior_makes_an_answer_no_surer_than_it_was_weighed(frozen: bool) -> None:
    """Where parts disagree, the solve has weighed a prior against what the data seemed to know, and what they know less is in the
    answer still. Oracle: the spread of 200 000 answers made so.

    Seen: 122.5 +- 0.3 mm given, 119.93 +- 0.30 answered, the data's own 119.8 +- 2.7. Mutations: the prior added to what the data
    know with all that they lack; nothing of it added; the time offset's added where it was held.
    """
    tape = PriorRow(3, 0.3, 0.0003)
    priors = priors_of(tape)
    added = np.diag([0.0, 0.0, 0.0, 0.25**2, 0.0, 0.0, 0.2**2])
    known = assess(information_of(_all(GOOD), np.eye(7), priors), priors, added=added, frozen_offset=frozen)
    weight, own = 0.0003**-2.0, (GOOD * UNITS[3]) ** -2.0
    draws = np.random.default_rng(1).standard_normal((3, 200_000))
    seen = draws[0] / np.sqrt(own) + draws[1] * 0.25 * UNITS[3]
    answers = (own * seen + weight * draws[2] / np.sqrt(weight)) / (own + weight)
    assert np.sqrt(known.covariance[3, 3]) == pytest.approx(float(np.std(answers)), rel=0.01)
    offset_std = np.sqrt(known.covariance[6, 6]) / UNITS[6]
    assert offset_std == pytest.approx(0.0 if frozen else np.hypot(GOOD, 0.2), abs=1e-3)
