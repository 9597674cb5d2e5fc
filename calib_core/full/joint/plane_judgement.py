"""Which planes stay in a solve, or are marked where somebody chose them: asked before the sensors are let go, and near rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.full.joint.alternation import settle
from calib_core.full.joint.doubtful_planes import face_three_ways, plane_doubts, require_three_ways
from calib_core.full.joint.estimation import Estimation, JointData
from calib_core.full.joint.plane_set import drop_planes, mark_planes, only_planes
from calib_core.full.joint.policies import PlaneSet
from calib_core.full.joint.round import associate, coarse_stride, gate_of, gathered
from calib_core.full.joint.schedule import Schedule
from calib_core.full.joint.tones import found_tones, heard_anew
from calib_core.full.planes.plane_tests import Fault, fault_of


def without_clutter(data: JointData, state: Estimation, schedule: Schedule) -> Estimation:
    """Without what is no plane by far: it would draw the sensors' parameters aside, and the motion round after round.

    Where no sensor is let go nothing lays points on planes anew, and all planes are judged next. Planes that were chosen stay,
    and what is wrong with them is noted, as narrow gates will see of a box before a wall what looks like the wall.
    """
    rules = schedule.planes
    if schedule.chosen:
        state = mark_planes(data, state, rules or PlaneSet())
    if rules is None or not data.sensors.blocks:
        return state
    left = drop_planes(data, state, rules, most_share=rules.clutter_share)
    return left if left is state else heard_anew(data, left, schedule.tones, schedule.coarse[-1], schedule.sampling)


def with_strayed_marked(data: JointData, state: Estimation, schedule: Schedule) -> Estimation:
    """A motion that all structure has told, with what did not stand still in it marked.

    A choice of a few planes would follow one that is pushed aside, and find nothing wrong with it.
    """
    last, rules = schedule.coarse[-1], schedule.planes or PlaneSet()
    gate = gate_of(state, last.gate_m, schedule.sampling)
    seen = associate(data, state, gate, stride=coarse_stride(data, state, schedule.sampling))
    doubt = plane_doubts(gathered(data, seen), seen.estimate, rules.rough_m)
    planes = tuple(replace(plane, strayed=bool(row[0] > 1.0)) for plane, row in zip(state.planes, doubt, strict=True))
    return replace(state, planes=planes)


def without_faulty(data: JointData, state: Estimation, schedule: Schedule, *, settled: bool) -> Estimation:
    """Without the planes that are none. settled: as drop_planes has it."""
    assert schedule.planes is not None
    left = drop_planes(data, state, schedule.planes, settled=settled)
    return left if left is state else heard_anew(data, left, schedule.tones, schedule.sensors, schedule.sampling)


def without_doubtful(data: JointData, state: Estimation, schedule: Schedule) -> Estimation:
    """Without what is no plane, unless something shakes the IMU unseen: it would be held against them, and is known later."""
    tones = schedule.tones
    if found_tones(data, state, tones, schedule.sensors, schedule.sampling, least=tones.explains_in_company):
        return state
    return without_faulty(data, state, schedule, settled=True)


def settle_without_doubtful(data: JointData, state: Estimation, schedule: Schedule) -> Estimation:
    """Settled again without what turns out to be no plane, in as many turns as there are."""
    assert schedule.planes is not None
    assert schedule.settling is not None
    for _ in range(schedule.planes.turns):
        left = without_faulty(data, state, schedule, settled=True)
        if left is state:
            break
        state = settle(data, left, schedule.settling, schedule.sampling)
    return state


def with_culprits_marked(data: JointData, state: Estimation, schedule: Schedule) -> Estimation:
    """The same, each chosen plane with what is wrong with it, where what seems sound among them does not hold the motion.

    A motion that a box has bent makes walls seem bent. So the most doubtful goes first and the rest settles without it, until
    nobody is doubtful: those that had to go are the culprits. Raises Refused where the others do not hold three directions.
    """
    assert schedule.settling is not None
    doubt = plane_doubts(gathered(data, state), state.estimate)
    sound = doubt.max(axis=1) <= 1.0
    if sound.all() or face_three_ways(state.estimate.normals[sound]):
        return state
    nearly = replace(schedule.settling, rounds=schedule.tones.settling_rounds)
    faults, left = dict[str, Fault](), state
    while doubt.max() > 1.0:
        worst = int(np.argmax(doubt.max(axis=1)))
        faults[left.planes[worst].name] = fault_of(doubt[worst])
        keep = np.arange(len(doubt)) != worst
        if not face_three_ways(left.estimate.normals[keep]):
            break
        left = settle(data, only_planes(left, keep, doubt[:, 2] < 1.0, PlaneSet()), nearly, schedule.sampling)
        left = replace(left, rounds=state.rounds)  # beside the way to the answer, whose rounds are bounded
        doubt = plane_doubts(gathered(data, left), left.estimate)
    planes = tuple(replace(plane, fault=faults.get(plane.name, "")) for plane in state.planes)
    require_three_ways(planes, [plane.fault for plane in planes], state.estimate.normals)
    return replace(state, planes=planes, iterations=left.iterations)
