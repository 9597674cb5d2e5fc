"""What grows with recordings: which runs are held against one another, and the rooms of many planes."""

from __future__ import annotations

import numpy as np
import pytest

from bench.growth import Grown, metrics_of, never_again, page, room_of
from bench.metrics import slips
from bench.passes import Cost, Spent
from calib_core.simulate import SCENARIOS


def run(of, size, cpu_s, pass_s, memory_mb=500.0, mode="ideal"):
    return Grown(of, size, 6, 10**6, Spent(2.0 * pass_s, pass_s), Cost({}, cpu_s / 2, 3, memory_mb, cpu_s), mode)


def test_the_largest_is_held_against_the_smallest_in_passes_of_its_own():
    """By hand. Mutations: seconds in place of passes; the pass by the clock; kinds mixed; lasers' or planes' MB judged."""
    runs = [
        run("length", 10.0, 5.0, 0.1),
        run("length", 60.0, 15.0, 0.5, 600.0),
        run("planes", 3, 2.0, 0.2),
        run("planes", 30, 8.0, 0.2),
    ]
    metrics = {metric.key: metric for metric in metrics_of(runs)}
    assert metrics["growth.length_60_over_10"].value == pytest.approx(30.0 / 50.0)
    assert metrics["growth.planes_30_over_3"].value == pytest.approx(4.0)
    assert metrics["growth.planes_30_mb"].value == 500.0
    assert [key for key, metric in metrics.items() if metric.is_judged()] == [
        "growth.length_60_over_10",
        "growth.planes_30_over_3",
        "growth.ideal_60_mb",
    ]
    slower = metrics_of([runs[0], run("length", 60.0, 45.0, 0.5), *runs[2:]])
    assert [slip.key for slip in slips(slower, metrics)] == ["growth.length_60_over_10"]


def test_ten_minutes_and_half_an_hour_are_held_against_the_minute_and_what_is_asked():
    """By hand, each mode by itself: 12 times the minute where 11 are asked, 30 where 33 are; 2.4 GB where 1.2 are.

    Mutations: modes mixed; held against ten seconds; half an hour's aim asked of ten minutes; memory that is not judged.
    """
    runs = [run("length", 10.0, 5.0, 0.1)]
    for mode, cpu_s, times, most_mb in (("ideal", 15.0, 10.0, 650.0), ("default", 20.0, 12.0, 2400.0)):
        runs.append(run("length", 60.0, cpu_s, 0.5, 600.0, mode))
        runs.append(run("length", 600.0, times * cpu_s, 5.0, most_mb, mode))
    runs.append(run("length", 1800.0, 450.0, 15.0, 1700.0))
    metrics = {metric.key: metric for metric in metrics_of(runs)}
    assert metrics["growth.default_600_over_60"].value == pytest.approx(12.0)
    assert metrics["growth.ideal_600_over_60"].value == pytest.approx(10.0)
    assert metrics["growth.ideal_1800_over_60"].value == pytest.approx(30.0)
    over = [metric.key for metric in metrics.values() if metric.is_over()]
    assert over == ["growth.ideal_1800_mb", "growth.default_600_over_60", "growth.default_600_mb"]
    assert slips(metrics.values(), metrics) == []
    more = metrics["growth.ideal_600_mb"].model_copy(update={"value": 850.0})
    assert [slip.key for slip in slips([*metrics.values(), more], metrics)] == [more.key]
    assert metrics["growth.length_60_over_10"].value == pytest.approx(0.6)
    assert "growth.default_60_over_10" not in metrics


def test_the_page_has_a_row_for_each_and_a_table_for_each_kind():
    """By hand. Mutations: CPU in the column of what was waited; the default in ideal sensors' table; no word on when it was."""
    text = page(
        [
            run("length", 10.0, 5.0, 0.1),
            run("length", 600.0, 9.0, 0.1, 2400.0, "default"),
            run("lasers", 128, 8.0, 0.4),
        ],
        "Measured on a day.",
    )
    ideal, _, default = text.partition("| s, default | planes used |")
    assert "| 10 | 6 | 1.0 | 0.20 | 2.5 | 12 | 5.0 | 50 | 500 |" in ideal
    assert "| 600 |" not in ideal
    assert "| 600 | 6 | 1.0 | 0.20 | 4.5 | 22 | 9.0 | 90 | 2400 |" in default
    assert "| lasers | planes used |" in text
    assert "| default_600_mb | 2400 MB | 1200 | **no** |" in text
    assert "Measured on a day." in text


def test_a_long_recording_does_not_come_back_to_where_it_was():
    """Seen: ten minutes whose motion came again after 100 s, whose lag of 200 s was as good a match, took a third longer.

    Oracle: poses 100 s and 200 s apart. Mutation: the tempos as they are.
    """
    plain = SCENARIOS["handheld"].motion
    t_ns = np.arange(20 * 10**9, 40 * 10**9, 10**8)
    for motion, apart in ((plain, False), (never_again(plain), True)):
        for later_ns in (100 * 10**9, 200 * 10**9):
            now, then = motion.kinematics(t_ns), motion.kinematics(t_ns + later_ns)
            assert (np.abs(now.p_m - then.p_m).max() > 0.05) == apart


@pytest.mark.parametrize("planes", [3, 6, 12, 30])
def test_a_room_of_so_many_planes_has_them_all_about_the_rig(planes):
    """Each faces wherever the rig comes, no two are one, and walls stand from floor to ceiling, end to end.

    Oracle: the motion itself and the outlines' own corners. Mutations: walls that look outwards; a polygon of one radius, whose
    walls are a cylinder's.
    """
    scene = room_of(planes)
    assert len(scene.faces) == planes
    normals = np.array([face.unit_normal for face in scene.faces])
    offsets_m = np.array([face.offset_m for face in scene.faces])
    kinematics = SCENARIOS["handheld"].motion.kinematics(np.arange(0, 20 * 10**9, 10**8))
    assert ((kinematics.p_m @ normals.T + offsets_m) > 0.2).all()
    walls = [face for face in scene.faces if face.outline_m]
    assert len(walls) in {0, planes - 2}
    for one, other in zip(walls, [*walls[1:], *walls[:1]], strict=True):
        assert one.outline_m[1] == other.outline_m[0]
        assert {corner[2] for corner in one.outline_m} == {0.0, 2.7}
        np.testing.assert_allclose(np.array(one.outline_m) @ one.unit_normal + one.offset_m, 0.0, atol=1e-12)
        if planes > 6:
            assert np.degrees(np.arccos(one.unit_normal @ other.unit_normal)) > 15.0
