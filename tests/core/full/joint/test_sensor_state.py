"""The sensors' own parameters among the blocks in play: values go with their names, whatever comes and goes about them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.factors.patches import SurfacePatches
from calib_core.full.joint.estimation import Estimation
from calib_core.full.joint.sensor_state import SensorState
from calib_core.full.joint.sensors import true_readings
from calib_core.full.prepare.nuisance import (
    LATE,
    MATERIAL,
    SURFACE,
    TONE,
    Nuisance,
    NuisanceBlock,
    choose_nuisance,
)
from calib_core.geometry import exp
from calib_core.intrinsics import KINDS, NAMES, UNKNOWN_IMU, UNKNOWN_LIDAR
from calib_core.types import FloatArray
from tests.core.full.joint.conftest import Half

EVERY = choose_nuisance(UNKNOWN_IMU, UNKNOWN_LIDAR, lasers=3, clock_rate_std_ppm=40.0)
PATCHES = SurfacePatches(np.eye(3)[:1], np.where(np.arange(9) < 4, np.arange(9), -1).reshape(1, 3, 3), 4)

Named = dict[tuple[str, str], float]
ByBlock = dict[str, list[float]]
ROOM = (MATERIAL, TONE, SURFACE)


def _named(state: SensorState) -> Named:
    """The slow twin: each value by its block and name, counted off one after the other."""
    out, left = {}, state.values.tolist()
    for block in state.blocks.blocks:
        for name in block.names:
            out[block.block, name] = left.pop(0)
    assert left == []
    return out


def _drawn(rng: np.random.Generator) -> Nuisance:
    """Some blocks with some of their members, in any order."""
    blocks = []
    for block in rng.permutation([*KINDS, MATERIAL, SURFACE, TONE])[: rng.integers(0, 9)]:
        names = rng.permutation([str(k) for k in range(6)])[: rng.integers(1, 7)]
        blocks.append(NuisanceBlock(str(block), tuple(map(str, names)), rng.uniform(1.0, 2.0, len(names))))  # type: ignore[arg-type]
    return Nuisance(tuple(blocks))


@pytest.mark.parametrize("seed", range(40))
def test_values_go_with_their_names(seed: int) -> None:
    """Between any two sets, of which many have blocks of one name with other members, in another order, or none at all.

    Oracle: a dictionary by name. Mutations: by place; blocks' first values; what is new at the last known value; members of two
    blocks that are called alike taken for one.
    """
    rng = np.random.default_rng(seed)
    before, after = _drawn(rng), _drawn(rng)
    state = SensorState(before, rng.normal(size=before.size))
    known, moved = _named(state), state.onto(after)
    assert moved.blocks is after
    asked = [(block.block, name) for block in after.blocks for name in block.names]
    assert _named(moved) == {name: known.get(name, 0.0) for name in asked}
    # And what has changed since is what the difference of the same two dictionaries is.
    now = SensorState(after, rng.normal(size=after.size))
    expected = {name: value - known.get(name, 0.0) for name, value in _named(now).items()}
    assert _named(SensorState(after, now.since(state))) == expected


def _step(rng: np.random.Generator, blocks: Nuisance, known: ByBlock) -> tuple[Nuisance, ByBlock]:
    """One of the ways in which blocks come and go in a solve, and what is known of each block after it."""
    which, hz, std = rng.integers(8), float(rng.uniform(1.0, 90.0)), float(rng.uniform(1e-4, 1e-2))
    if which == 0:
        return blocks.with_tone(hz, 0.1, 3.0), {**known, TONE: [*known.get(TONE, []), *[0.0] * 25]}
    if which == 1:  # near another
        near_hz = (blocks.tones_hz or (hz,))[-1] + 1e-4
        return blocks.with_tone(near_hz, 0.1, 3.0), {**known, TONE: [*known.get(TONE, []), *[0.0] * 25]}
    if which == 2:
        return blocks.without_tones(), {block: own for block, own in known.items() if block != TONE}
    if which == 3:
        late = LATE[rng.integers(len(LATE))]
        return blocks.with_late(late, std), {late: [0.0] * len(NAMES[late]), **known}
    if which == 4:
        made = {MATERIAL: [0.0] * 5} if "incidence" in known else {}
        return blocks.with_materials(5), {**made, **known}
    if which == 5:
        keep = rng.uniform(size=len(known.get(MATERIAL, [0.0]))) < 0.7
        keep[0] = True
        left = {MATERIAL: [value for value, kept in zip(known.get(MATERIAL, []), keep, strict=False) if kept]}
        return blocks.of_planes(keep), {**known, **(left if MATERIAL in known else {})}
    if which == 6:
        return blocks.with_surface(PATCHES, std, 2.0), {SURFACE: [0.0] * 4, **known}
    sensors = Nuisance(EVERY.blocks[int(rng.integers(len(EVERY.blocks))) :])
    others = {block: own for block, own in known.items() if block in ROOM}
    own = {each.block: known.get(each.block, [0.0] * len(each.names)) for each in sensors.blocks}
    return blocks.with_sensors(sensors), {**own, **others}


@pytest.mark.parametrize("seed", range(12))
def test_whatever_comes_and_goes_the_rest_stays(half: Half, seed: int) -> None:
    """Thirty changes of a solve's state in a row, after each of which what came gets a value. Oracle: lists by block, which what
    goes is struck out of and what comes is put into as zeros; no names. What was gathered is of the blocks before, and the room's
    blocks lie after the sensors', in their order.

    Mutations: what is known forgotten; a block beside itself as it was before; materials named anew when planes go; a tone called
    after hundredths of its frequency; tones after the patches; sensors that replace the room's blocks too; points kept.
    """
    rng = np.random.default_rng(seed)
    state: Estimation = replace(half.state, estimate=replace(half.state.estimate, sensors=SensorState()))
    known: ByBlock = {}
    for _ in range(30):
        blocks, known = _step(rng, state.nuisance, known)
        after = state.with_nuisance(blocks)
        sensors = after.estimate.sensors
        assert {each.block: sensors.of(each.block).tolist() for each in blocks.blocks} == known
        rank = [ROOM.index(each.block) if each.block in ROOM else -1 for each in blocks.blocks]
        assert rank == sorted(rank)
        assert after.observations is None
        assert after.minimum is None
        sensors = sensors.moved(np.where(sensors.values == 0.0, rng.normal(size=blocks.size), 0.0))
        known = {each.block: sensors.of(each.block).tolist() for each in blocks.blocks}
        state = replace(after, estimate=replace(after.estimate, sensors=sensors))


def test_two_tones_that_are_near_are_two() -> None:
    """Of an hour's recording a turn is a third of a thousandth of a hertz. Mutation: called after hundredths of a hertz."""
    two = Nuisance().with_tone(11.0031, 1e-4, 0.0).with_tone(11.0042, 1e-4, 0.0)
    values: FloatArray = np.arange(50.0)
    assert SensorState(two, values).onto(two.with_tone(3.0, 1e-4, 0.0)).of(TONE)[:50].tolist() == values.tolist()


