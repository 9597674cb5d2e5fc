"""Plane editing: geometry, operations, history. The room of world.py is the oracle: its walls are exact."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from app.errors import BadRequest
from app.planes.geometry import (
    convex_hull,
    fit_plane,
    labels,
    solved_outline,
    spread_of_directions,
    within_outline,
    within_patch,
)
from app.planes.operations import apply, free_name
from app.planes.state import PlaneHistory, PlaneSet, suggested
from app.planes.wire import determinacy, wire_planes
from app.schemas.planes import Confirm, Drop, Foreseen, Grow, Merge, Rename, Restrict, Side, Toggle, UseSuggestion
from calib_core.types import Plane, PlanePatch
from tests.app.support import world

PROPOSALS = world.make_proposals()
START = suggested(PROPOSALS)


def test_a_lone_plane_is_told_as_one_direction_of_three_with_no_figure_beside():
    """Seen: one of the two missing directions was named, beside a figure that no such solve keeps.

    Mutations: one direction named; the figure kept.
    """
    history = PlaneHistory(cache_key="", revision=0, steps=(suggested(PROPOSALS),), cursor=0)
    kept = tuple(
        patch.model_copy(update={"confirmed": place == 0}) for place, patch in enumerate(history.current.patches)
    )
    history = history.push(history.current.model_copy(update={"patches": kept}))
    known = Foreseen(name="Position y", std=0.014, unit="m", limit=0.02, weak=False)
    wire = wire_planes(history, static=True, known=known)
    assert "one direction of three: confirm two more" in wire.determinacy.text
    assert wire.foreseen is None
    full = PlaneHistory(cache_key="", revision=0, steps=(suggested(PROPOSALS),), cursor=0)
    assert wire_planes(full, static=True, known=known).foreseen == known


def edit(planes, operation, grow=lambda *_: None):
    return apply(planes, operation, proposals=PROPOSALS, grow=grow)


def test_confirm_drop_toggle_and_rename_change_one_patch_only():
    """Mutation: _replaced with the wrong slice moves or loses a neighbour."""
    after = edit(START, Drop(op="drop", index=2))
    assert [p.confirmed for p in after.patches] == [True, True, False, True, True, False]
    assert edit(after, Confirm(op="confirm", index=2)) == START
    assert edit(edit(START, Toggle(op="toggle", index=5)), Toggle(op="toggle", index=5)) == START
    named = edit(START, Rename(op="rename", index=1, name="  roof "))
    assert [p.name for p in named.patches] == ["floor", "roof", "east", "west", "north", "south"]


@pytest.mark.parametrize(
    "operation",
    [
        Drop(op="drop", index=6),
        Rename(op="rename", index=0, name="east"),
        Rename(op="rename", index=0, name=" "),
        Merge(op="merge", indices=[1, 1]),
        Merge(op="merge", indices=[0, 2]),
        Grow(op="grow", seed_m=[1, 1, 0]),
    ],
)
def test_what_makes_no_sense_is_refused_in_a_sentence(operation):
    """Mutation: dropping the rms check merges floor and east wall into one plane."""
    with pytest.raises(BadRequest) as refused:
        edit(START, operation)
    assert str(refused.value).endswith(".")


def test_merging_two_halves_of_a_wall_gives_the_wall_back():
    """Oracle: the wall that was cut. Mutation: fitting the first part's points only shrinks area and count."""
    half = PROPOSALS.cloud_m[:, 0] > 0
    split = np.where((PROPOSALS.cloud_patch == 0) & half, 5, PROPOSALS.cloud_patch).astype(np.int16)
    proposals = type(PROPOSALS)(
        PROPOSALS.patches, PROPOSALS.cloud_m, split, PROPOSALS.cloud_intensity, PROPOSALS.reference_scans, static=True
    )
    proposals.cloud_patch[PROPOSALS.cloud_patch == 5] = -1
    merged = apply(suggested(proposals), Merge(op="merge", indices=[0, 5]), proposals=proposals, grow=lambda *_: None)
    whole = merged.patches[0]
    assert len(merged.patches) == 5
    assert (whole.name, whole.members) == ("floor", (0, 5))
    assert whole.n_points == int((PROPOSALS.cloud_patch == 0).sum())
    np.testing.assert_allclose(np.abs(whole.normal), [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose([whole.offset_m, whole.rms_m], [2.0, 0.0], atol=1e-5)
    assert whole.area_m2 == pytest.approx(4 * 3.8 * 2.85, rel=0.05)
    np.testing.assert_array_equal(labels(proposals, merged) == 0, PROPOSALS.cloud_patch == 0)


def test_a_grown_patch_takes_free_points_inside_it_and_a_free_name():
    """Mutation: not restricting labels to unowned points steals the floor's."""
    plane = Plane("floor", np.array([0.0, 0.0, 1.0]), 0.0)
    outline = np.array([(0.5, -1.5, 0.0), (4.1, -1.5, 0.0), (4.1, 1.5, 0.0), (0.5, 1.5, 0.0)])
    found = PlanePatch(plane, outline, 40, 0.01, 1.0)
    after = edit(START, Grow(op="grow", seed_m=[1, 1, 0]), grow=lambda *_: found)
    grown = after.patches[-1]
    assert (grown.name, grown.confirmed, grown.color) == ("floor 2", True, 6)
    owner = labels(PROPOSALS, after)
    cloud = PROPOSALS.cloud_m
    inside = (cloud[:, 0] >= 0.5) & (np.abs(cloud[:, 1]) <= 1.5)
    expected = (np.abs(cloud[:, 2]) <= 0.03) & inside
    np.testing.assert_array_equal(owner == 6, expected & (PROPOSALS.cloud_patch == -1))
    assert (owner == 6).sum() > 5
    assert (expected & (PROPOSALS.cloud_patch == 2)).sum() > 2  # points of the east wall that it must leave alone


def test_growing_on_a_plane_says_whose_point_it_is():
    """Mutations: the refusal's check left out ("not flat enough", of a wall); a dropped patch told as one that is used."""
    seed = PROPOSALS.cloud_m[PROPOSALS.cloud_patch == 2][0].astype(float).tolist()
    name = START.patches[2].name
    with pytest.raises(BadRequest, match=f"on {name} already"):
        edit(START, Grow(op="grow", seed_m=seed), grow=lambda *_: None)
    dropped = edit(START, Drop(op="drop", index=2))
    with pytest.raises(BadRequest, match=f"on {name}, which is dropped"):
        edit(dropped, Grow(op="grow", seed_m=seed), grow=lambda *_: None)


def test_use_suggestion_forgets_every_edit():
    """Mutation: returning the set unchanged."""
    edited = edit(edit(START, Drop(op="drop", index=0)), Rename(op="rename", index=1, name="x"))
    assert edit(edited, UseSuggestion(op="use-suggestion")) == START


@settings(deadline=None)  # a loaded machine is no failure
@given(st.lists(st.sampled_from(["edit", "undo", "redo"]), max_size=40))
def test_history_behaves_like_two_stacks(story):
    """Oracle: two plain lists. Mutation: push() keeping what was undone lets redo bring back a stale set."""
    history = PlaneHistory(cache_key="k", revision=0, steps=(PlaneSet(patches=()),), cursor=0)
    done, undone, number = [0], [], 0
    for step in story:
        before = history.revision
        if step == "edit":
            number += 1
            patch = START.patches[0].model_copy(update={"n_points": number})
            history = history.push(PlaneSet(patches=(patch,)))
            done.append(number)
            undone.clear()
        elif step == "undo" and history.can_undo:
            history = history.moved(-1)
            undone.append(done.pop())
        elif step == "redo" and history.can_redo:
            history = history.moved(+1)
            done.append(undone.pop())
        else:
            continue
        assert history.revision == before + 1
        assert (history.can_undo, history.can_redo) == (len(done) > 1, bool(undone))
        shown = history.current.patches[0].n_points if history.current.patches else 0
        assert shown == done[-1]


@settings(deadline=None)  # a loaded machine is no failure
@given(st.integers(0, 10_000), st.integers(3, 40))
def test_every_point_is_inside_its_convex_hull_and_corners_turn_left(seed, count):
    """Law. Mutation: `>= 0` in the chain's test turns the hull inside out."""
    points = np.random.default_rng(seed).normal(size=(count, 2))
    hull = convex_hull(points)
    for a, b in zip(hull, np.roll(hull, -1, axis=0), strict=True):
        side = (b[0] - a[0]) * (points[:, 1] - a[1]) - (b[1] - a[1]) * (points[:, 0] - a[0])
        assert side.min() > -2e-3  # corners are rounded to a tenth of a millimetre


def test_fit_plane_recovers_a_known_plane_and_refuses_a_line():
    """Oracle: the plane the points were made on. Mutation: taking the largest eigenvector."""
    rng = np.random.default_rng(3)
    n = np.array([2.0, -1.0, 2.0]) / 3.0
    u, v = np.array([1.0, 2.0, 0.0]) / np.sqrt(5), np.cross(n, np.array([1.0, 2.0, 0.0]) / np.sqrt(5))
    points = (
        rng.uniform(-1, 1, (500, 1)) * u
        + rng.uniform(-2, 2, (500, 1)) * v
        - 1.5 * n
        + rng.normal(0, 0.01, (500, 1)) * n
    )
    fitted = fit_plane(points.astype(np.float32))
    np.testing.assert_allclose(fitted.normal, n, atol=3e-3)
    assert fitted.offset_m == pytest.approx(1.5, abs=2e-3)
    assert fitted.rms_m == pytest.approx(0.01, rel=0.15)  # 500 normal deviates: 3 % standard error
    assert fit_plane(np.outer(np.arange(5.0), [1, 2, 3]).astype(np.float32)) is None
    assert fit_plane(points[:2].astype(np.float32)) is None


def test_within_patch_is_the_slab_inside_the_outline():
    """Mutation: forgetting the slab takes the ceiling for the floor."""
    floor = START.patches[0]
    inside = within_patch(PROPOSALS.cloud_m, floor)
    np.testing.assert_array_equal(inside, PROPOSALS.cloud_patch == 0)


def test_determinacy_counts_directions_not_planes():
    """Oracle: eigenvalues by hand: three orthogonal directions give 1/3; two leave 0. Mutation: counting parallels."""
    everything = determinacy(START)
    assert everything.ok
    assert everything.smallest_eigenvalue == pytest.approx(1 / 3)
    floor_and_ceiling = PlaneSet(patches=START.patches[:2])
    assert determinacy(floor_and_ceiling).smallest_eigenvalue == pytest.approx(0.0)
    no_side = determinacy(PlaneSet(patches=START.patches[:4]))
    assert not no_side.ok
    assert "lidar's y axis" in no_side.text
    assert "No plane is confirmed" in determinacy(PlaneSet(patches=())).text
    value, _ = spread_of_directions(np.array([[0, 0, 1.0], [1, 0, 0], [np.cos(0.3), 0, np.sin(0.3)], [0, 1, 0]]))
    scatter = np.diag([1.0, 1, 1]) + np.outer([np.cos(0.3), 0, np.sin(0.3)], [np.cos(0.3), 0, np.sin(0.3)])
    assert value == pytest.approx(np.linalg.eigvalsh(scatter)[0] / 4)


def test_free_names():
    """Mutation: returning the wanted name unchecked."""
    assert free_name(["a", "a 2"], "a") == "a 3"
    assert free_name([], "a") == "a"


def upright_box(low, high):
    """Six half-spaces that keep what lies between two corners."""
    eye = np.eye(3)
    lower = [Side(normal=list(eye[k]), offset_m=-low[k]) for k in range(3)]
    upper = [Side(normal=list(-eye[k]), offset_m=high[k]) for k in range(3)]
    return [*lower, *upper]


def test_a_box_leaves_out_what_is_outside():
    """Oracle: the same comparison of coordinates with two corners. Planes not cut stay bit for bit as they were.

    Mutation: `<=` for `>=` in within_region keeps the outside; fitting to all points of the patch keeps the area.
    """
    low, high = (-10.0, -10.0, -10.0), (10.0, 10.0, 1.0)  # below one metre: the ceiling goes, the walls are cut
    after = edit(START, Restrict(op="restrict", sides=upright_box(low, high)))
    kept = PROPOSALS.cloud_m[:, 2] <= 1.0
    names = [patch.name for patch in after.patches]
    assert names == [patch.name for patch in START.patches if patch.name != "ceiling"]
    assert after.patches[0] == START.patches[0]
    owner = labels(PROPOSALS, after)
    for place, name in enumerate(names):
        before = next(k for k, patch in enumerate(START.patches) if patch.name == name)
        expected = (PROPOSALS.cloud_patch == before) & kept
        np.testing.assert_array_equal(owner == place, expected)
        assert after.patches[place].n_points == expected.sum()
    wall = next(patch for patch in after.patches if patch.name == "east")
    assert np.array(wall.outline_m)[:, 2].max() <= 1.0
    np.testing.assert_allclose(np.abs(wall.normal), [1, 0, 0], atol=1e-6)


def test_a_box_of_one_plane_leaves_the_others_alone():
    """Mutation: the half-spaces put on the set cut every wall."""
    east = next(k for k, patch in enumerate(START.patches) if patch.name == "east")
    after = edit(START, Restrict(op="restrict", index=east, sides=[Side(normal=[0, 2, 0], offset_m=0.0)]))
    assert [patch for k, patch in enumerate(after.patches) if k != east] == [
        patch for k, patch in enumerate(START.patches) if k != east
    ]
    assert after.patches[east].region == ((0.0, 1.0, 0.0, 0.0),)
    expected = (PROPOSALS.cloud_patch == east) & (PROPOSALS.cloud_m[:, 1] >= 0)
    np.testing.assert_array_equal(labels(PROPOSALS, after) == east, expected)
    # A second box adds to the first.
    corner = edit(after, Restrict(op="restrict", index=east, sides=[Side(normal=[0, 0, 1], offset_m=0.0)]))
    both = expected & (PROPOSALS.cloud_m[:, 2] >= 0)
    np.testing.assert_array_equal(labels(PROPOSALS, corner) == east, both)


@pytest.mark.parametrize(
    "operation",
    [
        Restrict(op="restrict", sides=[Side(normal=[0, 0, 1], offset_m=-50.0)]),
        Restrict(op="restrict", index=0, sides=[Side(normal=[0, 0, 1], offset_m=-50.0)]),
        Restrict(op="restrict", index=9, sides=[Side(normal=[0, 0, 1], offset_m=0.0)]),
        Restrict(op="restrict", sides=[Side(normal=[0, 0, 0], offset_m=0.0)]),
    ],
)
def test_an_empty_box_is_refused(operation):
    """Mutation: an empty set returned in silence leaves nothing to solve with."""
    with pytest.raises(BadRequest) as refused:
        edit(START, operation)
    assert str(refused.value).endswith(".")


def test_boxes_do_not_add_up_for_ever():
    """Mutation: no limit; every click would ask every point about hundreds of half-spaces."""
    box = Restrict(op="restrict", sides=upright_box((-9, -9, -9), (9, 9, 9)))
    planes = START
    for _ in range(8):
        planes = edit(planes, box)
    with pytest.raises(BadRequest, match="boxes"):
        edit(planes, box)


def test_growing_sees_free_points_inside_the_box_only():
    """What a box has set free can grow again, what is outside cannot. Mutation: proposals handed on as they are."""
    seen = []

    def grow(proposals, _):
        seen.append(proposals)

    after = edit(START, Restrict(op="restrict", sides=[Side(normal=[0, 0, -1], offset_m=1.0)]))
    with pytest.raises(BadRequest):
        edit(after, Grow(op="grow", seed_m=[1, 1, 0]), grow=grow)
    (offered,) = seen
    assert offered.cloud_m[:, 2].max() <= 1.0
    assert len(offered.cloud_m) == len(offered.cloud_patch) == len(offered.cloud_intensity)
    assert offered.cloud_patch.max() == len(after.patches) - 1


def test_what_a_box_has_set_free_belongs_to_the_patch_grown_there_and_merging_gives_the_wall_back():
    """Oracle: the wall that was cut. Mutation: boxes taken off after grown patches have taken leave these without points."""
    east = next(k for k, patch in enumerate(START.patches) if patch.name == "east")
    whole = START.patches[east]
    cut = edit(START, Restrict(op="restrict", index=east, sides=[Side(normal=[0, 1, 0], offset_m=0.0)]))
    wall = PROPOSALS.cloud_patch == east
    free = wall & (PROPOSALS.cloud_m[:, 1] < 0)
    fitted = fit_plane(PROPOSALS.cloud_m[free])
    found = PlanePatch(Plane("x", fitted.normal, fitted.offset_m), fitted.outline_m, int(free.sum()), 0.01, 1.0)
    grown = edit(cut, Grow(op="grow", seed_m=PROPOSALS.cloud_m[free][0].tolist()), grow=lambda *_: found)
    owner = labels(PROPOSALS, grown)
    np.testing.assert_array_equal(owner == len(START.patches), free)
    np.testing.assert_array_equal(owner == east, wall & ~free)
    merged = edit(grown, Merge(op="merge", indices=[east, len(START.patches)])).patches[east]
    assert merged.n_points == whole.n_points
    assert merged.area_m2 == pytest.approx(fit_plane(PROPOSALS.cloud_m[wall]).area_m2)


@settings(deadline=None)
@given(st.integers(0, 10_000))
def test_the_hull_of_many_points_is_the_hull_of_their_outer_ones(seed):
    """Oracle: SciPy's hull. Mutation: `>=` in _without_inner throws the corners away."""
    points = np.random.default_rng(seed).normal(size=(300, 2)).round(4)
    expected = points[ConvexHull(points).vertices]
    found = convex_hull(points)
    assert {tuple(p) for p in found.tolist()} == {tuple(p) for p in expected.tolist()}


@settings(deadline=None)
@given(st.integers(0, 10_000))
def test_the_outline_of_a_box_holds_the_points_of_the_plane_in_the_box(seed):
    """Oracle: random points of the plane, each asked about every half-space, those of the set and the patch's own.

    Mutations: the patch's boxes or the set's left out; the part below the cut kept; corners cut at the wrong share.
    """
    rng = np.random.default_rng(seed)
    east = next(patch for patch in START.patches if patch.name == "east")
    middle = np.array([4.0, *rng.uniform(-1.5, 1.5, 2)])
    normals = rng.normal(size=(5, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    sides = [(*n, float(rng.uniform(0.3, 2.0) - n @ middle)) for n in normals.tolist()]
    corners = solved_outline(east.model_copy(update={"region": tuple(sides[:3])}), tuple(sides[3:]))
    np.testing.assert_allclose(corners[:, 0], 4.0, atol=1e-9)
    near, far = rng.uniform(-2.5, 2.5, (400, 2)), rng.uniform(-99.0, 99.0, (400, 2))
    points = np.column_stack([np.full(800, 4.0), np.concatenate([near, far])])
    height = np.min(points @ normals.T + np.array([side[3] for side in sides]), axis=1)
    clear = np.abs(height) > 5e-3  # corners count a millimetre wider
    found = within_outline(points.astype(np.float32), np.array(east.normal), corners)
    np.testing.assert_array_equal(found[clear], (height > 0)[clear])
    assert found.any()


def test_a_plane_that_no_box_cuts_has_no_outline_and_one_whose_cut_is_empty_keeps_what_was_seen():
    """Mutations: an outline of a hundred metres for every plane; no corners, which would leave a solve nothing."""
    floor = START.patches[0]
    assert solved_outline(floor, ()) is None
    assert solved_outline(floor, ((0.0, 0.0, -1.0, 1.0),)) is None
    missed = solved_outline(floor, ((0.0, 0.0, 1.0, 1.9),))
    np.testing.assert_array_equal(missed, floor.outline_m)
