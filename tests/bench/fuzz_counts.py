"""How many senseless inputs every run tries, by the door they knock at: what is promised of all together is held to their sum."""

from __future__ import annotations

FILES = 3600
REQUESTS = 1000
SCENE_FRAMES = 400