def test_what_shakes_from_the_room_does_so_in_any_frame(half: Half) -> None:
    """Oracle: the readings of an ideal IMU, which know no map. Mutations: the map turned without the tones' axes; the other way
    round; the first tone's alone; the sensors' own values turned along."""
    blocks = EVERY.with_tone(1.4, 0.01, 1.0).with_tone(7.0, 0.01, 1.0).with_surface(PATCHES, 0.003, 2.0)
    sensors = SensorState(blocks, 0.1 * np.random.default_rng(0).normal(size=blocks.size) * blocks.prior_std)
    here = replace(half.state.estimate, sensors=sensors)
    there = here.seen_from(exp(np.array([0.4, -1.1, 0.7])), np.array([2.0, -1.0, 0.5]))
    readings = half.data.readings.part(0, half.state.knots)
    one, other = (true_readings(readings, each.sensors, each.states.R) for each in (here, there))
    np.testing.assert_allclose(other.knot_gyro, one.knot_gyro, atol=1e-9)
    np.testing.assert_allclose(other.knot_accel, one.knot_accel, atol=1e-9)
    assert np.abs(one.knot_accel - readings.knot_accel).max() > 1e-3
    for block in blocks.blocks:
        is_same = np.array_equal(there.sensors.of(block.block), sensors.of(block.block))
        assert is_same is (block.block != TONE)


def test_what_does_not_fit_together_is_refused() -> None:
    """Mutations: one value too many let pass; two parameters of one name taken for one."""
    with pytest.raises(ValueError, match="expected 3 values"):
        SensorState(Nuisance((NuisanceBlock("g_sensitivity", ("x", "y", "z"), np.ones(3)),)), np.zeros(4))
    twice = Nuisance((NuisanceBlock(MATERIAL, ("0", "0"), np.ones(2)),))
    with pytest.raises(ValueError, match="two of one name"):
        SensorState().onto(twice)


def test_what_is_not_in_play_is_zero_and_of_the_room_nothing() -> None:
    """Each block of the sensors as long as it is named, so that whoever takes a value need not ask. Mutation: none at all."""
    ideal = SensorState()
    for block, names in NAMES.items():
        assert ideal.of(block).tolist() == [0.0] * len(names)
    assert [len(ideal.of(block)) for block in (MATERIAL, TONE, SURFACE)] == [0, 0, 0]
    assert ideal.clock_rate_ppm() == 0.0
    assert ideal.tones().shape == (0, 25)
    assert not ideal.lasers(3).any()
