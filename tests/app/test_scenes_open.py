"""Which scenes stay open: who is counted where, and who goes first."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from app.scene.open_scenes import OpenScene, OpenScenes


def scene():
    stops = SimpleNamespace(stop=lambda: None)
    return OpenScene(SimpleNamespace(close=lambda: None), used_at_s=0.0, live=stops, cut=stops)


def test_who_leaves_a_closed_scene_is_not_missed_in_the_next():
    """Two look, the scene is closed for another's room, one comes back, and only then the other's old connection ends. Mutation:
    counts by the recording's name: nobody looked, and the scene was closed in the middle of a look."""
    scenes = OpenScenes(at_most=1, idle_s=10.0)
    first, _ = scenes.opened("a", scene)
    for _ in range(2):
        scenes.watcher_came(first, +1)
    scenes.make_room("b")
    assert scenes.find("a") is None
    again, made = scenes.opened("a", scene)
    scenes.watcher_came(again, +1)
    scenes.watcher_came(first, -1)
    assert (made, scenes.watchers("a"), scenes.count()) == (True, 1, (1, 1))
    again.used_at_s = -1e9
    scenes.close_idle(0.0)
    assert scenes.find("a") is again


@pytest.mark.parametrize(
    ("watched", "used_at_s", "gone"),
    [
        ("a", {"a": 1.0, "b": 2.0, "c": 3.0}, "b"),
        ("", {"a": 3.0, "b": 1.0, "c": 2.0}, "b"),
        ("abc", {"a": 2.0, "b": 3.0, "c": 1.0}, "c"),
        ("ab", {"a": 1.0, "b": 2.0, "c": 3.0}, "c"),
    ],
)
def test_what_nobody_watches_goes_first_then_what_is_longest_out_of_use(watched, used_at_s, gone):
    """Oracle: the rule by hand. Mutations: watched ones gone like others; the one last in use gone; none gone where all are
    watched."""
    scenes = OpenScenes(at_most=len(used_at_s), idle_s=10.0)
    for name, used_s in used_at_s.items():
        made, _ = scenes.opened(name, scene)
        scenes.watcher_came(made, +1 if name in watched else 0)
        made.used_at_s = used_s
    scenes.make_room("d")
    assert [name for name in used_at_s if scenes.find(name) is None] == [gone]
